//! `kestrel bench`.

#[cfg(feature = "gpu")]
use std::path::Path;
use std::path::PathBuf;
use std::time::Duration;

use crate::bench::{self, Figure};
use anyhow::Result;
use kestrel_core::policy_file::PolicyFile;
use kestrel_experiments::experiment_config;
use kestrel_experiments::output::say;
use kestrel_experiments::progress::amount;
use kestrel_experiments::results;
use kestrel_experiments::run_config::Subject;
use kestrel_experiments::training_run::untrained_actor;

use super::Done;

/// Arguments of `kestrel bench`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Experiment file whose scenario and settings are measured
    #[arg(default_value = "configs/hover.yaml")]
    config: PathBuf,

    /// Folder of the reference's tasks, some of which are measured
    #[arg(long, value_name = "FOLDER", default_value = "configs/aviaries")]
    aviaries: PathBuf,

    /// Time of each of the five repetitions of a figure
    #[arg(long, value_name = "SECONDS", default_value_t = 0.5, value_parser = repetition_secs, allow_negative_numbers = true)]
    secs: f64,
}

fn repetition_secs(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(secs) if (0.001..=60.0).contains(&secs) => Ok(secs),
        Ok(_) | Err(_) => Err("expected 0.001 to 60 seconds".to_owned()),
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let experiment = experiment_config::load_to_train(&arguments.config, &[])?;
    let duration = Duration::from_secs_f64(arguments.secs);
    let scenario = &experiment.scenario;
    say(format_args!("{:<44} {:>9} {:>9} {:>6}  limited by", "", "per s", "aim", "ratio"))?;
    print(&bench::vehicle(scenario, duration))?;
    print(&bench::environment(scenario, duration))?;
    for aviary in &bench::AVIARIES {
        let overrides: Vec<String> = aviary.overrides.iter().map(|&set| set.to_owned()).collect();
        let task = experiment_config::load(&arguments.aviaries.join(aviary.file), &overrides)?;
        print(&[bench::aviary(aviary, &task.scenario, duration)])?;
    }
    for sight in &bench::SIGHTS {
        let task = experiment_config::load(&arguments.aviaries.join(sight.file), &[])?;
        print(&[bench::sight(sight, &task.scenario, duration)])?;
    }
    print(&[bench::placing(scenario, duration)])?;
    print(&bench::eyes(duration))?;
    #[cfg(feature = "gpu")]
    print_gpu(&arguments.aviaries, duration)?;
    print(&bench::training(scenario, &experiment.ppo, duration))?;
    let settings = experiment.analytic.clone().unwrap_or_default();
    print(&Vec::from_iter(bench::gradients(scenario, &settings, duration)))?;
    for seeing in &bench::SEEING {
        let overrides: Vec<String> = seeing.overrides.iter().map(|&set| set.to_owned()).collect();
        let task = experiment_config::load(&arguments.aviaries.join(seeing.file), &overrides)?;
        print(&[bench::seeing(seeing, &task, duration)])?;
    }
    let actor = untrained_actor(&experiment)?;
    let export = results::exported(&Subject::of(&experiment), &actor, 0)?;
    let files = [PolicyFile::parse(&export.float_policy)?, PolicyFile::parse(&export.fixed_policy)?];
    print(&bench::inference(&actor, &files, duration))?;
    Ok(Done::Finished)
}

/// Of the GPU, or else of an adapter in software, which is named; says so where there is neither.
#[cfg(feature = "gpu")]
fn print_gpu(aviaries: &Path, duration: Duration) -> Result<()> {
    let gpu = match bench::gpu::open() {
        Ok(gpu) => gpu,
        Err(error) => return Ok(say(error)?),
    };
    say(format_args!("on {gpu}:"))?;
    for sight in &bench::SIGHTS {
        let task = experiment_config::load(&aviaries.join(sight.file), &[])?;
        print(&bench::gpu::sight(&gpu, sight, &task.scenario, duration)?)?;
    }
    Ok(())
}

fn print(figures: &[Figure]) -> Result<()> {
    for figure in figures {
        say(format_args!(
            "{:<44} {:>9} {:>9} {:>6.2}  {}",
            figure.what,
            amount(figure.per_second),
            amount(figure.aim),
            figure.per_second / figure.aim,
            figure.limit
        ))?;
    }
    Ok(())
}
