//! The learning curve of a run: return and success rate over environment steps, as SVG.

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use serde::Deserialize;

/// Width and height of the picture \[px\]; coordinates are whole pixels, so it is drawn large.
const SIZE: (u32, u32) = (1440, 960);

/// Height of the title above the panels \[px\].
const TITLE_HEIGHT: u32 = 130;

/// Height of the panel of the return, which shows more detail than the success rate \[px\].
const RETURN_HEIGHT: u32 = 440;

/// Space for the numbers left of a panel \[px\], equal so that the panels align.
const LEFT_LABELS: u32 = 120;

/// Width of the words about tests \[px\].
const TEST_LABEL: i32 = 390;

/// Space between a number and its axis \[px\].
const LABEL_GAP: u32 = 12;

pub(crate) const FONT: &str = "Helvetica Neue, Helvetica, Arial, sans-serif";
pub(crate) const INK: RGBColor = RGBColor(0x1f, 0x29, 0x33);
pub(crate) const MUTED: RGBColor = RGBColor(0x6b, 0x76, 0x83);
pub(crate) const GRID: RGBColor = RGBColor(0xe4, 0xe8, 0xee);
pub(crate) const PAPER: RGBColor = RGBColor(0xff, 0xff, 0xff);
pub(crate) const BLUE: RGBColor = RGBColor(0x2f, 0x6f, 0xde);
pub(crate) const GREEN: RGBColor = RGBColor(0x12, 0x9a, 0x74);

/// One update of a run, a row of `metrics.jsonl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
pub struct CurvePoint {
    /// Environment steps since the run began.
    pub steps: u64,
    /// Mean return of the episodes that ended in the update, if any did.
    pub episode_return: Option<f32>,
    /// Share of successes among them in \[0, 1\].
    pub success_rate: Option<f32>,
    /// Mean return of the test that followed, if one did.
    #[serde(default)]
    pub eval_mean_reward: Option<f32>,
    /// Share of successes in it.
    #[serde(default)]
    pub eval_success_rate: Option<f32>,
    /// Its 95 % confidence interval.
    #[serde(default)]
    pub eval_success_interval: Option<[f32; 2]>,
    /// Whether the policy was the best so far: the last of these is kept.
    #[serde(default)]
    pub eval_kept: Option<bool>,
}

/// The picture could not be drawn.
#[derive(Debug, thiserror::Error)]
#[error("cannot draw the learning curve: {0}")]
pub struct CurveError(String);

impl<E: std::error::Error + Send + Sync> From<DrawingAreaErrorKind<E>> for CurveError {
    fn from(error: DrawingAreaErrorKind<E>) -> Self {
        Self(error.to_string())
    }
}

/// SVG of the learning curve under `title`; updates in which no episode ended are skipped.
///
/// # Errors
/// [`CurveError`] when the plotting library fails.
pub fn learning_curve(title: &str, points: &[CurvePoint]) -> Result<String, CurveError> {
    let mut svg = String::new();
    let canvas = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
    canvas.fill(&PAPER)?;
    let (top, panels) = canvas.split_vertically(TITLE_HEIGHT);
    let (upper, lower) = panels.split_vertically(RETURN_HEIGHT);
    let last_steps = points.iter().map(|point| point.steps).max().unwrap_or(0).max(1);
    let (returns, successes) = (Series::of_returns(points), Series::of_successes(points));
    heading(&top, title, &summary(points, &returns, &successes))?;
    draw_panel(&upper, last_steps, &returns, "")?;
    draw_panel(&lower, last_steps, &successes, "environment steps")?;
    canvas.present()?;
    drop((top, panels, upper, lower, canvas));
    Ok(svg)
}

pub(crate) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// What one panel shows.
struct Series {
    name: &'static str,
    colour: RGBColor,
    /// Steps and value, finite.
    points: Vec<(f64, f64)>,
    tests: Vec<TestPoint>,
    /// Range of the vertical axis.
    low: f64,
    high: f64,
}

/// A test of the policy without exploration.
struct TestPoint {
    steps: f64,
    value: f64,
    /// Of 95 % confidence; the value itself where there is none.
    interval: [f64; 2],
    /// Whether this policy is the one that is kept.
    kept: bool,
}

impl Series {
    fn of_returns(curve: &[CurvePoint]) -> Self {
        let points = finite(curve, |point| point.episode_return);
        let tests = tests(curve, |point| point.eval_mean_reward.map(|value| (value, [value; 2])));
        let shown: Vec<_> =
            points.iter().copied().chain(tests.iter().map(|test| (test.steps, test.value))).collect();
        let (low, high) = range_with_margin(&shown);
        Self { name: "Episode return [reward]", colour: BLUE, points, tests, low, high }
    }

