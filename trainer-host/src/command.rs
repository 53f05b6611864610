//! What the command line can do, one module a command.

mod aviary;
mod baseline;
mod bench;
mod bridge;
mod check;
pub(crate) mod completions;
mod evaluate;
mod export;
mod flight;
mod fly;
mod identify;
mod import;
mod inspect;
mod json;
pub(crate) mod look;
mod new;
mod render;
mod replay;
mod run;
mod runs;
mod schema;
mod search;
mod study;
mod table;
mod test;
mod train;
#[cfg(feature = "verify")]
mod verify;
mod view;

use anyhow::Result;
use clap::Subcommand;

/// Shown below the help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  kestrel train configs/hover.yaml                 train, evaluate, export and draw
  kestrel train configs/hover.yaml --seed 3 --set training.epochs=2
  kestrel train --resume runs/hover-seed0-1        go on with an interrupted run
  kestrel fly runs/hover-seed0-1                   a MAVLink vehicle that the policy flies";

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Train a policy; then evaluate, export and draw it
    Train(train::Arguments),
    /// Fly a run's policy from many starts, beside the baselines
    Evaluate(evaluate::Arguments),
    /// Fly a task without a policy: doing nothing, at random, by a script
    Baseline(baseline::Arguments),
    /// Write a task of your own, from a shipped one, to be changed
    New(new::Arguments),
    /// Say whether a task's file is right, or what it comes to with all imports and defaults
    Check(check::Arguments),
    /// Write a run's best policy as policy files
    Export(export::Arguments),
    /// Make policies of a network that Stable-Baselines3, CleanRL, JAX or others trained
    Import(import::Arguments),
    /// Say what a policy file is, and what it would cost a microcontroller
    Inspect(inspect::Arguments),
    /// Fly a policy as a MAVLink vehicle in the simulator
    Fly(Box<fly::Arguments>),
    /// Fly scripted flights with faults, and judge them by the true state
    Test(test::Arguments),
    /// Lend a task's aviary to another autopilot: PX4, ArduPilot or Betaflight
    Bridge(bridge::Arguments),
    /// Find a drone's airframe, with its uncertainty, in logs of its flights
    Identify(identify::Arguments),
    /// Compare the simulator with a recording of the reference system, or of real flights
    #[cfg(feature = "verify")]
    Verify(verify::Arguments),
    /// Show a flight as cameras see it: from behind, on board, depth, labels
    Render(render::Arguments),
    /// Look at a flight in a window, or write what it would show to a file
    View(view::Arguments),
    /// Write a flight as a film, plots, a table, or ROS 2 messages
    Replay(replay::Arguments),
    /// List runs, and in what they differ
    Runs(runs::Arguments),
    /// Run a study of many trainings, and report it
    Study(study::Arguments),
    /// Search settings with which a study does best
    Search(search::Arguments),
    /// List the aviaries and draw their plans
    Aviary(aviary::Arguments),
    /// Print the JSON schema of experiment, study, search or test files
    Schema(schema::Arguments),
    /// Measure every scene on this machine
    Bench(bench::Arguments),
    /// Print a completion script for a shell
    Completions(completions::Arguments),
}

/// How a command ended that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Done {
    /// It did everything.
    Finished,
    /// It did everything, and what it measured is beyond a tolerance.
    Deviating,
    /// The user stopped it.
    Interrupted,
}

impl Command {
    pub(crate) fn run(self) -> Result<Done> {
        match self {
            Self::Train(arguments) => train::run(&arguments),
            Self::Evaluate(arguments) => evaluate::run(&arguments),
            Self::Baseline(arguments) => baseline::run(&arguments),
            Self::New(arguments) => new::run(&arguments),
            Self::Check(arguments) => check::run(&arguments),
            Self::Export(arguments) => export::run(&arguments),
            Self::Import(arguments) => import::run(&arguments),
            Self::Inspect(arguments) => inspect::run(&arguments),
            Self::Fly(arguments) => fly::run(&arguments),
            Self::Test(arguments) => test::run_tests(&arguments),
            Self::Bridge(arguments) => bridge::run(&arguments),
            Self::Identify(arguments) => identify::run(&arguments),
            #[cfg(feature = "verify")]
            Self::Verify(arguments) => verify::run(&arguments),
            Self::Render(arguments) => render::run(&arguments),
            Self::View(arguments) => view::run(&arguments),
            Self::Replay(arguments) => replay::run(&arguments),
            Self::Runs(arguments) => runs::run(&arguments),
            Self::Study(arguments) => study::run(&arguments),
            Self::Search(arguments) => search::run(&arguments),
            Self::Aviary(arguments) => aviary::run(&arguments),
            Self::Bench(arguments) => bench::run(&arguments),
            Self::Schema(arguments) => schema::print(&arguments),
            Self::Completions(arguments) => {
                completions::print(&arguments)?;
                Ok(Done::Finished)
            }
        }
    }
}
