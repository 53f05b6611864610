//! A square of cells of one metre around the origin, of which a drone visits one after the other.

use kestrel_config::{ConfigError, Field};
use kestrel_core::real::Real;

use crate::swarm::{Column, Swarm};

/// A square of cells of one metre around the origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cells {
    /// Along each side.
    along_side: u32,
    /// Whether coordinates up to a metre below the field count as its first cell, as in the reference, whose rounding
    /// is towards zero.
    rounds_towards_zero: bool,
}

impl Cells {
    /// Refuses a field of no cells or too many.
    pub(crate) fn check(along_side: u64, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("cells").whole(along_side, 1..=8).map(drop)
    }

    pub(crate) fn new(along_side: u64, as_published: bool) -> Self {
        Self { along_side: along_side as u32, rounds_towards_zero: as_published }
    }

    /// Cells in all, each of which is a number to remember.
    pub(crate) const fn count(along_side: u64) -> usize {
        (along_side * along_side) as usize
    }

    /// Marks the cell below the drone; one if it was new.
    #[inline(always)]
    pub(crate) fn visit<const LANES: usize, R: Real>(
        &self,
        swarm: &Swarm<LANES, R>,
        lane: usize,
        visited: &mut [Column<LANES, R>],
    ) -> R {
        let half = R::from_f64(0.5 * f64::from(self.along_side));
        let (x, y) = (swarm.position[0][lane] + half, swarm.position[1][lane] + half);
        let mut fresh = R::zero();
        for (index, cell) in visited.iter_mut().enumerate() {
            let (column, row) = (index as u32 / self.along_side, index as u32 % self.along_side);
            if self.holds(column, x) & self.holds(row, y) {
                fresh = R::one() - cell[lane];
                cell[lane] = R::one();
            }
        }
        fresh
    }

    /// From the drone to the middle of the nearest cell that was not visited \[m\], the first of several; zeros if none is left.
    #[inline(always)]
    pub(crate) fn nearest_left<const LANES: usize, R: Real>(
        &self,
        swarm: &Swarm<LANES, R>,
        lane: usize,
        visited: &[Column<LANES, R>],
    ) -> [R; 2] {
        let to_first = R::from_f64(0.5 - 0.5 * f64::from(self.along_side));
        let from = [0, 1].map(|axis| to_first - swarm.position[axis][lane]);
        let (mut nearest, mut least) = ([R::zero(); 2], R::from_f64(f64::from(f32::MAX)));
        for (index, cell) in visited.iter().enumerate() {
            let place = [index as u32 / self.along_side, index as u32 % self.along_side];
            let way = [0, 1].map(|axis| from[axis] + R::from_f64(f64::from(place[axis])));
            let square = way[0] * way[0] + way[1] * way[1];
            if cell[lane] < R::from_f64(0.5) && square < least {
                (nearest, least) = (way, square);
            }
        }
        nearest
    }

    /// Whether a coordinate, from the field's border \[m\], belongs to a row of cells.
    #[inline(always)]
    fn holds<R: Real>(&self, row: u32, coordinate: R) -> bool {
        let low = f64::from(row);
        let high = coordinate < R::from_f64(low + 1.0);
        if self.rounds_towards_zero && row == 0 {
            (R::from_f64(-1.0) < coordinate) & high
        } else {
            (R::from_f64(low) <= coordinate) & high
        }
    }
}
