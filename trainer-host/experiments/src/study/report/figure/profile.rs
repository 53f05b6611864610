//! Performance profiles: how many runs are at least how good.

use crate::statistics::bootstrap::interval;
use crate::statistics::sample::Sample;
use crate::study::data::StudyData;
use crate::study::report::summary::{Summary, final_success};
use kestrel_draw::chart::{Axes, Axis, MARGIN, TOP, colour, legend, pen, titled};
use kestrel_draw::drawing::Drawing;

/// Thresholds between 0 and 1 at which shares are counted.
const THRESHOLDS: usize = 100;

/// Repetitions of the bands, as Agarwal et al. 2021.
const REPETITIONS: usize = 2_000;

/// A line per method that has runs.
pub(super) fn draw(data: &StudyData, summary: &Summary) -> Option<Drawing> {
    let samples: Vec<(usize, Sample)> =
        (0..data.manifest.methods.len()).map(|method| (method, final_success(data, method))).collect();
    let samples: Vec<(usize, Sample)> = samples.into_iter().filter(|(_, sample)| !sample.is_empty()).collect();
    let about =
        "Share of runs and tasks whose final success exceeds what the horizontal axis says. Higher is better.";
    let mut drawing = titled(980.0, "Performance profile", about);
    let label = |method: usize| data.manifest.methods[method].label.as_str();
    let top = legend(&mut drawing, samples.iter().map(|(method, _)| (*method, label(*method))), TOP + 8.0);
    let panel = Axes {
        left: MARGIN + 56.0,
        top: top + 40.0,
        width: drawing.width - 2.0 * MARGIN - 70.0,
        height: 420.0,
        x: Axis::shares(0.1),
        y: Axis::shares(0.2),
    };
    panel.draw_axes(&mut drawing);
    panel.name_axes(&mut drawing, ["final success", "share of runs and tasks above"]);
    for (method, sample) in &samples {
        draw_profile(&mut drawing, &panel, summary, *method, sample);
    }
    drawing.extend_to(panel.bottom() + 60.0);
    (!samples.is_empty()).then_some(drawing)
}

fn draw_profile(drawing: &mut Drawing, panel: &Axes, summary: &Summary, method: usize, sample: &Sample) {
    let thresholds: Vec<f64> = (0..=THRESHOLDS).map(|index| index as f64 / THRESHOLDS as f64).collect();
    let resamples = summary.few.first(REPETITIONS);
    let profiles: Vec<Vec<f64>> =
        resamples.iter().filter_map(|counts| sample.shares_above(counts, &thresholds)).collect();
    let band = |index: usize| {
        let [low, high] = interval(profiles.iter().map(|profile| profile[index]).collect(), sample.units())?;
        Some([thresholds[index], low, high])
    };
    if sample.units() > 1 {
        let band: Vec<[f64; 3]> = (0..thresholds.len()).filter_map(band).collect();
        panel.band(drawing, &band, colour(method), 0.12);
    }
    let Some(shares) = sample.shares_above(&resamples.once(), &thresholds) else { return };
    let points = thresholds.iter().zip(shares).map(|(threshold, share)| [*threshold, share]);
    panel.path(drawing, points, pen(method, 3.0));
}
