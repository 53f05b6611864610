//! What the ranks of a run have in common, as `ppo::distributed`: each flies and differentiates its part of the batches of
//! environments, and shows the others their gradients.

use core::ops::Range;
use std::sync::Arc;

use super::{AnalyticTrainer, Batch, Differentiable};
use crate::environment::Episode;
use crate::ranks::{self, Ranks, UnequalShares};

impl<E: Differentiable> AnalyticTrainer<E> {
    /// From now on several processes share the work of this run; each of them has it.
    ///
    /// # Errors
    /// When batches of environments cannot be dealt to so many equally.
    pub fn work_with(&mut self, ranks: &Arc<dyn Ranks>) -> Result<(), UnequalShares> {
        ranks::check(ranks, self.batches.len(), "batches of environments")?;
        self.ranks = Arc::clone(ranks);
        Ok(())
    }

    /// The processes that share the work.
    pub fn ranks(&self) -> &Arc<dyn Ranks> {
        &self.ranks
    }

    /// Which of the batches I fly.
    pub(super) fn mine(&self) -> Range<usize> {
        ranks::part(&self.ranks, self.batches.len())
    }

    /// Shows a column of each of my batches and reads those of the others.
    pub(super) fn share(&mut self, column: impl Fn(&mut Batch<E>) -> &mut [f32]) {
        if self.ranks.size() == 1 {
            return;
        }
        let mut all: Vec<f32> = Vec::new();
        self.batches.iter_mut().for_each(|batch| all.extend_from_slice(column(batch)));
        self.ranks.share(&mut all);
        let mut rest = all.as_slice();
        for batch in &mut self.batches {
            let values = column(batch);
            let (shown, others) = rest.split_at(values.len());
            values.copy_from_slice(shown);
            rest = others;
        }
    }

    /// Shows what my batches have been paid and reads it of the others.
    pub(super) fn share_rewards(&mut self) {
        if self.ranks.size() > 1 {
            let mine: Vec<f64> = self.batches[self.mine()].iter().map(|batch| batch.reward).collect();
            let rewards = ranks::gathered(&self.ranks, &mine).concat();
            self.batches.iter_mut().zip(rewards).for_each(|(batch, reward)| batch.reward = reward);
        }
    }

    /// Episodes that ended since the last call, in all batches.
    pub(super) fn take_episodes(&mut self) -> Vec<Episode> {
        let mine = self.mine();
        let batches = self.batches[mine].iter_mut();
        let episodes: Vec<Episode> = batches.flat_map(|batch| batch.environment.take_episodes()).collect();
        if self.ranks.size() == 1 { episodes } else { ranks::gathered(&self.ranks, &episodes).concat() }
    }

    /// The environments of all batches, and what their policies remember.
    pub(super) fn batch_states(&self) -> (Vec<E::State>, Vec<f32>) {
        let mine = &self.batches[self.mine()];
        let states: Vec<E::State> = mine.iter().map(|batch| batch.environment.save()).collect();
        let memories = mine.iter().flat_map(|batch| &batch.memory);
        let hidden: Vec<f32> = memories.flat_map(|memory| &memory.hidden).copied().collect();
        if self.ranks.size() == 1 {
            return (states, hidden);
        }
        let states = ranks::gathered(&self.ranks, &states).into_iter().flatten().collect();
        (states, ranks::gathered(&self.ranks, &hidden).concat())
    }
}
