//! `kestrel train`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use kestrel_experiments::experiment_config::{self, Experiment};
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::output::{say, warn};
use kestrel_experiments::results;
use kestrel_experiments::run_directory::RunDirectory;
use kestrel_experiments::training_run::{self, End, TrainingRun};
use kestrel_learn::ranks::{self, Ranks};

use super::{Done, table};

/// Arguments of `kestrel train`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Experiment file, such as configs/hover.yaml
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

    /// Threads to use; the results do not depend on it [default: all cores]
    #[arg(long, value_name = "NUMBER", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let threads = arguments.threads.map_or(0, usize::from);
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("cannot start threads")?;
    let membership = ranks::join()?;
    let ranks = &membership.ranks;
    if ranks.rank() > 0 {
        Interrupt::leave_to_others()?;
        training_run::follow(&experiment(arguments)?, ranks)?;
        return Ok(Done::Finished);
    }
    let done = lead(arguments, ranks);
    ranks::end(ranks);
    done
}

/// Trains as the first of the ranks, or as the only one.
fn lead(arguments: &Arguments, ranks: &Arc<dyn Ranks>) -> Result<Done> {
    let interrupt = Interrupt::watch("Stopping after the step in progress; Ctrl-C again ends at once.")?;
    let mut run = open(arguments)?;
    run.work_with(ranks)?;
    let path = run.directory().path().to_owned();
    let experiment = run.experiment();
    say(format_args!(
        "Training in {} by {}: {} of {} steps done",
        path.display(),
        experiment.method(),
        run.steps(),
        experiment.total_steps()
    ))?;
    let silent = experiment.silent_rewards();
    if !silent.is_empty() {
        say(format_args!("No gradient goes through these rewards, which teach nothing: {}", silent.join(", ")))?;
    }
    match run.train(&interrupt)? {
        End::Finished => finish(&run, &interrupt),
        End::Interrupted => {
            say(format_args!("Saved after {} steps.", run.steps()))?;
            stopped(&path)
        }
    }
}

fn open(arguments: &Arguments) -> Result<TrainingRun> {
    if let Some(path) = &arguments.resume {
        let directory = RunDirectory::resume(path)?;
        let experiment = experiment_config::load_to_train(&directory.config(), &[])?;
        let (run, warning) = TrainingRun::resume(experiment, directory)?;
        if let Some(warning) = warning {
            warn(format_args!("warning: {warning}; going on from the checkpoint before it"));
        }
        return Ok(run);
    }
    let experiment = load(arguments)?;
    let directory = if let Some(path) = &arguments.run {
        RunDirectory::create(path, &experiment.resolved_yaml)?
    } else {
        let stem = format!("{}-seed{}", experiment.name, experiment.seed.0);
        RunDirectory::create_next("runs".as_ref(), &stem, &experiment.resolved_yaml)?
    };
    Ok(TrainingRun::begin(experiment, directory)?)
}

/// What is run.
fn experiment(arguments: &Arguments) -> Result<Experiment> {
    match &arguments.resume {
        Some(path) => Ok(experiment_config::load_to_train(&RunDirectory::config_in(path), &[])?),
        None => load(arguments),
    }
}

fn load(arguments: &Arguments) -> Result<Experiment> {
    let path = arguments.config.as_deref().context("an experiment file is needed, such as configs/hover.yaml")?;
    let seed = arguments.seed.map(|seed| format!("training.seed={seed}"));
    let overrides: Vec<String> = arguments.set.iter().cloned().chain(seed).collect();
    Ok(experiment_config::load_to_train(path, &overrides)?)
}

/// Exports, evaluates and draws; between these steps it may be interrupted.
fn finish(run: &TrainingRun, interrupt: &Interrupt) -> Result<Done> {
    let (experiment, directory) = (run.experiment(), run.directory());
    let (actor, steps) = run.best();
    say(format_args!(
        "Trained {} steps in {:.1} s; the best policy is that after {steps} steps.\n",
        run.steps(),
        run.training_secs()
    ))?;
    say(format_args!("{}\n", results::export_policy(experiment, directory, actor, steps)?))?;
    if interrupt.requested() {
        return stopped(directory.path());
    }
    say(format_args!("{}\n", table::evaluations(&results::evaluate_run(experiment, directory)?)))?;
    if interrupt.requested() {
        return stopped(directory.path());
    }
    results::draw(experiment, directory)?;
    for path in [directory.learning_curve(), directory.flight(), directory.policy()] {
        say(path.display())?;
    }
    Ok(Done::Finished)
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
