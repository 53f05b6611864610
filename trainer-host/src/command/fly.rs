//! `kestrel fly`.

use std::path::PathBuf;

use crate::fly::{FlyOptions, Place, fly};
use anyhow::{Error, Result, ensure};
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::output::say;
use kestrel_shim::policy_bytes::PolicyBytes;

use super::{Done, run};
use crate::shipped;

/// Arguments of `kestrel fly`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Directory of a run, a policy file, or the name of a pilot that comes with the program
    #[arg(value_name = "RUN|POLICY|PILOT")]
    pilot: PathBuf,

    /// In which task of a run that has several [default: the first]
    #[arg(long, value_name = "NAME")]
    task: Option<String>,

    #[command(flatten)]
    options: FlyOptions,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let interrupt = Interrupt::watch("Ending the flight.")?;
    let stop = || interrupt.requested();
    let path = &shipped::run(&arguments.pilot)?;
    let summary = if path.is_dir() {
        let (directory, config) = run::open(path, &[])?;
        let policy = PolicyBytes::read(&directory.exported_policy()?)?;
        fly(Place::Task(config.task(arguments.task.as_deref())?), policy.bytes(), &arguments.options, &stop)
    } else {
        ensure!(arguments.task.is_none(), "found --task beside a policy file, expected the directory of a run");
        fly(Place::FlatFloor, PolicyBytes::read(path)?.bytes(), &arguments.options, &stop)
    }
    .map_err(|error| {
        let of_the_pilot = error.is_of_the_pilot();
        let error = Error::from(error);
        if of_the_pilot { error.context(path.display().to_string()) } else { error }
    })?;
    let position = summary.position;
    say(format_args!(
        "Flew {:.1} s; ended {:?} at x {:.2}, y {:.2}, z {:.2} m.",
        summary.secs, summary.mode, position.x, position.y, position.z
    ))?;
    say(format_args!("Pace: {}.", summary.timing))?;
    Ok(Done::Finished)
}
