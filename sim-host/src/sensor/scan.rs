//! Many ideal rangers whose beams keep their directions in the world: a lidar behind an attitude estimate.

use core::f64::consts::TAU;

use nalgebra::Vector3;

/// Most beams of a scan.
pub const BEAM_LIMIT: usize = 64;

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

    /// Unit vectors of the beams, world.
    pub fn directions(&self) -> Vec<Vector3<f64>> {
        self.rings.iter().flat_map(|ring| (0..ring.beams).map(|beam| ring.direction(beam))).collect()
    }
}

impl ScanRing {
    fn direction(&self, beam: usize) -> Vector3<f64> {
        let (sine, cosine) = libm::sincos(TAU * beam as f64 / self.beams as f64);
        let (up, across) = libm::sincos(self.elevation);
        Vector3::new(across * cosine, across * sine, up)
    }
}
