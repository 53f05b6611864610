//! Bodies onto pixels, in lanes.

use pulp::{Arch, Simd, WithSimd};

use super::Camera;
use super::scene::Surface;

/// Pixels that are drawn at once; rows are padded to a multiple of it.
const LANES: usize = 16;

/// `base + column · per_column + row · per_row`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Affine {
    base: f32,
    per_column: f32,
    per_row: f32,
}

/// Constant, column, row, column², column · row, row².
#[derive(Clone, Copy, Debug)]
pub(super) struct Quadratic([f32; 6]);

/// The side of a cylinder: inverse depths are `middle ± √spread`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Side {
    pub(super) middle: Affine,
    pub(super) spread: Quadratic,
    /// Whether the eye is outside of the endless cylinder; then rays enter and leave, else they only leave.
    pub(super) from_outside: bool,
    pub(super) surface: Surface,
}

/// How a body is drawn.
#[derive(Clone, Debug, Default)]
pub(super) struct Plot {
    /// Columns and rows, from the first to one past the last.
    pub(super) area: [[usize; 2]; 2],
    /// Planes that face the eye.
    pub(super) entered: Vec<(Affine, Surface)>,
    /// Planes that do not.
    pub(super) left: Vec<Affine>,
    pub(super) side: Option<Side>,
    /// Greatest inverse depth that is seen \[1/m\].
    pub(super) nearest: f32,
}

/// What is nearest so far in each pixel.
#[derive(Clone, Debug, Default)]
pub struct Canvas {
    columns: usize,
    /// Columns with those that pad a row.
    stride: usize,
    /// \[1/m\].
    inverses: Vec<f32>,
    surfaces: Vec<Surface>,
    /// What is drawn next.
    pub(super) plot: Plot,
}

impl Affine {
    pub(super) fn new(base: f64, per_column: f64, per_row: f64) -> Self {
        Self { base: base as f32, per_column: per_column as f32, per_row: per_row as f32 }
    }

    /// At the beginning of a row.
    #[inline(always)]
    fn in_row(&self, row: f32) -> f32 {
        self.base + row * self.per_row
    }
}

impl Quadratic {
    pub(super) fn new(terms: [f64; 6]) -> Self {
        Self(terms.map(|term| term as f32))
    }

    /// In a row: constant, column, column².
    #[inline(always)]
    fn in_row(&self, row: f32) -> [f32; 3] {
        let [one, column, of_row, column_squared, both, row_squared] = self.0;
        [one + row * (of_row + row * row_squared), column + row * both, column_squared]
    }
}

impl Plot {
    /// Of a body without any surface, all over the image.
    pub(super) fn begin(&mut self, camera: &Camera) {
        self.area = [[0, camera.columns], [0, camera.rows]];
        self.entered.clear();
        self.left.clear();
        self.side = None;
        self.nearest = (1.0 / camera.near_m) as f32;
    }
}

impl Canvas {
    /// Nothing anywhere, as far as inverse depths of at least `farthest` \[1/m\].
    pub(super) fn clear(&mut self, columns: usize, rows: usize, farthest: f32) {
        (self.columns, self.stride) = (columns, columns.next_multiple_of(LANES));
        self.inverses.clear();
        self.inverses.resize(self.stride * rows, farthest);
        self.surfaces.clear();
        self.surfaces.resize(self.stride * rows, 0);
    }

    /// Inverse depths \[1/m\] and surfaces of a row.
    pub(super) fn row(&self, row: usize) -> (&[f32], &[Surface]) {
        let place = row * self.stride..row * self.stride + self.columns;
        (&self.inverses[place.clone()], &self.surfaces[place])
    }

    /// Draws the plot where it is nearer than what is there, with the best instructions of the processor.
    pub(super) fn draw(&mut self) {
        let Self { stride, inverses, surfaces, plot, .. } = self;
        Arch::new().dispatch(Draw { stride: *stride, inverses, surfaces, plot });
    }
}

struct Draw<'a> {
    stride: usize,
    inverses: &'a mut [f32],
    surfaces: &'a mut [Surface],
    plot: &'a Plot,
}

impl WithSimd for Draw<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let [[first, end], [top, bottom]] = self.plot.area;
        for row in top..bottom {
            let line = row * self.stride;
            for column in (first / LANES * LANES..end).step_by(LANES) {
                let place = line + column..line + column + LANES;
                let inverses: &mut [f32; LANES] =
                    (&mut self.inverses[place.clone()]).try_into().expect("rows are padded");
                let surfaces: &mut [Surface; LANES] =
                    (&mut self.surfaces[place]).try_into().expect("rows are padded");
                self.plot.draw(column as f32, row as f32, inverses, surfaces);
            }
        }
    }
}

impl Plot {
    /// Draws some pixels of a row.
    #[inline(always)]
    fn draw(&self, column: f32, row: f32, inverses: &mut [f32; LANES], surfaces: &mut [Surface; LANES]) {
        let columns: [f32; LANES] = core::array::from_fn(|lane| column + lane as f32);
        let mut enter = [f32::INFINITY; LANES];
        let mut surface = [0; LANES];
        for (inverse, own) in &self.entered {
            let base = inverse.in_row(row);
            for lane in 0..LANES {
                let value = base + columns[lane] * inverse.per_column;
                let last = value < enter[lane];
                enter[lane] = if last { value } else { enter[lane] };
                surface[lane] = if last { *own } else { surface[lane] };
            }
        }
        let mut leave = [0.0_f32; LANES];
        for inverse in &self.left {
            let base = inverse.in_row(row);
            for lane in 0..LANES {
                let value = base + columns[lane] * inverse.per_column;
                leave[lane] = if value > leave[lane] { value } else { leave[lane] };
            }
        }
        if let Some(side) = &self.side {
            side.clip(row, &columns, &mut enter, &mut leave, &mut surface);
        }
        for lane in 0..LANES {
            let meets = (enter[lane] >= leave[lane]) & (enter[lane] <= self.nearest);
            let seen = meets & (enter[lane] > inverses[lane]);
            inverses[lane] = if seen { enter[lane] } else { inverses[lane] };
            surfaces[lane] = if seen { surface[lane] } else { surfaces[lane] };
        }
    }
}

impl Side {
    /// Leaves of each ray what is inside the endless cylinder.
    #[inline(always)]
    fn clip(
        &self,
        row: f32,
        columns: &[f32; LANES],
        enter: &mut [f32; LANES],
        leave: &mut [f32; LANES],
        surface: &mut [Surface; LANES],
    ) {
        let base = self.middle.in_row(row);
        let [one, of_column, column_squared] = self.spread.in_row(row);
        for lane in 0..LANES {
            let column = columns[lane];
            let middle = base + column * self.middle.per_column;
            let spread = one + column * (of_column + column * column_squared);
            let misses = spread < 0.0;
            let root = if misses { 0.0 } else { spread }.sqrt();
            if self.from_outside {
                // A ray beside the cylinder leaves it before it enters.
                let (near, far) = (middle + root, if misses { f32::INFINITY } else { middle - root });
                let last = near < enter[lane];
                enter[lane] = if last { near } else { enter[lane] };
                surface[lane] = if last { self.surface } else { surface[lane] };
                leave[lane] = if far > leave[lane] { far } else { leave[lane] };
            } else {
                let far = middle + root;
                leave[lane] = if far > leave[lane] { far } else { leave[lane] };
            }
        }
    }
}
