//! `kestrel search`.

use std::path::{Path, PathBuf};

use anyhow::Result;
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::output::{say, warn};
use kestrel_experiments::search::runner::{CONFIG, SearchRun};
use kestrel_experiments::search::{Search, config, log, report};
use kestrel_experiments::training_run::End;

use super::Done;
use crate::shipped;

/// Arguments of `kestrel search`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Run a search over all cores, or go on with it, and write its report
    Run(RunArguments),
    /// Write the report of a search, finished or not
    Report {
        /// Directory of the search
        #[arg(value_name = "SEARCH")]
        directory: PathBuf,
    },
}

#[derive(Debug, clap::Args)]
struct RunArguments {
    /// Search file, such as configs/searches/anchor-strength.yaml, or the name of a shipped one: anchor-strength
    config: PathBuf,

    /// Replace a value of the search file, such as trials=8 (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,

    /// Directory of the search [default: searches/NAME]
    #[arg(long, value_name = "DIRECTORY")]
    directory: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    match &arguments.action {
        Action::Run(arguments) => run_search(arguments),
        Action::Report { directory } => report_on(directory, &config::load(&directory.join(CONFIG), &[])?),
    }
}

fn run_search(arguments: &RunArguments) -> Result<Done> {
    let search = config::load(&shipped::configuration("searches", &arguments.config)?, &arguments.set)?;
    let directory = arguments.directory.clone().unwrap_or_else(|| Path::new("searches").join(&search.name));
    let interrupt = Interrupt::watch("Stopping after the updates in progress; Ctrl-C again ends at once.")?;
    let run = SearchRun::open(&search, &directory)?;
    say(format_args!("Searching in {}: {} trials", directory.display(), search.trials))?;
    let tell = |trials: &[_]| warn(report::headline(&search, trials));
    match run.run(rayon::current_num_threads(), &interrupt, tell)? {
        End::Finished => report_on(&directory, &search),
        End::Interrupted => {
            say("Saved. The same command goes on.")?;
            Ok(Done::Interrupted)
        }
    }
}

fn report_on(directory: &Path, search: &Search) -> Result<Done> {
    let trials = log::load(directory, search)?;
    report::write(directory, search, &trials)?;
    say(report::headline(search, &trials))?;
    say(directory.join("report.md").display())?;
    Ok(Done::Finished)
}
