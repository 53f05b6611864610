//! A pair of axes.

use super::style::{GRID, MUTED};
use kestrel_draw::curve::with_unit;
use kestrel_draw::drawing::{Anchor, Colour, Drawing, Pen, Text};

/// Size of the numbers at axes \[px\].
const NUMBERS: f64 = 13.0;

/// A direction of a panel.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    pub(super) low: f64,
    pub(super) high: f64,
    /// Where lines are drawn and what stands at them.
    pub(super) ticks: Vec<(f64, String)>,
}

/// Where things are drawn; y grows upwards in its coordinates.
#[derive(Clone, Debug)]
pub(super) struct Panel {
    /// \[px\].
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) x: Axis,
    pub(super) y: Axis,
}

impl Axis {
    /// Shares from 0 to 1, as percentages.
    pub(super) fn shares(step: f64) -> Self {
        let count = (1.0 / step).round() as usize;
        let tick = |index: usize| {
            let share = index as f64 / count as f64;
            (share, format!("{:.0} %", 100.0 * share))
        };
        Self { low: 0.0, high: 1.0, ticks: (0..=count).map(tick).collect() }
    }

    /// Steps of training, with about `count` numbers.
    pub(super) fn steps(limit: f64, count: f64) -> Self {
        Self::numbers([0.0, limit], count)
    }

    /// A range that is not empty, with about `count` round numbers.
    pub(super) fn numbers([low, high]: [f64; 2], count: f64) -> Self {
        let step = round_step((high - low) / count);
        let most = high + 1e-4 * (high - low);
        let values = (0..).map(|index| ((low / step).ceil() + f64::from(index)) * step);
        let ticks = values.take_while(|value| *value <= most).map(|value| (value, with_unit(value)));
        Self { low, high, ticks: ticks.collect() }
    }

    /// Without numbers, with its lines.
    #[must_use]
    pub(super) fn silent(mut self) -> Self {
        self.ticks.iter_mut().for_each(|(_, words)| words.clear());
        self
    }

    fn share(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }
}

/// 1, 2 or 5 times a power of ten, at least `least`.
fn round_step(least: f64) -> f64 {
    let power = 10.0_f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .map(|factor| factor * power)
        .into_iter()
        .find(|step| *step >= 0.999 * least)
        .unwrap_or(least)
}

impl Panel {
    /// Where a point is \[px\].
    pub(super) fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.left + self.x.share(x) * self.width, self.top + (1.0 - self.y.share(y)) * self.height]
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height
    }

    /// Lines and numbers.
    pub(super) fn draw_axes(&self, drawing: &mut Drawing) {
        let label = |at: [f64; 2], words: &str, anchor| Text {
            at,
            words: words.to_owned(),
            size: NUMBERS,
            colour: MUTED,
            anchor,
        };
        for (value, words) in &self.x.ticks {
            let x = self.at([*value, self.y.low])[0];
            drawing.line([[x, self.top], [x, self.bottom()]], Pen::solid(GRID, 1.0));
            drawing.text(label([x, self.bottom() + 19.0], words, Anchor::Middle));
        }
        for (value, words) in &self.y.ticks {
            let y = self.at([self.x.low, *value])[1];
            drawing.line([[self.left, y], [self.left + self.width, y]], Pen::solid(GRID, 1.0));
            drawing.text(label([self.left - 9.0, y + 4.5], words, Anchor::End));
        }
    }

    /// What the axes mean: the vertical one above, the horizontal one below.
    pub(super) fn name_axes(&self, drawing: &mut Drawing, [horizontal, vertical]: [&str; 2]) {
        let label = |at: [f64; 2], words: &str, anchor| Text {
            at,
            words: words.to_owned(),
            size: 14.0,
            colour: MUTED,
            anchor,
        };
        drawing.text(label([self.left, self.top - 14.0], vertical, Anchor::Start));
        let right = [self.left + self.width, self.bottom() + 40.0];
        drawing.text(label(right, horizontal, Anchor::End));
    }

    pub(super) fn path(&self, drawing: &mut Drawing, points: impl IntoIterator<Item = [f64; 2]>, pen: Pen) {
        drawing.path(points.into_iter().map(|point| self.at(point)).collect(), pen);
    }

    /// The area between two lines over the same x, as `[x, low, high]`.
    pub(super) fn band(&self, drawing: &mut Drawing, band: &[[f64; 3]], colour: Colour, opacity: f64) {
        let upper = band.iter().map(|[x, _, high]| self.at([*x, *high]));
        let lower = band.iter().rev().map(|[x, low, _]| self.at([*x, *low]));
        drawing.polygon(upper.chain(lower).collect(), Some((colour, opacity)), None);
    }
}
