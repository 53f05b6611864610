//! Learning curves: success while a task is being trained.

use super::panel::{Axis, Panel};
use super::style::{INK, MUTED, colour, pen};
use super::{MARGIN, TOP, titled, width_of, wrapped};
use crate::curve::with_unit;
use crate::drawing::{Anchor, Drawing, Pen, Text};
use crate::statistics::sample::Sample;
use crate::study::data::{MethodKind, Run, StudyData};
use crate::study::report::score::success_at;
use crate::study::rows::CurveRow;

/// Places along the budget at which the runs are compared.
const PLACES: usize = 80;

/// Space left of the panels, for the methods' labels \[px\].
const LABELS: f64 = 190.0;

/// Height of a panel, and the space beside and below it \[px\].
const HEIGHT: f64 = 112.0;
const GAP: f64 = 30.0;
const BELOW: f64 = 34.0;

/// A row per method with curves, a column per task. Joint training has one panel for all tasks.
pub(super) fn draw(data: &StudyData) -> Option<Drawing> {
    let has_curves = |method: &usize| data.runs_of(*method).any(|run| !run.curve.is_empty());
    let methods: Vec<usize> = (0..data.manifest.methods.len()).filter(has_curves).collect();
    let tasks = data.manifest.tasks.len();
    let width = (840.0 / tasks as f64).clamp(130.0, 300.0);
    let total = (LABELS + MARGIN + tasks as f64 * (width + GAP) + 62.0).max(860.0);
    let about =
        "Success of test flights in the task that trains: median over runs, the middle half of them shaded.";
    let mut drawing = titled(total, "Learning curves", about);
    let grid = Grid { data, width, rows: methods.len() };
    grid.draw_headings(&mut drawing);
    for (row, &method) in methods.iter().enumerate() {
        grid.draw_row(&mut drawing, row, method);
    }
    drawing.extend_to(Grid::top(methods.len()) + 48.0);
    (!methods.is_empty()).then_some(drawing)
}

struct Grid<'a> {
    data: &'a StudyData,
    width: f64,
    rows: usize,
}

impl Grid<'_> {
    fn left(&self, column: usize) -> f64 {
        MARGIN + LABELS + 44.0 + column as f64 * (self.width + GAP)
    }

    fn top(row: usize) -> f64 {
        TOP + 46.0 + row as f64 * (HEIGHT + BELOW)
    }

    fn draw_headings(&self, drawing: &mut Drawing) {
        for (column, task) in self.data.manifest.tasks.iter().enumerate() {
            let at = [self.left(column), Self::top(0) - 14.0];
            drawing.text(Text { at, words: task.name.clone(), size: 15.0, colour: INK, anchor: Anchor::Start });
        }
        let at = [self.left(self.data.manifest.tasks.len()) - GAP, Self::top(self.rows) + 10.0];
        let words = "environment steps of the stage".to_owned();
        drawing.text(Text { at, words, size: 14.0, colour: MUTED, anchor: Anchor::End });
        let (start, words) = (self.left(0) - width_of("100 %", 13.0), "- - -  experts' median");
        let at = [start.max(MARGIN), Self::top(self.rows) + 10.0];
        if self.experts().is_some() {
            drawing.text(Text { at, words: words.to_owned(), size: 14.0, colour: MUTED, anchor: Anchor::Start });
        }
    }

    fn draw_row(&self, drawing: &mut Drawing, row: usize, method: usize) {
        let label = &self.data.manifest.methods[method].label;
        for (line, words) in wrapped(label, LABELS - 10.0, 15.0).into_iter().take(4).enumerate() {
            let at = [MARGIN, Self::top(row) + 18.0 + 19.0 * line as f64];
            drawing.text(Text { at, words, size: 15.0, colour: INK, anchor: Anchor::Start });
        }
        if self.data.manifest.methods[method].kind == MethodKind::Joint {
            return self.draw_joint(drawing, row, method);
        }
        for task in 0..self.data.manifest.tasks.len() {
            let panel = self.panel([task, row]);
            panel.draw_axes(drawing);
            if let Some(experts) = self.experts().filter(|experts| *experts != method) {
                let reference = self.curves_in(experts, task);
                panel.path(drawing, median(&reference, panel.x.high), Pen::dashes(MUTED, 1.5));
            }
            draw_curves(drawing, &panel, method, &self.curves_in(method, task));
        }
    }

    /// One panel, whose steps may go on for longer than those of a task.
    fn draw_joint(&self, drawing: &mut Drawing, row: usize, method: usize) {
        let curves = self.curves(method, |_| Some(1));
        let mut panel = self.panel([0, row]);
        let last_steps = curves.iter().filter_map(|curve| curve.last()).map(|last| last.steps as f64);
        let longest = last_steps.fold(0.0, f64::max);
        if longest > 1.001 * panel.x.high {
            panel.x = Axis::steps(longest, 3.0);
        }
        panel.draw_axes(drawing);
        draw_curves(drawing, &panel, method, &curves);
        let words = format!("all tasks at once, {} steps", with_unit(panel.x.high));
        let at = [panel.left + panel.width + 14.0, panel.top + 18.0];
        drawing.text(Text { at, words, size: 14.0, colour: MUTED, anchor: Anchor::Start });
    }

    fn experts(&self) -> Option<usize> {
        self.data.manifest.methods.iter().position(|method| method.kind == MethodKind::Experts)
    }

    fn panel(&self, [column, row]: [usize; 2]) -> Panel {
        let steps = Axis::steps(self.limit(), (self.width / 70.0).max(2.0));
        let shares = Axis::shares(0.5);
        Panel {
            left: self.left(column),
            top: Self::top(row),
            width: self.width,
            height: HEIGHT,
            x: if row + 1 == self.rows { steps } else { steps.silent() },
            y: if column == 0 { shares } else { shares.silent() },
        }
    }

    fn limit(&self) -> f64 {
        self.data.manifest.steps_per_stage.max(1) as f64
    }

    fn curves_in(&self, method: usize, task: usize) -> Vec<Vec<&CurveRow>> {
        self.curves(method, |run| {
            self.data.order(run).iter().position(|trained| *trained == task).map(|position| position + 1)
        })
    }

    fn curves(&self, method: usize, stage: impl Fn(&Run) -> Option<usize>) -> Vec<Vec<&CurveRow>> {
        let curves = self.data.runs_of(method).filter_map(|run| Some(run.curve_of(stage(run)?).collect()));
        curves.filter(|curve: &Vec<&CurveRow>| !curve.is_empty()).collect()
    }
}

fn draw_curves(drawing: &mut Drawing, panel: &Panel, method: usize, curves: &[Vec<&CurveRow>]) {
    let band: Vec<[f64; 3]> = places(panel.x.high)
        .filter_map(|steps| Some([steps, quantile(curves, steps, 0.25)?, quantile(curves, steps, 0.75)?]))
        .collect();
    panel.band(drawing, &band, colour(method), 0.25);
    panel.path(drawing, median(curves, panel.x.high), pen(method, 2.5));
}

fn median(curves: &[Vec<&CurveRow>], limit: f64) -> Vec<[f64; 2]> {
    places(limit).filter_map(|steps| Some([steps, quantile(curves, steps, 0.5)?])).collect()
}

fn places(limit: f64) -> impl Iterator<Item = f64> {
    (0..=PLACES).map(move |index| limit * index as f64 / PLACES as f64)
}

fn quantile(curves: &[Vec<&CurveRow>], steps: f64, share: f64) -> Option<f64> {
    Sample::new(curves.iter().map(|curve| (0, success_at(curve, steps)))).quantile(&[1], share)
}
