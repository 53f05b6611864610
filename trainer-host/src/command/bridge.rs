//! `kestrel bridge`.

use std::path::PathBuf;

use crate::bridge::lend;
use anyhow::Result;
use kestrel_experiments::experiment_config;
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::output::say;
use kestrel_shim::bridge::BridgeOptions;

use super::Done;
use crate::shipped;

/// Arguments of `kestrel bridge`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Experiment file, or name, of the task in whose aviary to fly
    config: PathBuf,

    #[command(flatten)]
    bridge: BridgeOptions,

    /// Change a value of the configuration, such as `scenario.episode_secs=5`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,

    /// Write the true state of every step to this file, one JSON object per line
    #[arg(long, value_name = "FILE")]
    true_state_log: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let interrupt = Interrupt::watch("Ending the simulation.")?;
    let experiment = experiment_config::load(&shipped::task(&arguments.config)?, &arguments.overrides)?;
    let log = arguments.true_state_log.as_deref();
    let counts = lend(&experiment.scenario, &arguments.bridge, log, &|| interrupt.requested())?;
    say(counts)?;
    Ok(Done::Finished)
}
