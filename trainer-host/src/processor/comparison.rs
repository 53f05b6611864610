//! Episodes that another processor flies, beside this one.

use std::fmt;

use kestrel_core::pilot::{Pilot, StatePolicy};
use kestrel_core::real::Real;
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;
use kestrel_experiments::evaluation::Starts;
use kestrel_shim::policy_backend::PolicyBackend;
use kestrel_sim::outcome::Outcome;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::simulation::Simulation;

use super::{ProcessorError, RemoteKind, RemoteProcessor};

/// A policy in the first episodes of an evaluation. Simulations are in `f64`; pilots see them rounded to `f32`.
#[derive(Clone, Debug)]
pub(crate) struct Judged<'a> {
    /// The task.
    pub(crate) scenario: &'a Scenario,
    /// Where the episodes begin.
    pub(crate) starts: Starts,
    /// The policy file's bytes.
    pub(crate) file: &'a [u8],
    /// What they say.
    pub(crate) policy: StatePolicy<'a>,
}

/// What two processors made of the same episodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Comparison {
    /// Episodes flown to their end, by the commands of the other processor.
    pub(crate) episodes: u32,
    /// How many of them succeeded.
    pub(crate) successes: u32,
    /// Control periods in all.
    pub(crate) ticks: u64,
    /// Control periods in which a rotor target differed in any bit.
    pub(crate) different: u64,
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { episodes, successes, ticks, different } = self;
        write!(f, "{episodes} episodes, {successes} of them with success; {ticks} control periods, ")?;
        match different {
            0 => write!(f, "all with the rotor targets of this machine, bit for bit"),
            _ => write!(f, "{different} with other rotor targets than this machine's"),
        }
    }
}

/// What a program with an autopilot's own interface made of the episodes that this machine flies too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FlownBeside {
    /// By the rotor targets of the program.
    pub(crate) program: Flights,
    /// By those of this machine.
    pub(crate) host: Flights,
    /// Largest difference of a rotor target from this machine's in the program's flights \[rad/s\].
    pub(crate) difference: f32,
}

/// Sums over flights.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Flights {
    episodes: u32,
    successes: u32,
    ticks: u64,
    /// Sum of the true distances to the goal at the control periods \[m\].
    distance: f64,
}

impl fmt::Display for FlownBeside {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { program, host, difference } = self;
        writeln!(f, "{} episodes, success and mean distance to the goal:", program.episodes)?;
        writeln!(f, "  the program   {program}")?;
        writeln!(f, "  this machine  {host}")?;
        write!(
            f,
            "largest difference of a rotor target: {difference:.3} rad/s, in {} control periods",
            program.ticks
        )
    }
}

impl fmt::Display for Flights {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let &Self { episodes, successes, ticks, distance } = self;
        let rate = 100.0 * f64::from(successes) / f64::from(episodes.max(1));
        write!(f, "{rate:5.1} %  {:.4} m", distance / ticks.max(1) as f64)
    }
}

/// What a pilot reads in a control period.
struct Input<'a> {
    measurements: &'a [f32],
    state: &'a State<f32>,
    setpoint: Setpoint<f32>,
}

/// An emulated processor flies, while the pilot of this machine computes every control period too; `shown` gets the number of
/// episodes that are done.
///
/// # Errors
/// When several drones fly, or the processor does not start, refuses the policy, or stops to answer.
///
/// # Panics
/// When the policy is of another task than the scenario's.
pub(crate) fn compare(
    judged: &Judged<'_>,
    image: RemoteKind<'_>,
    mut shown: impl FnMut(u64),
) -> Result<Comparison, ProcessorError> {
    let mut remote = judged.start(image)?;
    let mut pilot = Pilot::with_runner(judged.policy.clone());
    let mut different = 0;
    let mut flights = Flights::default();
    for first in 0..judged.starts.episodes as u32 {
        remote.reset();
        judged.fly(first, &mut pilot, &mut flights, |input, expected| {
            let targets = remote.tick_towards(input.measurements, input.state, &input.setpoint)?;
            different += u64::from(targets.map(f32::to_bits) != expected.map(f32::to_bits));
            Ok(targets)
        })?;
        shown(u64::from(flights.episodes));
    }
    let Flights { episodes, successes, ticks, .. } = flights;
    Ok(Comparison { episodes, successes, ticks, different })
}

