//! How soon a task is learned: Kaplan–Meier estimates.

use crate::statistics::bootstrap::interval;
use crate::statistics::survival::{Durations, SurvivalCurve};
use crate::study::data::StudyData;
use crate::study::report::summary::Summary;
use crate::study::report::threshold::{Learning, anybody_got_there};
use kestrel_draw::chart::{Axes, Axis, INK, MARGIN, TOP, colour, legend, pen, titled};
use kestrel_draw::drawing::{Anchor, Drawing, Text};

/// Repetitions of the bands.
const REPETITIONS: usize = 1_000;

/// Places along the budget at which a band is drawn.
const PLACES: usize = 120;

/// Width and height of a panel, and the space below it \[px\].
const PANEL: [f64; 2] = [400.0, 230.0];
const BELOW: f64 = 84.0;

/// A panel per task, a line per method with curves; nothing where no stage reached the threshold.
pub(super) fn draw(data: &StudyData, summary: &Summary, learnings: &[Learning]) -> Option<Drawing> {
    if !anybody_got_there(learnings) {
        return None;
    }
    let threshold = 100.0 * data.manifest.success_threshold;
    let about =
        "Share of stages whose success has reached the threshold (1 − Kaplan–Meier), with 95 % bands over seeds.";
    let title = format!("Steps until {threshold:.0} % success");
    let mut drawing = titled(2.0 * (MARGIN + 52.0 + PANEL[0]) + MARGIN, &title, about);
    let label = |learning: &Learning| data.manifest.methods[learning.method].label.as_str();
    let entries = learnings.iter().map(|learning| (learning.method, label(learning)));
    let top = legend(&mut drawing, entries, TOP + 8.0) + 40.0;
    for (index, task) in data.manifest.tasks.iter().enumerate() {
        let [column, row] = [index % 2, index / 2].map(|place| place as f64);
        let panel = Axes {
            left: MARGIN + 52.0 + column * (PANEL[0] + 52.0 + MARGIN),
            top: top + row * (PANEL[1] + BELOW),
            width: PANEL[0],
            height: PANEL[1],
            x: Axis::steps(data.manifest.steps_per_stage.max(1) as f64, 5.0),
            y: Axis::shares(0.25),
        };
        panel.draw_axes(&mut drawing);
        panel.name_axes(&mut drawing, ["environment steps of the stage", ""]);
        let at = [panel.left, panel.top - 14.0];
        drawing.text(Text { at, words: task.name.clone(), size: 16.0, colour: INK, anchor: Anchor::Start });
        for learning in learnings {
            draw_learning(&mut drawing, &panel, summary, learning.method, &learning.tasks[index]);
        }
    }
    let rows = data.manifest.tasks.len().div_ceil(2) as f64;
    drawing.extend_to(top + rows * (PANEL[1] + BELOW));
    Some(drawing)
}

fn draw_learning(drawing: &mut Drawing, panel: &Axes, summary: &Summary, method: usize, durations: &Durations) {
    let Some(curve) = durations.curve(&summary.few.once()) else { return };
    if durations.units() > 1 {
        let resamples = summary.few.first(REPETITIONS);
        let curves: Vec<SurvivalCurve> = resamples.iter().filter_map(|counts| durations.curve(counts)).collect();
        let band: Vec<[f64; 3]> = (0..=PLACES)
            .map(|place| panel.x.high * place as f64 / PLACES as f64)
            .filter_map(|steps| {
                let shares = curves.iter().map(|curve| 1.0 - curve.share_at(steps));
                interval(shares.collect(), durations.units()).map(|[low, high]| [steps, low, high])
            })
            .collect();
        panel.band(drawing, &band, colour(method), 0.12);
    }
    panel.path(drawing, staircase(&curve, panel.x.high), pen(method, 3.0));
}

/// Corners of one minus the curve.
fn staircase(curve: &SurvivalCurve, limit: f64) -> Vec<[f64; 2]> {
    let mut corners = vec![[0.0, 0.0]];
    let mut share = 0.0;
    for (time, waiting) in curve.steps.iter().filter(|(time, _)| *time <= limit) {
        corners.extend([[*time, share], [*time, 1.0 - waiting]]);
        share = 1.0 - waiting;
    }
    corners.push([limit, share]);
    corners
}
