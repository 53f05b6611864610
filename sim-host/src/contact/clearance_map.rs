//! How far the nearest solid is, looked up.

use nalgebra::Vector3;

use super::body::Body;

/// Greatest number of cells: half a mebibyte, which stays in the second-level cache.
pub(super) const FINE_CELLS: f64 = 524_288.0;

/// The same for a world of many: sixty-four lanes look into as many maps.
pub(super) const COARSE_CELLS: f64 = 32_768.0;

/// Smallest edge of a cell \[m\]: less than a drone's radius gains nothing.
const SMALLEST_CELL: f64 = 0.03;

/// Space around the solids that is resolved \[m\].
const RIM: f64 = 0.25;

/// Steps of distance in one cell's edge.
const STEPS_PER_CELL: f64 = 4.0;

/// Cells along an edge of the blocks that choose among the solids before their cells do.
const BLOCK: usize = 8;

/// Distance beyond which a block has one bound for all its cells \[m\].
pub(super) const FAR: f64 = 0.5;

/// Rounding of parry's distances, generously \[m\].
const ROUNDING: f64 = 1e-4;

/// A grid of lower bounds of the distance to a set of bodies, in steps of a fraction of a cell.
#[derive(Clone, Debug)]
pub(super) struct ClearanceMap {
    low: [f32; 3],
    /// Of the first cell.
    middle_of_first: [f32; 3],
    high: [f32; 3],
    cells_per_metre: f32,
    /// Index of the last cell along x, y, z.
    last: [f32; 3],
    /// Cells from one to the next along x, y, z.
    strides: [f32; 3],
    step: f32,
    cells: Vec<u8>,
}

impl ClearanceMap {
    /// With so many cells at most; `None` if there is nothing to be distant from.
    pub(super) fn new(bodies: &[Body], most_cells: f64) -> Option<Self> {
        let extents = bodies.iter().map(|body| body.extent);
        let (low, high) = extents.reduce(|(low, high), (a, b)| (low.inf(&a), high.sup(&b)))?;
        let rim = Vector3::repeat(RIM);
        let (low, size) = (low - rim, high - low + 2.0 * rim);
        let cell = SMALLEST_CELL.max(libm::cbrt(size.product() / most_cells));
        let counts = size.map(|length| libm::ceil(length / cell).max(1.0) as usize);
        let mut map = Self {
            low: low.map(|value| value as f32).into(),
            middle_of_first: low.map(|value| (value + 0.5 * cell) as f32).into(),
            high: (low + size).map(|value| value as f32).into(),
            cells_per_metre: (1.0 / cell) as f32,
            last: counts.map(|count| (count - 1) as f32).into(),
            strides: [1.0, counts.x as f32, (counts.x * counts.y) as f32],
            step: (cell / STEPS_PER_CELL) as f32,
            cells: vec![0; counts.product()],
        };
        map.fill(bodies, &low, cell);
        Some(map)
    }

    fn fill(&mut self, bodies: &[Body], low: &Vector3<f64>, cell: f64) {
        let counts = self.last.map(|last| last as usize + 1);
        let corner = |index: [usize; 3]| low + Vector3::from(index.map(|number| number as f64 * cell));
        for index in cells_of([0; 3], counts.map(|count| count.div_ceil(BLOCK))) {
            let first = index.map(|number| number * BLOCK);
            let half = 0.5 * BLOCK as f64 * cell;
            let block = nearest(bodies, &(corner(first) + Vector3::repeat(half)), 3.0_f64.sqrt() * half);
            let end: [usize; 3] = core::array::from_fn(|axis| counts[axis].min(first[axis] + BLOCK));
            for index in cells_of(first, end) {
                let middle = corner(index) + Vector3::repeat(0.5 * cell);
                let bound = match &block {
                    Block::Far { bound } => *bound,
                    Block::Near(bodies) => {
                        least_distance(bodies.iter().copied(), &middle) - 0.5 * 3.0_f64.sqrt() * cell - ROUNDING
                    }
                };
                let [x, y, z] = index;
                self.cells[x + counts[0] * (y + counts[1] * z)] = (bound / cell * STEPS_PER_CELL) as u8;
            }
        }
    }

