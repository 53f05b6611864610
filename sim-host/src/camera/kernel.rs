//! Bodies onto pixels, tile by tile.

mod affine;
mod facet;
mod outline;

use pulp::Simd;

pub(super) use affine::{Affine, Quadratic};
pub(super) use facet::{Corner, Facet};
use outline::Outline;

use super::Camera;
use super::scene::Surface;

/// Columns of a tile: what is worked on at once.
pub(super) const COLUMNS: usize = 16;

/// Rows of a tile.
pub(super) const ROWS: usize = 8;

const COLUMN: [f32; COLUMNS] =
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

/// The side of a cylinder, or a sphere: inverse depths are `middle ± √spread`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Side {
    pub(super) middle: Affine,
    pub(super) spread: Quadratic,
    /// Whether the eye is outside of the endless cylinder; then rays enter and leave, else they only leave.
    pub(super) from_outside: bool,
    pub(super) surface: Surface,
}

/// How a body is drawn.
#[derive(Clone, Debug)]
pub(super) struct Plot {
    /// Columns and rows of tiles, from the first to one past the last.
    pub(super) tiles: [[usize; 2]; 2],
    /// Greatest inverse depth that any of it has \[1/m\].
    pub(super) nearest: f32,
    pub(super) figure: Figure,
}

/// What is drawn: parts of the canvas's lists, each from its first to one past its last.
#[derive(Clone, Debug)]
pub(super) enum Figure {
    /// A convex body by its planes, those that face the eye and those that do not.
    Convex { entered: [usize; 2], left: [usize; 2], side: Option<Side> },
    /// A mesh by its triangles.
    Facets([usize; 2]),
}

/// A plane as an image sees it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Plane {
    pub(super) inverse: Affine,
    pub(super) surface: Surface,
}

/// What is nearest so far in a tile of pixels.
#[derive(Clone, Debug)]
pub(super) struct Tile {
    /// \[1/m\].
    pub(super) inverses: [[f32; COLUMNS]; ROWS],
    pub(super) surfaces: [[Surface; COLUMNS]; ROWS],
    /// The least of the inverse depths: what is nowhere nearer is hidden.
    farthest: f32,
}

/// Memory in which images are drawn.
#[derive(Clone, Debug, Default)]
pub struct Canvas {
    /// Tiles of a row.
    pub(super) across: usize,
    /// Greatest inverse depth that is seen \[1/m\].
    pub(super) limit: f32,
    pub(super) tiles: Vec<Tile>,
    pub(super) plots: Vec<Plot>,
    pub(super) planes: Vec<Plane>,
    pub(super) facets: Vec<Facet>,
    /// Of the mesh that is looked at.
    pub(super) corners: Vec<Corner>,
    /// What matters of the body that is drawn in the tile that is drawn.
    kept: Vec<Plane>,
}

impl Canvas {
    /// Nothing anywhere that a camera sees.
    pub(super) fn clear(&mut self, camera: &Camera) {
        let farthest = (1.0 / camera.far_m) as f32;
        self.limit = (1.0 / camera.near_m) as f32;
        self.across = camera.columns.div_ceil(COLUMNS);
        let empty = Tile { inverses: [[farthest; COLUMNS]; ROWS], surfaces: [[0; COLUMNS]; ROWS], farthest };
        self.tiles.clear();
        self.tiles.resize(self.across * camera.rows.div_ceil(ROWS), empty);
        self.plots.clear();
        self.planes.clear();
        self.facets.clear();
    }

