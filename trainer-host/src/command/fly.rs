//! `kestrel fly`.

use std::path::PathBuf;
use std::sync::mpsc::Sender;

use crate::fly::{FlightSummary, FlyOptions, Place, fly};
use anyhow::{Error, Result, ensure};
use kestrel_draw::viewer::Glimpse;
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::output::say;
use kestrel_experiments::run_config::RunConfig;
use kestrel_shim::policy_bytes::PolicyBytes;

use super::{Done, run};
use crate::audience::{Desktop, before_window, filming};
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

    /// Fly in the aviary of this task, by name or file, wherever the policy was trained
    #[arg(long, value_name = "TASK", conflicts_with = "task")]
    aviary: Option<PathBuf>,

    #[command(flatten)]
    options: FlyOptions,

    /// Show the flight in a window while it is flown; whoever closes it ends the flight
    #[arg(long)]
    view: bool,

    /// Write a film of the flight, of its last ten minutes, to this file: .gif or .mp4
    #[arg(long, value_name = "FILE", conflicts_with = "view")]
    headless: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let interrupt = Interrupt::watch("Ending the flight.")?;
    let summary = match &arguments.headless {
        _ if arguments.view => {
            let title = format!("kestrel: {}", arguments.pilot.display());
            let end = || interrupt.request();
            before_window(Desktop::open()?, &title, &end, |tell| flown(arguments, &interrupt, Some(tell)))?
        }
        Some(path) => filming(path, |tell| flown(arguments, &interrupt, Some(tell)))?,
        None => flown(arguments, &interrupt, None),
    }?;
    let position = summary.position;
    say(format_args!(
        "Flew {:.1} s; ended {:?} at x {:.2}, y {:.2}, z {:.2} m.",
        summary.secs, summary.mode, position.x, position.y, position.z
    ))?;
    say(format_args!("Pace: {}.", summary.timing))?;
    Ok(Done::Finished)
}

fn flown(arguments: &Arguments, interrupt: &Interrupt, tell: Option<Sender<Glimpse>>) -> Result<FlightSummary> {
    let stop = || interrupt.requested();
    let path = &shipped::run(&arguments.pilot)?;
    let aviary = match &arguments.aviary {
        Some(task) => Some(RunConfig::load(&shipped::task(task)?, &[])?),
        None => None,
    };
    let elsewhere = aviary.as_ref().map(|config| config.task(None).map(Place::Aviary)).transpose()?;
    let summary = if path.is_dir() {
        let (directory, config) = run::open(path, &[])?;
        let policy = PolicyBytes::read(&directory.exported_policy()?)?;
        let place = match elsewhere {
            Some(place) => place,
            None => Place::Task(config.task(arguments.task.as_deref())?),
        };
        fly(place, policy.bytes(), &arguments.options, &stop, tell)
    } else {
        ensure!(arguments.task.is_none(), "found --task beside a policy file, expected the directory of a run");
        fly(
            elsewhere.unwrap_or(Place::FlatFloor),
            PolicyBytes::read(path)?.bytes(),
            &arguments.options,
            &stop,
            tell,
        )
    };
    summary.map_err(|error| {
        let of_the_pilot = error.is_of_the_pilot();
        let error = Error::from(error);
        if of_the_pilot { error.context(path.display().to_string()) } else { error }
    })
}