/// A program and this machine fly the same episodes, each by its own rotor targets.
///
/// # Errors
/// As [`compare`].
///
/// # Panics
/// As [`compare`].
pub(crate) fn fly_beside(
    judged: &Judged<'_>,
    program: RemoteKind<'_>,
    mut shown: impl FnMut(u64),
) -> Result<FlownBeside, ProcessorError> {
    let mut remote = judged.start(program)?;
    let mut pilot = Pilot::with_runner(judged.policy.clone());
    let mut flown = FlownBeside { program: Flights::default(), host: Flights::default(), difference: 0.0 };
    for first in 0..judged.starts.episodes as u32 {
        remote.reset();
        judged.fly(first, &mut pilot, &mut flown.program, |input, expected| {
            let targets = remote.tick_towards(input.measurements, input.state, &input.setpoint)?;
            for (target, expected) in targets.iter().zip(expected) {
                flown.difference = flown.difference.max((target - expected).abs());
            }
            Ok(targets)
        })?;
        judged.fly(first, &mut pilot, &mut flown.host, |_, expected| Ok(expected))?;
        shown(u64::from(first + 1));
    }
    Ok(flown)
}

impl Judged<'_> {
    fn start(&self, kind: RemoteKind<'_>) -> Result<RemoteProcessor, ProcessorError> {
        match self.scenario.agents.count {
            1 => RemoteProcessor::start(kind, self.file, self.policy.metadata()),
            found => Err(ProcessorError::Team { found }),
        }
    }

    /// Flies episode `first` by the targets that `commanded` makes of a control period and the pilot's own targets.
    fn fly<'p>(
        &self,
        first: u32,
        pilot: &mut Pilot<'p, StatePolicy<'p>>,
        flights: &mut Flights,
        mut commanded: impl FnMut(&Input<'_>, [f32; 4]) -> Result<[f32; 4], ProcessorError>,
    ) -> Result<(), ProcessorError> {
        let Self { scenario, starts, policy, .. } = self;
        let measured = policy.metadata().observation.measured_len();
        let limit = scenario.airframe.rotor_speed_limit;
        let mut simulation = Simulation::<1, f64>::with_purpose(scenario, starts.seed, starts.purpose, first, 1);
        pilot.reset();
        while simulation.outcomes()[0] == Outcome::Running {
            let state: State<f32> = simulation.known_state(0).map(Real::to_f32);
            let setpoint = Setpoint::at(simulation.goal(0).map(Real::to_f32));
            // Measurements are the end of an observation.
            let observation = simulation.observations();
            let measurements: Vec<f32> =
                observation[observation.len() - measured..].iter().map(|value| value.to_f32()).collect();
            let expected = pilot.tick_towards(&measurements, &state, &setpoint);
            let targets = commanded(&Input { measurements: &measurements, state: &state, setpoint }, expected)?;
            flights.ticks += 1;
            flights.distance += (simulation.state(0).position - simulation.goal(0)).norm();
            let actions: Vec<f64> = pilot.previous_action().iter().map(|action| f64::from(*action)).collect();
            // A motor that is asked for more gives all that it has.
            let speeds = targets.map(|target| f64::from(target).clamp(0.0, limit));
            simulation.step_with_rotor_speeds(&actions, &[speeds]);
        }
        flights.episodes += 1;
        flights.successes += simulation.take_episodes().first().map_or(0, |episode| u32::from(episode.success));
        Ok(())
    }
}
