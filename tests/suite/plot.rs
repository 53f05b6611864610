//! Line charts, two panels beside each other.

use kestrel_draw::chart::{Axis, INK, MARGIN, colour};
use kestrel_draw::drawing::{Anchor, Drawing, Pen, Text};

/// Width and height of a panel \[px\].
const PANEL: [f64; 2] = [430.0, 260.0];

/// Space left of a panel and below it, and height of a line of the legend \[px\].
const NUMBERS: f64 = 50.0;
const BELOW: f64 = 60.0;
const ROW: f64 = 22.0;

/// Lines of the longest legend.
const ROWS: f64 = 3.0;

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
    pub(crate) points: Vec<[f64; 2]>,
}

/// One chart.
#[derive(Debug)]
pub(crate) struct Panel {
    pub(crate) title: &'static str,
    pub(crate) across: &'static str,
    pub(crate) lines: Vec<Line>,
}

impl Role {
    /// Later lines lie over earlier ones: they are thinner, so that equal ones both show.
    fn pen(self) -> Pen {
        match self {
            Self::Clean => Pen::solid(colour(2), 5.0),
            Self::Upstream => Pen::solid(colour(0), 3.0),
            Self::Fork => Pen::solid(colour(1), 1.5),
        }
    }
}

/// The SVG of two panels.
pub(crate) fn picture(panels: &[Panel; 2]) -> String {
    let [width, height] = PANEL;
    let top = 46.0 + ROW * ROWS;
    let mut drawing = Drawing::new(2.0 * (NUMBERS + width + MARGIN) + MARGIN, top + height + BELOW);
    for (column, panel) in panels.iter().enumerate() {
        draw(&mut drawing, panel, [NUMBERS + MARGIN + column as f64 * (NUMBERS + width + MARGIN), top]);
    }
    drawing.svg()
}

fn draw(drawing: &mut Drawing, panel: &Panel, [left, top]: [f64; 2]) {
    let words =
        |at, words: &str, size| Text { at, words: words.to_owned(), size, colour: INK, anchor: Anchor::Start };
    drawing.text(words([left, 28.0], panel.title, 17.0));
    for (index, line) in panel.lines.iter().enumerate() {
        let y = 48.0 + ROW * index as f64;
        drawing.line([[left, y], [left + 24.0, y]], line.role.pen());
        drawing.text(words([left + 34.0, y + 5.0], &line.name, 14.0));
    }
    let points = || panel.lines.iter().flat_map(|line| &line.points);
    let axes = kestrel_draw::chart::Axes {
        left,
        top,
        width: PANEL[0],
        height: PANEL[1],
        x: Axis::numbers(range(points().map(|[x, _]| *x)), 6.0),
        y: Axis::around(points().map(|[_, y]| *y), 5.0),
    };
    axes.draw_axes(drawing);
    axes.name_axes(drawing, [panel.across, ""]);
    for line in &panel.lines {
        axes.path(drawing, line.points.iter().copied(), line.role.pen());
    }
}

fn range(values: impl Iterator<Item = f64> + Clone) -> [f64; 2] {
    [values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max)]
}
