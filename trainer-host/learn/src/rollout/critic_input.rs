//! What the critic reads of a step: an agent's own columns, or those of its whole team.
//!
//! A row of an environment batch is `agent · environments + environment`: the agent `mate` places further in the team, beginning
//! again after the last, is `mate · environments` rows further, and a slice of such rows is one or two contiguous
//! pieces of a column.

use serde::{Deserialize, Serialize};

use crate::environment::{Environment, Outcome, TaskShape};

/// Whose observations, and privileged values where there are any, the critic reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum CriticScope {
    /// The agent's own: independent PPO with shared parameters (IPPO, de Witt et al. 2020).
    #[default]
    Own,
    /// Its own, then those of its team mates, agent + 1, agent + 2, … modulo their number: the centralised critic of
    /// MAPPO (Yu et al. 2022), one for all agents, since each comes first in its own input.
    ///
    /// MAPPO masks agents that have died. Here none stays dead: an agent whose episode ends alone starts anew before the
    /// next step, and its mates' critic reads its new episode.
    Team,
}

impl CriticScope {
    /// Agents whose values the critic reads, of a team of so many.
    pub fn agents(self, team: usize) -> usize {
        match self {
            Self::Own => 1,
            Self::Team => team,
        }
    }
}

/// Where an environment batch's critic finds its values.
#[derive(Clone, Copy, Debug)]
pub(super) struct CriticInput {
    /// Agents of the environment batch.
    rows: usize,
    environments: usize,
    /// Agents that it reads, itself first.
    agents: usize,
}

impl CriticInput {
    pub(super) fn new(shape: &TaskShape, rows: usize, scope: CriticScope) -> Self {
        Self { rows, environments: rows / shape.agents, agents: scope.agents(shape.agents) }
    }

    /// Writes `[values][columns]` of so many rows from `first_row` on, as they are after the last step.
    pub(super) fn write(
        &self,
        environment: &impl Environment,
        (first_row, columns): (usize, usize),
        input: &mut [f32],
    ) {
        let mut targets = input.chunks_exact_mut(columns);
        for mate in 0..self.agents {
            let start = self.mate(first_row, mate);
            let observed = environment.observations().chunks_exact(self.rows);
            let columns = observed.chain(environment.privileged().chunks_exact(self.rows));
            for (column, target) in columns.zip(&mut targets) {
                copy_turned(column, start, target);
            }
        }
    }

    /// The values of a row whose episode ended in the last step, from before its reset. A team mate whose episode ended
    /// too contributes its values from before its reset, one whose goes on those it goes on with.
    pub(super) fn at_end(&self, environment: &impl Environment, row: usize) -> Vec<f32> {
        let mut values = Vec::new();
        for mate in 0..self.agents {
            let row = self.mate(row, mate);
            let (observed, hidden) = match environment.outcomes()[row] {
                Outcome::Running => (environment.observations(), environment.privileged()),
                Outcome::Truncated | Outcome::Terminated => {
                    (environment.final_observations(), environment.final_privileged())
                }
            };
            let columns = observed.chunks_exact(self.rows).chain(hidden.chunks_exact(self.rows));
            values.extend(columns.map(|column| column[row]));
        }
        values
    }

    /// The row of a team mate, `mate` places after the agent of a row.
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
    fn the_mates_of_an_agent_follow_it_in_a_circle() {
        let input = CriticInput { rows: 12, environments: 4, agents: 3 };
        let team = |row| [0, 1, 2].map(|mate| input.mate(row, mate));
        // Environment 1 holds rows 1, 5 and 9.
        assert_eq!([team(1), team(5), team(9)], [[1, 5, 9], [5, 9, 1], [9, 1, 5]]);
    }
}
