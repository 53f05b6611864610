//! Roll and pitch within a limit, without angles.

use kestrel_core::real::Real;

use crate::swarm::Swarm;

/// Roll and pitch within ± a limit below π/2: with the third row (a, b, c) of the rotation matrix, pitch is −asin a and
/// roll is atan2(b, c).
pub(crate) struct RollPitchLimit<R> {
    sine: R,
    tangent: R,
}

impl<R: Real> RollPitchLimit<R> {
    /// `limit` in \[rad\].
    pub(crate) fn new(limit: f64) -> Self {
        Self { sine: R::from_f64(libm::sin(limit)), tangent: R::from_f64(libm::tan(limit)) }
    }

    #[inline(always)]
    pub(crate) fn holds<const LANES: usize>(&self, swarm: &Swarm<LANES, R>, lane: usize) -> bool {
        let [_, _, [a, b, c]] = swarm.state(lane).world_from_body.rows();
        (a.abs() < self.sine) & (b.abs() < self.tangent * c)
    }
}