    fn of_successes(curve: &[CurvePoint]) -> Self {
        let percent = |share: f32| 100.0 * share;
        let points = finite(curve, |point| point.success_rate.map(percent));
        let tests = tests(curve, |point| {
            let rate = percent(point.eval_success_rate?);
            Some((rate, point.eval_success_interval.map_or([rate; 2], |interval| interval.map(percent))))
        });
        Self { name: "Success rate [% of episodes]", colour: GREEN, points, tests, low: 0.0, high: 104.0 }
    }

    /// Mean over a fortieth of the run on either side: what lies behind the noise, without lagging behind it.
    fn smoothed(&self) -> Vec<(f64, f64)> {
        let reach = self.points.len() / 40;
        let mean = |index: usize| {
            let window = &self.points[index.saturating_sub(reach)..(index + reach + 1).min(self.points.len())];
            window.iter().map(|&(_, value)| value).sum::<f64>() / window.len() as f64
        };
        self.points.iter().enumerate().map(|(index, &(steps, _))| (steps, mean(index))).collect()
    }
}

fn finite(points: &[CurvePoint], value: impl Fn(&CurvePoint) -> Option<f32>) -> Vec<(f64, f64)> {
    let pairs = points.iter().filter_map(|point| Some((point.steps as f64, f64::from(value(point)?))));
    pairs.filter(|(_, value)| value.is_finite()).collect()
}

/// What the tests found, with intervals.
fn tests(curve: &[CurvePoint], found: impl Fn(&CurvePoint) -> Option<(f32, [f32; 2])>) -> Vec<TestPoint> {
    let kept = curve.iter().rposition(|point| point.eval_kept == Some(true));
    let test = |(index, point): (usize, &CurvePoint)| {
        let (value, interval) = found(point)?;
        let kept = Some(index) == kept;
        let [value, interval] = [[value; 2], interval].map(|pair| pair.map(f64::from));
        Some(TestPoint { steps: point.steps as f64, value: value[0], interval, kept })
    };
    curve.iter().enumerate().filter_map(test).filter(|test| test.value.is_finite()).collect()
}

/// The values' range and some air around them; never empty.
fn range_with_margin(points: &[(f64, f64)]) -> (f64, f64) {
    let values = || points.iter().map(|&(_, value)| value);
    let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
    if low > high {
        return (0.0, 1.0);
    }
    let margin = (0.06 * (high - low)).max(0.05 * low.abs().min(high.abs())).max(1e-3);
    (low - margin, high + margin)
}

fn summary(points: &[CurvePoint], returns: &Series, successes: &Series) -> String {
    let steps = amount(points.last().map_or(0, |point| point.steps) as f64);
    let last = |series: &Series| series.smoothed().last().map(|&(_, value)| value);
    match (last(returns), last(successes)) {
        (Some(episode_return), Some(success_percent)) => {
            format!("after {steps} environment steps: return {episode_return:.1}, success {success_percent:.1} %")
        }
        _ => format!("after {steps} environment steps: no episode has ended yet"),
    }
}

pub(crate) fn font(size: u32, colour: &RGBColor) -> TextStyle<'_> {
    (FONT, size).into_font().color(colour)
}

pub(crate) fn heading(area: &Area<'_>, title: &str, summary: &str) -> Result<(), CurveError> {
    let bold = FontDesc::new(FontFamily::Name(FONT), 38.0, FontStyle::Bold).color(&INK);
    area.draw(&Text::new(title.to_owned(), (44, 30), bold))?;
    area.draw(&Text::new(summary.to_owned(), (44, 84), font(25, &MUTED)))?;
    Ok(())
}

