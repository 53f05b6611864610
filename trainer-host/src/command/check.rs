//! `kestrel check`.

use std::path::PathBuf;

use anyhow::{Result, bail};
use kestrel_experiments::experiment_config::Experiment;
use kestrel_experiments::output::say;
use kestrel_experiments::run_config::RunConfig;

use super::Done;
use super::run::task_config;

/// Arguments of `kestrel check`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Experiment files, names of shipped tasks, or runs
    #[arg(required = true)]
    tasks: Vec<PathBuf>,

    /// Replace a value of each file, such as training.epochs=2 (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,

    /// Print the whole configuration instead, with every import resolved and every default filled in
    #[arg(long)]
    resolved: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let Arguments { tasks, set, resolved } = arguments;
    if *resolved && tasks.len() > 1 {
        bail!("--resolved: found {} tasks, expected one", tasks.len());
    }
    for path in tasks {
        let config = task_config(path, set)?;
        if *resolved {
            say(config.resolved_yaml().trim_end())?;
            continue;
        }
        let about = match &config {
            RunConfig::One(experiment) => {
                format!("{}, trained by {}", about(experiment), experiment.training.method())
            }
            RunConfig::Several(study) => {
                format!("{} tasks, each with {}", study.tasks.len(), about(&study.tasks[0]))
            }
        };
        say(format_args!("{}: right: {about}", path.display()))?;
    }
    Ok(Done::Finished)
}

/// What a policy sees and commands.
fn about(experiment: &Experiment) -> String {
    let scenario = &experiment.scenario;
    let rate = scenario.physics.control_rate_hz;
    format!("{} observed values, {} actions at {rate} Hz", scenario.observation.len(), scenario.action.len())
}
