//! `kestrel export`.

use std::path::PathBuf;

use anyhow::Result;
use kestrel_train::output::say;
use kestrel_train::results;
use kestrel_train::training_run::best_policy;

use super::{Done, run};

/// Arguments of `kestrel export`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Directory of the run
    run: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let (directory, experiment) = run::open(&arguments.run, &[])?;
    let (actor, steps) = best_policy(&experiment, &directory)?;
    let report = results::export_policy(&experiment, &directory, &actor, steps)?;
    say(format_args!("{report}\n"))?;
    say(directory.policy().display())?;
    say(directory.policy_f32().display())?;
    Ok(Done::Finished)
}
