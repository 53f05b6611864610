//! What ends an episode, and whether it was a success.

use crate::outcome::Ending;
use crate::scenario::{Cuboid, Success, Termination};
use crate::swarm::{Column, Swarm};

/// Endings as numbers that lanes can compare, failures first; zero goes on.
const ENDINGS: [Ending; 6] =
    [Ending::Collision, Ending::OutOfBounds, Ending::Tilt, Ending::Distance, Ending::Success, Ending::TimeLimit];

/// Code of an ending in a lane.
pub(crate) fn code(ending: Ending) -> f32 {
    ENDINGS.iter().position(|candidate| *candidate == ending).map_or(0.0, |index| (index + 1) as f32)
}

/// The ending behind a code.
pub(crate) fn decode(code: f32) -> Option<Ending> {
    (code as usize).checked_sub(1).and_then(|index| ENDINGS.get(index)).copied()
}

/// Whether a code is that of a failure.
#[inline(always)]
pub(crate) fn is_failure(code: f32) -> bool {
    (0.5 < code) & (code < 4.5)
}

/// What the rules look at.
pub(crate) struct FlightView<'a, const LANES: usize> {
    pub(crate) swarm: &'a Swarm<LANES>,
    pub(crate) hits: &'a Column<LANES>,
    pub(crate) distances: &'a Column<LANES>,
    /// Control periods flown, this one included.
    pub(crate) steps: &'a Column<LANES>,
    pub(crate) episode_steps: f32,
}

/// Writes each lane's code: a failure first, then success, then the clock.
#[inline(always)]
pub(crate) fn find_endings<const LANES: usize>(
    view: &FlightView<'_, LANES>,
    terminations: &[Termination],
    success: &Success,
    codes: &mut Column<LANES>,
) {
    let time_limit = code(Ending::TimeLimit);
    for lane in 0..LANES {
        codes[lane] = if view.steps[lane] < view.episode_steps { 0.0 } else { time_limit };
    }
    match success {
        Success::Settle { .. } => {}
        Success::Reach { region, speed_limit } => mark_reached(view, region, *speed_limit, codes),
    }
    for termination in terminations.iter().rev() {
        mark_failures(view, termination, codes);
    }
    mark_broken(view, codes);
}

#[inline(always)]
fn mark_failures<const LANES: usize>(
    view: &FlightView<'_, LANES>,
    termination: &Termination,
    codes: &mut Column<LANES>,
) {
    match *termination {
        Termination::Collision => {
            let hit = code(Ending::Collision);
            mark(codes, hit, |lane| view.hits[lane] < 0.5);
        }
        Termination::OutOfBounds(bounds) => {
            mark(codes, code(Ending::OutOfBounds), |lane| contains(&bounds, view.swarm, lane));
        }
        Termination::Tilt { limit } => {
            let least = libm::cosf(limit);
            mark(codes, code(Ending::Tilt), |lane| least < view.swarm.state(lane).world_from_body.up_cosine());
        }
        Termination::Distance { limit_m } => {
            mark(codes, code(Ending::Distance), |lane| view.distances[lane] < limit_m);
        }
    }
}

/// Beyond any flight of a real drone: a lane that gets here has left the model's validity, as has NaN.
const SPEED_LIMIT: f32 = 100.0;
const BODY_RATES_LIMIT: f32 = 200.0;

#[inline(always)]
fn mark_broken<const LANES: usize>(view: &FlightView<'_, LANES>, codes: &mut Column<LANES>) {
    let swarm = view.swarm;
    mark(codes, code(Ending::OutOfBounds), |lane| {
        let [vx, vy, vz] = [swarm.velocity[0][lane], swarm.velocity[1][lane], swarm.velocity[2][lane]];
        let [p, q, r] = [swarm.body_rates[0][lane], swarm.body_rates[1][lane], swarm.body_rates[2][lane]];
        (vx * vx + vy * vy + vz * vz < SPEED_LIMIT * SPEED_LIMIT)
            & (p * p + q * q + r * r < BODY_RATES_LIMIT * BODY_RATES_LIMIT)
            & (view.distances[lane] < f32::MAX)
    });
}

#[inline(always)]
fn mark_reached<const LANES: usize>(
    view: &FlightView<'_, LANES>,
    region: &Cuboid,
    speed_limit: f32,
    codes: &mut Column<LANES>,
) {
    mark(codes, code(Ending::Success), |lane| {
        let velocity = &view.swarm.velocity;
        let square = velocity[0][lane] * velocity[0][lane]
            + velocity[1][lane] * velocity[1][lane]
            + velocity[2][lane] * velocity[2][lane];
        !(contains(region, view.swarm, lane) & (square < speed_limit * speed_limit))
    });
}

/// Writes `code` where the lane is not `fine`; comparisons with NaN are false, so NaN is never fine.
#[inline(always)]
fn mark<const LANES: usize>(codes: &mut Column<LANES>, code: f32, fine: impl Fn(usize) -> bool) {
    for (lane, slot) in codes.iter_mut().enumerate() {
        *slot = if fine(lane) { *slot } else { code };
    }
}

#[inline(always)]
fn contains<const LANES: usize>(cuboid: &Cuboid, swarm: &Swarm<LANES>, lane: usize) -> bool {
    let [x, y, z] = [swarm.position[0][lane], swarm.position[1][lane], swarm.position[2][lane]];
    (cuboid.low.x < x)
        & (x < cuboid.high.x)
        & (cuboid.low.y < y)
        & (y < cuboid.high.y)
        & (cuboid.low.z < z)
        & (z < cuboid.high.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_the_endings_in_lanes() {
        assert_eq!(decode(0.0), None);
        for ending in ENDINGS {
            assert_eq!(decode(code(ending)), Some(ending));
            assert_eq!(is_failure(code(ending)), ending.is_failure());
        }
        assert!(!is_failure(0.0));
    }
}
