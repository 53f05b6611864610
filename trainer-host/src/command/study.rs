//! `kestrel study`.

use std::path::{Path, PathBuf};
use std::thread::available_parallelism;

use anyhow::Result;
use kestrel_train::interrupt::Interrupt;
use kestrel_train::output::say;
use kestrel_train::study::data::StudyData;
use kestrel_train::study::runner::StudyRun;
use kestrel_train::study::{config, report};
use kestrel_train::training_run::End;

use super::Done;

/// Arguments of `kestrel study`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Run a study over all cores, or go on with it, and write its report
    Run(RunArguments),
    /// Write the report of a study, finished or not
    Report {
        /// Directory of the study
        #[arg(value_name = "STUDY")]
        directory: PathBuf,
    },
}

#[derive(Debug, clap::Args)]
struct RunArguments {
    /// Study file, such as configs/studies/rooms.yaml
    config: PathBuf,

    /// Replace a value of the study file, such as seeds.count=4 (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,

    /// Directory of the study [default: studies/NAME]
    #[arg(long, value_name = "DIRECTORY")]
    directory: Option<PathBuf>,

    /// Threads to use; the results do not depend on it [default: all cores]
    #[arg(long, value_name = "NUMBER", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    match &arguments.action {
        Action::Run(arguments) => run_study(arguments),
        Action::Report { directory } => report_on(directory),
    }
}

fn run_study(arguments: &RunArguments) -> Result<Done> {
    let study = config::load(&arguments.config, &arguments.set)?;
    let directory = arguments.directory.clone().unwrap_or_else(|| Path::new("studies").join(&study.name));
    let cores = available_parallelism().map_or(1, usize::from);
    let threads = arguments.threads.map_or(cores, usize::from);
    let interrupt = Interrupt::watch("Stopping after the updates in progress; Ctrl-C again ends at once.")?;
    let run = StudyRun::open(&study, &directory)?;
    say(format_args!("Running {} jobs in {}", study.jobs().len(), directory.display()))?;
    match run.run(threads, &interrupt)? {
        End::Finished => report_on(&directory),
        End::Interrupted => {
            say("Saved. The same command goes on.")?;
            Ok(Done::Interrupted)
        }
    }
}

fn report_on(directory: &Path) -> Result<Done> {
    let data = StudyData::load(directory)?;
    report::write(directory, &data)?;
    say(report::headline(&data))?;
    say(directory.join("report.md").display())?;
    Ok(Done::Finished)
}
