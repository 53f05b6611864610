//! The pictures of the report.

use super::expected_best;
use crate::search::{Search, Trial};
use kestrel_draw::chart::{Axes, Axis, INK, MARGIN, TOP, colour, titled};
use kestrel_draw::drawing::{Anchor, Drawing, Pen, Text};

/// Width and height of a panel \[px\].
const PANEL: [f64; 2] = [400.0, 220.0];

/// Space left of a panel, above and below it \[px\].
const NUMBERS: f64 = 44.0;
const ABOVE: f64 = 36.0;
const BELOW: f64 = 48.0;

/// What was found has the first colour, and what it is compared with the second.
const FOUND: usize = 0;
const RANDOM: usize = 1;

/// A panel for objectives of the trials, in a column and row; to the right are shares, with words at some of them.
fn panel([column, row]: [usize; 2], trials: &[Trial], ticks: Vec<(f64, String)>) -> Axes {
    let [width, height] = PANEL;
    Axes {
        left: MARGIN + NUMBERS + column as f64 * (width + NUMBERS + MARGIN),
        top: TOP + ABOVE + row as f64 * (ABOVE + height + BELOW),
        width,
        height,
        x: Axis { low: 0.0, high: 1.0, ticks },
        y: Axis::around(trials.iter().map(|trial| trial.objective), 4.0),
    }
}

/// Axes, and what the panel shows.
fn draw(panel: &Axes, drawing: &mut Drawing, title: &str) {
    panel.draw_axes(drawing);
    let at = [panel.left, panel.top - 14.0];
    drawing.text(Text { at, words: title.to_owned(), size: 14.0, colour: INK, anchor: Anchor::Start });
    drawing.extend_to(panel.bottom() + BELOW);
}

/// The objective of every trial against each setting; trials that went all the way are filled.
pub(super) fn settings(search: &Search, trials: &[Trial]) -> Drawing {
    let about = format!("{}, a disc a trial; pale ones were stopped early", search.objective.name());
    let columns = search.space.len().clamp(1, 2);
    let mut drawing = titled(width(columns), "What each setting does", &about);
    for (index, dimension) in search.space.iter().enumerate() {
        let shares = match dimension.options() {
            None => vec![0.0, 0.25, 0.5, 0.75, 1.0],
            Some(count) => (0..count).map(|option| (option as f64 + 0.5) / count as f64).collect(),
        };
        // Where values are few, several shares are those of one.
        let mut shares: Vec<f64> = shares.into_iter().map(|share| dimension.settled(share)).collect();
        shares.dedup();
        let ticks = shares.into_iter().map(|share| (share, shortened(&dimension.value(share)))).collect();
        let panel = panel([index % columns, index / columns], trials, ticks);
        draw(&panel, &mut drawing, &dimension.key);
        for trial in trials {
            let opacity = if trial.rungs == search.rungs.len() { 0.9 } else { 0.3 };
            let centre = panel.at([trial.point[index], trial.objective]);
            drawing.disc(centre, 4.5, Some((colour(FOUND), opacity)), None);
        }
    }
    drawing
}

/// The best so far, beside what drawing at random is expected to find.
pub(super) fn progress(search: &Search, trials: &[Trial]) -> Drawing {
    let about = format!("{}: what the search had found after each trial", search.objective.name());
    let mut drawing = titled(width(2), "Best so far", &about);
    let share = |number: usize| number as f64 / search.trials.max(1) as f64;
    let ticks = (0..=4)
        .map(|part| (f64::from(part) / 4.0, format!("{:.0}", search.trials as f64 * f64::from(part) / 4.0)))
        .collect();
    let panel = panel([0, 0], trials, ticks);
    draw(&panel, &mut drawing, "trials");
    let drawn = search.algorithm.random_trials(trials.len());
    let random: Vec<f64> = trials[..drawn].iter().map(|trial| trial.objective).collect();
    let expected = expected_best(&random, trials.len());
    let expected = expected.iter().enumerate().map(|(index, value)| [share(index + 1), *value]);
    let found = trials.iter().scan(f64::NEG_INFINITY, |best, trial| {
        *best = best.max(trial.objective);
        Some([share(trial.number + 1), *best])
    });
    let entries = [
        ("this search", Pen::solid(colour(FOUND), 3.0)),
        ("random search, expected", Pen::dashes(colour(RANDOM), 2.0)),
    ];
    panel.path(&mut drawing, expected, entries[1].1);
    panel.path(&mut drawing, found, entries[0].1);
    for (row, (label, pen)) in entries.into_iter().enumerate() {
        let (x, y) = (panel.right() + 32.0, panel.top + 16.0 + 26.0 * row as f64);
        drawing.line([[x, y], [x + 30.0, y]], pen);
        let at = [x + 40.0, y + 5.0];
        drawing.text(Text { at, words: label.to_owned(), size: 15.0, colour: INK, anchor: Anchor::Start });
    }
    drawing
}

/// Of a picture with so many columns \[px\].
fn width(columns: usize) -> f64 {
    MARGIN + columns as f64 * (NUMBERS + PANEL[0] + MARGIN)
}

/// The beginning of a long value.
fn shortened(value: &str) -> String {
    const LIMIT: usize = 14;
    if value.chars().count() <= LIMIT {
        value.to_owned()
    } else {
        value.chars().take(LIMIT - 1).chain(['…']).collect()
    }
}