    /// A lower bound of the distance \[m\] to the bodies; outside the grid it is the distance to the grid or the
    /// bound at its rim, for nothing is nearer than from there.
    #[inline(always)]
    pub(super) fn bound(&self, point: [f32; 3]) -> f32 {
        let (cell, outside) = self.place(point);
        outside.max(self.bound_in(cell))
    }

    /// As [`Self::bound`] for the points of many lanes, `[axis][lane]`.
    #[inline(always)]
    pub(super) fn bounds<const LANES: usize>(&self, points: &[[f32; LANES]; 3]) -> [f32; LANES] {
        let mut cells = [0; LANES];
        let mut bounds = [0.0; LANES];
        // In lanes; what is looked up is not.
        for lane in 0..LANES {
            (cells[lane], bounds[lane]) = self.place(points.each_ref().map(|axis| axis[lane]));
        }
        let found: [f32; LANES] = core::array::from_fn(|lane| self.bound_in(cells[lane]));
        core::array::from_fn(|lane| bounds[lane].max(found[lane]))
    }

    /// The cell nearest to a point, and how far outside the grid the point is \[m\].
    #[inline(always)]
    fn place(&self, point: [f32; 3]) -> (i32, f32) {
        let mut cell = 0.0;
        let mut outside = 0.0_f32;
        for axis in 0..3 {
            let place = (point[axis] - self.middle_of_first[axis]) * self.cells_per_metre;
            // Whole numbers up to 2²⁴ are exact.
            cell += nearest_whole(place.max(0.0).min(self.last[axis])) * self.strides[axis];
            outside = outside.max(self.low[axis] - point[axis]).max(point[axis] - self.high[axis]);
        }
        (cell as i32, outside)
    }

    #[inline(always)]
    fn bound_in(&self, cell: i32) -> f32 {
        f32::from(self.cells.get(cell as usize).copied().unwrap_or(0)) * self.step
    }
}

/// The nearest whole number, of numbers from 0 to a million: conversions to integers and back take longer.
#[inline(always)]
fn nearest_whole(value: f32) -> f32 {
    const WHOLE: f32 = 8_388_608.0;
    (value + WHOLE) - WHOLE
}

/// What bounds the distances of a block of cells.
enum Block<'a> {
    /// This, for all of them \[m\].
    Far { bound: f64 },
    /// These bodies: one of them is the nearest.
    Near(Vec<&'a Body>),
}

fn nearest<'a>(bodies: &'a [Body], middle: &Vector3<f64>, radius: f64) -> Block<'a> {
    let least = least_distance(bodies, middle);
    let bound = least - radius - ROUNDING;
    if bound > FAR {
        return Block::Far { bound };
    }
    let reach = least + 2.0 * radius + ROUNDING;
    Block::Near(bodies.iter().filter(|body| body.distance_to_extent(middle) <= reach).collect())
}

/// Distance of a point to the nearest body \[m\]; bodies whose boxes are farther are not asked.
fn least_distance<'a>(bodies: impl IntoIterator<Item = &'a Body>, point: &Vector3<f64>) -> f64 {
    bodies.into_iter().fold(f64::INFINITY, |least, body| {
        // parry's distances are rounded to `f32`, so a box may seem farther than what it holds.
        if body.distance_to_extent(point) - ROUNDING > least { least } else { least.min(body.distance_to(point)) }
    })
}

/// All indices from `first` to before `end`.
fn cells_of(first: [usize; 3], end: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    let row = move |y, z| (first[0]..end[0]).map(move |x| [x, y, z]);
    (first[2]..end[2]).flat_map(move |z| (first[1]..end[1]).flat_map(move |y| row(y, z)))
}
