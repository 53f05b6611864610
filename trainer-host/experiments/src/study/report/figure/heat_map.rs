//! Success in every task after every stage, as shades.

use crate::statistics::bootstrap::Estimate;
use crate::study::data::{MethodKind, StudyData};
use crate::study::report::summary::Summary;
use kestrel_draw::chart::{INK, MARGIN, MUTED, PAPER, TOP, titled, width_of, wrapped};
use kestrel_draw::drawing::{Anchor, Colour, Drawing, Pen, Text};

/// Greatest width of the picture \[px\].
const WIDTH: f64 = 1100.0;

/// Least width of a cell, and the height of all \[px\].
const CELL: [f64; 2] = [64.0, 36.0];

/// Space left of the cells, for the stages \[px\].
const STAGES: f64 = 74.0;

/// Space above the cells, for three lines: the method's label and the tasks \[px\].
const HEADING: f64 = 70.0;

/// Space between two matrices \[px\].
const GAP: f64 = 34.0;

const SMALL: f64 = 13.0;

/// A small matrix per method that has runs.
pub(super) fn draw(data: &StudyData, summary: &Summary) -> Option<Drawing> {
    let methods: Vec<usize> =
        (0..summary.methods.len()).filter(|method| summary.methods[*method].runs > 0).collect();
    let names = (0..summary.columns.len()).map(|column| width_of(&summary.columns.name(data, column), SMALL));
    let cell_width = names.fold(CELL[0], |width, name| width.max(name + 8.0));
    let width = STAGES + cell_width * summary.columns.len() as f64;
    let per_row = (((WIDTH - 2.0 * MARGIN + GAP) / (width + GAP)).floor() as usize).clamp(1, methods.len().max(1));
    let total = (2.0 * MARGIN + per_row as f64 * (width + GAP) - GAP).max(760.0);
    let about = "Mean success [%] over seeds and orders. Below the staircase: tasks that were trained before.";
    let mut drawing = titled(total, "Success in each task after each stage", about);
    let mut top = TOP;
    for row in methods.chunks(per_row) {
        let mut bottom = top;
        for (place, &method) in row.iter().enumerate() {
            let corner = [MARGIN + place as f64 * (width + GAP), top];
            let matrix = Matrix { data, summary, method, corner, cell: [cell_width, CELL[1]] };
            bottom = matrix.draw(&mut drawing).max(bottom);
        }
        top = bottom + GAP;
    }
    drawing.extend_to(top);
    (!methods.is_empty()).then_some(drawing)
}

struct Matrix<'a> {
    data: &'a StudyData,
    summary: &'a Summary,
    method: usize,
    corner: [f64; 2],
    cell: [f64; 2],
}

impl Matrix<'_> {
    /// Returns where it ends \[px\].
    fn draw(&self, drawing: &mut Drawing) -> f64 {
        let rows = &self.summary.methods[self.method].matrix;
        self.draw_headings(drawing);
        let shown = rows.iter().enumerate().filter(|(_, row)| row.iter().any(Option::is_some));
        let mut top = self.corner[1] + HEADING;
        for (stage, row) in shown {
            let at = [self.corner[0] + STAGES - 8.0, top + 0.5 * self.cell[1] + 5.0];
            let words = self.stage_name(stage);
            drawing.text(Text { at, words, size: SMALL, colour: MUTED, anchor: Anchor::End });
            for (column, estimate) in row.iter().enumerate() {
                self.draw_cell(drawing, column, *estimate, top);
            }
            top += self.cell[1];
        }
        self.draw_staircases(drawing, top);
        top
    }

    fn draw_headings(&self, drawing: &mut Drawing) {
        let [left, top] = self.corner;
        let label = &self.data.manifest.methods[self.method].label;
        let width = STAGES + self.cell[0] * self.summary.columns.len() as f64;
        for (line, words) in wrapped(label, width, 16.0).into_iter().take(2).enumerate() {
            let at = [left, top + 18.0 + 19.0 * line as f64];
            drawing.text(Text { at, words, size: 16.0, colour: INK, anchor: Anchor::Start });
        }
        for column in 0..self.summary.columns.len() {
            let at = [left + STAGES + (column as f64 + 0.5) * self.cell[0], top + HEADING - 8.0];
            let words = self.summary.columns.name(self.data, column);
            drawing.text(Text { at, words, size: SMALL, colour: MUTED, anchor: Anchor::Middle });
        }
    }

    /// Above each task and stage that it was trained in, when tasks follow each other; the last row ends at `bottom`.
    fn draw_staircases(&self, drawing: &mut Drawing, bottom: f64) {
        if self.data.manifest.methods[self.method].kind == MethodKind::Sequential {
            let stages = self.summary.columns.len();
            for stage in 1..=stages {
                self.draw_staircase(drawing, stage, bottom - (stages + 1 - stage) as f64 * self.cell[1]);
            }
        }
    }

    fn stage_name(&self, stage: usize) -> String {
        match (self.data.manifest.methods[self.method].kind, stage) {
            (_, 0) => "untrained".to_owned(),
            (MethodKind::Sequential, stage) => format!("after {stage}"),
            (MethodKind::Joint | MethodKind::Averaged, _) => "trained".to_owned(),
            (MethodKind::Experts, stage) => format!("expert {stage}"),
        }
    }

    fn draw_cell(&self, drawing: &mut Drawing, column: usize, estimate: Option<Estimate>, top: f64) {
        let left = self.corner[0] + STAGES + column as f64 * self.cell[0];
        let [right, bottom] = [left + self.cell[0], top + self.cell[1]];
        let corners = vec![[left, top], [right, top], [right, bottom], [left, bottom]];
        let value = estimate.map(|estimate| estimate.value);
        let fill = value.map_or(PAPER, shade);
        drawing.polygon(corners, Some((fill, 1.0)), Some(Pen::solid(PAPER, 2.0)));
        let words = value.map_or("–".to_owned(), |value| format!("{:.0}", 100.0 * value));
        let colour = value.map_or(MUTED, on_shade);
        let at = [0.5 * (left + right), 0.5 * (top + bottom) + 5.5];
        drawing.text(Text { at, words, size: 16.0, colour, anchor: Anchor::Middle });
    }

    /// Between the tasks that were trained before and those to come.
    fn draw_staircase(&self, drawing: &mut Drawing, stage: usize, top: f64) {
        let [left, right] = [stage - 1, stage].map(|edge| self.corner[0] + STAGES + edge as f64 * self.cell[0]);
        let bottom = top + self.cell[1];
        let pen = Pen::solid(INK, 2.0);
        drawing.path(vec![[left, top], [right, top], [right, bottom]], pen);
    }
}

/// From white at 0 to dark blue at 1: one hue, told apart by lightness.
fn shade(share: f64) -> Colour {
    let (light, dark) = ([0xf7, 0xfb, 0xff], [0x08, 0x45, 0x94]);
    let mix = |index: usize| {
        let (from, to): (u8, u8) = (light[index], dark[index]);
        (f64::from(from) + share.clamp(0.0, 1.0) * (f64::from(to) - f64::from(from))).round() as u8
    };
    Colour([mix(0), mix(1), mix(2)])
}

/// Readable on [`shade`].
fn on_shade(share: f64) -> Colour {
    if share > 0.55 { PAPER } else { INK }
}
