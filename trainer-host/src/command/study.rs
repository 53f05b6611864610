//! `kestrel study`.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use kestrel_experiments::atomic_file::{FileError, write_atomically};
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::output::say;
use kestrel_experiments::study::data::StudyData;
use kestrel_experiments::study::data::StudyError;
use kestrel_experiments::study::directory::StudyDirectory;
use kestrel_experiments::study::{Study, config, report, runner};
use kestrel_experiments::training_run::End;
use kestrel_learn::ranks::{self, Ranks};

use super::Done;
use crate::membership;
use crate::shipped;

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
    /// Write one page about several studies, finished or not
    Results {
        /// Directories of the studies, in the order of the page
        #[arg(value_name = "STUDY", required = true)]
        directories: Vec<PathBuf>,

        /// The page, in Markdown
        #[arg(long, short, value_name = "FILE")]
        output: PathBuf,

        /// Folder for pictures of the page, from where the page is [default: no pictures]
        #[arg(long, value_name = "FOLDER")]
        pictures: Option<String>,

        /// Leave what the page has about other studies as it is
        #[arg(long)]
        update: bool,
    },
}

#[derive(Debug, clap::Args)]
struct RunArguments {
    /// Study file, such as configs/studies/rooms.yaml, or the name of a shipped one: rooms
    config: PathBuf,

    /// Replace a value of the study file, such as seeds.count=4 (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,

    /// Directory of the study [default: studies/NAME]
    #[arg(long, value_name = "DIRECTORY")]
    directory: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    match &arguments.action {
        Action::Run(arguments) => run_study(arguments),
        Action::Report { directory } => report_on(directory),
        Action::Results { directories, output, pictures, update } => {
            results(directories, output, pictures.as_deref(), *update)
        }
    }
}

fn run_study(arguments: &RunArguments) -> Result<Done> {
    let membership = membership::join()?;
    let ranks = &membership.ranks;
    let study = config::load(&shipped::configuration("studies", &arguments.config)?, &arguments.set)?;
    if ranks.rank() > 0 {
        Interrupt::leave_to_others()?;
        runner::follow(&study, ranks)?;
        return Ok(Done::Finished);
    }
    let done = lead(arguments, &study, ranks);
    ranks::end(ranks);
    done
}

/// Runs a study as the first of the ranks, or as the only one.
fn lead(arguments: &RunArguments, study: &Study, ranks: &Arc<dyn Ranks>) -> Result<Done> {
    let directory = arguments.directory.clone().unwrap_or_else(|| Path::new("studies").join(&study.name));
    let interrupt = Interrupt::watch("Stopping after the updates in progress; Ctrl-C again ends at once.")?;
    let study_directory = StudyDirectory::open(study, &directory)?;
    let jobs = study.jobs();
    let left = jobs.iter().filter(|job| !study_directory.is_done(**job)).count();
    say(format_args!("{left} of {} jobs are left to run in {}", jobs.len(), directory.display()))?;
    match runner::run(&[study_directory], rayon::current_num_threads(), &interrupt, ranks)? {
        End::Finished => report_on(&directory),
        End::Interrupted => {
            say("Saved. The same command goes on.")?;
            Ok(Done::Interrupted)
        }
    }
}

fn results(directories: &[PathBuf], output: &Path, pictures: Option<&str>, update: bool) -> Result<Done> {
    let studies = directories.iter().map(|directory| load(directory)).collect::<Result<Vec<_>>>()?;
    let mut page = report::page(&studies, pictures);
    if update && output.exists() {
        let earlier = fs::read_to_string(output).map_err(|cause| FileError::new("read", output, cause))?;
        page.keep(&earlier).with_context(|| output.display().to_string())?;
    }
    if let Some(folder) = pictures {
        let folder = output.parent().unwrap_or(Path::new("")).join(folder);
        fs::create_dir_all(&folder).map_err(|cause| FileError::new("create", &folder, cause))?;
        for (name, picture) in &page.pictures {
            write_atomically(&folder.join(name), picture.as_bytes())?;
        }
    }
    write_atomically(output, page.text().as_bytes())?;
    say(output.display())?;
    Ok(Done::Finished)
}

fn load(directory: &Path) -> Result<StudyData> {
    if !directory.join("study.json").is_file() {
        let expected = "expected a directory made by `kestrel study run`, found no study.json";
        anyhow::bail!("{} holds no study: {expected}", directory.display());
    }
    StudyData::load(directory).map_err(advised)
}

fn report_on(directory: &Path) -> Result<Done> {
    let data = load(directory)?;
    report::write(directory, &data)?;
    say(report::headline(&data))?;
    say(directory.join("report.md").display())?;
    Ok(Done::Finished)
}

/// Rows that somebody has changed can be had again.
fn advised(error: StudyError) -> anyhow::Error {
    match &error {
        StudyError::Row { path, .. } => {
            let advice = format!("; remove {} and run the study again to get it back", path.display());
            anyhow::anyhow!("{error}{advice}")
        }
        StudyError::File(_) | StudyError::Json { .. } | StudyError::Manifest { .. } => error.into(),
    }
}
