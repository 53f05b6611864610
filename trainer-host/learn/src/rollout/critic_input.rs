//! What the critic reads of a step: a drone's own columns, or those of its whole team.
//!
//! A row of a panel is `agent · environments + environment`: the drone `mate` places further in the team, beginning
//! again after the last, is `mate · environments` rows further, and a tile of such rows is one or two contiguous
//! pieces of a column.

use kestrel_sim::outcome::Outcome;
use kestrel_sim::simulation::Simulation;
use serde::{Deserialize, Serialize};

/// Whose observations, and privileged values where there are any, the critic reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum CriticScope {
    /// The drone's own: independent PPO with shared parameters (IPPO, de Witt et al. 2020).
    #[default]
    Own,
    /// Its own, then those of its team mates, agent + 1, agent + 2, … modulo their number: the centralised critic of
    /// MAPPO (Yu et al. 2022), one for all drones, since each comes first in its own input.
    ///
    /// MAPPO masks agents that have died. Here nobody stays dead: a drone whose episode ends alone
    /// ([`TeamEnd::Alone`](kestrel_sim::scenario::TeamEnd::Alone)) starts anew before the next step, and its mates'
    /// critic reads its new episode.
    Team,
}

impl CriticScope {
    /// Drones whose values the critic reads, of a team of so many.
    pub fn drones(self, team: u32) -> usize {
        match self {
            Self::Own => 1,
            Self::Team => team as usize,
        }
    }
}

/// Where a panel's critic finds its values.
#[derive(Clone, Copy, Debug)]
pub(super) struct CriticInput {
    /// Drones of the panel.
    rows: usize,
    environments: usize,
    /// Drones that it reads, itself first.
    drones: usize,
}

impl CriticInput {
    pub(super) fn new(simulation: &Simulation, scope: CriticScope) -> Self {
        Self {
            rows: simulation.rows(),
            environments: simulation.environments(),
            drones: scope.drones(simulation.scenario().agents.count),
        }
    }

    /// Number of values.
    pub(super) fn len(&self, simulation: &Simulation) -> usize {
        self.drones * (simulation.observation_len() + simulation.privileged_len())
    }

    /// Writes `[values][columns]` of so many rows from `first_row` on, as they are after the last step.
    pub(super) fn write(&self, simulation: &Simulation, (first_row, columns): (usize, usize), input: &mut [f32]) {
        let mut targets = input.chunks_exact_mut(columns);
        for mate in 0..self.drones {
            let start = self.mate(first_row, mate);
            let seen = simulation.observations().chunks_exact(self.rows);
            let columns = seen.chain(simulation.privileged().chunks_exact(self.rows));
            for (column, target) in columns.zip(&mut targets) {
                copy_turned(column, start, target);
            }
        }
    }

    /// The values of a row whose episode ended in the last step, from before its reset. A team mate whose episode ended
    /// too contributes its values from before its reset, one that flies on those it flies on with.
    pub(super) fn at_end(&self, simulation: &Simulation, row: usize) -> Vec<f32> {
        let mut values = Vec::with_capacity(self.len(simulation));
        for mate in 0..self.drones {
            let row = self.mate(row, mate);
            let (seen, hidden) = match simulation.outcomes()[row] {
                Outcome::Running => (simulation.observations(), simulation.privileged()),
                Outcome::Truncated | Outcome::Terminated => {
                    (simulation.final_observations(), simulation.final_privileged())
                }
            };
            let columns = seen.chunks_exact(self.rows).chain(hidden.chunks_exact(self.rows));
            values.extend(columns.map(|column| column[row]));
        }
        values
    }

    /// The row of a team mate, `mate` places after the drone of a row.
    fn mate(&self, row: usize, mate: usize) -> usize {
        (row + mate * self.environments) % self.rows
    }
}

/// Copies what follows `start`, and from the beginning on what then is missing.
fn copy_turned(column: &[f32], start: usize, target: &mut [f32]) {
    let until_end = target.len().min(column.len() - start);
    let (front, back) = target.split_at_mut(until_end);
    front.copy_from_slice(&column[start..start + until_end]);
    back.copy_from_slice(&column[..back.len()]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tile_beyond_the_end_begins_again() {
        let column: Vec<f32> = (0..6).map(|row| row as f32).collect();
        let turned = |start: usize| {
            let mut target = [0.0; 4];
            copy_turned(&column, start, &mut target);
            target
        };
        assert_eq!(turned(1), [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(turned(4), [4.0, 5.0, 0.0, 1.0]);
    }

    #[test]
    fn the_mates_of_a_drone_follow_it_in_a_circle() {
        let input = CriticInput { rows: 12, environments: 4, drones: 3 };
        let team = |row| [0, 1, 2].map(|mate| input.mate(row, mate));
        // Environment 1 holds rows 1, 5 and 9.
        assert_eq!([team(1), team(5), team(9)], [[1, 5, 9], [5, 9, 1], [9, 1, 5]]);
    }
}
