//! Tables for people.

use kestrel_sim::outcome::Ending;
use kestrel_train::evaluation::Evaluation;

/// The rows of an evaluation, one line each.
pub(crate) fn evaluations(rows: &[Evaluation]) -> String {
    let heading = format!(
        "{:<16} {:>8}  {:<16} {:>9} {:>8}  endings\n",
        "pilot", "success", "95 % interval", "return", "length"
    );
    rows.iter().map(line).fold(heading, |text, line| text + &line)
}

fn line(row: &Evaluation) -> String {
    let [low, high] = row.success_interval.map(|share| 100.0 * share);
    format!(
        "{:<16} {:>6.1} %  {:<16} {:>9.2} {:>6.2} s  {}\n",
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
            Ending::TimeLimit => "time limit",
        };
        format!("{count} {name}")
    });
    words.collect::<Vec<_>>().join(", ")
}
