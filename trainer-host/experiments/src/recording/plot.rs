//! A recording as plots over time: what the drone did, what its pilot commanded, what that paid.

use kestrel_core::attitude::Attitude;
use kestrel_draw::chart::{Axes, Axis, INK, MARGIN, TOP, legend, pen, titled};
use kestrel_draw::drawing::{Anchor, Drawing, Pen, Text};

use super::{Moment, Recording, Track};
use crate::experiment_config::Experiment;

/// Width of the picture and height of a panel \[px\].
const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 130.0;

/// Space for the numbers left of a panel, for words above and below it \[px\].
const NUMBERS: f64 = 60.0;
const ABOVE: f64 = 36.0;
const BELOW: f64 = 26.0;

/// So many lines are named beside a panel's name, more below it.
const BESIDE: usize = 4;

/// A panel: its name with the unit, and lines with their labels.
struct Signal {
    name: &'static str,
    lines: Vec<(String, Vec<f64>)>,
    /// Where the lines should be, by the lines' places.
    wanted: Vec<f64>,
}

impl Recording {
    /// Position, velocity, attitude, body rates, rotor speeds, commands and reward terms of one drone over time.
    ///
    /// # Panics
    /// When it has no such drone.
    pub fn plot(&self, experiment: &Experiment, drone: usize) -> Drawing {
        let track = &self.drones[drone];
        let control_secs = f64::from(experiment.scenario.physics.control_secs());
        let secs = track.steps.len() as f64 * control_secs;
        let outcome = track.outcome().map_or(String::new(), |outcome| format!(", {outcome}"));
        let about = format!("drone {drone}, start {} of seed {}: {secs:.2} s{outcome}", self.start, self.seed);
        let mut drawing = titled(WIDTH, &format!("{}: {}", experiment.name, self.pilot), &about);
        let mut top = TOP;
        for signal in self.signals(track) {
            let panel = Axes {
                left: MARGIN + NUMBERS,
                top: signal.draw_names(&mut drawing, top),
                width: WIDTH - NUMBERS - 2.0 * MARGIN,
                height: HEIGHT,
                x: Axis::numbers([0.0, secs.max(control_secs)], 10.0),
                y: signal.axis(),
            };
            signal.draw(&mut drawing, &panel, control_secs);
            top = panel.bottom() + BELOW;
        }
        let at = [WIDTH - MARGIN, top + 16.0];
        let words = "time since the start [s]".to_owned();
        drawing.text(Text { at, words, size: 14.0, colour: INK, anchor: Anchor::End });
        drawing.extend_to(top + 34.0);
        drawing
    }

    fn signals(&self, track: &Track) -> Vec<Signal> {
        let states = |name, labels: &[&str], of: &dyn Fn(&Moment) -> Vec<f64>| {
            let values: Vec<Vec<f64>> = track.moments.iter().map(of).collect();
            let line = |(index, label): (usize, &&str)| {
                ((*label).to_owned(), values.iter().map(|moment| moment[index]).collect())
            };
            Signal { name, lines: labels.iter().enumerate().map(line).collect(), wanted: Vec::new() }
        };
        let commands = track.steps.iter().map(|step| step.action.len()).max().unwrap_or(0);
        let command = |index: usize| {
            (
                format!("{index}"),
                track.steps.iter().map(|step| step.action.get(index).copied().unwrap_or(f64::NAN)).collect(),
            )
        };
        let paid =
            |(index, name): (usize, String)| (name, track.steps.iter().map(|step| step.rewards[index]).collect());
        let (where_it_is, wanted) = if self.is_episode() {
            ("position [m], dashed: the goal", track.goal.into())
        } else {
            ("position [m]", Vec::new())
        };
        let position = states(where_it_is, &["x", "y", "z"], &|moment| moment.placed.position.into());
        let mut signals = vec![
            Signal { wanted, ..position },
            states("velocity [m/s]", &["x", "y", "z"], &|moment| moment.velocity.into()),
            states("attitude [degrees]", &["roll", "pitch", "yaw"], &degrees),
            states("body rates [rad/s]", &["x", "y", "z"], &|moment| moment.body_rates.into()),
            states("rotor speeds [rad/s]", &["0", "1", "2", "3"], &|moment| moment.rotor_speeds.into()),
            Signal { name: "action", lines: (0..commands).map(command).collect(), wanted: Vec::new() },
        ];
        if !self.components.is_empty() {
            let lines = self.terms().into_iter().enumerate().map(paid).collect();
            signals.push(Signal { name: "reward of a step", lines, wanted: Vec::new() });
        }
        signals
    }
}

impl Signal {
    fn axis(&self) -> Axis {
        let values = self.lines.iter().flat_map(|(_, values)| values).chain(&self.wanted);
        Axis::around(values.copied(), 4.0)
    }

    /// Draws its name, and those of its lines where they are too many to stand beside it; returns where its panel begins.
    fn draw_names(&self, drawing: &mut Drawing, top: f64) -> f64 {
        let at = [MARGIN + NUMBERS, top + ABOVE - 14.0];
        drawing.text(Text { at, words: self.name.to_owned(), size: 15.0, colour: INK, anchor: Anchor::Start });
        if self.lines.len() <= BESIDE {
            return top + ABOVE;
        }
        let labels = self.lines.iter().enumerate().map(|(index, (label, _))| (index, label.as_str()));
        legend(drawing, labels, top + ABOVE + 8.0) + 8.0
    }

    fn draw(&self, drawing: &mut Drawing, panel: &Axes, step_secs: f64) {
        panel.draw_axes(drawing);
        for (index, level) in self.wanted.iter().enumerate() {
            let goal = Pen::dashes(pen(index, 1.2).colour, 1.2);
            panel.path(drawing, [[panel.x.low, *level], [panel.x.high, *level]], goal);
        }
        for (index, (_, values)) in self.lines.iter().enumerate() {
            let points = values.iter().enumerate().filter(|(_, value)| value.is_finite());
            panel.path(drawing, points.map(|(step, value)| [step as f64 * step_secs, *value]), pen(index, 1.8));
        }
        if self.lines.len() <= BESIDE {
            let labels = self.lines.iter().enumerate();
            panel.name_lines(drawing, labels.map(|(index, (label, _))| (label.as_str(), pen(index, 1.8))));
        }
    }
}

fn degrees(moment: &Moment) -> Vec<f64> {
    let [w, x, y, z] = moment.placed.attitude;
    Attitude { w, x, y, z }.roll_pitch_yaw().map(f64::to_degrees).into()
}
