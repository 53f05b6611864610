//! The learning curve of a run: return and success rate over environment steps.

use serde::Deserialize;

use crate::chart::{Axes, Axis, INK, MARGIN, MUTED, PAPER, TOP, amount, colour, faded, titled};
use crate::drawing::{Anchor, Colour, Drawing, Pen, Text};

/// Width of the picture, space for numbers left of a panel, and below and above it \[px\].
const WIDTH: f64 = 900.0;
const NUMBERS: f64 = 60.0;
const BELOW: f64 = 54.0;
const ABOVE: f64 = 36.0;

/// Heights of the panels: the return shows more detail than the success rate \[px\].
const RETURN_HEIGHT: f64 = 220.0;
const SUCCESS_HEIGHT: f64 = 180.0;

/// What the marks over a curve are, and how wide these words are at most \[px\].
const TESTS: &str = "tests of the policy, ring: kept";
const TESTS_WIDTH: f64 = 238.0;

/// Radii of a test's mark and of the ring around the policy that is kept \[px\].
const DOT: f64 = 3.2;
const RING: f64 = 7.0;

/// One update of a run, a row of `metrics.jsonl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
pub struct CurvePoint {
    /// Environment steps since the run began.
    pub steps: u64,
    /// Time spent in training until then \[s\].
    #[serde(default)]
    pub training_secs: Option<f64>,
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

/// Who learns nothing, to be compared with: a dashed line.
#[derive(Clone, Debug, PartialEq)]
pub struct CurveBaseline {
    /// Such as `scripted pilot`.
    pub pilot: String,
    /// Mean return of its test flights.
    pub episode_return: f64,
    /// Share of successes among them.
    pub success_rate: f64,
}

/// The learning curve under `title`; updates in which no episode ended are skipped.
pub fn learning_curve(title: &str, points: &[CurvePoint], baseline: Option<&CurveBaseline>) -> Drawing {
    let last_steps = points.iter().map(|point| point.steps).max().unwrap_or(0).max(1);
    let (returns, successes) = (Series::of_returns(points, baseline), Series::of_successes(points, baseline));
    let mut drawing = titled(WIDTH, title, &summary(points, &returns, &successes));
    let mut top = TOP + 10.0;
    for (series, height) in [(&returns, RETURN_HEIGHT), (&successes, SUCCESS_HEIGHT)] {
        let panel = Axes {
            left: MARGIN + NUMBERS,
            top: top + ABOVE,
            width: WIDTH - NUMBERS - 2.0 * MARGIN,
            height,
            x: Axis::steps(last_steps as f64, 9.0),
            y: series.axis.clone(),
        };
        draw_panel(&mut drawing, &panel, series);
        if let Some(baseline) = baseline {
            draw_baseline(&mut drawing, &panel, series, baseline);
        }
        draw_times(&mut drawing, &panel, points);
        top = panel.bottom() + BELOW;
    }
    let words = "environment steps, time of training".to_owned();
    drawing.text(Text { at: [WIDTH - MARGIN, top + 2.0], words, size: 14.0, colour: MUTED, anchor: Anchor::End });
    drawing.extend_to(top + 18.0);
    drawing
}

fn draw_baseline(drawing: &mut Drawing, panel: &Axes, series: &Series, baseline: &CurveBaseline) {
    let Some(level) = series.baseline else { return };
    panel.path(drawing, [[panel.x.low, level], [panel.x.high, level]], Pen::dashes(MUTED, 1.5));
    let [right, height] = panel.at([panel.x.high, level]);
    let at = [right - 6.0, height - 6.0];
    drawing.text(Text { at, words: baseline.pilot.clone(), size: 13.0, colour: MUTED, anchor: Anchor::End });
}

/// Below the steps: how long the training had taken by then.
fn draw_times(drawing: &mut Drawing, panel: &Axes, points: &[CurvePoint]) {
    for (steps, _) in panel.x.ticks.iter().filter(|(steps, _)| *steps > 0.0) {
        let reached = points.iter().find(|point| point.steps as f64 >= 0.999 * steps);
        if let Some(secs) = reached.and_then(|point| point.training_secs) {
            let at = [panel.at([*steps, panel.y.low])[0], panel.bottom() + 36.0];
            let words = if secs < 120.0 { format!("{secs:.1} s") } else { format!("{:.0} min", secs / 60.0) };
            drawing.text(Text { at, words, size: 12.0, colour: MUTED, anchor: Anchor::Middle });
        }
    }
}

/// What one panel shows.
struct Series {
    name: &'static str,
    colour: Colour,
    /// Steps and value, finite.
    points: Vec<[f64; 2]>,
    tests: Vec<TestPoint>,
    baseline: Option<f64>,
    axis: Axis,
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
    fn of_returns(curve: &[CurvePoint], baseline: Option<&CurveBaseline>) -> Self {
        let points = finite(curve, |point| point.episode_return);
        let tests = tests(curve, |point| point.eval_mean_reward.map(|value| (value, [value; 2])));
        let baseline = baseline.map(|baseline| baseline.episode_return).filter(|value| value.is_finite());
        let shown = points.iter().map(|[_, value]| *value).chain(tests.iter().map(|test| test.value));
        let axis = Axis::around(shown.chain(baseline), 5.0);
        Self { name: "Episode return [reward]", colour: colour(0), points, tests, baseline, axis }
    }

