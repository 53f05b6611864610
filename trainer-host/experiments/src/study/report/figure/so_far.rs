//! What is left of all tasks so far, as their number grows.

use crate::statistics::bootstrap::Estimate;
use crate::study::data::StudyData;
use crate::study::report::summary::{MethodSummary, Summary};
use kestrel_draw::chart::{Axes, Axis, MARGIN, TOP, colour, legend, pen, titled};
use kestrel_draw::drawing::Drawing;

/// Two tasks are a line between two points, which a table says as well.
const FEWEST_TASKS: usize = 3;

/// Numbers at the axis of tasks, at most.
const NUMBERS: usize = 12;

/// A line per sequence that has runs.
pub(super) fn draw(data: &StudyData, summary: &Summary) -> Option<Drawing> {
    let tasks = summary.columns.len();
    let learned = |(_, found): &(usize, &MethodSummary)| found.so_far.iter().any(Option::is_some);
    let sequences: Vec<(usize, &MethodSummary)> = summary.methods.iter().enumerate().filter(learned).collect();
    if sequences.is_empty() || tasks < FEWEST_TASKS {
        return None;
    }
    let about = "Mean success after each stage in the tasks trained until then, with 95 % bands over seeds.";
    let mut drawing = titled(980.0, "Success in the tasks learned so far", about);
    let label = |method: usize| data.manifest.methods[method].label.as_str();
    let entries = sequences.iter().map(|(method, _)| (*method, label(*method)));
    let top = legend(&mut drawing, entries, TOP + 8.0);
    let panel = Axes {
        left: MARGIN + 56.0,
        top: top + 40.0,
        width: drawing.width - 2.0 * MARGIN - 70.0,
        height: 420.0,
        x: task_axis(tasks),
        y: Axis::shares(0.2),
    };
    panel.draw_axes(&mut drawing);
    panel.name_axes(&mut drawing, ["tasks learned", "success in them"]);
    for (method, found) in &sequences {
        draw_sequence(&mut drawing, &panel, *method, &found.so_far);
    }
    drawing.extend_to(panel.bottom() + 60.0);
    Some(drawing)
}

fn task_axis(tasks: usize) -> Axis {
    let step = tasks.div_ceil(NUMBERS);
    let ticks =
        (1..=tasks).filter(|count| count.is_multiple_of(step)).map(|count| (count as f64, count.to_string()));
    Axis { low: 1.0, high: tasks as f64, ticks: ticks.collect() }
}

fn draw_sequence(drawing: &mut Drawing, panel: &Axes, method: usize, so_far: &[Option<Estimate>]) {
    let points = so_far.iter().zip(1_u32..).filter_map(|(found, count)| Some((f64::from(count), (*found)?)));
    let points: Vec<(f64, Estimate)> = points.collect();
    let band: Vec<[f64; 3]> =
        points.iter().filter_map(|(count, found)| found.interval.map(|[low, high]| [*count, low, high])).collect();
    if !band.is_empty() {
        panel.band(drawing, &band, colour(method), 0.12);
    }
    panel.path(drawing, points.iter().map(|(count, found)| [*count, found.value]), pen(method, 3.0));
    for (count, found) in points {
        drawing.disc(panel.at([count, found.value]), 4.0, Some((colour(method), 1.0)), None);
    }
}
