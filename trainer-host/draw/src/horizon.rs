//! Errors of predictions over the time that they look ahead: a panel each signal, a line each model.

use crate::chart::{Axes, Axis, INK, MARGIN, MUTED, TOP, colour, titled};
use crate::drawing::{Anchor, Colour, Drawing, Pen, Text};

/// Width of the picture and height of a panel \[px\].
const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 190.0;

/// Space for the numbers left of a panel, for words above and below it \[px\].
const NUMBERS: f64 = 60.0;
const ABOVE: f64 = 36.0;
const BELOW: f64 = 56.0;

/// Mean errors of one signal.
#[derive(Clone, Debug, PartialEq)]
pub struct HorizonPanel {
    /// Signal and unit, such as `velocity [m/s]`.
    pub name: String,
    /// Name of each model, and its mean errors after 1, 2, … steps.
    pub models: Vec<(String, Vec<f64>)>,
}

/// The panels under `title` and `summary`; a step takes `step_secs`.
pub fn horizon_chart(title: &str, summary: &str, step_secs: f64, panels: &[HorizonPanel]) -> Drawing {
    let mut drawing = titled(WIDTH, title, summary);
    let mut top = TOP + 10.0;
    for panel in panels {
        top = draw_panel(&mut drawing, panel, step_secs, top) + BELOW;
    }
    drawing.extend_to(top);
    drawing
}

/// Draws a panel from `top`; returns where it ends \[px\].
fn draw_panel(drawing: &mut Drawing, shown: &HorizonPanel, step_secs: f64, top: f64) -> f64 {
    let steps = shown.models.iter().map(|(_, errors)| errors.len()).max().unwrap_or(0).max(1);
    let errors = shown.models.iter().flat_map(|(_, errors)| errors);
    let most = errors.copied().filter(|error| error.is_finite()).fold(0.0, f64::max).max(1e-9);
    let panel = Axes {
        left: MARGIN + NUMBERS,
        top: top + ABOVE,
        width: WIDTH - NUMBERS - 2.0 * MARGIN,
        height: HEIGHT,
        x: Axis::numbers([0.0, 1e3 * step_secs * steps as f64], 10.0),
        y: Axis::numbers([0.0, 1.1 * most], 5.0),
    };
    panel.draw_axes(drawing);
    panel.name_axes(drawing, ["milliseconds ahead", ""]);
    let at = [panel.left, panel.top - 14.0];
    drawing.text(Text { at, words: shown.name.clone(), size: 15.0, colour: INK, anchor: Anchor::Start });
    for (index, (_, errors)) in shown.models.iter().enumerate() {
        let points = errors.iter().enumerate().filter(|(_, error)| error.is_finite());
        let points = points.map(|(step, error)| [1e3 * step_secs * (step + 1) as f64, *error]);
        panel.path(drawing, points, pen(index));
    }
    let names = shown.models.iter().enumerate();
    panel.name_lines(drawing, names.map(|(index, (model, _))| (model.as_str(), pen(index))));
    panel.bottom()
}

/// The first model is what the others are compared with.
fn pen(index: usize) -> Pen {
    let colour: Colour = if index == 0 { MUTED } else { colour(index - 1) };
    Pen::solid(colour, 2.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_name_signals_and_models() {
        let panel = |name: &str| HorizonPanel {
            name: name.to_owned(),
            models: vec![("hold".to_owned(), vec![0.1, 0.2]), ("identified".to_owned(), vec![0.05, f64::NAN])],
        };
        let svg = horizon_chart("a", "b", 0.01, &[panel("velocity [m/s]"), panel("position [m]")]).svg();
        for text in ["velocity [m/s]", "position [m]", "identified", "milliseconds ahead"] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(!svg.contains("NaN") && svg.trim_end().ends_with("</svg>"));
        assert!(horizon_chart("a", "b", 0.01, &[]).svg().contains("</svg>"));
    }
}
