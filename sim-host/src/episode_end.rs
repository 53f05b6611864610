//! How episodes end, as codes in lanes: by a termination, by success or by the clock.

use kestrel_core::real::Real;

use crate::outcome::{Ending, Outcome};
use crate::scenario::{Clock, Scenario, Success, TimeLimit};
use crate::swarm::Column;
use crate::term::{FlightView, contains, mark};
use crate::world::Cuboid;

/// Endings as numbers that lanes can compare, failures first; zero goes on.
const ENDINGS: [Ending; 10] = [
    Ending::Collision,
    Ending::OutOfBounds,
    Ending::Tilt,
    Ending::Distance,
    Ending::OutOfFuel,
    Ending::Overdue,
    Ending::Limit,
    Ending::Teammate,
    Ending::Success,
    Ending::TimeLimit,
];

/// Greatest code of a failure.
const FAILURES: f32 = 7.0;

/// Added to a code whose outcome is not the usual one of its ending: a terminal time limit, a truncating rule.
const UNUSUAL: f32 = 16.0;

/// Code of an ending in a lane.
pub(crate) fn code(ending: Ending) -> f32 {
    ENDINGS.iter().position(|candidate| *candidate == ending).map_or(0.0, |index| (index + 1) as f32)
}

/// Code of the ending of a drone whose teammate ended with `code`: terminal, unless that was cut off.
pub(crate) fn code_of_teammate(code_of_other: f32) -> f32 {
    match outcome(code_of_other) {
        Outcome::Truncated => code(Ending::Teammate) + UNUSUAL,
        Outcome::Running | Outcome::Terminated => code(Ending::Teammate),
    }
}

/// The ending behind a code.
pub(crate) fn decode(code: f32) -> Option<Ending> {
    (usual(code) as usize).checked_sub(1).and_then(|index| ENDINGS.get(index)).copied()
}

/// What a code means for the value of the future.
pub(crate) fn outcome(code: f32) -> Outcome {
    let usually = decode(code).map_or(Outcome::Running, Ending::outcome);
    match usually {
        Outcome::Terminated if code > UNUSUAL => Outcome::Truncated,
        Outcome::Truncated if code > UNUSUAL => Outcome::Terminated,
        Outcome::Running | Outcome::Terminated | Outcome::Truncated => usually,
    }
}

#[inline(always)]
fn usual(code: f32) -> f32 {
    if code > UNUSUAL { code - UNUSUAL } else { code }
}

/// Whether a code is that of a failure.
#[inline(always)]
pub(crate) fn is_failure(code: f32) -> bool {
    let usual = usual(code);
    (0.5 < usual) & (usual < FAILURES + 0.5)
}

/// Whether a code is that of the time limit.
#[inline(always)]
pub(crate) fn is_time_limit(code: f32) -> bool {
    usual(code) > ENDINGS.len() as f32 - 0.5
}

/// Writes each lane's code: that of the first rule of the list that ends it, then success, then the clock; the published clock
/// comes before all.
#[inline(always)]
pub(crate) fn find_endings<const LANES: usize, R: Real>(
    view: &FlightView<'_, LANES, R>,
    scenario: &Scenario,
    memory: &mut [Vec<Column<LANES, R>>],
    codes: &mut Column<LANES>,
) {
    let time_limit = match scenario.time_limit {
        TimeLimit::Truncates => code(Ending::TimeLimit),
        TimeLimit::Terminates => code(Ending::TimeLimit) + UNUSUAL,
    };
    let episode_steps = R::from_f64(f64::from(scenario.episode_steps()));
    *codes = [0.0; LANES];
    mark(codes, time_limit, |lane| view.steps[lane] < episode_steps);
    match scenario.success {
        Success::Settle { .. } | Success::Visit { .. } | Success::Ending => {}
        Success::Reach { region, speed_limit } => mark_reached(view, &region, speed_limit, codes),
    }
    for (rule, memory) in scenario.terminations.iter().zip(memory).rev() {
        let code = code(rule.ending()) + if rule.truncates() { UNUSUAL } else { 0.0 };
        rule.mark(view, memory, code, codes);
    }
    if scenario.clock == Clock::Reference {
        mark(codes, time_limit, |lane| view.steps[lane] < episode_steps);
    }
    mark_broken(view, codes);
}

/// Beyond any flight of a real drone: a lane that gets here has left the model's validity, as has NaN.
const SPEED_LIMIT: f64 = 200.0;
const BODY_RATES_LIMIT: f64 = 300.0;

#[inline(always)]
fn mark_broken<const LANES: usize, R: Real>(view: &FlightView<'_, LANES, R>, codes: &mut Column<LANES>) {
    let swarm = view.swarm;
    let (speed, rates) =
        (R::from_f64(SPEED_LIMIT * SPEED_LIMIT), R::from_f64(BODY_RATES_LIMIT * BODY_RATES_LIMIT));
    let far = R::from_f32(f32::MAX);
    mark(codes, code(Ending::OutOfBounds), |lane| {
        let [vx, vy, vz] = [swarm.velocity[0][lane], swarm.velocity[1][lane], swarm.velocity[2][lane]];
        let [p, q, r] = [swarm.body_rates[0][lane], swarm.body_rates[1][lane], swarm.body_rates[2][lane]];
        (vx * vx + vy * vy + vz * vz < speed) & (p * p + q * q + r * r < rates) & (view.distances[lane] < far)
    });
}

#[inline(always)]
fn mark_reached<const LANES: usize, R: Real>(
    view: &FlightView<'_, LANES, R>,
    region: &Cuboid,
    speed_limit: f32,
    codes: &mut Column<LANES>,
) {
    let limit = R::from_f32(speed_limit * speed_limit);
    mark(codes, code(Ending::Success), |lane| {
        let velocity = &view.swarm.velocity;
        let square = velocity[0][lane] * velocity[0][lane]
            + velocity[1][lane] * velocity[1][lane]
            + velocity[2][lane] * velocity[2][lane];
        !(contains(region, view.swarm, lane) & (square < limit))
    });
}

#[cfg(test)]
mod tests;
#[cfg(test)]
pub(crate) mod trial;
