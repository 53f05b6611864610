//! Plans of aviaries: each from above and from the side, to scale, as SVG or PNG.
//!
//! A [`Subject`] is what is drawn; [`plan()`] lays one out, [`sheet()`] many beside each other. Both make a [`Drawing`].
//! [`seen_sheet()`] shows what a drone sees of each at its start.

pub(crate) mod above;
mod outline;
mod seen;
mod sheet;
mod subject;
mod view;

use crate::drawing::{Anchor, Colour, Text};
use view::{Detail, Views};

pub use crate::drawing::{Drawing, PngError};
pub use seen::seen_sheet;
pub use sheet::sheet;
pub use subject::Subject;

/// Greatest width of a plan \[px\].
const WIDTH_LIMIT: f64 = 1200.0;

/// Least width, for the heading and the legend \[px\].
const WIDTH_LEAST: f64 = 800.0;

/// Space left of the views, for the numbers of the y and z axes \[px\].
const LEFT: f64 = 76.0;

/// Space right of the views, for their heights \[px\].
const RIGHT: f64 = 96.0;

/// Where the views begin below the heading \[px\].
const TOP: f64 = 148.0;

/// Greatest height of the view from above \[px\].
const HEIGHT_LIMIT: f64 = 820.0;

const INK: Colour = Colour([0x1f, 0x29, 0x33]);
const MUTED: Colour = Colour([0x6b, 0x76, 0x83]);

/// The plan of one aviary, from above and from the side, with dimensions, start, goal and a scale.
pub fn plan(subject: &Subject) -> Drawing {
    let views = Views::fitting(subject, [WIDTH_LIMIT - LEFT - RIGHT, HEIGHT_LIMIT]);
    let mut drawing = Drawing::new((LEFT + views.width() + RIGHT).max(WIDTH_LEAST), 0.0);
    let heading = |words: &str, top: f64, size: f64| Text {
        at: [LEFT, top],
        words: words.to_owned(),
        size,
        colour: if size > 20.0 { INK } else { MUTED },
        anchor: Anchor::Start,
    };
    drawing.text(heading(&subject.name, 50.0, 28.0));
    drawing.text(heading(&subject.about, 76.0, 16.0));
    drawing.text(heading(&subject.summary(), 100.0, 16.0));
    let bottom = views.draw(&mut drawing, subject, [LEFT, TOP], Detail::Full);
    let bottom = view::legend(&mut drawing, subject, [LEFT, bottom + 40.0], views.scale());
    drawing.extend_to(bottom + 24.0);
    drawing
}
