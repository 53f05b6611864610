//! `kestrel baseline`.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use kestrel_experiments::evaluation::{Evaluation, Flyer, Starts, evaluate_exactly};
use kestrel_experiments::experiment_config::{self, Experiment};
use kestrel_experiments::recording;
use kestrel_sim::reward::RewardTerm;
use kestrel_sim::seed::{Purpose, Seed};
use serde_json::json;

use super::flight::Pilot;
use super::json::Json;
use super::{Done, table};
use crate::shipped;

/// Most episodes of each pilot.
const EPISODES_LIMIT: usize = 100_000;

/// Arguments of `kestrel baseline`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Experiment file, or name of a shipped task
    config: PathBuf,

    /// Episodes of each pilot
    #[arg(long, value_name = "NUMBER", default_value_t = 20, allow_negative_numbers = true)]
    episodes: usize,

    /// What starts and random actions follow from
    #[arg(long, value_name = "NUMBER", default_value_t = 0, allow_negative_numbers = true)]
    seed: u64,

    /// Change a value of the configuration, such as `scenario.episode_secs=5`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,

    /// Keep the first episode of a pilot in this file, for `kestrel replay`
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,

    /// Whose episode to keep
    #[arg(long, value_enum, default_value_t = Pilot::Scripted, requires = "record")]
    pilot: Pilot,

    #[command(flatten)]
    json: Json,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let episodes = arguments.episodes;
    ensure!(
        (1..=EPISODES_LIMIT).contains(&episodes),
        "found --episodes {episodes}, expected a number from 1 to {EPISODES_LIMIT}"
    );
    let experiment = experiment_config::load(&shipped::task(&arguments.config)?, &arguments.overrides)?;
    let starts = Starts { seed: Seed(arguments.seed), purpose: Purpose::Evaluation, episodes };
    let scenario = &experiment.evaluation.scenario;
    let flyers = [Flyer::Nothing, Flyer::Random, Flyer::Scripted].into_iter().chain(Flyer::stock(scenario));
    let rows: Vec<Evaluation> = flyers.map(|flyer| evaluate_exactly(scenario, flyer, starts)).collect();
    let words = table::baselines(&experiment.name, arguments.seed, &rows);
    let names: Vec<&str> = scenario.rewards.iter().map(RewardTerm::name).collect();
    let found = json!({ "task": experiment.name, "seed": arguments.seed, "terms": names, "rows": rows });
    arguments.json.tell(format_args!("{words}\n{}", terms(&experiment, &rows)), &found)?;
    if let Some(path) = &arguments.record {
        recording::fly(&experiment, arguments.pilot.flyer(), starts, 0).write(path)?;
        arguments.json.add(format_args!("\nRecorded: kestrel replay {}", path.display()))?;
    }
    Ok(Done::Finished)
}

/// What each reward term paid, one line each.
fn terms(experiment: &Experiment, rows: &[Evaluation]) -> String {
    let rewards = &experiment.evaluation.scenario.rewards;
    let joined = |values: Vec<String>| values.concat();
    let pilots = joined(rows.iter().map(|row| format!(" {:>16}", row.pilot)).collect());
    let line = |(index, term): (usize, &RewardTerm)| {
        let returns = joined(rows.iter().map(|row| format!(" {:>16.4}", row.terms[index])).collect());
        format!("\n{:<20}{returns}", term.name())
    };
    let lines = joined(rewards.iter().enumerate().map(line).collect());
    format!("\n{:<20}{pilots}{lines}", "mean return of")
}
