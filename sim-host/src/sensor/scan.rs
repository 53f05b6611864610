//! Many ideal rangers whose beams keep their directions in the world: a lidar behind an attitude estimate.

use core::f64::consts::TAU;

use nalgebra::Vector3;

/// Most beams of a scan.
pub const BEAM_LIMIT: usize = 64;

/// Positions of beams that sweep, one after the other from reading to reading.
const SWEEP_POSITIONS: usize = 8;

/// Between two heights of beams that sweep \[rad\]: 2.5 degrees, so that they rise and sink by up to 8.75.
const SWEEP_RISE: f64 = 2.5 * TAU / 360.0;

/// Beams around the drone, fixed in the world however the drone is turned, without noise or delay.
#[derive(Clone, Debug, PartialEq)]
pub struct Scan {
    /// The beams, ring by ring; at most [`BEAM_LIMIT`] in all.
    pub rings: Vec<ScanRing>,
    /// Nothing farther is seen \[m\].
    pub limit: f32,
    /// With a scale `s` \[m\] a beam reads `(1 - d / limit) s / (s + d)` for an obstacle `d` metres away: finer within
    /// about that distance, coarser beyond. Without one it reads `1 - d / limit`.
    pub near_scale: Option<f32>,
    /// Whether the beams of a ring turn, rise and sink a little from reading to reading: what eight readings have looked at has
    /// no gaps for posts and boards.
    pub sweeps: bool,
}

/// Beams of one elevation, evenly spaced from +x on, counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanRing {
    /// Above the horizon \[rad\].
    pub elevation: f64,
    /// How many, at least one.
    pub beams: usize,
}

impl Scan {
    /// Number of values, one for each beam.
    #[expect(clippy::len_without_is_empty, reason = "no scan is empty")]
    pub fn len(&self) -> usize {
        self.rings.iter().map(|ring| ring.beams).sum()
    }

    /// In how many positions the beams can be.
    pub const fn positions(&self) -> usize {
        if self.sweeps { SWEEP_POSITIONS } else { 1 }
    }

    /// Unit vectors of the beams in a position, world.
    pub fn directions(&self, position: usize) -> Vec<Vector3<f64>> {
        // In an order in which neither turns nor rises follow their neighbours.
        let step = |stride: usize| (position * stride % SWEEP_POSITIONS) as f64;
        let (turn, rise) = if self.sweeps {
            (step(5) / SWEEP_POSITIONS as f64, SWEEP_RISE * (step(3) - 0.5 * (SWEEP_POSITIONS - 1) as f64))
        } else {
            (0.0, 0.0)
        };
        self.rings
            .iter()
            .flat_map(|ring| (0..ring.beams).map(move |beam| ring.direction(beam, turn, rise)))
            .collect()
    }

    /// How far away the nearest thing is along each beam \[m\], by what the beams read.
    #[inline(always)]
    pub(crate) fn distances(&self, nearness: &[f32; BEAM_LIMIT]) -> [f32; BEAM_LIMIT] {
        match self.near_scale {
            None => nearness.map(|nearness| self.limit * (1.0 - nearness)),
            Some(scale) => nearness.map(|nearness| scale * (1.0 - nearness) / (nearness + scale / self.limit)),
        }
    }
}

impl ScanRing {
    /// Of a beam, turned by a share of the angle to the next one and risen \[rad\].
    fn direction(&self, beam: usize, turn: f64, rise: f64) -> Vector3<f64> {
        let (sine, cosine) = libm::sincos(TAU * (beam as f64 + turn) / self.beams as f64);
        let (up, across) = libm::sincos(self.elevation + rise);
        Vector3::new(across * cosine, across * sine, up)
    }
}
