//! The pictures of the report.

use super::expected_best;
use crate::search::{Search, Trial};
use kestrel_draw::drawing::{Anchor, Colour, Drawing, Pen, Text};

const INK: Colour = Colour([0x1f, 0x29, 0x33]);
const MUTED: Colour = Colour([0x5b, 0x66, 0x73]);
const GRID: Colour = Colour([0xe4, 0xe8, 0xee]);

/// Of Okabe and Ito 2008: what was found, and what it is compared with.
const FOUND: Colour = Colour([0x00, 0x72, 0xb2]);
const RANDOM: Colour = Colour([0xd5, 0x5e, 0x00]);

/// Width and height of a panel \[px\].
const PANEL: [f64; 2] = [400.0, 220.0];

/// Space around panels: left, above, right, below \[px\].
const AROUND: [f64; 4] = [72.0, 56.0, 24.0, 48.0];

/// Space for the heading \[px\].
const TOP: f64 = 72.0;

/// A pair of axes: shares from 0 to 1 to the right, objectives upwards.
struct Panel {
    left: f64,
    top: f64,
    low: f64,
    high: f64,
}

impl Panel {
    /// The panel in a column and row, for objectives of the trials.
    fn new([column, row]: [usize; 2], trials: &[Trial]) -> Self {
        let objectives = trials.iter().map(|trial| trial.objective);
        let (low, high) = objectives
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        // Where all are the same there is still an axis.
        let margin = if high > low { 0.06 * (high - low) } else { 0.5 };
        let [left, above, right, below] = AROUND;
        Self {
            left: left + column as f64 * (left + PANEL[0] + right),
            top: TOP + above + row as f64 * (above + PANEL[1] + below),
            low: low - margin,
            high: high + margin,
        }
    }

    fn at(&self, share: f64, objective: f64) -> [f64; 2] {
        let height = (objective - self.low) / (self.high - self.low);
        [self.left + share * PANEL[0], self.top + (1.0 - height) * PANEL[1]]
    }

    /// Grid, numbers, and what the panel shows; `ticks` are shares and the words at them.
    fn draw(&self, drawing: &mut Drawing, title: &str, ticks: &[(f64, String)]) {
        for index in 0..=4 {
            let objective = self.low + (self.high - self.low) * f64::from(index) / 4.0;
            let [left, y] = self.at(0.0, objective);
            drawing.line([[left, y], [left + PANEL[0], y]], Pen::solid(GRID, 1.0));
            drawing.text(words([left - 8.0, y + 4.5], format!("{objective:.3}"), 13.0, MUTED, Anchor::End));
        }
        for (share, text) in ticks {
            let [x, bottom] = self.at(*share, self.low);
            drawing.line([[x, self.top], [x, bottom]], Pen::solid(GRID, 1.0));
            drawing.text(words([x, bottom + 19.0], text.clone(), 13.0, MUTED, Anchor::Middle));
        }
        drawing.text(words([self.left, self.top - 14.0], title.to_owned(), 14.0, INK, Anchor::Start));
        let [_, above, _, below] = AROUND;
        drawing.extend_to(self.top + PANEL[1] + below + above * 0.25);
    }
}

/// The objective of every trial against each setting; trials that went all the way are filled.
pub(super) fn settings(search: &Search, trials: &[Trial]) -> Drawing {
    let about = format!("{}, a disc a trial; pale ones were stopped early", search.objective.name());
    let columns = search.space.len().clamp(1, 2);
    let mut drawing = titled(columns, "What each setting does", &about);
    for (index, dimension) in search.space.iter().enumerate() {
        let panel = Panel::new([index % columns, index / columns], trials);
        let shares = match dimension.options() {
            None => vec![0.0, 0.25, 0.5, 0.75, 1.0],
            Some(count) => (0..count).map(|option| (option as f64 + 0.5) / count as f64).collect(),
        };
        // Where values are few, several shares are those of one.
        let mut shares: Vec<f64> = shares.into_iter().map(|share| dimension.settled(share)).collect();
        shares.dedup();
        let ticks: Vec<(f64, String)> =
            shares.into_iter().map(|share| (share, shortened(&dimension.value(share)))).collect();
        panel.draw(&mut drawing, &dimension.key, &ticks);
        for trial in trials {
            let opacity = if trial.rungs == search.rungs.len() { 0.9 } else { 0.3 };
            drawing.disc(panel.at(trial.point[index], trial.objective), 4.5, Some((FOUND, opacity)), None);
        }
    }
    drawing
}

/// The best so far, beside what drawing at random is expected to find.
pub(super) fn progress(search: &Search, trials: &[Trial]) -> Drawing {
    let about = format!("{}: what the search had found after each trial", search.objective.name());
    let mut drawing = titled(2, "Best so far", &about);
    let panel = Panel::new([0, 0], trials);
    let share = |number: usize| number as f64 / search.trials.max(1) as f64;
    let ticks: Vec<(f64, String)> = (0..=4)
        .map(|part| (f64::from(part) / 4.0, format!("{:.0}", search.trials as f64 * f64::from(part) / 4.0)))
        .collect();
    panel.draw(&mut drawing, "trials", &ticks);
    let mut best = f64::NEG_INFINITY;
    let mut found = Vec::new();
    for trial in trials {
        best = best.max(trial.objective);
        found.push(panel.at(share(trial.number + 1), best));
    }
    let drawn = search.algorithm.random_trials(trials.len());
    let random: Vec<f64> = trials[..drawn].iter().map(|trial| trial.objective).collect();
    let expected = expected_best(&random, trials.len());
    let expected = expected.iter().enumerate().map(|(index, value)| panel.at(share(index + 1), *value)).collect();
    drawing.path(expected, Pen::dashes(RANDOM, 2.0));
    drawing.path(found, Pen::solid(FOUND, 3.0));
    let entries = [("this search", Pen::solid(FOUND, 3.0)), ("random search, expected", Pen::dashes(RANDOM, 2.0))];
    for (row, (label, pen)) in entries.into_iter().enumerate() {
        let (x, y) = (panel.left + PANEL[0] + 32.0, panel.top + 16.0 + 26.0 * row as f64);
        drawing.line([[x, y], [x + 30.0, y]], pen);
        drawing.text(words([x + 40.0, y + 5.0], label.to_owned(), 15.0, INK, Anchor::Start));
    }
    drawing
}

/// A picture as wide as some columns, with its heading.
fn titled(columns: usize, title: &str, about: &str) -> Drawing {
    let [left, _, right, _] = AROUND;
    let mut drawing = Drawing::new(columns as f64 * (left + PANEL[0] + right), TOP);
    drawing.text(words([24.0, 38.0], title.to_owned(), 24.0, INK, Anchor::Start));
    drawing.text(words([24.0, 62.0], about.to_owned(), 15.0, MUTED, Anchor::Start));
    drawing
}

fn words(at: [f64; 2], words: String, size: f64, colour: Colour, anchor: Anchor) -> Text {
    Text { at, words, size, colour, anchor }
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