fn draw_panel(area: &Area<'_>, last_steps: u64, series: &Series, below: &str) -> Result<(), CurveError> {
    let mut chart = ChartBuilder::on(area)
        .margin_right(56)
        .margin_top(52)
        .margin_bottom(10)
        .x_label_area_size(if below.is_empty() { 60 } else { 84 })
        .y_label_area_size(LEFT_LABELS)
        .build_cartesian_2d(0.0..last_steps as f64, series.low..series.high)?;
    chart
        .configure_mesh()
        .axis_style(GRID)
        .bold_line_style(GRID)
        .max_light_lines(0)
        .x_labels(9)
        .y_labels(6)
        .set_all_tick_mark_size(LABEL_GAP)
        .x_label_formatter(&|&steps| with_unit(steps))
        .y_label_formatter(&|&value| with_unit(value))
        .label_style(font(22, &MUTED))
        .axis_desc_style(font(22, &MUTED))
        .x_desc(below)
        .draw()?;
    draw_series(&mut chart, series)?;
    draw_tests(&mut chart, &series.tests)?;
    let bold = FontDesc::new(FontFamily::Name(FONT), 25.0, FontStyle::Bold).color(&series.colour);
    area.draw(&Text::new(series.name, (LEFT_LABELS as i32, 12), bold))?;
    if !series.tests.is_empty() {
        let right = area.dim_in_pixel().0 as i32 - TEST_LABEL;
        area.draw(&Circle::new((right, 23), 6, INK.filled()))?;
        area.draw(&Text::new("tests of the policy, ring: kept", (right + 16, 14), font(22, &MUTED)))?;
    }
    Ok(())
}

/// Points with their intervals, and a ring around the policy that is kept.
fn draw_tests(chart: &mut Chart<'_, '_>, tests: &[TestPoint]) -> Result<(), CurveError> {
    for TestPoint { steps, value, interval: [low, high], kept } in tests {
        let at = (*steps, *value);
        chart.draw_series([PathElement::new(vec![(*steps, *low), (*steps, *high)], INK.stroke_width(2))])?;
        chart.draw_series([Circle::new(at, 5, INK.filled())])?;
        if *kept {
            chart.draw_series([Circle::new(at, 11, INK.stroke_width(2))])?;
        }
    }
    Ok(())
}

fn draw_series(chart: &mut Chart<'_, '_>, series: &Series) -> Result<(), CurveError> {
    let smoothed = series.smoothed();
    let Some(&last) = smoothed.last() else { return Ok(()) };
    let first_steps = smoothed[0].0;
    let mut shade = smoothed.clone();
    shade.extend([(last.0, series.low), (first_steps, series.low)]);
    chart.draw_series([Polygon::new(shade, series.colour.mix(0.07))])?;
    chart.draw_series([PathElement::new(series.points.clone(), series.colour.mix(0.3).stroke_width(2))])?;
    chart.draw_series([PathElement::new(smoothed, series.colour.stroke_width(4))])?;
    chart.draw_series([Circle::new(last, 8, PAPER.filled()), Circle::new(last, 6, series.colour.filled())])?;
    Ok(())
}

/// A number of steps with three digits and its unit, such as `1.25 M`.
pub fn amount(value: f64) -> String {
    let (scaled, unit) = match value {
        value if value < 999.5 => return format!("{value:.0}"),
        value if value < 999.5e3 => (value / 1e3, "k"),
        value if value < 999.5e6 => (value / 1e6, "M"),
        value => (value / 1e9, "G"),
    };
    let digits = if scaled < 9.995 { 2 } else { usize::from(scaled < 99.95) };
    format!("{scaled:.digits$} {unit}")
}

