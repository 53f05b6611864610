//! Tables for people.

use kestrel_sim::outcome::Ending;
use kestrel_train::evaluation::Evaluation;
use kestrel_train::results::EvaluationReport;

/// The rows of an evaluation, one line each, below the starts that they flew from.
pub(crate) fn evaluations(report: &EvaluationReport) -> String {
    let episodes = report.rows.first().map_or(0, |row| row.episodes);
    let heading = format!(
        "{episodes} starts of seed {}:\n{:<16} {:>8}  {:<16} {:>9} {:>8}  endings",
        report.seed, "pilot", "success", "95 % interval", "return", "length"
    );
    report.rows.iter().map(line).fold(heading, |text, line| text + "\n" + &line)
}

fn line(row: &Evaluation) -> String {
    let [low, high] = row.success_interval.map(|share| 100.0 * share);
    format!(
        "{:<16} {:>6.1} %  {:<16} {:>9.2} {:>6.2} s  {}",
        row.pilot,
        100.0 * row.success_rate,
        format!("{low:.1} to {high:.1} %"),
        row.episode_return,
        row.length_secs,
        endings(&row.endings)
    )
}

fn endings(endings: &[(Ending, usize)]) -> String {
    let words = endings.iter().map(|(ending, count)| {
        let name = match ending {
            Ending::Success => "goal reached",
            Ending::Collision => "collision",
            Ending::OutOfBounds => "out of bounds",
            Ending::Tilt => "tilt",
            Ending::Distance => "too far",
            Ending::OutOfFuel => "out of fuel",
            Ending::Overdue => "overdue",
            Ending::Teammate => "teammate ended",
            Ending::TimeLimit => "time limit",
        };
        format!("{count} {name}")
    });
    words.collect::<Vec<_>>().join(", ")
}
