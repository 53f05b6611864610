//! Which cells of a field a drone has visited: what it can tell from its own way.

use crate::term::Cells;

/// A square of cells of one metre around the origin, in the episode so far, without error: for each cell, along y and then
/// along x, one if it was visited and else zero. The cell of the start counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Coverage {
    /// Along each side, at least one.
    pub cells: u64,
}

impl Coverage {
    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "there is a cell")]
    pub const fn len(&self) -> usize {
        Cells::count(self.cells)
    }
}
