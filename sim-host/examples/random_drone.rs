//! Drones that command at random: the smallest program around a [`Simulation`].
//!
//! `cargo run --release -p kestrel-sim --example random_drone`

use kestrel_sim::config::{ConfigError, Document};
use kestrel_sim::outcome::Episode;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::{Purpose, Seed, Stream};
use kestrel_sim::simulation::Simulation;

/// What is left out has defaults; `configs/schema.json` explains every key.
const TASK: &str = "
aviary: { goal_m: [0, 0, 1] }
start: { position: { around_goal: { farthest_m: 0.5 } } }
rewards:
  - proximity: { weight: 1, scale_m: 0.5 }
terminations:
  - collision
  - distance: { limit_m: 2 }
success: { settle: { radius_m: 0.1, within_secs: 4 } }
";

/// Drones that fly side by side.
const DRONES: usize = 64;

fn main() -> Result<(), ConfigError> {
    for episode in episodes(100)? {
        let Episode { environment, steps, total_reward, ending, .. } = episode;
        println!("drone {environment}: {} after {steps} control periods, return {total_reward:.2}", ending.name());
    }
    Ok(())
}

/// The episodes that end within some control periods.
fn episodes(periods: usize) -> Result<Vec<Episode>, ConfigError> {
    let document = Document::parse("task.yaml", TASK)?;
    let scenario = Scenario::of("random", &document)?;
    let mut simulation = Simulation::<64>::new(&scenario, Seed(1), 0, DRONES);
    let mut noise = Stream::new(Seed(1), 0, Purpose::Actions);
    // Actions are columns: the first value of every drone, then the second of every drone, …
    let mut actions = vec![0.0; scenario.action.len() * DRONES];
    for _ in 0..periods {
        actions.fill_with(|| noise.between(-1.0, 1.0));
        simulation.step(&actions);
    }
    Ok(simulation.take_episodes())
}

#[test]
fn random_actions_lose_drones() -> Result<(), ConfigError> {
    let episodes = episodes(100)?;
    assert!(episodes.len() > DRONES / 2, "{}", episodes.len());
    assert!(episodes.iter().any(|episode| episode.ending.is_failure()));
    Ok(())
}
