//! What ends an episode, and whether it was a success.

use kestrel_core::real::Real;
use nalgebra::Vector3;

use crate::outcome::{Ending, Outcome};
use crate::scenario::{Clock, EndRule, Scenario, Success, Termination, TimeLimit};
use crate::swarm::{Column, Swarm, vector};
use crate::world::Cuboid;

/// Endings as numbers that lanes can compare, failures first; zero goes on.
const ENDINGS: [Ending; 9] = [
    Ending::Collision,
    Ending::OutOfBounds,
    Ending::Tilt,
    Ending::Distance,
    Ending::OutOfFuel,
    Ending::Overdue,
    Ending::Teammate,
    Ending::Success,
    Ending::TimeLimit,
];

/// Greatest code of a failure.
const FAILURES: f32 = 6.0;

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

/// What the rules look at.
pub(crate) struct FlightView<'a, const LANES: usize, R: Real> {
    pub(crate) swarm: &'a Swarm<LANES, R>,
    pub(crate) touches: &'a [Column<LANES, R>; 2],
    pub(crate) distances: &'a Column<LANES, R>,
    /// Control periods flown, this one included.
    pub(crate) steps: &'a Column<LANES, R>,
    pub(crate) episode_steps: R,
}

/// Writes each lane's code: a failure first, then success, then the clock; the published clock comes before all.
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
    *codes = [0.0; LANES];
    mark(codes, time_limit, |lane| view.steps[lane] < view.episode_steps);
    match scenario.success {
        Success::Settle { .. } | Success::Visit { .. } | Success::Ending => {}
        Success::Reach { region, speed_limit } => mark_reached(view, &region, speed_limit, codes),
    }
    for (rule, memory) in scenario.terminations.iter().zip(memory).rev() {
        mark_ends(view, rule, memory, codes);
    }
    if scenario.clock == Clock::Published {
        mark(codes, time_limit, |lane| view.steps[lane] < view.episode_steps);
    }
    mark_broken(view, codes);
}

impl Termination {
    /// How it is reported.
    fn ending(&self) -> Ending {
        match self {
            Self::Collision { .. } => Ending::Collision,
            Self::OutOfBounds(_) => Ending::OutOfBounds,
            Self::Tilt { .. } | Self::RollPitch { .. } => Ending::Tilt,
            Self::Distance { .. } => Ending::Distance,
            Self::Fuel { .. } => Ending::OutOfFuel,
            Self::EleventhStep => Ending::Overdue,
            Self::Landing
            | Self::Coverage(_)
            | Self::LevelWithin { .. }
            | Self::EnterArea(_)
            | Self::Hold { .. }
            | Self::Rest { .. }
            | Self::Arrival { .. } => Ending::Success,
        }
    }

    /// Columns that the rule remembers an episode by.
    pub(crate) fn memory_len(&self) -> usize {
        match self {
            Self::Coverage(field) => field.len(),
            Self::Fuel { .. } | Self::Hold { .. } | Self::Rest { .. } => 1,
            Self::Collision { .. }
            | Self::OutOfBounds(_)
            | Self::Tilt { .. }
            | Self::RollPitch { .. }
            | Self::Distance { .. }
            | Self::EleventhStep
            | Self::Landing
            | Self::LevelWithin { .. }
            | Self::EnterArea(_)
            | Self::Arrival { .. } => 0,
        }
    }

    /// What they hold at the start of an episode.
    pub(crate) fn memory_start(&self) -> f64 {
        if let Self::Fuel { periods, .. } = self { f64::from(*periods) } else { 0.0 }
    }
}

