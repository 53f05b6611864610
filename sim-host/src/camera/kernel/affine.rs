//! Functions of columns and rows, in single precision.

use super::{COLUMNS, ROWS};

/// Columns and rows from a tile's first pixel to its middle.
const TILE_MIDDLE: [f64; 2] = [0.5 * (COLUMNS - 1) as f64, 0.5 * (ROWS - 1) as f64];

/// Bound of what twenty operations in `f32` lose of the greatest number among them.
const ROUNDING: f64 = 2e-6;

/// `base + column · per_column + row · per_row`.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::camera) struct Affine {
    pub(super) base: f32,
    pub(super) per_column: f32,
    pub(super) per_row: f32,
    /// What it is in the middle of the first tile.
    middle: f32,
    /// By how much a pixel of a tile may differ from its middle, rounding included.
    reach: f32,
}

/// Constant, column, row, column², column · row, row².
#[derive(Clone, Copy, Debug)]
pub(in crate::camera) struct Quadratic([f32; 6]);

impl Affine {
    /// For an image that has no more columns and rows than `size`.
    #[inline(always)]
    pub(in crate::camera) fn new(base: f64, per_column: f64, per_row: f64, size: [f64; 2]) -> Self {
        let [across, down] = [per_column, per_row].map(f64::abs);
        let most = base.abs() + size[0] * across + size[1] * down;
        Self {
            base: base as f32,
            per_column: per_column as f32,
            per_row: per_row as f32,
            middle: (base + TILE_MIDDLE[0] * per_column + TILE_MIDDLE[1] * per_row) as f32,
            reach: (TILE_MIDDLE[0] * across + TILE_MIDDLE[1] * down + ROUNDING * most) as f32,
        }
    }

    /// Bounds of what it is in the tile that begins at a column and row.
    #[inline(always)]
    pub(super) fn range(&self, [column, row]: [f32; 2]) -> [f32; 2] {
        let middle = self.middle + column * self.per_column + row * self.per_row;
        [middle - self.reach, middle + self.reach]
    }
}

impl Quadratic {
    pub(in crate::camera) fn new(terms: [f64; 6]) -> Self {
        Self(terms.map(|term| term as f32))
    }

    /// In a row: constant, column, column².
    #[inline(always)]
    pub(super) fn in_row(&self, row: f32) -> [f32; 3] {
        let [one, column, of_row, column_squared, both, row_squared] = self.0;
        [one + row * (of_row + row * row_squared), column + row * both, column_squared]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::{Purpose, Seed, Stream};

    /// A plane that is left out of a tile by its bounds must not be missed in any pixel.
    #[test]
    fn no_pixel_of_a_tile_is_beyond_its_bounds() {
        let mut stream = Stream::new(Seed(1), 0, Purpose::Baseline);
        for _ in 0..2000 {
            let mut term = || f64::from(stream.between(-1.0, 1.0)) * f64::from(stream.between(-20.0, 20.0)).exp2();
            let affine = Affine::new(term(), term(), term(), [640.0, 480.0]);
            for place in [[0.0, 0.0], [320.0, 232.0], [624.0, 472.0]] {
                let [low, high] = affine.range(place);
                for column in 0..COLUMNS {
                    // As `Strip::visit` has it.
                    let first = affine.base + place[1] * affine.per_row;
                    let mut value = first + (place[0] + column as f32) * affine.per_column;
                    for _ in 0..ROWS {
                        assert!(
                            low <= value && value <= high,
                            "{value} in {low} to {high}: {affine:?} at {place:?}"
                        );
                        value += affine.per_row;
                    }
                }
            }
        }
    }
}
