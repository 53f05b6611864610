//! The gradient of a minibatch, which several threads and processes share.

use rayon::prelude::*;

use super::loss::LossSums;
use super::{Loss, Trainer};
use crate::actor_critic::{Actor, Critic, Gradient, Networks};
use crate::environment::Environment;
use crate::ranks;
use crate::rollout::{EnvBatch, Rollout};

/// Parts of a minibatch: enough for the cores of a workstation, few enough that adding them up costs nothing.
pub(super) const SHARDS: usize = 16;

/// One window of one environment batch: slices that are differentiated together, one as a rule.
#[derive(Clone, Copy, Debug)]
pub(super) struct WindowIndex {
    pub(super) env_batch: usize,
    pub(super) window: usize,
}

impl<E: Environment> Trainer<E> {
    /// The gradient of a minibatch's loss: clipped surrogate, value error and entropy.
    pub(super) fn differentiate(&mut self, minibatch: &[WindowIndex]) -> LossSums {
        let mine = ranks::part(&self.ranks, SHARDS);
        let (columns, samples) = (self.columns(), self.window_samples());
        let Self { settings, env_batches, shards, workspaces, actor, critic, quantised, encoders, .. } = self;
        let actor = quantised.as_mut().map_or(&*actor, |quantised| {
            quantised.follow(actor);
            quantised.actor()
        });
        encoders.arrange(actor, critic);
        let networks = Networks { actor, critic, encoders };
        workspaces.provide(&networks, columns);
        let sample_weight = 1.0 / (minibatch.len() * samples) as f32;
        let loss = Loss { settings, sample_weight, imitation_weight: self.imitation_weight };
        let rollouts: Vec<&Rollout> = env_batches.iter().map(EnvBatch::rollout).collect();
        let part = |shard: usize| shard * minibatch.len() / SHARDS..(shard + 1) * minibatch.len() / SHARDS;
        shards[mine.clone()].par_iter_mut().zip(mine).for_each(|(shard, index)| {
            let mut workspace = workspaces.mine();
            if !part(index).is_empty() {
                shard.clear();
            }
            for WindowIndex { env_batch, window } in &minibatch[part(index)] {
                loss.differentiate(rollouts[*env_batch].window(*window), &networks, &mut workspace, shard);
            }
        });
        self.share_shards();
        self.add_shards(|shard| !part(shard).is_empty())
    }

    /// Adds up those shards that are filled, in their order, and the gradient of the entropy.
    fn add_shards(&mut self, is_filled: impl Fn(usize) -> bool) -> LossSums {
        let Self { shards, actor, gradient, settings, .. } = self;
        let filled = || shards.iter().enumerate().filter(|(index, _)| is_filled(*index)).map(|(_, shard)| shard);
        gradient.sum(&filled().map(|shard| &shard.gradient).collect::<Vec<_>>());
        let mut sums = LossSums::default();
        for shard in filled() {
            sums.add(&shard.sums);
        }
        for log_std in &mut gradient.actor[actor.log_std_places()] {
            // Each nat of log_std is a nat of entropy.
            *log_std -= settings.entropy_weight;
        }
        sums
    }
}

/// What one part of a minibatch adds to the whole.
#[derive(Clone, Debug)]
pub(crate) struct Shard {
    pub(crate) gradient: Gradient,
    pub(crate) sums: LossSums,
}

impl Shard {
    pub(crate) fn new(actor: &Actor, critic: &Critic) -> Self {
        Self { gradient: Gradient::new(actor, critic), sums: LossSums::default() }
    }

    /// Forgets the gradient and the sums of the last minibatch.
    pub(crate) fn clear(&mut self) {
        self.gradient.clear();
        self.sums = LossSums::default();
    }
}
