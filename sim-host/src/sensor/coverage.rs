//! Which cells of a field a drone has visited, and where the next is: what it can tell from its own way.

use kestrel_core::real::Real;

use crate::swarm::{Column, Swarm};
use crate::term::Cells;

/// A square of cells of one metre around the origin, in the episode so far, without error: for each cell, along y and then
/// along x, one if it was visited and else zero. The cell of the start counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coverage {
    /// Along each side, at least one.
    pub cells: u64,
    /// Distance that reads as one of the way to the middle of the nearest cell that is left, world x and y behind the
    /// cells \[m\]; zeros when none is. Without it the way is not told.
    pub next_scale_m: Option<f32>,
}

impl Coverage {
    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "there is a cell")]
    pub const fn len(&self) -> usize {
        Cells::count(self.cells) + if self.next_scale_m.is_some() { 2 } else { 0 }
    }

    /// Marks where the drone of a lane is, and says where the next cell is.
    #[inline(always)]
    pub(crate) fn tell<const LANES: usize, R: Real>(
        &self,
        swarm: &Swarm<LANES, R>,
        lane: usize,
        values: &mut [Column<LANES, R>],
    ) {
        let cells = Cells::new(self.cells, false);
        let (visited, next) = values.split_at_mut(Cells::count(self.cells));
        cells.visit(swarm, lane, visited);
        if let (Some(scale_m), [x, y]) = (self.next_scale_m, next) {
            let per_metre = R::one() / R::from_f32(scale_m);
            let [to_x, to_y] = cells.nearest_left(swarm, lane, visited);
            (x[lane], y[lane]) = (to_x * per_metre, to_y * per_metre);
        }
    }
}
