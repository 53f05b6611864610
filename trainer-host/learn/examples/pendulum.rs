//! Swings up Gymnasium's Pendulum-v1 with PPO and compares the result with the published one.
//!
//! `cargo run --release -p kestrel-learn --example pendulum [-- SEED]`
//!
//! rl-baselines3-zoo publishes −172 ± 104 for PPO after 100 000 steps (`benchmark.md` of DLR-RM/rl-baselines3-zoo: one
//! run, 750 episodes of the mean action, ± is the standard deviation over episodes), with state-dependent exploration
//! and four environments. Here seeds 0 to 5 come to −217 to −270: a batch has at least 256 environments, which then
//! have seen no more than two episodes. With 32 steps per rollout and a step size of 1e-3 they come to −223 to −256
//! after 300 000 steps, and to −174 to −237 after a million. Without a lower limit of the standard deviation it
//! shrinks to a tenth before a pendulum is up, and returns are −230 to −900.

use std::error::Error;

use kestrel_core::seed::Seed;
use kestrel_learn::environment::evaluate;
use kestrel_learn::pendulum::{Pendulum, SwingUp};
use kestrel_learn::ppo::{PpoSettings, Trainer};
use kestrel_learn::schedule::Schedule;

fn main() -> Result<(), Box<dyn Error>> {
    let seed = std::env::args().nth(1).map_or(Ok(0), |seed| seed.parse())?;
    let settings = PpoSettings {
        environments: 256,
        steps_per_rollout: 8,
        total_steps: 100_000,
        epochs: 10,
        minibatch: 256,
        discount: 0.9,
        gae_lambda: 0.95,
        clip_range: 0.2,
        learning_rate: Schedule::Constant(3e-3),
        initial_log_std: -0.7,
        lowest_log_std: -1.0,
        reward_scale: 0.05,
        ..PpoSettings::default()
    };
    let mut trainer = Trainer::<Pendulum>::new(&[SwingUp], &settings, Seed(seed));
    while trainer.steps() < settings.total_steps {
        let metrics = trainer.update();
        if let Some(episode_return) = metrics.episode_return {
            println!("{:>7} steps: mean return of a training episode {episode_return:.0}", metrics.steps);
        }
    }
    let returns = evaluate::<Pendulum>(&SwingUp, trainer.actor(), Seed(seed + 1), 750);
    let mean = returns.iter().sum::<f32>() / returns.len() as f32;
    let variance = returns.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / returns.len() as f32;
    println!("{:>7} steps: {mean:.0} ± {:.0}, published −172 ± 104", trainer.steps(), variance.sqrt());
    Ok(())
}
