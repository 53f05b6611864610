//! `kestrel evaluate`.

use std::path::PathBuf;

use crate::processor::{ProcessorKind, ProcessorOptions, compare};
use anyhow::{Context, Result, ensure};
use kestrel_core::policy_file::PolicyFile;
use kestrel_experiments::output::say;
use kestrel_experiments::progress::Progress;
use kestrel_experiments::results;

use super::{Done, run, table};

/// Arguments of `kestrel evaluate`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Directory of the run
    run: PathBuf,

    /// Starts to fly from [default: the experiment's]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    episodes: Option<u64>,

    /// What the starts follow from [default: the experiment's]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    seed: Option<u64>,

    /// Keep the policy's first episode in this file, for `kestrel replay`
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,

    /// With an emulated processor, it flies the fixed-point policy beside this machine, and nothing else is flown
    #[command(flatten)]
    processor: ProcessorOptions,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let episodes = arguments.episodes.map(|episodes| format!("evaluation.episodes={episodes}"));
    let seed = arguments.seed.map(|seed| format!("evaluation.seed={seed}"));
    let overrides: Vec<String> = episodes.into_iter().chain(seed).collect();
    let (directory, experiment) = run::open(&arguments.run, &overrides)?;
    directory.require_policies()?;
    if arguments.processor.processor == ProcessorKind::Qemu {
        ensure!(arguments.record.is_none(), "found --record beside --processor qemu, expected one of them");
        let mut progress = Progress::counting("episodes", experiment.evaluation.episodes as u64, 0);
        let shown = |done| progress.show_steps(done, String::new);
        let file = results::checked_policy(&experiment, &directory)?;
        let policy = PolicyFile::parse(&file).with_context(|| directory.policy().display().to_string())?;
        let (scenario, starts) = (&experiment.evaluation.scenario, results::starts(&experiment));
        let comparison = compare(scenario, starts, (&file, policy), &arguments.processor.image, shown)?;
        progress.finish();
        say(comparison)?;
        return Ok(if comparison.different == 0 { Done::Finished } else { Done::Deviating });
    }
    let report = results::evaluate_run(&experiment, &directory)?;
    say(table::evaluations(&report))?;
    if let Some(path) = &arguments.record {
        results::record_run(&experiment, &directory)?.write(path)?;
        say(format_args!("\nRecorded: kestrel replay {}", path.display()))?;
    }
    Ok(Done::Finished)
}
