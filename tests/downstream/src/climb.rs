//! A task of drones with a reward and a termination of its own: up, two metres.

use kestrel_core::seed::Seed;
use kestrel_experiments::drone_environment::{DroneEnvironment, Trainer};
use kestrel_learn::environment::evaluate;
use kestrel_learn::ppo::PpoSettings;
use kestrel_learn::regulariser::FineTuning;
use kestrel_learn::schedule::Schedule;
use kestrel_sim::config::{ConfigError, Document, ScenarioConfig};
use kestrel_sim::outcome::Ending;
use kestrel_sim::reward::{self, DroneView, Memory, Paid, RewardFunction};
use kestrel_sim::scenario::{Scenario, Success};
use kestrel_sim::termination::{self, TerminationFunction};

const TASK: &str = "
aviary: { goal_m: [0, 0, 1] }
start: { position: { exactly: [ { position_m: [0, 0, 1] } ] } }
rewards:
  - alive: { weight: 0 }
terminations:
  - tilt: { limit_deg: 90 }
success: { settle: { radius_m: 0.1, within_secs: 4 } }
episode_secs: 4
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

fn task() -> Result<Scenario, ConfigError> {
    let document = Document::parse("task.yaml", TASK)?;
    let mut task = document.decode::<ScenarioConfig>()?.check("climb", &document.root())?;
    task.rewards.push(reward::Custom::new(10.0, Record).into());
    task.terminations.push(termination::Custom::new(Summit).into());
    task.success = Success::Ending;
    Ok(task)
}

/// The mean return of the task before any learning and after it; 20 is the way to the summit.
pub(crate) fn returns() -> Result<[f32; 2], ConfigError> {
    let task = task()?;
    let settings = PpoSettings {
        environments: 256,
        steps_per_rollout: 64,
        minibatch: 4096,
        discount: 0.98,
        learning_rate: Schedule::Constant(3e-3),
        ..PpoSettings::default()
    };
    let mut trainer = Trainer::new(&[task.clone()], &settings, Seed(0));
    let mean = |trainer: &Trainer| {
        let returns = evaluate::<DroneEnvironment>(&task, trainer.actor(), Seed(9), 64);
        returns.iter().sum::<f32>() / returns.len() as f32
    };
    let before = mean(&trainer);
    (0..40).for_each(|_| drop(trainer.update_with(&mut FineTuning)));
    Ok([before, mean(&trainer)])
}
