//! `kestrel train`.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use anyhow::{Context, Result};
use kestrel_experiments::diagnosis;
use kestrel_experiments::experiment_config::Experiment;
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::multi_task_run::MultiTaskRun;
use kestrel_experiments::output::say;
use kestrel_experiments::results;
use kestrel_experiments::run_config::{RunConfig, Subject};
use kestrel_experiments::run_directory::RunDirectory;
use kestrel_experiments::study::{Study, runner};
use kestrel_experiments::training_run::{self, End, TrainingError, TrainingRun};
use kestrel_experiments::watch::{NewestPolicy, fly_newest};
use kestrel_learn::actor_critic::Actor;
use kestrel_learn::ranks::{self, Ranks};

use super::{Done, table};
use crate::audience::{Desktop, before_window};
use crate::{membership, shipped};

/// Arguments of `kestrel train`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Experiment file, or name of a shipped task, such as hover; also of several tasks, such as crosses
    #[arg(required_unless_present = "resume", conflicts_with = "resume")]
    config: Option<PathBuf>,

    /// Go on with the run in this directory
    #[arg(long, value_name = "RUN")]
    resume: Option<PathBuf>,

    /// What all randomness follows from; short for --set training.seed=NUMBER
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true, conflicts_with = "resume")]
    seed: Option<u64>,

    /// Replace a value of the experiment file, such as training.epochs=2 (repeatable)
    #[arg(long, value_name = "KEY=VALUE", conflicts_with = "resume")]
    set: Vec<String>,

    /// Directory of the run [default: runs/NAME-seedSEED-N with the first free N]
    #[arg(long, value_name = "DIRECTORY", conflicts_with = "resume")]
    run: Option<PathBuf>,

    /// Show the newest policy in a window while it is trained, in the starts of the evaluation, in real time; no result depends
    /// on it
    #[arg(long)]
    watch: bool,

    /// Begin anew in a directory of --run that holds a run, which is lost
    #[arg(long, requires = "run")]
    force: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let membership = membership::join()?;
    let ranks = &membership.ranks;
    let config = config(arguments)?;
    if ranks.rank() > 0 {
        Interrupt::leave_to_others()?;
        match &config {
            RunConfig::One(experiment) => training_run::follow(experiment, ranks)?,
            RunConfig::Several(study) => runner::follow(study, ranks)?,
        }
        return Ok(Done::Finished);
    }
    let done = lead(arguments, config, ranks);
    ranks::end(ranks);
    done
}

/// Trains as the first of the ranks, or as the only one.
fn lead(arguments: &Arguments, config: RunConfig, ranks: &Arc<dyn Ranks>) -> Result<Done> {
    let interrupt = Interrupt::watch("Stopping after the step in progress; Ctrl-C again ends at once.")?;
    let desktop = arguments.watch.then(Desktop::open).transpose()?;
    let directory = directory(arguments, &config)?;
    let means = Means { ranks, interrupt: &interrupt, desktop };
    match config {
        RunConfig::One(experiment) => lead_one(arguments, *experiment, directory, means),
        RunConfig::Several(study) => lead_several(arguments, &study, directory, means),
    }
}

/// With what it is done.
struct Means<'a> {
    ranks: &'a Arc<dyn Ranks>,
    interrupt: &'a Interrupt,
    /// To look at it.
    desktop: Option<Desktop>,
}

fn lead_one(
    arguments: &Arguments,
    experiment: Experiment,
    directory: RunDirectory,
    Means { ranks, interrupt, desktop }: Means<'_>,
) -> Result<Done> {
    let mut run = if arguments.resume.is_some() {
        TrainingRun::resume(experiment, directory)?
    } else {
        TrainingRun::begin(experiment, directory)?
    };
    run.work_with(ranks)?;
    let experiment = run.experiment();
    begun(run.directory(), experiment.training.method(), [run.steps(), experiment.total_steps()])?;
    let silent = experiment.silent_rewards();
    if !silent.is_empty() {
        say(format_args!("No gradient goes through these rewards, which teach nothing: {}", silent.join(", ")))?;
    }
    let tasks = [run.experiment().clone()];
    let end = watched(desktop, &tasks, |newest| {
        if let Some(newest) = newest {
            run.show_to(newest);
        }
        run.train(interrupt)
    })?;
    if end == End::Interrupted {
        return saved(run.directory(), run.steps());
    }
    let (actor, steps) = run.best();
    let [trained, secs] = [run.steps() as f64, run.training_secs()];
    say(format_args!("Trained {trained} steps in {secs:.1} s; the best policy is that after {steps} steps.\n"))?;
    finish(&Subject::of(run.experiment()), run.directory(), (actor, steps), interrupt)
}

