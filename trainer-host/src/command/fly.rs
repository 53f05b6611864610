//! `kestrel fly`.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use kestrel_train::fly::{FlyOptions, Place, fly};
use kestrel_train::interrupt::Interrupt;

use super::{Done, run};

/// Arguments of `kestrel fly`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Directory of a run, or a policy file
    #[arg(value_name = "RUN|POLICY")]
    pilot: PathBuf,

    #[command(flatten)]
    options: FlyOptions,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let interrupt = Interrupt::watch("Ending the flight.")?;
    let stop = || interrupt.requested();
    let path = &arguments.pilot;
    let summary = if path.is_dir() {
        let (directory, experiment) = run::open(path, &[])?;
        let policy = read(&directory.policy())?;
        fly(Place::Scenario(&experiment.scenario), &policy, &arguments.options, &stop)
    } else {
        fly(Place::FlatFloor, &read(path)?, &arguments.options, &stop)
    }
    .with_context(|| path.display().to_string())?;
    let position = summary.position;
    println!(
        "Flew {:.1} s; ended {:?} at x {:.2}, y {:.2}, z {:.2} m.",
        summary.secs, summary.mode, position.x, position.y, position.z
    );
    Ok(Done::Finished)
}

fn read(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).with_context(|| format!("cannot read the policy {}", path.display()))
}
