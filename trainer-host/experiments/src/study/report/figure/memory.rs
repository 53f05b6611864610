//! Bytes against retention.

use crate::statistics::bootstrap::Estimate;
use crate::study::data::{Method, MethodKind, StudyData};
use crate::study::report::notation::bytes;
use crate::study::report::summary::{MethodSummary, Summary};
use kestrel_draw::chart::{Axes, Axis, GRID, INK, MARGIN, MUTED, PAPER, TOP, colour, titled, width_of};
use kestrel_draw::drawing::{Anchor, Drawing, Pen, Text};

const LABEL: f64 = 14.0;

/// Radius of a point, and half the height of a label \[px\].
const POINT: f64 = 7.0;
const HALF_LINE: f64 = 9.0;

/// A point of the picture.
struct Point<'a> {
    method: usize,
    label: &'a str,
    sequential: bool,
    stored_bytes: u64,
    success: f64,
    interval: Option<[f64; 2]>,
}

/// A rectangle that is taken: left, top, right, bottom \[px\].
type Taken = [f64; 4];

/// A point per method that has runs; the staircase connects sequences that no other beats in both.
pub(super) fn draw(data: &StudyData, summary: &Summary) -> Option<Drawing> {
    let points = points(data, summary);
    let about =
        "Bytes kept from task to task beyond the policy. Filled: tasks one after the other; hollow: not so.";
    let mut drawing = titled(980.0, "Memory against success after the last task", about);
    let panel = Axes {
        left: MARGIN + 56.0,
        top: TOP + 36.0,
        width: drawing.width - 2.0 * MARGIN - 80.0,
        height: 440.0,
        x: byte_axis(&points),
        y: Axis::shares(0.2),
    };
    panel.draw_axes(&mut drawing);
    panel.name_axes(&mut drawing, ["bytes kept from task to task", "final success, with 95 % interval"]);
    let frontier = frontier(&panel, &points);
    drawing.path(frontier.clone(), Pen::dashes(MUTED, 1.5));
    for point in &points {
        draw_point(&mut drawing, &panel, point);
    }
    draw_labels(&mut drawing, &panel, &points, &frontier);
    drawing.extend_to(panel.bottom() + 60.0);
    (!points.is_empty()).then_some(drawing)
}

fn points<'a>(data: &'a StudyData, summary: &Summary) -> Vec<Point<'a>> {
    let methods = data.manifest.methods.iter().zip(&summary.methods).enumerate();
    methods.filter_map(|(method, (about, found))| point(method, about, found)).collect()
}

fn point<'a>(method: usize, about: &'a Method, found: &MethodSummary) -> Option<Point<'a>> {
    let Estimate { value: success, interval, .. } = found.mean?;
    let sequential = about.kind == MethodKind::Sequential;
    Some(Point { method, label: &about.label, sequential, stored_bytes: about.stored_bytes, success, interval })
}

/// Where a number of bytes stands: its logarithm, and nothing at all a decade left of the fewest.
fn place(stored_bytes: u64, fewest: f64) -> f64 {
    if stored_bytes == 0 { fewest - 1.0 } else { (stored_bytes as f64).log10() }
}

