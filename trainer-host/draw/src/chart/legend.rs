//! Which line is whose.

use super::style::{INK, pen};
use super::{MARGIN, width_of};
use crate::drawing::{Anchor, Drawing, Text};

/// Height of a row \[px\].
const ROW: f64 = 26.0;

/// Length of a line's sample \[px\].
const SAMPLE: f64 = 30.0;

const SIZE: f64 = 15.0;

/// Draws lines, by their place in [`pen`], and their labels in rows from `top`; returns where they end \[px\].
pub fn legend<'a>(drawing: &mut Drawing, entries: impl IntoIterator<Item = (usize, &'a str)>, top: f64) -> f64 {
    let (mut left, mut middle) = (MARGIN, top);
    for (index, label) in entries {
        let width = SAMPLE + 10.0 + width_of(label, SIZE) + 18.0;
        if left > MARGIN && left + width > drawing.width - MARGIN {
            (left, middle) = (MARGIN, middle + ROW);
        }
        drawing.line([[left, middle], [left + SAMPLE, middle]], pen(index, 3.5));
        let at = [left + SAMPLE + 10.0, middle + 5.0];
        drawing.text(Text { at, words: label.to_owned(), size: SIZE, colour: INK, anchor: Anchor::Start });
        left += width;
    }
    middle + 0.5 * ROW
}
