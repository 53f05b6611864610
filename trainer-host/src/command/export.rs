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
    /// What to write besides the policy files
    #[arg(long, value_enum, default_value_t = Target::File)]
    target: Target,
}

/// Forms of a policy.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Target {
    /// Policy files only, in fixed point and in float
    File,
    /// A Rust module for firmwares that link kestrel-core: policy.rs
    Rust,
    /// C99 without a library, in fixed point: policy.h and policy.c
    C,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let (directory, experiment) = run::open(&arguments.run, &[])?;
    let (actor, steps) = best_policy(&experiment, &directory)?;
    let report = results::export_policy(&experiment, &directory, &actor, steps)?;
    say(format_args!("{report}\n"))?;
    say(directory.policy().display())?;
    say(directory.policy_f32().display())?;
    match arguments.target {
        Target::File => {}
        Target::Rust => say(results::export_rust(&directory)?.display())?,
        Target::C => {
            for path in results::export_c(&directory)? {
                say(path.display())?;
            }
        }
    }
    Ok(Done::Finished)
}
