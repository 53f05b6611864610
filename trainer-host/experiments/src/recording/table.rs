//! A recording as text: a summary for people, a table for other programs.

use std::fmt::Write;

use super::{Recording, Track};
use crate::experiment_config::Experiment;

impl Recording {
    /// Who flew what, and how each drone ended with which return.
    pub fn summary(&self, experiment: &Experiment) -> String {
        let Self { pilot, start, seed, .. } = self;
        let mut text = format!("{}: {pilot}, start {start} of seed {seed}", experiment.name);
        let control_secs = f64::from(experiment.scenario.physics.control_secs());
        for (index, track) in self.drones.iter().enumerate() {
            let returns = self.returns(track);
            let secs = track.steps.len() as f64 * control_secs;
            let verdict = if track.success { "success" } else { "no success" };
            let parts: Vec<_> =
                self.components.iter().zip(&returns).map(|(name, paid)| format!("{name} {paid:.3}")).collect();
            let total: f64 = returns.iter().sum();
            write!(text, "\ndrone {index}: {secs:.2} s, {}, {verdict}, return {total:.3}", track.ending)
                .expect("strings take all text");
            if parts.len() > 1 {
                write!(text, " ({})", parts.join(", ")).expect("strings take all text");
            }
        }
        text
    }

    /// Comma-separated values: a line with names, then one per drone and moment, drone by drone.
    ///
    /// Actions and rewards stand beside the state from which they were taken; the last line of a drone has none where
    /// the episode ended. Numbers are the shortest that read back to the same `f64`.
    pub fn table(&self, control_secs: f64) -> String {
        let action_len = self.drones.iter().flat_map(|track| &track.steps).map(|step| step.action.len()).max();
        let mut names: Vec<String> = ["drone", "secs"].map(str::to_owned).into();
        names.extend("px py pz qw qx qy qz vx vy vz wx wy wz m0 m1 m2 m3".split(' ').map(str::to_owned));
        names.extend((0..action_len.unwrap_or(0)).map(|index| format!("a{index}")));
        names.extend(self.components.iter().map(|name| format!("r_{name}")));
        let width = names.len();
        let mut text = names.join(",");
        text.push('\n');
        for (drone, track) in self.drones.iter().enumerate() {
            for moment in 0..track.moments.len() {
                let mut cells = vec![drone.to_string(), (moment as f64 * control_secs).to_string()];
                cells.extend(cells_of(track, moment));
                cells.resize(width, String::new());
                text.push_str(&cells.join(","));
                text.push('\n');
            }
        }
        text
    }
}

fn cells_of(track: &Track, moment: usize) -> impl Iterator<Item = String> {
    let step = track.steps.get(moment);
    let moment = &track.moments[moment];
    let state = [&moment.placed.position[..], &moment.placed.attitude, &moment.velocity, &moment.body_rates];
    let state = state.concat().into_iter().chain(moment.rotor_speeds);
    let step = step.map(|step| [&step.action[..], &step.rewards].concat()).unwrap_or_default();
    state.chain(step).map(|value| value.to_string())
}
