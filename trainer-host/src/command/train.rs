//! `kestrel train`.

use std::path::PathBuf;

use anyhow::{Context, Result};
use kestrel_train::experiment_config::{self, Experiment};
use kestrel_train::interrupt::Interrupt;
use kestrel_train::results;
use kestrel_train::run_directory::RunDirectory;
use kestrel_train::training_run::{End, TrainingRun};

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
    #[arg(long, value_name = "NUMBER", conflicts_with = "resume")]
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
    let interrupt = Interrupt::watch("Stopping after this update; Ctrl-C again ends at once.")?;
    let mut run = open(arguments)?;
    let path = run.directory().path().to_owned();
    println!("Training in {}: {} of {} steps done", path.display(), run.steps(), run.experiment().ppo.total_steps);
    match run.train(&interrupt)? {
        End::Finished => finish(&run),
        End::Interrupted => {
            println!(
                "Saved after {} steps. Go on with:\n  kestrel train --resume {}",
                run.steps(),
                path.display()
            );
            Ok(Done::Interrupted)
        }
    }
}

fn open(arguments: &Arguments) -> Result<TrainingRun> {
    if let Some(path) = &arguments.resume {
        let directory = RunDirectory::resume(path)?;
        let experiment = experiment_config::load(&directory.config(), &[])?;
        let (run, warning) = TrainingRun::resume(experiment, directory)?;
        if let Some(warning) = warning {
            eprintln!("warning: {warning}; going on from the checkpoint before it");
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

fn load(arguments: &Arguments) -> Result<Experiment> {
    let path = arguments.config.as_deref().context("an experiment file is needed, such as configs/hover.yaml")?;
    let seed = arguments.seed.map(|seed| format!("training.seed={seed}"));
    let overrides: Vec<String> = arguments.set.iter().cloned().chain(seed).collect();
    Ok(experiment_config::load(path, &overrides)?)
}

/// Exports, evaluates and draws.
fn finish(run: &TrainingRun) -> Result<Done> {
    let (experiment, directory) = (run.experiment(), run.directory());
    let (actor, steps) = run.best();
    println!(
        "Trained {} steps in {:.1} s; the best policy is that after {steps} steps.\n",
        run.steps(),
        run.training_secs()
    );
    println!("{}\n", results::export_policy(experiment, directory, actor, steps)?);
    let report = results::evaluate_run(experiment, directory)?;
    println!("{} starts of seed {}:", experiment.evaluation.episodes, report.seed);
    println!("{}", table::evaluations(&report.rows));
    results::draw(experiment, directory)?;
    println!("{}", directory.learning_curve().display());
    println!("{}", directory.flight().display());
    println!("{}", directory.policy().display());
    Ok(Done::Finished)
}
