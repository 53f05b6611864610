//! Line charts as SVG, two panels beside each other.

use plotters::coord::Shift;
use plotters::prelude::*;

/// Width and height of a picture \[px\]; coordinates are whole pixels, so it is drawn large.
const SIZE: (u32, u32) = (2880, 1200);

/// Height of the legend above the axes \[px\], and of one of its lines.
const LEGEND_HEIGHT: u32 = 256;
const LEGEND_STEP: i32 = 60;

/// Space for the numbers left of a panel and below it \[px\].
const LEFT_LABELS: u32 = 220;
const BELOW_LABELS: u32 = 148;

const FONT: &str = "Helvetica Neue, Helvetica, Arial, sans-serif";
const INK: RGBColor = RGBColor(0x1f, 0x29, 0x33);
const MUTED: RGBColor = RGBColor(0x6b, 0x76, 0x83);
const GRID: RGBColor = RGBColor(0xe4, 0xe8, 0xee);
const PAPER: RGBColor = RGBColor(0xff, 0xff, 0xff);

/// What a line shows.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Role {
    /// The physics as it should be.
    Clean,
    /// The reference's.
    Upstream,
    /// The fork's, where it differs.
    Fork,
}

/// One line of a chart.
#[derive(Debug)]
pub(crate) struct Line {
    pub(crate) name: String,
    pub(crate) role: Role,
    pub(crate) points: Vec<(f64, f64)>,
}

/// One chart.
#[derive(Debug)]
pub(crate) struct Panel {
    pub(crate) title: &'static str,
    pub(crate) across: &'static str,
    pub(crate) lines: Vec<Line>,
}

impl Role {
    const fn colour(self) -> RGBColor {
        match self {
            Self::Clean => RGBColor(0x12, 0x9a, 0x74),
            Self::Upstream => RGBColor(0x2f, 0x6f, 0xde),
            Self::Fork => RGBColor(0xd9, 0x4f, 0x30),
        }
    }

    /// Later lines lie over earlier ones: they are thinner, so that equal ones both show.
    const fn width(self) -> u32 {
        match self {
            Self::Clean => 14,
            Self::Upstream => 8,
            Self::Fork => 4,
        }
    }
}

/// The SVG of two panels.
pub(crate) fn picture(panels: &[Panel; 2]) -> String {
    let mut svg = String::new();
    {
        let canvas = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        canvas.fill(&PAPER).unwrap();
        let (left, right) = canvas.split_horizontally(SIZE.0 / 2);
        draw(&left, &panels[0]);
        draw(&right, &panels[1]);
        canvas.present().unwrap();
    }
    svg
}

fn font(size: u32, colour: &RGBColor) -> TextStyle<'_> {
    (FONT, size).into_font().color(colour)
}

fn draw(area: &DrawingArea<SVGBackend<'_>, Shift>, panel: &Panel) {
    let bold = FontDesc::new(FontFamily::Name(FONT), 50.0, FontStyle::Bold).color(&INK);
    area.draw(&Text::new(panel.title, (LEFT_LABELS as i32, 28), bold)).unwrap();
    for (index, line) in panel.lines.iter().enumerate() {
        let y = 100 + LEGEND_STEP * index as i32;
        let x = LEFT_LABELS as i32;
        let colour = line.role.colour();
        area.draw(&PathElement::new([(x, y + 18), (x + 68, y + 18)], colour.stroke_width(line.role.width())))
            .unwrap();
        area.draw(&Text::new(line.name.as_str(), (x + 92, y), font(42, &INK))).unwrap();
    }
    let points = || panel.lines.iter().flat_map(|line| &line.points);
    let ((left, right), (low, high)) =
        (range(points().map(|point| point.0), 0.0), range(points().map(|p| p.1), 0.06));
    let mut chart = ChartBuilder::on(area)
        .margin_right(88)
        .margin_top(LEGEND_HEIGHT + 28)
        .margin_bottom(12)
        .x_label_area_size(BELOW_LABELS)
        .y_label_area_size(LEFT_LABELS)
        .build_cartesian_2d(left..right, low..high)
        .unwrap();
    chart
        .configure_mesh()
        .axis_style(GRID)
        .bold_line_style(GRID)
        .max_light_lines(0)
        .x_labels(7)
        .y_labels(6)
        .set_all_tick_mark_size(20)
        .x_label_formatter(&|value| short(*value))
        .y_label_formatter(&|value| short(*value))
        .label_style(font(40, &MUTED))
        .axis_desc_style(font(40, &MUTED))
        .x_desc(panel.across)
        .draw()
        .unwrap();
    for line in &panel.lines {
        let style = line.role.colour().stroke_width(line.role.width());
        chart.draw_series([PathElement::new(line.points.clone(), style)]).unwrap();
    }
}

/// The values' range, and a share of it more on both sides.
fn range(values: impl Iterator<Item = f64> + Clone, margin: f64) -> (f64, f64) {
    let (low, high) = (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max));
    let air = margin * (high - low).max(1e-9);
    (low - air, high + air)
}

/// A number as short as it can be read on an axis.
fn short(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.replace('-', "−") }
}