fn fewest(points: &[Point<'_>]) -> f64 {
    let places = points.iter().filter(|point| point.stored_bytes > 0).map(|point| place(point.stored_bytes, 0.0));
    let fewest = places.fold(f64::INFINITY, f64::min);
    if fewest.is_finite() { fewest.floor() } else { 3.0 }
}

fn byte_axis(points: &[Point<'_>]) -> Axis {
    let low = fewest(points);
    let high = points.iter().map(|point| place(point.stored_bytes, low)).fold(low + 1.0, f64::max).ceil();
    let decade = |power: i32| {
        (f64::from(power), bytes(10_u64.saturating_pow(power.max(0) as u32)).replace(".00", "").replace(".0", ""))
    };
    let mut ticks = vec![(low - 1.0, "none".to_owned())];
    ticks.extend((low as i32..=high as i32).map(decade));
    Axis { low: low - 1.3, high: high + 0.2, ticks }
}

fn draw_point(drawing: &mut Drawing, panel: &Axes, point: &Point<'_>) {
    let x = place(point.stored_bytes, panel.x.low + 1.3);
    let colour = colour(point.method);
    if let Some([low, high]) = point.interval {
        drawing.line([panel.at([x, low]), panel.at([x, high])], Pen::solid(colour, 2.5));
    }
    let fill = if point.sequential { colour } else { PAPER };
    drawing.disc(panel.at([x, point.success]), POINT, Some((fill, 1.0)), Some(Pen::solid(colour, 2.5)));
}

/// The best success of sequences for at most so many bytes, as corners \[px\].
fn frontier(panel: &Axes, points: &[Point<'_>]) -> Vec<[f64; 2]> {
    let mut sequences: Vec<&Point<'_>> = points.iter().filter(|point| point.sequential).collect();
    sequences.sort_by(|first, second| {
        first.stored_bytes.cmp(&second.stored_bytes).then(second.success.total_cmp(&first.success))
    });
    let mut corners: Vec<[f64; 2]> = Vec::new();
    for point in sequences {
        let x = place(point.stored_bytes, panel.x.low + 1.3);
        match corners.last().copied() {
            Some([_, best]) if point.success <= best => {}
            Some([_, best]) => corners.extend([[x, best], [x, point.success]]),
            None => corners.push([x, point.success]),
        }
    }
    if let Some([_, best]) = corners.last().copied() {
        corners.push([panel.x.high, best]);
    }
    corners.into_iter().map(|corner| panel.at(corner)).collect()
}

/// Each label at the first place beside its point where nothing stands yet.
fn draw_labels(drawing: &mut Drawing, panel: &Axes, points: &[Point<'_>], frontier: &[[f64; 2]]) {
    let centre = |point: &Point<'_>| panel.at([place(point.stored_bytes, panel.x.low + 1.3), point.success]);
    let mut taken: Vec<Taken> = frontier.windows(2).map(|side| around(side[0], side[1])).collect();
    for point in points {
        let [x, y] = centre(point);
        taken.push([x - POINT, y - POINT, x + POINT, y + POINT]);
        if let Some([low, high]) = point.interval {
            let [top, bottom] = [high, low].map(|end| panel.at([0.0, end])[1]);
            taken.push([x - 3.0, top, x + 3.0, bottom]);
        }
    }
    for point in points {
        let area = label_area(panel, centre(point), width_of(point.label, LABEL), &taken);
        let [left, top, right, bottom] = area;
        let [x, y] = centre(point);
        let middle = 0.5 * (top + bottom);
        if (middle - y).abs() > 2.0 * HALF_LINE {
            let nearest = if left > x { left - 2.0 } else { right + 2.0 };
            drawing.line([[x, y], [nearest, middle]], Pen::solid(GRID, 1.5));
        }
        let (edge, anchor) = if left > x { (left, Anchor::Start) } else { (right, Anchor::End) };
        let words = point.label.to_owned();
        drawing.text(Text { at: [edge, middle + 5.0], words, size: LABEL, colour: INK, anchor });
        taken.push(area);
    }
}

fn label_area(panel: &Axes, [x, y]: [f64; 2], width: f64, taken: &[Taken]) -> Taken {
    let beside = |left: f64, shift: f64| {
        let middle = y + shift * 2.0 * HALF_LINE;
        [left, middle - HALF_LINE, left + width, middle + HALF_LINE]
    };
    let shifts = (0..24).flat_map(|step| [f64::from(step), -f64::from(step)]);
    let sides = [x + POINT + 7.0, x - POINT - 7.0 - width];
    let candidates = shifts.flat_map(|shift| sides.map(|left| beside(left, shift)));
    let fits = |area: &Taken| {
        let inside = area[0] >= panel.left
            && area[2] <= panel.left + panel.width + MARGIN
            && area[1] >= panel.top - HALF_LINE
            && area[3] <= panel.bottom();
        inside && taken.iter().all(|other| !overlap(area, other))
    };
    candidates.into_iter().find(fits).unwrap_or_else(|| beside(sides[0], 0.0))
}

/// The upright or level line between two points, with its width.
fn around([x1, y1]: [f64; 2], [x2, y2]: [f64; 2]) -> Taken {
    [x1.min(x2) - 1.0, y1.min(y2) - 1.0, x1.max(x2) + 1.0, y1.max(y2) + 1.0]
}

fn overlap(first: &Taken, second: &Taken) -> bool {
    first[0] < second[2] && second[0] < first[2] && first[1] < second[3] && second[1] < first[3]
}
