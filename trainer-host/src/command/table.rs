//! Tables for people.

use kestrel_experiments::evaluation::Evaluation;
use kestrel_experiments::results::{EvaluationReport, WorldsReport};
use kestrel_sim::outcome::Ending;

/// The rows of an evaluation, one line each, below the starts that they flew from.
pub(crate) fn evaluations(report: &EvaluationReport) -> String {
    let starts = format!("{} starts of seed {}", episodes(&report.rows), report.seed);
    let Some(WorldsReport { unseen, seen, rows_in_seen }) = &report.worlds else {
        return rows(&format!("{starts}:"), &report.rows, 2);
    };
    let title = format!("{starts} in {unseen} worlds that training did not see:");
    let title_in_seen = format!("{starts} in the {seen} worlds of training:");
    rows(&title, &report.rows, 2) + "\n\n" + &rows(&title_in_seen, rows_in_seen, 2)
}

/// The baselines of a task, one line each.
pub(crate) fn baselines(name: &str, seed: u64, baselines: &[Evaluation]) -> String {
    rows(&format!("{name}, {} episodes of seed {seed}:", episodes(baselines)), baselines, 4)
}

fn episodes(rows: &[Evaluation]) -> usize {
    rows.first().map_or(0, |row| row.episodes)
}

/// `digits` are those of the return.
fn rows(title: &str, rows: &[Evaluation], digits: usize) -> String {
    let heading = format!(
        "{title}\n{:<16} {:>8}  {:<16} {:>11} {:>9} {:>7}  endings",
        "pilot", "success", "95 % interval", "return", "length", "steps"
    );
    rows.iter().map(|row| line(row, digits)).fold(heading, |text, line| text + "\n" + &line)
}

fn line(row: &Evaluation, digits: usize) -> String {
    let [low, high] = row.success_interval.map(|share| 100.0 * share);
    format!(
        "{:<16} {:>6.1} %  {:<16} {:>11.digits$} {:>7.2} s {:>7.1}  {}",
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