    /// Draws all plots, the nearest first, where they are nearer than what is there.
    #[inline(always)]
    pub(super) fn draw<S: Simd>(&mut self, simd: S) {
        let Self { across, limit, tiles, plots, planes, facets, kept, .. } = self;
        plots.sort_unstable_by(|one, other| other.nearest.total_cmp(&one.nearest));
        for Plot { tiles: area, nearest, figure } in &*plots {
            match figure {
                Figure::Convex { entered, left, side } => {
                    let [entered, left] = [entered, left].map(|[first, end]| &planes[*first..*end]);
                    let outline = Outline { entered, left, side: side.as_ref(), limit: *limit };
                    kept.resize(kept.len().max(entered.len() + left.len() + 1), Plane::default());
                    let draw = |tile: &mut Tile, place: [f32; 2]| {
                        if let Some(outline) = outline.in_tile(place, tile.farthest, kept) {
                            tile.draw(simd, place, &outline);
                        }
                    };
                    each_behind(tiles, *across, area, *nearest, draw);
                }
                Figure::Facets([first, end]) => {
                    for facet in &facets[*first..*end] {
                        let draw = |tile: &mut Tile, place: [f32; 2]| tile.draw_facet(simd, place, facet, *limit);
                        each_behind(tiles, *across, &facet.tiles, facet.range[1], draw);
                    }
                }
            }
        }
    }
}

/// Calls back for each tile of an area in which something is farther, with the column and row of its first pixel.
#[inline(always)]
fn each_behind(
    tiles: &mut [Tile],
    across: usize,
    [[first, end], [top, bottom]]: &[[usize; 2]; 2],
    nearest: f32,
    mut draw: impl FnMut(&mut Tile, [f32; 2]),
) {
    for row in *top..*bottom {
        for column in *first..*end {
            let tile = &mut tiles[row * across + column];
            if nearest > tile.farthest {
                draw(tile, [(column * COLUMNS) as f32, (row * ROWS) as f32]);
            }
        }
    }
}

impl Tile {
    /// Draws what is nearer, some columns at a time.
    #[inline(always)]
    fn draw<S: Simd>(&mut self, simd: S, [column, row]: [f32; 2], body: &Outline<'_>) {
        let mut changed = false;
        for part in 0..COLUMNS / S::F32_LANES {
            let columns = simd.add_f32s(simd.splat_f32s(column), S::as_simd_f32s(&COLUMN).0[part]);
            let strip = Strip { simd, columns, row };
            let mut enter = [simd.splat_f32s(f32::INFINITY); ROWS];
            let mut leave = [simd.splat_f32s(0.0); ROWS];
            for plane in body.entered {
                strip.visit(&plane.inverse, |line, value| enter[line] = simd.min_f32s(enter[line], value));
            }
            for plane in body.left {
                strip.visit(&plane.inverse, |line, value| leave[line] = simd.max_f32s(leave[line], value));
            }
            if let Some(side) = body.side {
                strip.clip(side, &mut enter, &mut leave);
            }
            if self.see::<S>(simd, part, body.limit, &mut enter, &leave) {
                changed = true;
                self.name::<S>(&strip, part, body, &enter);
            }
        }
        if changed {
            self.settle(simd);
        }
    }

    /// Finds out how far away the farthest is.
    #[inline(always)]
    fn settle<S: Simd>(&mut self, simd: S) {
        let all = S::as_simd_f32s(self.inverses.as_flattened()).0;
        let least = all.iter().fold(all[0], |least, inverse| simd.min_f32s(least, *inverse));
        self.farthest = simd.reduce_min_f32s(least);
    }

    /// Keeps what is nearer; of `enter` it leaves that alone. Whether there is any.
    #[inline(always)]
    fn see<S: Simd>(
        &mut self,
        simd: S,
        part: usize,
        limit: f32,
        enter: &mut [S::f32s; ROWS],
        leave: &[S::f32s; ROWS],
    ) -> bool {
        let mut any = simd.less_than_f32s(simd.splat_f32s(0.0), simd.splat_f32s(0.0));
        for line in 0..ROWS {
            let old = &mut S::as_mut_simd_f32s(&mut self.inverses[line]).0[part];
            let inside = simd.and_m32s(
                simd.less_than_or_equal_f32s(leave[line], enter[line]),
                simd.less_than_or_equal_f32s(enter[line], simd.splat_f32s(limit)),
            );
            let seen = simd.and_m32s(inside, simd.less_than_f32s(*old, enter[line]));
            *old = simd.select_f32s(seen, enter[line], *old);
            // No surface is there.
            enter[line] = simd.select_f32s(seen, enter[line], simd.splat_f32s(f32::NEG_INFINITY));
            any = simd.or_m32s(any, seen);
        }
        simd.first_true_m32s(any) < S::F32_LANES
    }

