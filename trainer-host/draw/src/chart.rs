//! Charts on a [`Drawing`]: a heading, panels with axes, lines and bands, and a legend.

mod axes;
mod legend;
mod number;
mod style;

pub use axes::{Axes, Axis};
pub use legend::legend;
pub use number::{amount, with_unit};
pub use style::{GRID, INK, MUTED, PAPER, colour, faded, pen};

use crate::drawing::{Anchor, Drawing, Text};

/// Space left and right of everything \[px\].
pub const MARGIN: f64 = 28.0;

/// Where charts begin below their headings \[px\].
pub const TOP: f64 = 92.0;

/// A picture with its heading and a line below it.
pub fn titled(width: f64, title: &str, about: &str) -> Drawing {
    let mut drawing = Drawing::new(width, TOP);
    let heading = |words: &str, top: f64, size: f64| Text {
        at: [MARGIN, top],
        words: words.to_owned(),
        size,
        colour: if size > 20.0 { INK } else { MUTED },
        anchor: Anchor::Start,
    };
    drawing.text(heading(title, 42.0, 24.0));
    drawing.text(heading(about, 68.0, 15.0));
    drawing
}

/// Width of words in a usual typeface, rather too much than too little \[px\].
pub fn width_of(words: &str, size: f64) -> f64 {
    0.56 * size * words.chars().count() as f64
}

/// Words in lines that are at most as wide, as far as single words allow \[px\].
pub fn wrapped(words: &str, width: f64, size: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in words.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width_of(line, size) + width_of(word, size) + 0.56 * size <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}
