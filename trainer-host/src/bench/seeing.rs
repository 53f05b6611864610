//! Lines for the training of policies that see.

use std::time::Duration;

use kestrel_sim::seed::Seed;

use super::{Figure, best_rate};
use kestrel_experiments::drone_environment::Trainer;
use kestrel_experiments::experiment_config::Experiment;

/// A way to train a policy that sees, and where we want it to be.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seeing {
    /// What is counted.
    pub(crate) what: &'static str,
    /// Experiment file in the folder of tasks.
    pub(crate) file: &'static str,
    /// Changes of its configuration.
    pub(crate) overrides: &'static [&'static str],
    /// Steps per second of all cores.
    pub(crate) aim: f64,
    limit: &'static str,
}

const PRODUCTS: &str = "matrix products of the eye, forward once and both ways in each epoch";

/// The reference's network and settings (features, heads, minibatch; 256 environments take the place of 8 that are stepped
/// for longer), the same with large minibatches, and what a task with a camera has by default.
pub(crate) const SEEING: [Seeing; 4] = [
    Seeing {
        what: "PPO steps, NatureCNN, 10 epochs of 64, all cores",
        file: "harder-cross-11-vision.yaml",
        overrides: &[
            "scenario.camera={paper: {}}",
            "training.eye.network={nature: {features: 256}}",
            "training.environments=256",
            "training.steps_per_rollout=16",
            "training.minibatch=64",
            "training.epochs=10",
        ],
        aim: 1e3,
        limit: PRODUCTS,
    },
    Seeing {
        what: "PPO steps, NatureCNN, 4 epochs, all cores",
        file: "harder-cross-11-vision.yaml",
        overrides: NATURE_4,
        aim: 2.5e3,
        limit: PRODUCTS,
    },
    Seeing {
        what: "PPO steps, NatureCNN, 1 epoch, all cores",
        file: "harder-cross-11-vision.yaml",
        overrides: NATURE_1,
        aim: 7.5e3,
        limit: PRODUCTS,
    },
    Seeing {
        what: "PPO steps, small eye, 4 epochs, all cores",
        file: "harder-cross-11-vision.yaml",
        overrides: &[],
        aim: 10e3,
        limit: PRODUCTS,
    },
];

const NATURE_4: &[&str] = &[
    "scenario.camera={paper: {channels: [rgb]}}",
    "training.eye.network={nature: {features: 512}}",
    "training.environments=256",
    "training.steps_per_rollout=32",
    "training.minibatch=2048",
    "training.epochs=4",
];

const NATURE_1: &[&str] = &[NATURE_4[0], NATURE_4[1], NATURE_4[2], NATURE_4[3], NATURE_4[4], "training.epochs=1"];

/// Environment steps per second of training, rollout and optimisation, on all cores.
pub(crate) fn seeing(seeing: &Seeing, experiment: &Experiment, duration: Duration) -> Figure {
    let mut trainer = Trainer::new(std::slice::from_ref(&experiment.scenario), &experiment.training.ppo, Seed(0));
    trainer.update();
    let per_second = best_rate(duration, || {
        let before = trainer.steps();
        trainer.update();
        trainer.steps() - before
    });
    Figure { what: seeing.what.to_owned(), per_second, aim: seeing.aim, limit: seeing.limit }
}
