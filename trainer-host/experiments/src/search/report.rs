//! What a search found: `report.md` and its pictures.

mod figure;

use std::fs;
use std::path::Path;

use super::{Search, Trial};
use crate::atomic_file::{FileError, write_atomically};

/// Trials in the table.
const SHOWN: usize = 10;

/// Writes `report.md` and `report/*.svg` into the search's directory, each file whole or not at all.
///
/// # Errors
/// When a file cannot be written.
pub fn write(directory: &Path, search: &Search, trials: &[Trial]) -> Result<(), FileError> {
    let folder = directory.join("report");
    fs::create_dir_all(&folder).map_err(|cause| FileError::new("create", &folder, cause))?;
    if !trials.is_empty() {
        write_atomically(&folder.join("settings.svg"), figure::settings(search, trials).svg().as_bytes())?;
        write_atomically(&folder.join("progress.svg"), figure::progress(search, trials).svg().as_bytes())?;
    }
    write_atomically(&directory.join("report.md"), text(search, trials).as_bytes())
}

/// The best trial, for the terminal.
pub fn headline(search: &Search, trials: &[Trial]) -> String {
    let done = format!("{}: {} of {} trials", search.name, trials.len(), search.trials);
    let Some(best) = ranked(trials).first().copied() else { return done };
    let judged = format!("{} {:.4} on {} seeds", search.objective.name(), best.objective, best.seeds);
    format!("{done}; the best is trial {}, {judged}:\n{}", best.number, settings(search, best))
}

/// What a search is expected to have found after each of `count` trials if it draws at random: the mean of the
/// greatest of so many draws from the trials that were drawn at random (Dodge et al. 2019, section 3.1).
pub fn expected_best(random: &[f64], count: usize) -> Vec<f64> {
    let mut sorted = random.to_vec();
    sorted.sort_by(f64::total_cmp);
    let drawn = sorted.len() as f64;
    let share = |rank: usize, trials: usize| libm::pow(rank as f64 / drawn, trials as f64);
    let best = |trials: usize| {
        let weighted = sorted.iter().enumerate();
        weighted.map(|(rank, value)| value * (share(rank + 1, trials) - share(rank, trials))).sum()
    };
    (1..=count).map(best).collect()
}

/// The best first.
fn ranked(trials: &[Trial]) -> Vec<&Trial> {
    let mut ranked: Vec<&Trial> = trials.iter().collect();
    ranked.sort_by(|one, other| one.by_rank(other));
    ranked
}

/// A trial's values as options of `kestrel study run`.
fn settings(search: &Search, trial: &Trial) -> String {
    let lines = search.space.iter().zip(search.values(trial));
    lines
        .map(|(dimension, value)| format!("  --set '{}={value}'", dimension.key))
        .collect::<Vec<_>>()
        .join(" \\\n")
}

fn text(search: &Search, trials: &[Trial]) -> String {
    let about = if search.about.is_empty() { String::new() } else { format!("\n{}\n", search.about) };
    let head = format!("# {}\n{about}", search.name);
    let ranked = ranked(trials);
    let Some(best) = ranked.first() else { return head + "\nNo trial has finished yet.\n" };
    let seeds = best.seeds;
    format!(
        "{head}\n{} of {} trials are done. Trial {} has the best {}: {:.4} on {seeds} seeds from {}.\n\n\
         ```sh\nkestrel study run STUDY \\\n{}\n```\n\n\
         ## The best trials\n\n{}\n\
         ## What each setting does\n\n![Objective against each setting](report/settings.svg)\n\n\
         ## What the search was worth\n\n![Best so far](report/progress.svg)\n\n{}\n",
        trials.len(),
        search.trials,
        best.number,
        search.objective.name(),
        best.objective,
        search.first_seed,
        settings(search, best),
        table(search, &ranked),
        notes(search)
    )
}

fn table(search: &Search, ranked: &[&Trial]) -> String {
    let keys = search.space.iter().map(|dimension| format!("`{}`", dimension.key));
    let names = ["trial", search.objective.name(), "seeds"].map(str::to_owned);
    let heading = row(names.into_iter().chain(keys));
    let rule = row(vec!["---".to_owned(); 3 + search.space.len()]);
    let line = |trial: &&Trial| {
        let found = [trial.number.to_string(), format!("{:.4}", trial.objective), trial.seeds.to_string()];
        row(found.into_iter().chain(search.values(trial)))
    };
    [heading, rule].into_iter().chain(ranked.iter().take(SHOWN).map(line)).collect()
}

fn row(cells: impl IntoIterator<Item = String>) -> String {
    format!("| {} |\n", cells.into_iter().collect::<Vec<_>>().join(" | "))
}

fn notes(search: &Search) -> String {
    let random = search.algorithm.random_trials(search.trials);
    format!(
        "Trials that were stopped early are judged by the seeds that they had; a trial that climbed further counts as \
         better than all that stayed behind. The line of random search is the expected best of so many draws from the \
         {random} trials that were drawn at random (Dodge et al. 2019); it cannot rise above the best of them. \
         The best of many trials owes something to luck: judge it again with other seeds, as the study's own are."
    )
}

#[cfg(test)]
mod tests;
