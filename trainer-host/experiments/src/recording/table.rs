//! A recording as a summary for people, and as a table for other programs.

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
            let parts: Vec<_> =
                self.components.iter().zip(&returns).map(|(name, paid)| format!("{name} {paid:.3}")).collect();
            let total: f64 = returns.iter().sum();
            write!(text, "\ndrone {index}: {secs:.2} s").expect("strings take all text");
            if let Some(outcome) = track.outcome() {
                write!(text, ", {outcome}, return {total:.3}").expect("strings take all text");
            }
            if parts.len() > 1 {
                write!(text, " ({})", parts.join(", ")).expect("strings take all text");
            }
        }
        text
    }

    /// The flight as a table: a row per drone and moment, drone by drone.
    ///
    /// Actions and rewards stand beside the state from which they were taken; the last row of a drone has none where the
    /// episode ended.
    pub fn table(&self, control_secs: f64) -> Table {
        let action_len = self.drones.iter().flat_map(|track| &track.steps).map(|step| step.action.len()).max();
        let mut names: Vec<String> = STATE.map(str::to_owned).into();
        names.extend((0..action_len.unwrap_or(0)).map(|index| format!("action_{index}")));
        names.extend(self.terms().iter().map(|name| format!("reward_{name}")));
        let row = |drone: usize, track: &Track, moment: usize| {
            let mut row = vec![Some(drone as f64), Some(moment as f64 * control_secs)];
            row.extend(cells_of(track, moment).map(Some));
            row.resize(names.len(), None);
            row
        };
        let tracks = self.drones.iter().enumerate();
        let rows = tracks
            .flat_map(|(drone, track)| (0..track.moments.len()).map(move |moment| row(drone, track, moment)));
        Table { rows: rows.collect(), names }
    }
}

/// What a row says of a drone's state: positions and velocities in the world, the attitude from the body to it.
const STATE: [&str; 19] = [
    "drone",
    "time_secs",
    "position_x_m",
    "position_y_m",
    "position_z_m",
    "attitude_w",
    "attitude_x",
    "attitude_y",
    "attitude_z",
    "velocity_x_m_per_s",
    "velocity_y_m_per_s",
    "velocity_z_m_per_s",
    "body_rate_x_rad_per_s",
    "body_rate_y_rad_per_s",
    "body_rate_z_rad_per_s",
    "rotor_0_rad_per_s",
    "rotor_1_rad_per_s",
    "rotor_2_rad_per_s",
    "rotor_3_rad_per_s",
];

fn cells_of(track: &Track, moment: usize) -> impl Iterator<Item = f64> {
    let step = track.steps.get(moment);
    let moment = &track.moments[moment];
    let state = [&moment.placed.position[..], &moment.placed.attitude, &moment.velocity, &moment.body_rates];
    let state = state.concat().into_iter().chain(moment.rotor_speeds);
    state.chain(step.map(|step| [&step.action[..], &step.rewards].concat()).unwrap_or_default())
}

/// Numbers in named columns, for other programs.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// What the columns hold, with their units.
    pub names: Vec<String>,
    /// A number for each column, or none.
    pub rows: Vec<Vec<Option<f64>>>,
}

impl Table {
    /// Comma-separated values: a line with the names, then a line per row. Numbers are the shortest that read back to the same
    /// `f64`.
    pub fn csv(&self) -> String {
        let mut text = self.names.join(",");
        text.push('\n');
        for row in &self.rows {
            let cells: Vec<String> =
                row.iter().map(|cell| cell.map(|value| value.to_string()).unwrap_or_default()).collect();
            text.push_str(&cells.join(","));
            text.push('\n');
        }
        text
    }
}
