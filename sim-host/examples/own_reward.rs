//! A reward term and a termination of one's own, beside those that a task file names.
//!
//! `cargo run --release -p kestrel-sim --example own_reward`

use kestrel_sim::config::{ConfigError, Document};
use kestrel_sim::outcome::Ending;
use kestrel_sim::reward::{self, DroneView, Memory, Paid, RewardFunction};
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;
use kestrel_sim::simulation::Simulation;
use kestrel_sim::termination::{self, TerminationFunction};

const TASK: &str = "
aviary: { goal_m: [0, 0, 1] }
start: { position: { exactly: [ { position_m: [0, 0, 1] } ] } }
rewards:
  - alive: { weight: 1 }
success: { settle: { radius_m: 0.1, within_secs: 4 } }
";

/// Pays every metre of height that the drone has never been at in this episode.
#[derive(Debug)]
struct Record;

impl RewardFunction for Record {
    fn name(&self) -> &'static str {
        "record"
    }

    fn paid(&self) -> Paid {
        Paid::PerStep
    }

    /// The greatest height so far.
    fn memory(&self) -> Memory {
        Memory::unset(1)
    }

    fn value(&self, drone: &DroneView<'_>, memory: &mut [f64]) -> f64 {
        let height = drone.state.position.z;
        let record = if memory[0].is_nan() { height } else { memory[0] };
        memory[0] = record.max(height);
        memory[0] - record
    }
}

/// Ends the episode in success two metres above the goal.
#[derive(Debug)]
struct Summit;

impl TerminationFunction for Summit {
    fn name(&self) -> &'static str {
        "summit"
    }

    fn ending(&self) -> Ending {
        Ending::Success
    }

    fn ends(&self, drone: &DroneView<'_>, _memory: &mut [f64]) -> bool {
        drone.state.position.z > drone.goal.z + 2.0
    }
}

fn main() -> Result<(), ConfigError> {
    let (ending, terms) = climb()?;
    println!("{}: {} for records, {} for turning", ending.name(), terms[1], terms[2]);
    Ok(())
}

/// The task with what this program adds to it.
fn scenario() -> Result<Scenario, ConfigError> {
    let document = Document::parse("task.yaml", TASK)?;
    let mut scenario = Scenario::of("climb", &document)?;
    scenario.rewards.push(reward::Custom::new(10.0, Record).into());
    // What remembers nothing is a closure.
    let turning = |drone: &DroneView<'_>| drone.state.body_rates.norm();
    scenario.rewards.push(reward::Custom::from_fn(-0.1, "turning", turning).into());
    scenario.terminations.push(termination::Custom::new(Summit).into());
    let too_low = |drone: &DroneView<'_>| drone.state.position.z < 0.2;
    scenario.terminations.push(termination::Custom::from_fn("too_low", too_low).into());
    scenario.success = kestrel_sim::scenario::Success::Ending;
    Ok(scenario)
}

/// How a climb at full thrust ends, and what each reward term paid.
fn climb() -> Result<(Ending, Vec<f32>), ConfigError> {
    let scenario = scenario()?;
    let mut simulation = Simulation::<64>::new(&scenario, Seed(1), 0, 1);
    let full_thrust = vec![1.0; scenario.action.len()];
    loop {
        simulation.step(&full_thrust);
        if let Some(episode) = simulation.take_episodes().pop() {
            return Ok((episode.ending, episode.terms));
        }
    }
}

#[test]
fn the_summit_is_two_metres_of_records() -> Result<(), ConfigError> {
    let (ending, terms) = climb()?;
    assert_eq!(ending, Ending::Success);
    // Ten for each metre, and what the last control period added.
    assert!((20.0..22.0).contains(&terms[1]), "{terms:?}");
    assert!(terms[2].abs() < 0.01, "{terms:?}");
    Ok(())
}
