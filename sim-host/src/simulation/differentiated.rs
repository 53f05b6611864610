//! Steps whose derivatives are wanted afterwards.

use kestrel_core::action::ACTION_LIMIT;

use super::{Simulation, load_actions, rows_of_block};
use crate::gradient::{LANES, StepGradient, StepRecord};

impl Simulation {
    /// Blocks of [`LANES`] environments, the last of which may have fewer.
    pub fn blocks(&self) -> usize {
        self.blocks.len()
    }

    /// Takes down, block by block, what a step with these actions `[action_len][rows]` begins with.
    ///
    /// # Panics
    /// When `actions` has another length.
    pub fn take_down(&mut self, gradient: &StepGradient, actions: &[f32], records: &mut [StepRecord]) {
        let (rows, len) = (self.rows(), self.scenario.action.len());
        assert_eq!(actions.len(), len * rows, "actions are [{len}][rows]");
        let agents = self.scenario.agents.count as usize;
        let mut columns = vec![[[0.0; LANES]; ACTION_LIMIT]; agents];
        for (index, (block, record)) in self.blocks.iter_mut().zip(records).enumerate() {
            for (agent, columns) in columns.iter_mut().enumerate() {
                load_actions(
                    actions,
                    rows,
                    rows_of_block::<LANES>(self.environments, agent, index),
                    true,
                    columns,
                );
            }
            let commanded: Vec<[f32; LANES]> = columns.iter().flat_map(|agent| &agent[..len]).copied().collect();
            gradient.take_down(block, &commanded, record);
        }
    }

    /// Takes down what that step has found in the end: once it is over.
    pub fn take_down_end(&mut self, gradient: &StepGradient, records: &mut [StepRecord]) {
        for (block, record) in self.blocks.iter_mut().zip(records) {
            gradient.take_down_end(block, record);
        }
    }

    /// Ends the episodes of some environments without a word, and begins their next ones; images stay as they were until
    /// the next step.
    ///
    /// # Panics
    /// When there is no such environment.
    pub fn restart(&mut self, environments: impl IntoIterator<Item = usize>) {
        for environment in environments {
            let (scenario, arenas) = (&self.scenario, self.arenas.as_ref());
            self.blocks[environment / LANES].restart(scenario, arenas, environment % LANES);
        }
        self.gather_outputs();
    }
}
