//! `kestrel bench`.

use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::bench::{self, Figure};
use anyhow::Result;
use kestrel_core::policy_file::PolicyFile;
use kestrel_experiments::experiment_config;
use kestrel_experiments::progress::amount;
use kestrel_experiments::results;
use kestrel_experiments::run_config::Subject;
use kestrel_experiments::training_run::untrained_actor;
use kestrel_sim::scenario::Scenario;
use serde_json::json;

use super::Done;
use super::json::Json;
use crate::shipped;

/// Arguments of `kestrel bench`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Experiment file, or name of a shipped task, whose scenario and settings are measured
    #[arg(default_value = "hover")]
    config: PathBuf,

    /// Folder of the reference's tasks, some of which are measured
    #[arg(long, value_name = "FOLDER", default_value = "configs/aviaries")]
    aviaries: PathBuf,

    /// Time of each of the five repetitions of a figure
    #[arg(long, value_name = "SECONDS", default_value_t = 0.5, value_parser = repetition_secs, allow_negative_numbers = true)]
    secs: f64,

    /// Groups of rows that are measured; all without it
    #[arg(long, value_name = "GROUP", value_delimiter = ',')]
    rows: Vec<Rows>,

    #[command(flatten)]
    json: Json,
}

/// Rows of the table that belong together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Rows {
    /// The vehicle alone
    Vehicle,
    /// Environments of the experiment
    Environment,
    /// Tasks of the reference
    Aviaries,
    /// Tasks as users train them, in one world and in drawn ones
    Tasks,
    /// Camera images
    Images,
    /// Encoders of images
    Encoders,
    /// PPO, regularisers and gradients through the physics
    Training,
    /// Training with a camera
    Seeing,
    /// Policies in float and in fixed point
    Inference,
}

impl Arguments {
    fn asks_for(&self, rows: Rows) -> bool {
        self.rows.is_empty() || self.rows.contains(&rows)
    }
}

fn repetition_secs(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(secs) if (0.001..=60.0).contains(&secs) => Ok(secs),
        Ok(_) | Err(_) => Err("expected 0.001 to 60 seconds".to_owned()),
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let experiment = experiment_config::load_to_train(&shipped::task(&arguments.config)?, &[])?;
    let duration = Duration::from_secs_f64(arguments.secs);
    let scenario = &experiment.scenario;
    let json = arguments.json;
    json.add(format_args!("{:<44} {:>9} {:>9} {:>6}  limited by", "", "per s", "aim", "ratio"))?;
    if arguments.asks_for(Rows::Vehicle) {
        print(json, &bench::vehicle(scenario, duration))?;
    }
    if arguments.asks_for(Rows::Environment) {
        print(json, &bench::environment(scenario, duration))?;
    }
    if arguments.asks_for(Rows::Aviaries) {
        print_aviaries(json, (&arguments.aviaries, &bench::AVIARIES), duration)?;
    }
    if arguments.asks_for(Rows::Tasks) {
        print_aviaries(json, (&arguments.aviaries, &bench::TASKS), duration)?;
        for aviary in &bench::DRAWN {
            let task = experiment_config::load(&arguments.aviaries.join(aviary.file), &owned(aviary.overrides))?;
            print(json, &bench::drawn(aviary, &task.scenario, duration))?;
        }
    }
    if arguments.asks_for(Rows::Images) {
        print_images(json, &arguments.aviaries, scenario, duration)?;
    }
    if arguments.asks_for(Rows::Encoders) {
        print(json, &bench::eyes(duration))?;
    }
    if arguments.asks_for(Rows::Training) {
        print(json, &bench::training(scenario, &experiment.training.ppo, duration))?;
        let settings = experiment.training.analytic.clone().unwrap_or_default();
        print(json, &Vec::from_iter(bench::gradients(scenario, &settings, duration)))?;
    }
    if arguments.asks_for(Rows::Seeing) {
        print_seeing(json, &arguments.aviaries, duration)?;
    }
    if arguments.asks_for(Rows::Inference) {
        let actor = untrained_actor(&experiment)?;
        let export = results::exported(&Subject::of(&experiment), &actor, 0)?;
        let files = [PolicyFile::parse(&export.float_policy)?, PolicyFile::parse(&export.fixed_policy)?];
        print(json, &bench::inference(&actor, &files, duration))?;
    }
    Ok(Done::Finished)
}

fn print_aviaries(json: Json, (folder, aviaries): (&Path, &[bench::Aviary]), duration: Duration) -> Result<()> {
    for aviary in aviaries {
        let task = experiment_config::load(&folder.join(aviary.file), &owned(aviary.overrides))?;
        print(json, &[bench::aviary(aviary, &task.scenario, duration)])?;
    }
    Ok(())
}

fn print_images(json: Json, aviaries: &Path, scenario: &Scenario, duration: Duration) -> Result<()> {
    for sight in &bench::SIGHTS {
        let task = experiment_config::load(&aviaries.join(sight.file), &[])?;
        print(json, &[bench::sight(sight, &task.scenario, duration)])?;
    }
    print(json, &[bench::placing(scenario, duration)])?;
    #[cfg(feature = "gpu")]
    print_gpu(json, aviaries, duration)?;
    Ok(())
}

fn print_seeing(json: Json, aviaries: &Path, duration: Duration) -> Result<()> {
    for seeing in &bench::SEEING {
        let task = experiment_config::load(&aviaries.join(seeing.file), &owned(seeing.overrides))?;
        print(json, &[bench::seeing(seeing, &task, duration)])?;
    }
    Ok(())
}

fn owned(overrides: &[&str]) -> Vec<String> {
    overrides.iter().map(|&set| set.to_owned()).collect()
}

/// Of the GPU, or else of an adapter in software, which is named; says so where there is neither.
#[cfg(feature = "gpu")]
fn print_gpu(json: Json, aviaries: &Path, duration: Duration) -> Result<()> {
    let gpu = match bench::gpu::open() {
        Ok(gpu) => gpu,
        Err(error) => return json.add(error),
    };
    json.add(format_args!("{gpu}:"))?;
    for sight in &bench::SIGHTS {
        let task = experiment_config::load(&aviaries.join(sight.file), &[])?;
        print(json, &bench::gpu::sight(&gpu, sight, &task.scenario, duration)?)?;
    }
    Ok(())
}

fn print(json: Json, figures: &[Figure]) -> Result<()> {
    for Figure { what, per_second, aim, limit } in figures {
        let ratio = per_second / aim;
        let words = format!("{what:<44} {:>9} {:>9} {ratio:>6.2}  {limit}", amount(*per_second), amount(*aim));
        json.tell_line(words, &json!({ "what": what, "per_second": per_second, "aim": aim, "limit": limit }))?;
    }
    Ok(())
}
