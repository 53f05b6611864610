//! Tables for people.

use kestrel_experiments::diagnosis::Cause;
use kestrel_experiments::evaluation::Evaluation;
use kestrel_experiments::experiment_config::Experiment;
use kestrel_experiments::results::{EvaluationReport, WorldsReport};
use kestrel_experiments::study::rows::EpisodeRow;
use kestrel_sim::outcome::Ending;

/// Most kinds of things that a table names below its rows.
const HITS_SHOWN: usize = 6;

/// The rows of an evaluation, one line each, below the starts that they flew from; where there are several tasks, one
/// table each.
pub(crate) fn evaluations(reports: &[EvaluationReport]) -> String {
    let table = |report: &EvaluationReport| {
        let name = if reports.len() == 1 { String::new() } else { format!("{}, ", report.name) };
        let starts = format!("{name}{} starts of seed {}", episodes(&report.rows), report.seed);
        let Some(WorldsReport { unseen, seen, rows_in_seen }) = &report.worlds else {
            return rows(&format!("{starts}:"), "pilot", &report.rows, 2);
        };
        let title = format!("{starts} in {unseen} worlds that training did not see:");
        let title_in_seen = format!("{starts} in the {seen} worlds of training:");
        rows(&title, "pilot", &report.rows, 2) + "\n\n" + &rows(&title_in_seen, "pilot", rows_in_seen, 2)
    };
    reports.iter().map(table).collect::<Vec<_>>().join("\n\n")
}

/// The baselines of a task, one line each.
pub(crate) fn baselines(name: &str, seed: u64, baselines: &[Evaluation]) -> String {
    rows(&format!("{name}, {} episodes of seed {seed}:", episodes(baselines)), "pilot", baselines, 4)
}

/// How policies fly tasks, `[task][policy]`: of one policy all that is known, of several the success rates.
pub(crate) fn matrix(policies: &[String], tasks: &[String], flown: &[Vec<Evaluation>]) -> String {
    if let [policy] = policies {
        let named = |(task, row): (&String, &Vec<Evaluation>)| Evaluation {
            pilot: task.clone(),
            hits: Vec::new(),
            ..row[0].clone()
        };
        let lines: Vec<Evaluation> = tasks.iter().zip(flown).map(named).collect();
        let mean = lines.iter().map(|line| line.success_rate).sum::<f64>() / lines.len() as f64;
        let title = format!("{policy}, {} starts of each task:", episodes(&lines));
        return format!("{}\nmean success: {:.1} %", rows(&title, "task", &lines, 2), 100.0 * mean);
    }
    let first = width(tasks.iter());
    let columns: Vec<usize> = policies.iter().map(|policy| policy.chars().count().max(8)).collect();
    let joined = |cells: &[String]| -> String {
        let cells = cells.iter().zip(&columns).map(|(cell, width)| format!("  {cell:>width$}"));
        cells.collect::<Vec<_>>().concat()
    };
    let title = format!("Success, {} starts of each task:", flown.first().map_or(0, |row| episodes(row)));
    let heading = format!("{title}\n{:<first$}{}", "task", joined(policies));
    let line = |(task, row): (&String, &Vec<Evaluation>)| {
        let cells: Vec<String> = row.iter().map(|cell| format!("{:.1} %", 100.0 * cell.success_rate)).collect();
        format!("{task:<first$}{}", joined(&cells))
    };
    tasks.iter().zip(flown).map(line).fold(heading, |text, line| text + "\n" + &line)
}

/// Why a run may not have learned, the likeliest first.
pub(crate) fn causes(causes: &[Cause]) -> String {
    let lines = causes.iter().enumerate().map(|(index, cause)| format!("\n  {}. {cause}", index + 1));
    lines.fold("Why it may not have learned its task:".to_owned(), |text, line| text + &line)
}

/// Success in each task before training and after each of its stages.
pub(crate) fn stages(tasks: &[Experiment], flights: &[EpisodeRow]) -> String {
    let stages = flights.iter().map(|flight| flight.stage).max().unwrap_or(0);
    let name = width(tasks.iter().map(|task| &task.name));
    let numbers = (0..=stages).map(|stage| format!("  {stage:>7}")).collect::<Vec<_>>().concat();
    let cell = |task: usize, stage: usize| {
        let flown = flights.iter().filter(|flight| (flight.task, flight.stage) == (task, stage));
        let (count, good) =
            flown.fold((0u32, 0u32), |(count, good), flight| (count + 1, good + u32::from(flight.success)));
        format!("  {:>5.1} %", 100.0 * f64::from(good) / f64::from(count.max(1)))
    };
    let line = |(index, task): (usize, &Experiment)| {
        let cells: String = (0..=stages).map(|stage| cell(index, stage)).collect();
        format!("{:<name$}{cells}", task.name)
    };
    let heading = format!("Success after each stage:\n{:<name$}{numbers}", "task");
    tasks.iter().enumerate().map(line).fold(heading, |text, line| text + "\n" + &line)
}

/// Of the first column.
fn width<'a>(names: impl Iterator<Item = &'a String>) -> usize {
    names.map(|name| name.chars().count()).max().unwrap_or(0).max(16)
}

fn episodes(rows: &[Evaluation]) -> usize {
    rows.first().map_or(0, |row| row.episodes)
}

/// `digits` are those of the return; `who` is in the first column.
fn rows(title: &str, who: &str, rows: &[Evaluation], digits: usize) -> String {
    let width = width(rows.iter().map(|row| &row.pilot));
    let heading = format!(
        "{title}\n{who:<width$} {:>8}  {:<16} {:>11} {:>9} {:>7}  endings",
        "success", "95 % interval", "return", "length", "steps"
    );
    let table = rows.iter().map(|row| line(row, width, digits)).fold(heading, |text, line| text + "\n" + &line);
    // Whoever is judged stands first.
    match rows.first() {
        Some(first) if !first.hits.is_empty() => {
            format!("{table}\ncollisions of {}: {}", first.pilot, hits(&first.hits))
        }
        Some(_) | None => table,
    }
}

/// What collisions were with; of rare things only how many.
fn hits(hits: &[(String, usize)]) -> String {
    let (often, rare) = hits.split_at(hits.len().min(HITS_SHOWN));
    let mut words: Vec<String> = often.iter().map(|(name, count)| format!("{name} ({count})")).collect();
    let others: usize = rare.iter().map(|(_, count)| count).sum();
    words.extend((others > 0).then(|| format!("others ({others})")));
    words.join(", ")
}

fn line(row: &Evaluation, width: usize, digits: usize) -> String {
    let [low, high] = row.success_interval.map(|share| 100.0 * share);
    format!(
        "{:<width$} {:>6.1} %  {:<16} {:>11.digits$} {:>7.2} s {:>7.1}  {}",
        row.pilot,
        100.0 * row.success_rate,
        format!("{low:.1} to {high:.1} %"),
        row.episode_return,
        row.length_secs,
        row.steps,
        endings(&row.endings)
    )
}

fn endings(endings: &[(Ending, usize)]) -> String {
    let words = endings.iter().map(|(ending, count)| format!("{count} {}", ending.name()));
    words.collect::<Vec<_>>().join(", ")
}
