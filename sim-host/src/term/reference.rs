//! Numbers and defects that several terms and terminations of the reference system share.

use kestrel_config::Limits;
use kestrel_core::real::Real;
use nalgebra::Vector3;

use super::lanes::contains;
use crate::config::area::BoxConfig;
use crate::swarm::Swarm;
use crate::world::Cuboid;

/// Height of a resting drone's centre above what it stands on, as the reference has it \[m\].
pub(crate) const REST_HEIGHT: f64 = 0.01347;

/// Greatest magnitude of roll and pitch that counts as level \[rad\].
pub(crate) const LEVEL: f64 = 1.0;

/// Times between two events of an episode.
pub(crate) const INTERVAL: Limits = Limits::above(0.0, 600.0, "s");

/// Physics steps per second of the reference, which it takes for its control rate where it counts steps.
const PUBLISHED_RATE: f64 = 240.0;

/// Greatest magnitude of the quaternion's x at the reference's exit of the maze.
const PUBLISHED_ROLL: f64 = 0.1;

/// The target of a component that, as published, takes its landing zone for the middle of a box on the floor, and its
/// target for a drone on that \[m, world\].
pub(crate) fn doubled(zone: [f64; 3], as_published: bool) -> Vector3<f64> {
    let [x, y, z] = zone;
    Vector3::new(x, y, if as_published { 2.0 * z + REST_HEIGHT } else { z })
}

/// Control periods of an interval, at least one; as published they count as if there were 240 in a second.
pub(crate) fn counted_periods(interval_secs: f64, control_rate_hz: f64, as_published: bool) -> u32 {
    let rate = if as_published { PUBLISHED_RATE } else { control_rate_hz };
    (interval_secs * rate).round().max(1.0) as u32
}

/// The exit of the maze. As published a drone has to have nearly no roll there: the reference compares the fourth number
/// of its state, the quaternion's x, with zero.
pub(crate) struct LevelWithin<R> {
    region: Cuboid,
    roll_limit: R,
}

impl<R: Real> LevelWithin<R> {
    pub(crate) fn new(region: &BoxConfig, as_published: bool) -> Self {
        let roll_limit = if as_published { PUBLISHED_ROLL } else { f64::INFINITY };
        Self { region: region.cuboid(), roll_limit: R::from_f64(roll_limit) }
    }

    #[inline(always)]
    pub(crate) fn holds<const LANES: usize>(&self, swarm: &Swarm<LANES, R>, lane: usize) -> bool {
        contains(&self.region, swarm, lane) & (swarm.attitude[1][lane].abs() <= self.roll_limit)
    }
}