#[inline(always)]
fn mark_ends<const LANES: usize, R: Real>(
    view: &FlightView<'_, LANES, R>,
    rule: &EndRule,
    memory: &mut [Column<LANES, R>],
    codes: &mut Column<LANES>,
) {
    let end = code(rule.rule.ending()) + if rule.truncates { UNUSUAL } else { 0.0 };
    let half = R::from_f64(0.5);
    let swarm = view.swarm;
    match &rule.rule {
        Termination::Collision { allowed: None } => mark(codes, end, |lane| view.touches[0][lane] < half),
        Termination::Collision { allowed: Some(area) } => {
            mark(codes, end, |lane| (view.touches[0][lane] < half) | area.contains(swarm, lane));
        }
        Termination::OutOfBounds(bounds) => mark(codes, end, |lane| stays_in(bounds, swarm, lane)),
        Termination::Tilt { limit } => {
            let least = R::from_f32(libm::cosf(*limit));
            mark(codes, end, |lane| least < swarm.state(lane).world_from_body.up_cosine());
        }
        Termination::RollPitch { limit } => {
            let limit = RollPitchLimit::new(*limit);
            mark(codes, end, |lane| limit.holds(swarm, lane));
        }
        Termination::Distance { limit_m } => {
            let limit = R::from_f32(*limit_m);
            mark(codes, end, |lane| view.distances[lane] < limit);
        }
        Termination::Landing => mark(codes, end, |lane| view.touches[1][lane] < half),
        Termination::Coverage(field) => {
            for lane in 0..LANES {
                field.visit(swarm, lane, memory);
            }
            mark(codes, end, |lane| memory.iter().any(|cell| cell[lane] < half));
        }
        Termination::Fuel { periods, station } => {
            burn_fuel(view, *periods, &station.map(R::from_f64), &mut memory[0]);
            mark(codes, end, |lane| R::zero() < memory[0][lane]);
        }
        Termination::EleventhStep => {
            mark(codes, end, |lane| view.steps[lane] < R::from_f64(10.5));
        }
        Termination::LevelWithin { region, roll_limit } => {
            let limit = R::from_f64(*roll_limit);
            mark(codes, end, |lane| !(contains(region, swarm, lane) & (swarm.attitude[1][lane].abs() <= limit)));
        }
        Termination::EnterArea(area) => mark(codes, end, |lane| !area.contains(swarm, lane)),
        Termination::Hold { radius_m, speed_limit, periods } => {
            let (radius, limit) = (R::from_f32(*radius_m), R::from_f32(speed_limit * speed_limit));
            for lane in 0..LANES {
                let velocity = vector(&swarm.velocity, lane);
                let slow = velocity.x * velocity.x + velocity.y * velocity.y + velocity.z * velocity.z < limit;
                let held = slow & (view.distances[lane] < radius);
                memory[0][lane] += if held { R::one() } else { R::zero() };
            }
            let enough = R::from_f64(f64::from(*periods) - 0.5);
            mark(codes, end, |lane| memory[0][lane] < enough);
        }
        Termination::Rest { speed_limit, tilt_limit, periods } => {
            let (limit, least) = (R::from_f32(speed_limit * speed_limit), R::from_f32(libm::cosf(*tilt_limit)));
            for lane in 0..LANES {
                let velocity = vector(&swarm.velocity, lane);
                let slow = velocity.x * velocity.x + velocity.y * velocity.y + velocity.z * velocity.z < limit;
                let upright = least < swarm.state(lane).world_from_body.up_cosine();
                let rests = slow & upright & (half < view.touches[1][lane]);
                memory[0][lane] = if rests { memory[0][lane] + R::one() } else { R::zero() };
            }
            let enough = R::from_f64(f64::from(*periods) - 0.5);
            mark(codes, end, |lane| memory[0][lane] < enough);
        }
        Termination::Arrival { radius_m } => {
            let radius = R::from_f32(*radius_m);
            mark(codes, end, |lane| radius <= view.distances[lane]);
        }
    }
}

/// Burns one period's fuel and refills within 12 cm of the station.
#[inline(always)]
fn burn_fuel<const LANES: usize, R: Real>(
    view: &FlightView<'_, LANES, R>,
    periods: u32,
    station: &Vector3<R>,
    fuel: &mut Column<LANES, R>,
) {
    let full = R::from_f64(f64::from(periods));
    let radius = R::from_f64(0.12);
    for lane in 0..LANES {
        let offset = vector(&view.swarm.position, lane) - station;
        let distance = (offset.x * offset.x + offset.y * offset.y + offset.z * offset.z).sqrt();
        fuel[lane] = distance.where_less(radius, full, fuel[lane] - R::one());
    }
}

/// Roll and pitch within ± a limit below π/2, without angles: with the third row (a, b, c) of the rotation matrix,
/// pitch is −asin a and roll is atan2(b, c).
pub(crate) struct RollPitchLimit<R> {
    sine: R,
    tangent: R,
}

impl<R: Real> RollPitchLimit<R> {
    pub(crate) fn new(limit: f64) -> Self {
        Self { sine: R::from_f64(libm::sin(limit)), tangent: R::from_f64(libm::tan(limit)) }
    }

    #[inline(always)]
    pub(crate) fn holds<const LANES: usize>(&self, swarm: &Swarm<LANES, R>, lane: usize) -> bool {
        let [_, _, [a, b, c]] = swarm.state(lane).world_from_body.rows();
        (a.abs() < self.sine) & (b.abs() < self.tangent * c)
    }
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

/// Writes `code` where the lane is not `fine`; comparisons with NaN are false, so NaN is never fine.
#[inline(always)]
fn mark<const LANES: usize>(codes: &mut Column<LANES>, code: f32, fine: impl Fn(usize) -> bool) {
    for (lane, slot) in codes.iter_mut().enumerate() {
        *slot = if fine(lane) { *slot } else { code };
    }
}

#[inline(always)]
pub(crate) fn contains<const LANES: usize, R: Real>(
    cuboid: &Cuboid,
    swarm: &Swarm<LANES, R>,
    lane: usize,
) -> bool {
    let [x, y, z] = [swarm.position[0][lane], swarm.position[1][lane], swarm.position[2][lane]];
    let (low, high) = (cuboid.low.map(R::from_f32), cuboid.high.map(R::from_f32));
    (low.x < x) & (x < high.x) & (low.y < y) & (y < high.y) & (low.z < z) & (z < high.z)
}

/// Within the box, its surface included: the reference's bounds end what is beyond them.
#[inline(always)]
fn stays_in<const LANES: usize, R: Real>(cuboid: &Cuboid, swarm: &Swarm<LANES, R>, lane: usize) -> bool {
    let [x, y, z] = [swarm.position[0][lane], swarm.position[1][lane], swarm.position[2][lane]];
    let (low, high) = (cuboid.low.map(R::from_f32), cuboid.high.map(R::from_f32));
    (low.x <= x) & (x <= high.x) & (low.y <= y) & (y <= high.y) & (low.z <= z) & (z <= high.z)
}

#[cfg(test)]
mod tests;