fn lead_several(
    arguments: &Arguments,
    study: &Study,
    directory: RunDirectory,
    Means { ranks, interrupt, desktop }: Means<'_>,
) -> Result<Done> {
    let mut run = if arguments.resume.is_some() {
        MultiTaskRun::resume(study, directory)?
    } else {
        MultiTaskRun::begin(study, directory)?
    };
    run.work_with(ranks)?;
    let method = format!("PPO, {} tasks {}", study.tasks.len(), study.methods[0].procedure.manner());
    begun(run.directory(), &method, [run.steps(), run.total_steps()])?;
    let end = watched(desktop, &study.tasks, |newest| {
        if let Some(newest) = newest {
            run.show_to(newest);
        }
        run.train(interrupt)
    })?;
    if end == End::Interrupted {
        return saved(run.directory(), run.steps());
    }
    let subject = Subject { name: &study.name, seed: study.seeds[0], tasks: &study.tasks };
    say(format_args!("Trained {} steps in {:.1} s.\n", run.steps(), run.training_secs()))?;
    say(format_args!("{}\n", table::stages(subject.tasks, run.flights())))?;
    finish(&subject, run.directory(), (&run.actor(), run.steps()), interrupt)
}

/// Trains, before a window if that is asked for: there the tasks are flown with the policy that training shows.
fn watched(
    desktop: Option<Desktop>,
    tasks: &[Experiment],
    train: impl FnOnce(Option<NewestPolicy>) -> Result<End, TrainingError> + Send,
) -> Result<End> {
    let Some(desktop) = desktop else { return Ok(train(None)?) };
    let (newest, over) = (NewestPolicy::default(), AtomicBool::new(false));
    let trained = before_window(desktop, "kestrel train", &|| (), |tell| {
        thread::scope(|scope| {
            scope.spawn(|| fly_newest(tasks, &newest, &tell, &|| over.load(Ordering::Relaxed)));
            let end = train(Some(newest.clone()));
            over.store(true, Ordering::Relaxed);
            end
        })
    })?;
    Ok(trained?)
}

/// The directory of the run, new or as it was left.
fn directory(arguments: &Arguments, config: &RunConfig) -> Result<RunDirectory> {
    if let Some(path) = &arguments.resume {
        return Ok(RunDirectory::resume(path)?);
    }
    if let Some(path) = &arguments.run {
        if arguments.force && RunDirectory::config_in(path).is_file() {
            RunDirectory::remove(path)?;
        }
        return Ok(RunDirectory::create(path, config.resolved_yaml())?);
    }
    let Subject { name, seed, .. } = config.subject();
    let stem = format!("{name}-seed{}", seed.0);
    Ok(RunDirectory::create_next("runs".as_ref(), &stem, config.resolved_yaml())?)
}

/// What is run.
fn config(arguments: &Arguments) -> Result<RunConfig> {
    if let Some(path) = &arguments.resume {
        return Ok(RunConfig::load_to_train(RunDirectory::open(path)?.config().as_path(), &[])?);
    }
    let path = arguments.config.as_deref().context("an experiment file is needed, such as configs/hover.yaml")?;
    let path = &shipped::task(path)?;
    let seed = arguments.seed.map(|seed| format!("training.seed={seed}"));
    let overrides: Vec<String> = arguments.set.iter().cloned().chain(seed).collect();
    Ok(RunConfig::load_to_train(path, &overrides)?)
}

fn begun(directory: &RunDirectory, method: &str, [steps, total]: [u64; 2]) -> Result<()> {
    let path = directory.path().display();
    Ok(say(format_args!("Training in {path} by {method}: {steps} of {total} steps done"))?)
}

/// Exports, evaluates and draws; between these steps it may be interrupted.
fn finish(
    subject: &Subject<'_>,
    directory: &RunDirectory,
    (actor, steps): (&Actor, u64),
    interrupt: &Interrupt,
) -> Result<Done> {
    say(format_args!("{}\n", results::export_policy(subject, directory, actor, steps)?))?;
    if interrupt.requested() {
        return stopped(directory.path());
    }
    let reports = results::evaluate_run(subject, directory)?;
    say(format_args!("{}\n", table::evaluations(&reports)))?;
    let causes = diagnosis::of_run(subject, directory, &reports)?;
    if !causes.is_empty() {
        say(format_args!("{}\n", table::causes(&causes)))?;
    }
    if interrupt.requested() {
        return stopped(directory.path());
    }
    for path in results::draw(subject, directory)?.into_iter().chain([directory.policy()]) {
        say(path.display())?;
    }
    Ok(Done::Finished)
}

/// Says what was saved, and how to go on.
fn saved(directory: &RunDirectory, steps: u64) -> Result<Done> {
    say(format_args!("Saved after {steps} steps."))?;
    stopped(directory.path())
}

/// Says how to go on.
fn stopped(run: &Path) -> Result<Done> {
    say(format_args!("Go on with:\n  kestrel train --resume {}", quoted(&run.display().to_string())))?;
    Ok(Done::Interrupted)
}

/// The text as one word of a shell's command line.
fn quoted(text: &str) -> String {
    let plain = |letter: char| letter.is_alphanumeric() || "-_./:@%+,=".contains(letter);
    if text.chars().all(plain) { text.to_owned() } else { format!("'{}'", text.replace('\'', r"'\''")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_quoted_where_a_shell_would_split_them() {
        assert_eq!(quoted("runs/hover-seed0-1"), "runs/hover-seed0-1");
        assert_eq!(quoted("my runs/it's"), r"'my runs/it'\''s'");
    }
}
