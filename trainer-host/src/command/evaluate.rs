//! `kestrel evaluate`.

use std::path::PathBuf;

use anyhow::Result;
use kestrel_train::results;

use super::{Done, run, table};

/// Arguments of `kestrel evaluate`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Directory of the run
    run: PathBuf,

    /// Starts to fly from [default: the experiment's]
    #[arg(long, value_name = "NUMBER")]
    episodes: Option<u64>,

    /// What the starts follow from [default: the experiment's]
    #[arg(long, value_name = "NUMBER")]
    seed: Option<u64>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let episodes = arguments.episodes.map(|episodes| format!("evaluation.episodes={episodes}"));
    let seed = arguments.seed.map(|seed| format!("evaluation.seed={seed}"));
    let overrides: Vec<String> = episodes.into_iter().chain(seed).collect();
    let (directory, experiment) = run::open(&arguments.run, &overrides)?;
    let report = results::evaluate_run(&experiment, &directory)?;
    println!("{} starts of seed {}:", experiment.evaluation.episodes, report.seed);
    print!("{}", table::evaluations(&report.rows));
    Ok(Done::Finished)
}
