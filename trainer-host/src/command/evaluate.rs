//! `kestrel evaluate`.

use std::path::{Path, PathBuf};

use crate::processor::{Judged, ProcessorOptions, RemoteKind, compare, fly_beside};
use anyhow::{Context, Result, bail, ensure};
use kestrel_core::pilot::StatePolicy;
use kestrel_experiments::experiment_config::Experiment;
use kestrel_experiments::output::say;
use kestrel_experiments::progress::Progress;
use kestrel_experiments::results::{self, JudgedPolicy};
use kestrel_experiments::run_directory::RunDirectory;
use serde_json::json;

use super::json::Json;
use super::{Done, run, table};
use crate::shipped;

/// Arguments of `kestrel evaluate`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Directory of a run, or the name of a pilot that comes with the program; with --tasks any number of them, and of
    /// policy files
    #[arg(value_name = "RUN|POLICY|PILOT", required = true)]
    subjects: Vec<PathBuf>,

    /// Fly the fixed-point policies in these tasks, and print how each does in each: experiment files, names of shipped tasks, or
    /// directories of runs
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with_all = ["record", "processor", "task"])]
    tasks: Vec<PathBuf>,

    /// Only this task of a run that has several
    #[arg(long, value_name = "NAME")]
    task: Option<String>,

    /// Starts to fly from [default: the experiment's]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    episodes: Option<u64>,

    /// What the starts follow from [default: the experiment's]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    seed: Option<u64>,

    /// Change a value of the configuration, of every task, such as `evaluation.seed=7` (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,

    /// Keep the policy's first episode in this file, for `kestrel replay`
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,

    /// With another processor, it flies the fixed-point policy beside this machine, and nothing else is flown
    #[command(flatten)]
    processor: ProcessorOptions,

    #[command(flatten)]
    json: Json,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let episodes = arguments.episodes.map(|episodes| format!("evaluation.episodes={episodes}"));
    let seed = arguments.seed.map(|seed| format!("evaluation.seed={seed}"));
    let overrides: Vec<String> = arguments.set.iter().cloned().chain(episodes).chain(seed).collect();
    if !arguments.tasks.is_empty() {
        return fly_tasks(arguments, &overrides);
    }
    let [subject] = arguments.subjects.as_slice() else {
        bail!("found {} runs, expected one, or tasks to fly in: --tasks FILE…", arguments.subjects.len());
    };
    let path = &shipped::run(subject)?;
    ensure!(
        !path.is_file(),
        "{}: found a file, expected the directory of a run, or tasks to fly in: --tasks FILE…",
        path.display()
    );
    let (directory, config) = run::open(path, &overrides)?;
    directory.exported_policy()?;
    let task = config.task(arguments.task.as_deref())?;
    if let Some(remote) = arguments.processor.remote()? {
        return fly_elsewhere(arguments, remote, &directory, task);
    }
    let mut subject = config.subject();
    if arguments.task.is_some() {
        subject.tasks = std::slice::from_ref(task);
    }
    let reports = results::evaluate_run(&subject, &directory)?;
    arguments.json.tell(table::evaluations(&reports), &reports)?;
    if let Some(path) = &arguments.record {
        results::record_run(task, &directory)?.write(path)?;
        arguments.json.add(format_args!("\nRecorded: kestrel replay {}", path.display()))?;
    }
    Ok(Done::Finished)
}

/// Flies the fixed-point policy on another processor beside this machine.
fn fly_elsewhere(
    arguments: &Arguments,
    remote: RemoteKind<'_>,
    directory: &RunDirectory,
    task: &Experiment,
) -> Result<Done> {
    ensure!(
        arguments.record.is_none(),
        "found --record beside --processor {}, expected one of them",
        remote.name()
    );
    let mut progress = Progress::counting("episodes", task.evaluation.episodes as u64, 0);
    let shown = |done| progress.show_steps(done, String::new);
    let file = results::checked_policy(task, directory)?;
    let policy = StatePolicy::parse(&file).with_context(|| directory.policy().display().to_string())?;
    let scenario = &task.evaluation.scenario;
    let judged = Judged { scenario, starts: results::starts(task), file: &file, policy };
    let done = match remote {
        RemoteKind::Qemu(_) => {
            let comparison = compare(&judged, remote, shown)?;
            progress.finish();
            say(comparison)?;
            if comparison.different == 0 { Done::Finished } else { Done::Deviating }
        }
        RemoteKind::Program(_) => {
            let flown = fly_beside(&judged, remote, shown)?;
            progress.finish();
            say(flown)?;
            Done::Finished
        }
    };
    Ok(done)
}

/// The policy of a run, of a file or of a name.
fn judged(subject: &Path) -> Result<JudgedPolicy> {
    Ok(JudgedPolicy::read(&shipped::run(subject)?)?)
}

/// Flies every policy in every task, after all of them fit.
fn fly_tasks(arguments: &Arguments, overrides: &[String]) -> Result<Done> {
    let mut tasks: Vec<Experiment> = Vec::new();
    for path in &arguments.tasks {
        tasks.extend_from_slice(run::task_config(path, overrides)?.subject().tasks);
    }
    let policies = arguments.subjects.iter().map(|subject| judged(subject)).collect::<Result<Vec<_>>>()?;
    for task in &tasks {
        policies.iter().try_for_each(|policy| policy.check(task))?;
    }
    let mut progress = Progress::counting("tasks", tasks.len() as u64, 0);
    let mut flown = Vec::new();
    for task in &tasks {
        flown.push(policies.iter().map(|policy| policy.evaluate(task)).collect::<Result<Vec<_>, _>>()?);
        progress.show_steps(flown.len() as u64, String::new);
    }
    progress.finish();
    let names: Vec<String> = tasks.into_iter().map(|task| task.name).collect();
    let subjects: Vec<String> = arguments.subjects.iter().map(|path| path.display().to_string()).collect();
    let cells = names.iter().zip(&flown).flat_map(|(task, row)| {
        subjects
            .iter()
            .zip(row)
            .map(move |(policy, evaluation)| json!({ "policy": policy, "task": task, "evaluation": evaluation }))
    });
    arguments.json.tell(table::matrix(&subjects, &names, &flown), &cells.collect::<Vec<_>>())?;
    Ok(Done::Finished)
}
