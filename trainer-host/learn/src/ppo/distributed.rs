//! What the ranks of a run have in common.

use std::sync::Arc;

use super::{EnvBatch, SHARDS, Trainer};
use crate::environment::{Environment, Episode, Outcome};
use crate::ranks::{self, Ranks, UnequalShares};

impl<E: Environment> Trainer<E> {
    /// From now on several processes share the work of this run; each of them has it.
    ///
    /// # Errors
    /// When environment batches or shards cannot be dealt to so many equally.
    pub fn work_with(&mut self, ranks: &Arc<dyn Ranks>) -> Result<(), UnequalShares> {
        ranks::check(ranks, self.env_batches.len(), "environment batches")?;
        ranks::check(ranks, SHARDS, "parts of a minibatch")?;
        self.ranks = Arc::clone(ranks);
        Ok(())
    }

    /// The processes that share the work.
    pub fn ranks(&self) -> &Arc<dyn Ranks> {
        &self.ranks
    }

    /// Shows the rollouts of my environment batches and reads those of the others.
    pub(super) fn share_rollouts(&mut self) {
        if self.ranks.size() == 1 {
            return;
        }
        let mut all: Vec<f32> = Vec::new();
        for env_batch in &mut self.env_batches {
            env_batch.rollout_mut().columns_mut().iter().for_each(|column| all.extend_from_slice(column));
        }
        self.ranks.share(&mut all);
        let mut rest = all.as_slice();
        for column in self.env_batches.iter_mut().flat_map(|env_batch| env_batch.rollout_mut().columns_mut()) {
            let (values, others) = rest.split_at(column.len());
            column.copy_from_slice(values);
            rest = others;
        }
        self.share_images();
        self.share_outcomes();
    }

    /// How steps ended, where policies forget what they remember with their episodes.
    fn share_outcomes(&mut self) {
        if self.settings.memory.is_none() {
            return;
        }
        let mine = ranks::part(&self.ranks, self.env_batches.len());
        let mine = self.env_batches[mine].iter_mut().map(EnvBatch::rollout_mut);
        let outcomes: Vec<Outcome> = mine.flat_map(|rollout| rollout.outcomes_mut().to_vec()).collect();
        let mut all = ranks::gathered(&self.ranks, &outcomes).into_iter().flatten();
        for env_batch in &mut self.env_batches {
            for (outcome, shown) in env_batch.rollout_mut().outcomes_mut().iter_mut().zip(&mut all) {
                *outcome = shown;
            }
        }
    }

    /// Bytes travel as the numbers that four of them are, whole slices being multiples of four.
    fn share_images(&mut self) {
        let mut all: Vec<f32> = Vec::new();
        for env_batch in &mut self.env_batches {
            let words = env_batch.rollout_mut().images_mut().as_chunks::<4>().0;
            all.extend(words.iter().map(|bytes| f32::from_bits(u32::from_le_bytes(*bytes))));
        }
        if all.is_empty() {
            return;
        }
        self.ranks.share(&mut all);
        let mut words = all.iter();
        for env_batch in &mut self.env_batches {
            for (bytes, word) in
                env_batch.rollout_mut().images_mut().as_chunks_mut::<4>().0.iter_mut().zip(&mut words)
            {
                *bytes = word.to_bits().to_le_bytes();
            }
        }
    }

    /// Shows my parts of a minibatch's gradient and reads those of the others.
    pub(super) fn share_shards(&mut self) {
        if self.ranks.size() == 1 {
            return;
        }
        let mut all: Vec<f32> = Vec::new();
        for shard in &self.shards {
            all.extend_from_slice(&shard.gradient.actor);
            all.extend_from_slice(&shard.gradient.critic);
        }
        self.ranks.share(&mut all);
        let mut rest = all.as_slice();
        for shard in &mut self.shards {
            for part in [&mut shard.gradient.actor, &mut shard.gradient.critic] {
                let (values, others) = rest.split_at(part.len());
                part.copy_from_slice(values);
                rest = others;
            }
        }
        let mine: Vec<_> = self.shards[ranks::part(&self.ranks, SHARDS)].iter().map(|shard| shard.sums).collect();
        let sums = ranks::gathered(&self.ranks, &mine);
        for (shard, sums) in self.shards.iter_mut().zip(sums.into_iter().flatten()) {
            shard.sums = sums;
        }
    }

    /// Episodes that ended since the last call, in all environment batches.
    pub(super) fn take_episodes(&mut self) -> Vec<Episode> {
        let mine = ranks::part(&self.ranks, self.env_batches.len());
        let episodes: Vec<Episode> = self.env_batches[mine].iter_mut().flat_map(EnvBatch::take_episodes).collect();
        if self.ranks.size() == 1 { episodes } else { ranks::gathered(&self.ranks, &episodes).concat() }
    }

    /// The environments of all environment batches, and what their policies remember.
    pub(super) fn batch_states(&self) -> (Vec<E::State>, Vec<f32>) {
        let mine = &self.env_batches[ranks::part(&self.ranks, self.env_batches.len())];
        let states: Vec<E::State> = mine.iter().map(EnvBatch::save).collect();
        let hidden: Vec<f32> = mine.iter().flat_map(EnvBatch::hidden).copied().collect();
        if self.ranks.size() == 1 {
            return (states, hidden);
        }
        let states = ranks::gathered(&self.ranks, &states).into_iter().flatten().collect();
        (states, ranks::gathered(&self.ranks, &hidden).concat())
    }
}
