//! Many aviaries beside each other.

use super::subject::Subject;
use super::view::{Detail, Views};
use super::{INK, MUTED};
use crate::drawing::{Anchor, Drawing, Text};

/// Columns of the sheet.
const COLUMNS: usize = 4;

/// Width of a column \[px\].
const COLUMN: f64 = 330.0;

/// Around and between the cells \[px\].
const MARGIN: f64 = 24.0;

/// Greatest height of a view from above \[px\].
const HEIGHT_LIMIT: f64 = 230.0;

/// Height of a cell's two lines of text \[px\].
const HEADING: f64 = 40.0;

/// All subjects, each with its name, its views and its size.
pub fn sheet(subjects: &[Subject]) -> Drawing {
    let width = MARGIN + COLUMNS as f64 * (COLUMN + MARGIN);
    let mut drawing = Drawing::new(width, 0.0);
    let mut top = MARGIN;
    for row in subjects.chunks(COLUMNS) {
        let bottoms = row.iter().enumerate().map(|(column, subject)| {
            let left = MARGIN + column as f64 * (COLUMN + MARGIN);
            cell(&mut drawing, subject, [left, top])
        });
        top = bottoms.fold(top, f64::max) + 1.6 * MARGIN;
    }
    drawing.extend_to(top);
    drawing
}

/// Draws one subject; returns where it ends \[px\].
fn cell(drawing: &mut Drawing, subject: &Subject, [left, top]: [f64; 2]) -> f64 {
    let mut line = |words: String, below: f64, size: f64, colour| {
        drawing.text(Text { at: [left, top + below], words, size, colour, anchor: Anchor::Start });
    };
    line(subject.name.clone(), 14.0, 16.0, INK);
    line(subject.summary(), 31.0, 12.0, MUTED);
    let views = Views::fitting(subject, [COLUMN, HEIGHT_LIMIT]);
    let indent = (COLUMN - views.width()) / 2.0;
    views.draw(drawing, subject, [left + indent, top + HEADING], Detail::Sheet)
}
