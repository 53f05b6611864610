//! Episodes that another processor flies, beside this one.

use std::fmt;
use std::path::Path;

use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::PolicyFile;
use kestrel_core::real::Real;
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;
use kestrel_shim::policy_backend::PolicyBackend;
use kestrel_sim::outcome::Outcome;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::simulation::Simulation;

use super::{ProcessorError, Qemu};
use kestrel_experiments::evaluation::Starts;

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

/// Flies the first episodes of an evaluation by the policy file `file` on an emulated processor, while the pilot of this machine
/// computes every control period too; `shown` gets the number of episodes that are done. Simulations are in `f64`; pilots see them rounded to `f32`.
///
/// # Errors
/// When several drones fly, or the processor does not start, refuses the policy, or stops to answer.
///
/// # Panics
/// When the policy is of another task than the scenario's.
pub(crate) fn compare(
    scenario: &Scenario,
    starts: Starts,
    (file, policy): (&[u8], PolicyFile<'_>),
    image: &Path,
    mut shown: impl FnMut(u64),
) -> Result<Comparison, ProcessorError> {
    if scenario.agents.count != 1 {
        return Err(ProcessorError::Team { found: scenario.agents.count });
    }
    let mut remote = Qemu::start(image, file, &policy)?;
    let measured = policy.metadata().observation.measured_len();
    let mut pilot = Pilot::new(policy);
    let mut sums = Comparison { episodes: 0, successes: 0, ticks: 0, different: 0 };
    for first in 0..starts.episodes as u32 {
        let mut simulation = Simulation::<1, f64>::with_purpose(scenario, starts.seed, starts.purpose, first, 1);
        pilot.reset();
        remote.reset();
        while simulation.outcomes()[0] == Outcome::Running {
            let state: State<f32> = simulation.known_state(0).map(Real::to_f32);
            let setpoint = Setpoint::at(simulation.goal(0).map(Real::to_f32));
            // Measurements are the end of an observation.
            let observation = simulation.observations();
            let measurements: Vec<f32> =
                observation[observation.len() - measured..].iter().map(|value| value.to_f32()).collect();
            let silent = || ProcessorError::Silent { path: image.to_owned() };
            let targets = remote.tick_towards(&measurements, &state, &setpoint).ok_or_else(silent)?;
            let expected = pilot.tick_towards(&measurements, &state, &setpoint);
            sums.ticks += 1;
            sums.different += u64::from(targets.map(f32::to_bits) != expected.map(f32::to_bits));
            let actions: Vec<f64> = pilot.previous_action().iter().map(|action| f64::from(*action)).collect();
            simulation.step_with_rotor_speeds(&actions, &[targets.map(f64::from)]);
        }
        sums.episodes += 1;
        shown(u64::from(sums.episodes));
        sums.successes += simulation.take_episodes().first().map_or(0, |episode| u32::from(episode.success));
    }
    Ok(sums)
}