    fn of_successes(curve: &[CurvePoint], baseline: Option<&CurveBaseline>) -> Self {
        let percent = |share: f32| 100.0 * share;
        let points = finite(curve, |point| point.success_rate.map(percent));
        let tests = tests(curve, |point| {
            let rate = percent(point.eval_success_rate?);
            Some((rate, point.eval_success_interval.map_or([rate; 2], |interval| interval.map(percent))))
        });
        let axis = Axis::numbers([0.0, 104.0], 5.0);
        let baseline = baseline.map(|baseline| 100.0 * baseline.success_rate);
        Self { name: "Success rate [% of episodes]", colour: colour(2), points, tests, baseline, axis }
    }

    /// Mean over a fortieth of the run on either side: what lies behind the noise, without lagging behind it.
    fn smoothed(&self) -> Vec<[f64; 2]> {
        let reach = self.points.len() / 40;
        let mean = |index: usize| {
            let window = &self.points[index.saturating_sub(reach)..(index + reach + 1).min(self.points.len())];
            window.iter().map(|[_, value]| value).sum::<f64>() / window.len() as f64
        };
        self.points.iter().enumerate().map(|(index, &[steps, _])| [steps, mean(index)]).collect()
    }
}

fn finite(points: &[CurvePoint], value: impl Fn(&CurvePoint) -> Option<f32>) -> Vec<[f64; 2]> {
    let pairs = points.iter().filter_map(|point| Some([point.steps as f64, f64::from(value(point)?)]));
    pairs.filter(|[_, value]| value.is_finite()).collect()
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

fn summary(points: &[CurvePoint], returns: &Series, successes: &Series) -> String {
    let steps = amount(points.last().map_or(0, |point| point.steps) as f64);
    let last = |series: &Series| series.smoothed().last().map(|[_, value]| *value);
    match (last(returns), last(successes)) {
        (Some(episode_return), Some(success_percent)) => {
            format!("after {steps} environment steps: return {episode_return:.1}, success {success_percent:.1} %")
        }
        _ => format!("after {steps} environment steps: no episode has ended yet"),
    }
}

fn draw_panel(drawing: &mut Drawing, panel: &Axes, series: &Series) {
    panel.draw_axes(drawing);
    draw_series(drawing, panel, series);
    draw_tests(drawing, panel, &series.tests);
    let above = panel.top - 14.0;
    let words = |at, words: &str, colour, anchor| Text { at, words: words.to_owned(), size: 15.0, colour, anchor };
    drawing.text(words([panel.left, above], series.name, series.colour, Anchor::Start));
    if !series.tests.is_empty() {
        drawing.text(words([panel.right(), above], TESTS, MUTED, Anchor::End));
        drawing.disc([panel.right() - TESTS_WIDTH, above - 5.0], DOT, Some((INK, 1.0)), None);
    }
}

/// Points with their intervals, and a ring around the policy that is kept.
fn draw_tests(drawing: &mut Drawing, panel: &Axes, tests: &[TestPoint]) {
    for TestPoint { steps, value, interval: [low, high], kept } in tests {
        let centre = panel.at([*steps, *value]);
        panel.path(drawing, [[*steps, *low], [*steps, *high]], Pen::solid(INK, 1.2));
        drawing.disc(centre, DOT, Some((INK, 1.0)), None);
        if *kept {
            drawing.disc(centre, RING, None, Some(Pen::solid(INK, 1.2)));
        }
    }
}

fn draw_series(drawing: &mut Drawing, panel: &Axes, series: &Series) {
    let smoothed = series.smoothed();
    let Some(&last) = smoothed.last() else { return };
    let below: Vec<[f64; 3]> = smoothed.iter().map(|&[steps, value]| [steps, panel.y.low, value]).collect();
    panel.band(drawing, &below, series.colour, 0.07);
    panel.path(drawing, series.points.iter().copied(), Pen::solid(faded(series.colour, 0.7), 1.2));
    panel.path(drawing, smoothed, Pen::solid(series.colour, 2.5));
    drawing.disc(panel.at(last), 5.0, Some((series.colour, 1.0)), Some(Pen::solid(PAPER, 1.2)));
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

    fn svg_of(title: &str, points: &[CurvePoint]) -> String {
        learning_curve(title, points, None).svg()
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
            assert!(is_complete(&svg_of("hover-seed0-1", &points(count))), "{count} points");
        }
    }

    #[test]
    fn a_constant_return_makes_a_picture() {
        let constant = points(5).into_iter().map(|point| CurvePoint { episode_return: Some(7.0), ..point });
        assert!(is_complete(&svg_of("constant", &constant.collect::<Vec<_>>())));
    }

    #[test]
    fn updates_without_ended_episodes_are_skipped() {
        let mut with_gaps = points(3);
        let none = CurvePoint { steps: 1, ..CurvePoint::default() };
        let nan = CurvePoint { episode_return: Some(f32::NAN), success_rate: Some(f32::NAN), ..none };
        with_gaps.insert(0, none);
        with_gaps.insert(2, nan);
        assert_eq!(svg_of("gaps", &with_gaps), svg_of("gaps", &points(3)));
        assert!(is_complete(&svg_of("nothing", &[none, nan])));
    }

    #[test]
    fn the_smooth_curve_follows_a_straight_line_and_calms_a_noisy_one() {
        let straight = Series::of_returns(&points(400), None);
        for (&[_, value], [_, smooth]) in straight.points.iter().zip(straight.smoothed()).skip(10).take(380) {
            assert!((value - smooth).abs() < 1e-9);
        }
        let noisy = points(400).into_iter().enumerate().map(|(index, point)| {
            let sign = if index % 2 == 0 { 1.0 } else { -1.0 };
            CurvePoint { episode_return: Some(sign), ..point }
        });
        let smoothed = Series::of_returns(&noisy.collect::<Vec<_>>(), None).smoothed();
        assert!(smoothed.iter().all(|[_, value]| value.abs() < 0.1));
    }

    #[test]
    fn the_picture_names_run_axes_and_units() {
        let svg = svg_of("hover <1> & co", &points(50));
        for text in ["hover &lt;1&gt; &amp; co", "environment steps", "[reward]", "[% of episodes]", "500 k"] {
            assert!(svg.contains(text), "{text}");
        }
    }

    #[test]
    fn tests_of_the_policy_stand_over_the_curve_and_the_kept_one_has_a_ring() {
        let plain = svg_of("a", &points(9));
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
            svg_of("a", &points)
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
    fn a_baseline_is_a_line_and_the_time_stands_below_the_steps() {
        let scripted =
            CurveBaseline { pilot: "scripted pilot".to_owned(), episode_return: 9.0, success_rate: 0.04 };
        let timed: Vec<_> = points(50)
            .into_iter()
            .map(|point| CurvePoint { training_secs: Some(point.steps as f64 / 1e6), ..point })
            .collect();
        let svg = learning_curve("hover", &timed, Some(&scripted)).svg();
        assert_eq!((svg.matches("scripted pilot").count(), svg.matches(">1.0 s<").count()), (2, 2));
        assert!(!svg_of("hover", &points(50)).contains(" s<"));
    }

    #[test]
    fn the_same_points_make_the_same_bytes() {
        assert_eq!(svg_of("a", &points(9)), svg_of("a", &points(9)));
    }

    #[test]
    fn rows_of_the_metrics_are_points() {
        let row = r#"{"updates":1,"steps":40,"episode_return":null,"success_rate":0.5,"entropy":5.0}"#;
        let point: CurvePoint = serde_json::from_str(row).unwrap();
        assert_eq!(point, CurvePoint { steps: 40, success_rate: Some(0.5), ..CurvePoint::default() });
    }
}
