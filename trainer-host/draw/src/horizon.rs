//! Errors of predictions over the time that they look ahead, as SVG: a panel each signal, a line each model.

use plotters::prelude::*;

use crate::curve::{Area, BLUE, CurveError, GREEN, GRID, INK, MUTED, PAPER, font, heading, with_unit};

/// Width of the picture and height of a panel \[px\].
const SIZE: (u32, u32) = (1440, 420);

/// Height of the title above the panels \[px\].
const TITLE_HEIGHT: u32 = 130;

/// Space for the numbers left of a panel \[px\].
const LEFT_LABELS: u32 = 120;

/// Width of a letter in the names of the models \[px\], and of the space after each.
const LETTER_WIDTH: usize = 13;

/// Colours of the models, in their order.
const COLOURS: [RGBColor; 4] = [MUTED, RGBColor(0xd9, 0x6c, 0x1e), BLUE, GREEN];

/// Mean errors of one signal.
#[derive(Clone, Debug, PartialEq)]
pub struct HorizonPanel {
    /// Signal and unit, such as `velocity [m/s]`.
    pub name: String,
    /// Name of each model, and its mean errors after 1, 2, … steps.
    pub models: Vec<(String, Vec<f64>)>,
}

/// SVG of the panels under `title` and `summary`; a step takes `step_secs`.
///
/// # Errors
/// [`CurveError`] when the plotting library fails.
pub fn horizon_chart(
    title: &str,
    summary: &str,
    step_secs: f64,
    panels: &[HorizonPanel],
) -> Result<String, CurveError> {
    let mut svg = String::new();
    let size = (SIZE.0, TITLE_HEIGHT + SIZE.1 * panels.len().max(1) as u32);
    let canvas = SVGBackend::with_string(&mut svg, size).into_drawing_area();
    canvas.fill(&PAPER)?;
    let (top, below) = canvas.split_vertically(TITLE_HEIGHT);
    heading(&top, title, summary)?;
    for (area, panel) in below.split_evenly((panels.len().max(1), 1)).iter().zip(panels) {
        draw_panel(area, step_secs, panel)?;
    }
    canvas.present()?;
    drop((top, below, canvas));
    Ok(svg)
}

fn draw_panel(area: &Area<'_>, step_secs: f64, panel: &HorizonPanel) -> Result<(), CurveError> {
    let steps = panel.models.iter().map(|(_, errors)| errors.len()).max().unwrap_or(0).max(1);
    let errors = panel.models.iter().flat_map(|(_, errors)| errors);
    let most = errors.copied().filter(|error| error.is_finite()).fold(0.0, f64::max).max(1e-9);
    let mut chart = ChartBuilder::on(area)
        .margin_right(56)
        .margin_top(52)
        .margin_bottom(10)
        .x_label_area_size(84)
        .y_label_area_size(LEFT_LABELS)
        .build_cartesian_2d(0.0..1e3 * step_secs * steps as f64, 0.0..1.1 * most)?;
    chart
        .configure_mesh()
        .axis_style(GRID)
        .bold_line_style(GRID)
        .max_light_lines(0)
        .x_labels(11)
        .y_labels(5)
        .x_label_formatter(&|&millis| with_unit(millis))
        .y_label_formatter(&|&error| with_unit(error))
        .label_style(font(22, &MUTED))
        .axis_desc_style(font(22, &MUTED))
        .x_desc("milliseconds ahead")
        .draw()?;
    let name = FontDesc::new(FontFamily::Name(crate::curve::FONT), 25.0, FontStyle::Bold).color(&INK);
    area.draw(&Text::new(panel.name.clone(), (LEFT_LABELS as i32, 12), name))?;
    let widths = panel.models.iter().map(|(model, _)| LETTER_WIDTH * (model.chars().count() + 4));
    let mut left = SIZE.0.saturating_sub(widths.clone().sum::<usize>() as u32) as i32;
    for ((index, (model, errors)), width) in panel.models.iter().enumerate().zip(widths) {
        let colour = COLOURS[index % COLOURS.len()];
        let points = errors.iter().enumerate().filter(|(_, error)| error.is_finite());
        let points = points.map(|(step, error)| (1e3 * step_secs * (step + 1) as f64, *error));
        chart.draw_series([PathElement::new(points.collect::<Vec<_>>(), colour.stroke_width(4))])?;
        area.draw(&Text::new(format!("— {model}"), (left, 14), font(23, &colour)))?;
        left += width as i32;
    }
    Ok(())
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
        let svg = horizon_chart("a", "b", 0.01, &[panel("velocity [m/s]"), panel("position [m]")]).unwrap();
        for text in ["velocity [m/s]", "position [m]", "identified", "milliseconds ahead"] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(!svg.contains("NaN") && svg.trim_end().ends_with("</svg>"));
        assert!(horizon_chart("a", "b", 0.01, &[]).is_ok());
    }
}
