//! The pictures of the report.

mod curves;
mod finals;
mod heat_map;
mod learning;
mod memory;
mod profile;
mod so_far;

use super::summary::Summary;
use super::threshold::Learning;
use crate::study::data::StudyData;
use curves::Quantity;
use kestrel_draw::drawing::Drawing;

/// One picture, with the name of its file.
pub(super) struct Figure {
    /// Without folder.
    pub(super) file: &'static str,
    pub(super) drawing: Drawing,
}

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
