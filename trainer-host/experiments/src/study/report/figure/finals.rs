//! Final success of every method with its interval.

use crate::study::data::StudyData;
use crate::study::report::summary::{MethodSummary, Summary};
use kestrel_draw::chart::{Axes, Axis, INK, MARGIN, MUTED, PAPER, TOP, colour, titled, width_of};
use kestrel_draw::drawing::{Anchor, Drawing, Pen, Text};

const ROW: f64 = 40.0;
const LABEL: f64 = 15.0;
const PLOT: f64 = 620.0;

/// A row per method that has runs.
pub(super) fn draw(data: &StudyData, summary: &Summary) -> Option<Drawing> {
    let with_mean = |(_, method): &(usize, &MethodSummary)| method.mean.is_some();
    let methods: Vec<(usize, &MethodSummary)> = summary.methods.iter().enumerate().filter(with_mean).collect();
    let label = |method: usize| data.manifest.methods[method].label.as_str();
    let labels = methods.iter().map(|(method, _)| width_of(label(*method), LABEL)).fold(60.0, f64::max);
    let left = MARGIN + labels + 14.0;
    let about = "Mean over seeds, orders and tasks with its 95 % interval (filled); interquartile mean (hollow).";
    let mut drawing = titled(left + PLOT + 48.0, "Success after the last task", about);
    let panel = Axes {
        left,
        top: TOP + 8.0,
        width: PLOT,
        height: ROW * methods.len() as f64,
        x: Axis::shares(0.1),
        y: Axis { low: 0.0, high: methods.len() as f64, ticks: Vec::new() },
    };
    panel.draw_axes(&mut drawing);
    for (row, (method, found)) in methods.iter().enumerate() {
        let y = methods.len() as f64 - row as f64 - 0.5;
        let at = [left - 14.0, panel.at([0.0, y])[1] + 5.0];
        let words = label(*method).to_owned();
        drawing.text(Text { at, words, size: LABEL, colour: INK, anchor: Anchor::End });
        draw_estimates(&mut drawing, &panel, *method, found, y);
    }
    draw_baseline(&mut drawing, &panel, data);
    drawing.extend_to(panel.bottom() + 66.0);
    (!methods.is_empty()).then_some(drawing)
}

fn draw_estimates(drawing: &mut Drawing, panel: &Axes, method: usize, found: &MethodSummary, y: f64) {
    let colour = colour(method);
    if let Some(middle) = found.interquartile_mean {
        let centre = panel.at([middle.value, y - 0.2]);
        drawing.disc(centre, 4.5, Some((PAPER, 1.0)), Some(Pen::solid(colour, 2.0)));
    }
    let Some(mean) = found.mean else { return };
    if let Some([low, high]) = mean.interval {
        let ends = [panel.at([low, y + 0.1]), panel.at([high, y + 0.1])];
        drawing.line(ends, Pen::solid(colour, 4.0));
    }
    drawing.disc(panel.at([mean.value, y + 0.1]), 6.5, Some((colour, 1.0)), None);
}

/// The best of the trivial pilots, averaged over tasks.
fn draw_baseline(drawing: &mut Drawing, panel: &Axes, data: &StudyData) {
    let mut pilots: Vec<(&str, f64)> = Vec::new();
    for baseline in &data.manifest.baselines {
        if pilots.iter().all(|(pilot, _)| *pilot != baseline.pilot) {
            let rows = data.manifest.baselines.iter().filter(|row| row.pilot == baseline.pilot);
            let rates: Vec<f64> = rows.map(|row| row.success_rate).collect();
            pilots.push((&baseline.pilot, rates.iter().sum::<f64>() / rates.len() as f64));
        }
    }
    let Some((pilot, rate)) = pilots.into_iter().max_by(|first, second| first.1.total_cmp(&second.1)) else {
        return;
    };
    let [x, top] = panel.at([rate, panel.y.high]);
    drawing.line([[x, top], [x, panel.bottom() + 6.0]], Pen::dashes(MUTED, 2.0));
    let words = format!("{pilot}: {:.0} %", 100.0 * rate);
    let anchor = if rate > 0.5 { Anchor::End } else { Anchor::Start };
    let at = [if rate > 0.5 { x + 6.0 } else { x - 6.0 }, panel.bottom() + 44.0];
    drawing.text(Text { at, words, size: 14.0, colour: MUTED, anchor });
}