/// A number as short as it can be read on an axis: `0`, `-0.25`, `40`, `1.5 k`, `2 M`.
pub fn with_unit(value: f64) -> String {
    let (scaled, unit) = match value.abs() {
        size if size < 1e3 => (value, ""),
        size if size < 1e6 => (value / 1e3, " k"),
        size if size < 1e9 => (value / 1e6, " M"),
        _ => (value / 1e9, " G"),
    };
    let digits = if scaled.abs() < 1.0 { 3 } else { 2 };
    let text = format!("{scaled:.digits$}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    let short = if short == "-0" { "0" } else { short };
    format!("{short}{unit}").replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(count: u64) -> Vec<CurvePoint> {
        let point = |index: u64| CurvePoint {
            steps: 40_000 * (index + 1),
            episode_return: Some(-20.0 + index as f32),
            success_rate: Some(index as f32 / count as f32),
            ..CurvePoint::default()
        };
        (0..count).map(point).collect()
    }

    fn is_complete(svg: &str) -> bool {
        svg.starts_with("<svg ")
            && svg.trim_end().ends_with("</svg>")
            && !svg.contains("NaN")
            && !svg.contains("inf")
    }

    #[test]
    fn any_number_of_points_makes_a_picture() {
        for count in [0, 1, 2, 500] {
            assert!(is_complete(&learning_curve("hover-seed0-1", &points(count)).unwrap()), "{count} points");
        }
    }

    #[test]
    fn a_constant_return_makes_a_picture() {
        let constant = points(5).into_iter().map(|point| CurvePoint { episode_return: Some(7.0), ..point });
        assert!(is_complete(&learning_curve("constant", &constant.collect::<Vec<_>>()).unwrap()));
    }

    #[test]
    fn updates_without_ended_episodes_are_skipped() {
        let mut with_gaps = points(3);
        let none = CurvePoint { steps: 1, ..CurvePoint::default() };
        let nan = CurvePoint { episode_return: Some(f32::NAN), success_rate: Some(f32::NAN), ..none };
        with_gaps.insert(0, none);
        with_gaps.insert(2, nan);
        assert_eq!(learning_curve("gaps", &with_gaps).unwrap(), learning_curve("gaps", &points(3)).unwrap());
        assert!(is_complete(&learning_curve("nothing", &[none, nan]).unwrap()));
    }

    #[test]
    fn the_smooth_curve_follows_a_straight_line_and_calms_a_noisy_one() {
        let straight = Series::of_returns(&points(400));
        for (&(_, value), (_, smooth)) in straight.points.iter().zip(straight.smoothed()).skip(10).take(380) {
            assert!((value - smooth).abs() < 1e-9);
        }
        let noisy = points(400).into_iter().enumerate().map(|(index, point)| {
            let sign = if index % 2 == 0 { 1.0 } else { -1.0 };
            CurvePoint { episode_return: Some(sign), ..point }
        });
        let smoothed = Series::of_returns(&noisy.collect::<Vec<_>>()).smoothed();
        assert!(smoothed.iter().all(|(_, value)| value.abs() < 0.1));
    }

    #[test]
    fn the_picture_names_run_axes_and_units() {
        let svg = learning_curve("hover <1> & co", &points(50)).unwrap();
        for text in ["hover &lt;1&gt; &amp; co", "environment steps", "[reward]", "[% of episodes]", "500 k"] {
            assert!(svg.contains(text), "{text}");
        }
    }

    #[test]
    fn tests_of_the_policy_stand_over_the_curve_and_the_kept_one_has_a_ring() {
        let plain = learning_curve("a", &points(9)).unwrap();
        let tested = |kept: [bool; 2]| {
            let mut points = points(9);
            for (point, kept) in points.iter_mut().skip(3).step_by(4).zip(kept) {
                let (rate, interval) = (Some(0.5), Some([0.4, 0.6]));
                let reward = Some(-3.0);
                *point = CurvePoint {
                    eval_success_rate: rate,
                    eval_success_interval: interval,
                    eval_mean_reward: reward,
                    eval_kept: Some(kept),
                    ..*point
                };
            }
            learning_curve("a", &points).unwrap()
        };
        let circles = |svg: &str| svg.matches("<circle").count();
        let words = "tests of the policy, ring: kept";
        assert!(!plain.contains(words) && is_complete(&tested([true; 2])) && tested([true; 2]).contains(words));
        // In each panel a mark beside the words and two tests; the ring is around the last that was kept.
        assert_eq!(circles(&tested([false; 2])) - circles(&plain), 2 * 3);
        assert_eq!(circles(&tested([true; 2])) - circles(&plain), 2 * 4);
        assert_ne!(tested([true, false]), tested([true; 2]));
    }

    #[test]
    fn the_same_points_make_the_same_bytes() {
        assert_eq!(learning_curve("a", &points(9)).unwrap(), learning_curve("a", &points(9)).unwrap());
    }

    #[test]
    fn amounts_keep_three_digits_across_every_unit() {
        let shown = [0.0, 999.4, 999.6, 1250.0, 99_960.0, 999_600.0, 1.25e7, 2.5e9].map(amount);
        assert_eq!(shown, ["0", "999", "1.00 k", "1.25 k", "100 k", "1.00 M", "12.5 M", "2.50 G"]);
    }

    #[test]
    fn numbers_on_axes_are_short() {
        let shown = [0.0, -0.0, 0.25, -40.0, 100.0, 1500.0, -2000.0, 250_000.0, 1e6, 2.5e7, 3e9].map(with_unit);
        let expected = ["0", "0", "0.25", "−40", "100", "1.5 k", "−2 k", "250 k", "1 M", "25 M", "3 G"];
        assert_eq!(shown, expected);
    }

    #[test]
    fn rows_of_the_metrics_are_points() {
        let row = r#"{"updates":1,"steps":40,"episode_return":null,"success_rate":0.5,"entropy":5.0}"#;
        let point: CurvePoint = serde_json::from_str(row).unwrap();
        assert_eq!(point, CurvePoint { steps: 40, success_rate: Some(0.5), ..CurvePoint::default() });
    }
}