    /// Finds out which surface each is that is seen; where two planes are one, the first.
    #[inline(always)]
    fn name<S: Simd>(&mut self, strip: &Strip<S>, part: usize, body: &Outline<'_>, seen: &[S::f32s; ROWS]) {
        let simd = strip.simd;
        let surfaces = &mut self.surfaces;
        let mut name = |line: usize, value: S::f32s, surface: Surface| {
            let old = &mut S::as_mut_simd_u32s(&mut surfaces[line]).0[part];
            *old = simd.select_u32s(simd.equal_f32s(value, seen[line]), simd.splat_u32s(surface), *old);
        };
        if let Some(side) = body.side.filter(|side| side.from_outside) {
            strip.roots(side, |line, middle, root, _| name(line, simd.add_f32s(middle, root), side.surface));
        }
        for plane in body.entered.iter().rev() {
            strip.visit(&plane.inverse, |line, value| name(line, value, plane.surface));
        }
    }
}

/// Some columns of a tile.
struct Strip<S: Simd> {
    simd: S,
    columns: S::f32s,
    /// The first.
    row: f32,
}

impl<S: Simd> Strip<S> {
    /// What a plane has in each row.
    #[inline(always)]
    fn visit(&self, inverse: &Affine, mut visit: impl FnMut(usize, S::f32s)) {
        let simd = self.simd;
        let first = simd.splat_f32s(inverse.base + self.row * inverse.per_row);
        let mut value = simd.add_f32s(first, simd.mul_f32s(self.columns, simd.splat_f32s(inverse.per_column)));
        let down = simd.splat_f32s(inverse.per_row);
        for line in 0..ROWS {
            visit(line, value);
            value = simd.add_f32s(value, down);
        }
    }

    /// The middle, the root of the spread, and where that has none.
    #[inline(always)]
    fn roots(&self, side: &Side, mut visit: impl FnMut(usize, S::f32s, S::f32s, S::m32s)) {
        let (simd, columns) = (self.simd, self.columns);
        let zero = simd.splat_f32s(0.0);
        for line in 0..ROWS {
            let row = self.row + line as f32;
            let base = simd.splat_f32s(side.middle.base + row * side.middle.per_row);
            let [one, of_column, column_squared] = side.spread.in_row(row);
            let along = simd.mul_f32s(columns, simd.splat_f32s(side.middle.per_column));
            let inner =
                simd.add_f32s(simd.splat_f32s(of_column), simd.mul_f32s(columns, simd.splat_f32s(column_squared)));
            let spread = simd.add_f32s(simd.splat_f32s(one), simd.mul_f32s(columns, inner));
            let misses = simd.less_than_f32s(spread, zero);
            let root = simd.sqrt_f32s(simd.max_f32s(spread, zero));
            visit(line, simd.add_f32s(base, along), root, misses);
        }
    }

    /// Leaves of each ray what is inside the endless cylinder or the sphere.
    #[inline(always)]
    fn clip(&self, side: &Side, enter: &mut [S::f32s; ROWS], leave: &mut [S::f32s; ROWS]) {
        let simd = self.simd;
        self.roots(side, |line, middle, root, misses| {
            let far = if side.from_outside {
                enter[line] = simd.min_f32s(enter[line], simd.add_f32s(middle, root));
                // A ray beside the cylinder leaves it before it enters.
                simd.select_f32s(misses, simd.splat_f32s(f32::INFINITY), simd.sub_f32s(middle, root))
            } else {
                simd.add_f32s(middle, root)
            };
            leave[line] = simd.max_f32s(leave[line], far);
        });
    }
}
