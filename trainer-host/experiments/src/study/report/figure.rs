//! The pictures of the report.

mod curves;
mod finals;
mod heat_map;
mod learning;
mod legend;
mod memory;
mod panel;
mod profile;
mod so_far;
mod style;

use super::summary::Summary;
use super::threshold::Learning;
use crate::study::data::StudyData;
use curves::Quantity;
use kestrel_draw::drawing::{Anchor, Drawing, Text};
use style::{INK, MUTED};

/// One picture, with the name of its file.
pub(super) struct Figure {
    /// Without folder.
    pub(super) file: &'static str,
    pub(super) drawing: Drawing,
}

/// Space left and right of everything \[px\].
const MARGIN: f64 = 28.0;

/// Where pictures begin below their headings \[px\].
const TOP: f64 = 92.0;

/// All pictures for which there is something to show.
pub(super) fn figures(data: &StudyData, summary: &Summary, learnings: &[Learning]) -> Vec<Figure> {
    let drawings = [
        ("final.svg", finals::draw(data, summary)),
        ("matrix.svg", heat_map::draw(data, summary)),
        ("profile.svg", profile::draw(data, summary)),
        ("so-far.svg", so_far::draw(data, summary)),
        ("curves.svg", curves::draw(data, Quantity::Success)),
        ("returns.svg", data.manifest.published.as_ref().and_then(|_| curves::draw(data, Quantity::Return))),
        ("memory.svg", memory::draw(data, summary)),
        ("threshold.svg", learning::draw(data, summary, learnings)),
    ];
    let figure = |(file, drawing): (_, Option<Drawing>)| Some(Figure { file, drawing: drawing? });
    drawings.into_iter().filter_map(figure).collect()
}

/// A picture with its heading and a line below it.
fn titled(width: f64, title: &str, about: &str) -> Drawing {
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
fn width_of(words: &str, size: f64) -> f64 {
    0.56 * size * words.chars().count() as f64
}

/// Words in lines that are at most as wide, as far as single words allow \[px\].
fn wrapped(words: &str, width: f64, size: f64) -> Vec<String> {
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
