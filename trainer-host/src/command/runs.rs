//! `kestrel runs`.

use std::path::PathBuf;

use anyhow::{Result, bail};
use kestrel_draw::chart::amount;
use kestrel_experiments::output::warn;
use kestrel_experiments::run_summary::{Difference, RunSummary, differences};

use super::Done;
use super::json::Json;

/// Most keys that a comparison shows.
const KEYS_SHOWN: usize = 24;

/// Most runs that are compared side by side.
const COMPARED: usize = 6;

/// Longest value that a comparison shows \[letters\].
const VALUE_LEN: usize = 24;

/// Arguments of `kestrel runs`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Runs, or folders of runs; of two to six runs also in what their configurations differ
    #[arg(value_name = "RUN|FOLDER", default_value = "runs")]
    paths: Vec<PathBuf>,

    #[command(flatten)]
    json: Json,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let mut summaries = Vec::new();
    for path in &arguments.paths {
        let found = RunSummary::found(path);
        if found.is_empty() {
            bail!("{}: found no run, expected a run or a folder of runs", path.display());
        }
        for run in found {
            match RunSummary::read(&run) {
                Ok(summary) => summaries.push(summary),
                Err(error) => warn(format_args!("{}: {error}", run.display())),
            }
        }
    }
    arguments.json.tell(table(&summaries), &summaries)?;
    if (2..=COMPARED).contains(&summaries.len()) {
        let differing = differences(&summaries);
        if !differing.is_empty() {
            arguments.json.add(format_args!("\n{}", comparison(&summaries, &differing)))?;
        }
    }
    Ok(Done::Finished)
}

fn table(runs: &[RunSummary]) -> String {
    let names: Vec<String> = runs.iter().map(|run| run.path.display().to_string()).collect();
    let [path, name] = [&names, &runs.iter().map(|run| run.name.clone()).collect()].map(|cells| width(cells));
    let heading = format!(
        "{:<path$}  {:<name$} {:>6} {:>8} {:>9} {:>9}  {:<16} {:>8}",
        "run", "task", "seed", "steps", "time", "success", "95 % interval", "return"
    );
    let line = |(shown, run): (&String, &RunSummary)| {
        let begun = format!(
            "{shown:<path$}  {:<name$} {:>6} {:>8} {:>7.1} s",
            run.name,
            run.seed,
            amount(run.steps as f64),
            run.training_secs
        );
        let Some(rate) = run.success_rate() else { return format!("{begun}  not judged") };
        match run.evaluations.as_slice() {
            [evaluation] => {
                let [low, high] = evaluation.success_interval.map(|share| 100.0 * share);
                let interval = format!("{low:.1} to {high:.1} %");
                format!("{begun} {:>7.1} %  {interval:<16} {:>8.2}", 100.0 * rate, evaluation.episode_return)
            }
            several => format!("{begun} {:>7.1} %  mean of {} tasks", 100.0 * rate, several.len()),
        }
    };
    names.iter().zip(runs).map(line).fold(heading, |text, line| text + "\n" + &line)
}

fn comparison(runs: &[RunSummary], differing: &[Difference]) -> String {
    let keys: Vec<String> = differing.iter().take(KEYS_SHOWN).map(|difference| difference.key.clone()).collect();
    let key = width(&keys);
    let heads = runs.iter().map(|run| run.path.file_name().unwrap_or_default().to_string_lossy().into_owned());
    let cell = |text: &str| {
        let cut: String = text.chars().take(VALUE_LEN).collect();
        format!("  {cut:<VALUE_LEN$}")
    };
    let heading: String = heads.map(|head| cell(&head)).collect();
    let line = |difference: &Difference| {
        let values = difference.values.iter().map(|value| cell(value.as_deref().unwrap_or("-")));
        format!("{:<key$}{}", difference.key, values.collect::<String>().trim_end())
    };
    let mut text = format!("{:<key$}{}", "differs", heading.trim_end());
    for difference in differing.iter().take(KEYS_SHOWN) {
        text = text + "\n" + &line(difference);
    }
    let more = differing.len().saturating_sub(KEYS_SHOWN);
    if more > 0 { format!("{text}\nand {more} keys more") } else { text }
}

fn width(cells: &[String]) -> usize {
    cells.iter().map(|cell| cell.chars().count()).max().unwrap_or(0).max(4)
}
