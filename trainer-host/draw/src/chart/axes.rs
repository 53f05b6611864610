//! A pair of axes.

use super::number::with_unit;
use super::style::{GRID, MUTED};
use super::width_of;
use crate::drawing::{Anchor, Colour, Drawing, Pen, Text};

/// Size of the numbers at axes, and of words beside them \[px\].
const NUMBERS: f64 = 13.0;
const WORDS: f64 = 14.0;

/// Length of a line's sample \[px\].
const SAMPLE: f64 = 18.0;

/// A direction of a panel.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Where it begins.
    pub low: f64,
    /// Where it ends, above `low`.
    pub high: f64,
    /// Where lines are drawn and what stands at them.
    pub ticks: Vec<(f64, String)>,
}

/// Where things are drawn; y grows upwards in its coordinates.
#[derive(Clone, Debug)]
pub struct Axes {
    /// \[px\].
    pub left: f64,
    /// \[px\].
    pub top: f64,
    /// \[px\].
    pub width: f64,
    /// \[px\].
    pub height: f64,
    /// To the right.
    pub x: Axis,
    /// Upwards.
    pub y: Axis,
}

impl Axis {
    /// Shares from 0 to 1, as percentages.
    pub fn shares(step: f64) -> Self {
        let count = (1.0 / step).round() as usize;
        let tick = |index: usize| {
            let share = index as f64 / count as f64;
            (share, format!("{:.0} %", 100.0 * share))
        };
        Self { low: 0.0, high: 1.0, ticks: (0..=count).map(tick).collect() }
    }

    /// Steps of training, with about `count` numbers.
    pub fn steps(limit: f64, count: f64) -> Self {
        Self::numbers([0.0, limit], count)
    }

    /// From the least of the finite values to the greatest with some air around them, never empty.
    pub fn around(values: impl IntoIterator<Item = f64>, count: f64) -> Self {
        let finite = values.into_iter().filter(|value| value.is_finite());
        let (low, high) = finite
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        if low > high {
            return Self::numbers([0.0, 1.0], count);
        }
        let margin = (0.06 * (high - low)).max(0.05 * low.abs().min(high.abs())).max(1e-3);
        Self::numbers([low - margin, high + margin], count)
    }

    /// A range that is not empty, with about `count` round numbers.
    pub fn numbers([low, high]: [f64; 2], count: f64) -> Self {
        let step = round_step((high - low) / count);
        let most = high + 1e-4 * (high - low);
        let values = (0..).map(|index| ((low / step).ceil() + f64::from(index)) * step);
        let ticks = values.take_while(|value| *value <= most).map(|value| (value, with_unit(value)));
        Self { low, high, ticks: ticks.collect() }
    }

    /// Without numbers, with its lines.
    #[must_use]
    pub fn silent(mut self) -> Self {
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

impl Axes {
    /// Where a point is \[px\].
    pub fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.left + self.x.share(x) * self.width, self.top + (1.0 - self.y.share(y)) * self.height]
    }

    /// Where the horizontal axis is \[px\].
    pub fn bottom(&self) -> f64 {
        self.top + self.height
    }

    /// \[px\].
    pub fn right(&self) -> f64 {
        self.left + self.width
    }

    /// Lines and numbers.
    pub fn draw_axes(&self, drawing: &mut Drawing) {
        for (value, words) in &self.x.ticks {
            let x = self.at([*value, self.y.low])[0];
            drawing.line([[x, self.top], [x, self.bottom()]], Pen::solid(GRID, 1.0));
            drawing.text(muted([x, self.bottom() + 19.0], words, NUMBERS, Anchor::Middle));
        }
        for (value, words) in &self.y.ticks {
            let y = self.at([self.x.low, *value])[1];
            drawing.line([[self.left, y], [self.right(), y]], Pen::solid(GRID, 1.0));
            drawing.text(muted([self.left - 9.0, y + 4.5], words, NUMBERS, Anchor::End));
        }
    }

    /// What the axes mean: the vertical one above, the horizontal one below.
    pub fn name_axes(&self, drawing: &mut Drawing, [horizontal, vertical]: [&str; 2]) {
        drawing.text(muted([self.left, self.top - 14.0], vertical, WORDS, Anchor::Start));
        drawing.text(muted([self.right(), self.bottom() + 40.0], horizontal, WORDS, Anchor::End));
    }

    /// Which line is which, above, at the right end; each label has its line's colour.
    pub fn name_lines<'a>(&self, drawing: &mut Drawing, lines: impl DoubleEndedIterator<Item = (&'a str, Pen)>) {
        let mut right = self.right();
        for (label, pen) in lines.rev() {
            let words = label.to_owned();
            let at = [right, self.top - 14.0];
            drawing.text(Text { at, words, size: WORDS, colour: pen.colour, anchor: Anchor::End });
            right -= width_of(label, WORDS) + 6.0;
            drawing.line([[right - SAMPLE, at[1] - 4.5], [right, at[1] - 4.5]], pen);
            right -= SAMPLE + 16.0;
        }
    }

    /// A line through points in its coordinates.
    pub fn path(&self, drawing: &mut Drawing, points: impl IntoIterator<Item = [f64; 2]>, pen: Pen) {
        drawing.path(points.into_iter().map(|point| self.at(point)).collect(), pen);
    }

    /// The area between two lines over the same x, as `[x, low, high]`.
    pub fn band(&self, drawing: &mut Drawing, band: &[[f64; 3]], colour: Colour, opacity: f64) {
        let upper = band.iter().map(|[x, _, high]| self.at([*x, *high]));
        let lower = band.iter().rev().map(|[x, low, _]| self.at([*x, *low]));
        drawing.polygon(upper.chain(lower).collect(), Some((colour, opacity)), None);
    }
}

fn muted(at: [f64; 2], words: &str, size: f64, anchor: Anchor) -> Text {
    Text { at, words: words.to_owned(), size, colour: MUTED, anchor }
}
