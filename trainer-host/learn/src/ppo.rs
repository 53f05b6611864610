//! Proximal policy optimisation (Schulman et al. 2017), with the details of Huang et al. 2022.
//!
//! [`Trainer::update`] is algorithm 1 of the paper, and this file its page: collect a rollout with the policy `π_old`,
//! estimate advantages, then several epochs of minibatches with the clipped surrogate (`clipped_surrogate`), the
//! critic's squared error and an entropy bonus, each followed by a step of Adam. Where a method of continual learning
//! remembers earlier tasks, its [`Regulariser`] adds its penalty's gradient to every minibatch's.
//!
//! A minibatch is a random set of *slices*: up to [`ENV_BATCH`](crate::rollout::ENV_BATCH) rows of one environment batch
//! at one step. Nothing is gathered, a slice is read where the rollout wrote it. That is as good as single samples: the
//! environments of a slice are independent of each other and at different moments of their episodes, and a minibatch
//! draws its slices from all environment batches and all steps. Where the policy has a memory ([`crate::gru`]), a window of
//! such slices, step after step, takes the place of one, and the gradient goes back through it.
//!
//! Several agents of one environment train one policy together, each from what it observes itself (IPPO with shared
//! parameters). With [`CriticScope::Team`] their critic reads what all of them observe; with [`ValueScaling::PopArt`]
//! beside, that is MAPPO (Yu et al. 2022).
//!
//! Simpler methods are settings of this one. In the first gradient step of an update every ratio of probabilities is
//! one, whatever it is clipped to, and the surrogate's gradient is that of −A log π: with one epoch of one minibatch
//! there is no other step, which is synchronous advantage actor-critic (A2C, Mnih et al. 2016; Huang et al. 2022
//! "A2C is a special case of PPO"), and with `gae_lambda` 1 beside, returns take the place of estimates: REINFORCE
//! with the critic for a baseline (Williams 1992). `configs/parts/a2c.yaml` and `reinforce.yaml` are these.
//!
//! With `quantised_from` the actor acts and is differentiated with the weights of its export (`quantisation.rs`); with
//! `teacher` the loss has the imitation loss of kickstarting (Schmitt et al. 2018), whose weight is annealed.
//!
//! Every sum has an order that the number of threads does not change: a minibatch is cut into a fixed number of shards,
//! and their gradients are added in order. Several processes share environment batches and shards, bit-exactly
//! ([`crate::ranks`]).

mod begin;
mod continual;
mod distributed;
mod loss;
mod metrics;
mod minibatch;
mod settings;
mod state;
mod workspace;

use std::sync::Arc;

use kestrel_core::seed::{Purpose, Seed, Stream};
use rayon::prelude::*;
use web_time::Instant;

pub use crate::actor_critic::{Actor, ActorLengths, Critic};
use crate::actor_critic::{EncoderWeights, Gradient, Networks};
use crate::adam::Adam;
use crate::advantage::{Moments, normalise};
use crate::environment::{Environment, Outcome};
use crate::quantisation::Quantised;
use crate::ranks::{self, Ranks};
use crate::regulariser::{FineTuning, Learning, OptimiserStep, Regulariser};
pub use crate::rollout::CriticScope;
use crate::rollout::{Collection, EnvBatch, MinibatchSlice};
pub use continual::{CarryOver, WarmStart};
use loss::{LossSums, PolicyLoss, ValueLoss};
pub use metrics::UpdateMetrics;
use minibatch::{SHARDS, Shard, WindowIndex};
pub use settings::{
    EncoderKind, EncoderSettings, EncoderSharing, MemorySettings, PpoSettings, SettingsError, TeacherSettings,
    ValueScaling, fits_minibatch, fits_windows,
};
pub(crate) use state::restore_hidden;
pub use state::{RestoreError, TrainerState};
use workspace::{SliceWorkspace, Workspaces};

/// An update stops when its divergence exceeds the target by this factor, as in Stable-Baselines3.
const KL_TOLERANCE: f32 = 1.5;

/// Keeps the ratio finite for actions that the new policy finds impossible; far outside any clip range.
const LOG_RATIO_LIMIT: f32 = 20.0;

/// A training run between two updates.
#[derive(Clone, Debug)]
pub struct Trainer<E> {
    settings: PpoSettings,
    seed: Seed,
    actor: Actor,
    critic: Critic,
    /// The actor with the weights of its export, once it acts with them.
    quantised: Option<Quantised>,
    /// What they were when they were arranged last.
    encoders: EncoderWeights,
    actor_optimiser: Adam,
    critic_optimiser: Adam,
    learning_rate: f32,
    /// Weight of the imitation loss in this update.
    imitation_weight: f32,
    updates: u64,
    env_batches: Vec<EnvBatch<E>>,
    shards: Vec<Shard>,
    workspaces: Workspaces,
    gradient: Gradient,
    ranks: Arc<dyn Ranks>,
}

impl<E: Environment> Trainer<E> {
    /// One rollout and the optimisation on it. The bits do not depend on the number of threads of the current
    /// rayon pool.
    pub fn update(&mut self) -> UpdateMetrics {
        self.update_with(&mut FineTuning)
    }

    /// As [`Self::update`], regularised towards what earlier tasks left behind.
    pub fn update_with(&mut self, regulariser: &mut impl Regulariser) -> UpdateMetrics {
        let start = Instant::now();
        self.collect();
        let rollout_secs = start.elapsed().as_secs_f64();
        let mut metrics = UpdateMetrics { learning_rate: self.learning_rate, rollout_secs, ..Default::default() };
        metrics.boundary = self.show(regulariser);
        metrics.explained_variance = self.normalise_advantages();
        self.optimise(regulariser, &mut metrics);
        self.finish(&mut metrics);
        metrics.update_secs = start.elapsed().as_secs_f64() - rollout_secs;
        metrics
    }

    /// Every environment batch takes T steps with `π_old`, and estimates their advantages (eq. 11 and 12).
    fn collect(&mut self) {
        let progress = self.progress();
        let is_due = self.settings.quantised_from.is_some_and(|share| progress >= f64::from(share));
        self.imitation_weight = self.settings.teacher.map_or(0.0, |teacher| teacher.weight_at(progress));
        self.quantised = is_due.then(|| Quantised::new(&self.actor));
        let actor = self.quantised.as_ref().map_or(&self.actor, Quantised::actor);
        self.encoders.arrange(actor, &self.critic);
        let collection = Collection {
            networks: Networks { actor, critic: &self.critic, encoders: &self.encoders },
            first_step: self.updates * self.settings.steps_per_rollout as u64,
            reward_scale: self.settings.reward_scale,
            discount: self.settings.discount,
            gae_lambda: self.settings.gae_lambda,
            asks_teacher: self.imitation_weight > 0.0,
        };
        let mine = ranks::part(&self.ranks, self.env_batches.len());
        self.env_batches[mine].par_iter_mut().for_each(|env_batch| env_batch.collect(&collection));
        self.share_rollouts();
    }

    /// Gives the advantages of each task mean zero and unit spread, so that no task drowns the others; returns the
    /// explained variance, the mean over the tasks.
    fn normalise_advantages(&mut self) -> f32 {
        let mut moments = vec![(Moments::default(), Moments::default()); self.tasks()];
        for env_batch in &self.env_batches {
            let (advantages, returns) = &mut moments[env_batch.rollout().task()];
            advantages.add(env_batch.rollout().advantages());
            returns.add(env_batch.rollout().returns());
        }
        self.env_batches.par_iter_mut().for_each(|env_batch| {
            let rollout = env_batch.rollout_mut();
            let (advantages, _) = &moments[rollout.task()];
            normalise(rollout.advantages_mut(), advantages);
        });
        if self.settings.value_scale == ValueScaling::PopArt {
            for (task, (_, returns)) in moments.iter().enumerate() {
                self.critic.rescale(task, returns);
            }
        }
        // An advantage is what its return has beyond the critic's value.
        let explained = |(advantages, returns): &(Moments, Moments)| match returns.variance() {
            variance if variance > 0.0 => 1.0 - advantages.variance() / variance,
            _ => 0.0,
        };
        (moments.iter().map(explained).sum::<f64>() / moments.len() as f64) as f32
    }

    /// K epochs of minibatches: gradient, then Adam.
    fn optimise(&mut self, regulariser: &mut impl Regulariser, metrics: &mut UpdateMetrics) {
        let (mut all, mut norms, mut minibatches) = (LossSums::default(), 0.0, 0_u32);
        'epochs: for epoch in 0..self.settings.epochs {
            let mut this_epoch = LossSums::default();
            for minibatch in self.shuffled(epoch).chunks(self.settings.minibatch / self.window_samples()) {
                let sums = self.differentiate(minibatch);
                regulariser
                    .add_gradient(Learning { actor: &self.actor, critic: &self.critic }, &mut self.gradient);
                let norm = self.gradient.norm();
                (norms, minibatches) = (norms + norm, minibatches + 1);
                all.add(&sums);
                this_epoch.add(&sums);
                metrics.approx_kl = this_epoch.mean(this_epoch.approx_kl);
                if self.settings.target_kl.is_some_and(|target| sums.mean(sums.approx_kl) > KL_TOLERANCE * target)
                {
                    break 'epochs;
                }
                let (scale, learning_rate) = (self.descend(norm), self.learning_rate);
                let step = OptimiserStep { gradient: &self.gradient, scale, learning_rate };
                regulariser.after_step(&mut self.actor, &step);
            }
        }
        metrics.gradient_norm = norms / minibatches.max(1) as f32;
        metrics.policy_loss = all.mean(all.policy_loss);
        metrics.value_loss = all.mean(all.value_loss);
        metrics.clip_fraction = all.mean(all.clipped);
    }

    /// All windows of the rollout in random order.
    fn shuffled(&self, epoch: u32) -> Vec<WindowIndex> {
        let windows = |(env_batch, of): (usize, &EnvBatch<E>)| {
            (0..of.rollout().windows()).map(move |window| WindowIndex { env_batch, window })
        };
        let mut all: Vec<WindowIndex> = self.env_batches.iter().enumerate().flat_map(windows).collect();
        let pass = self.updates * u64::from(self.settings.epochs) + u64::from(epoch);
        let mut stream = Stream::new(self.seed, pass as u32, Purpose::Shuffle);
        for last in (1..all.len()).rev() {
            all.swap(last, stream.below(last as u32 + 1) as usize);
        }
        all
    }

    /// One Adam step along the gradient, clipped to the maximum norm; returns the factor by which it was.
    fn descend(&mut self, gradient_norm: f32) -> f32 {
        // As in PyTorch: the small number keeps a vanished gradient finite.
        let scale = (self.settings.gradient_norm_limit / (gradient_norm + 1e-6)).min(1.0);
        let rate = self.learning_rate;
        self.actor_optimiser.step(self.actor.parameters_mut(), &self.gradient.actor, scale, rate);
        self.critic_optimiser.step(self.critic.parameters_mut(), &self.gradient.critic, scale, rate);
        self.actor.limit_log_std(self.settings.lowest_log_std, self.settings.highest_log_std);
        scale
    }

    /// Counts the update, moves the learning rate and reports the rest.
    fn finish(&mut self, metrics: &mut UpdateMetrics) {
        self.updates += 1;
        self.learning_rate =
            self.settings.learning_rate.next(self.learning_rate, self.progress(), metrics.approx_kl);
        metrics.steps = self.steps();
        metrics.updates = self.updates;
        metrics.entropy = self.actor.gaussian().entropy();
        metrics.log_std = self.actor.log_std().iter().sum::<f32>() / self.actor.action_len() as f32;
        metrics.describe(&self.take_episodes());
    }
}

/// The loss of a minibatch, eq. 9: −L^CLIP + c₁ L^VF − c₂ S, and an imitation loss where there is a teacher.
#[derive(Clone, Copy, Debug)]
struct Loss<'a> {
    settings: &'a PpoSettings,
    /// Inverse of the minibatch's size.
    sample_weight: f32,
    /// Of the imitation loss.
    imitation_weight: f32,
}

impl Loss<'_> {
    /// Adds a window's part of the gradient to a shard: all but that of the entropy S, which no sample enters.
    fn differentiate<'r>(
        &self,
        window: impl Iterator<Item = MinibatchSlice<'r>>,
        networks: &Networks<'_>,
        workspace: &mut SliceWorkspace,
        shard: &mut Shard,
    ) {
        let window: Vec<MinibatchSlice<'_>> = window.collect();
        for (step, slice) in window.iter().enumerate() {
            let before = step.checked_sub(1).map(|before| window[before].outcomes);
            self.differentiate_slice(slice, before, (networks, workspace), shard);
        }
        workspace.backward_window(networks, &window, &mut shard.gradient);
    }

    /// As [`Self::differentiate`], of one slice; a memory has to wait for the whole window. `before` are the outcomes of the
    /// slice before it in the window.
    fn differentiate_slice(
        &self,
        slice: &MinibatchSlice<'_>,
        before: Option<&[Outcome]>,
        (networks, workspace): (&Networks<'_>, &mut SliceWorkspace),
        shard: &mut Shard,
    ) {
        let Networks { actor, critic, .. } = networks;
        workspace.forward(networks, slice.batch, before);
        let (means, mean_gradient) = workspace.action_deltas();
        let log_std_gradient = &mut shard.gradient.actor[actor.log_std_places()];
        let policy = PolicyLoss { loss: *self, slice, means, gaussian: &actor.gaussian() };
        policy.differentiate(mean_gradient, log_std_gradient, &mut shard.sums);
        let (heads, head_gradient) = workspace.head_deltas();
        let value = ValueLoss { loss: *self, slice, heads, scale: critic.scale(slice.task) };
        value.differentiate(head_gradient, &mut shard.sums);
        workspace.backward(networks, slice.batch.images, &mut shard.gradient);
    }
}

/// What the clipped surrogate makes of one sample.
struct Surrogate {
    /// −L^CLIP.
    loss: f32,
    /// Its derivative with respect to log π(a|s).
    gradient: f32,
    /// Estimate of `KL(π_old, π)`: unbiased, and of little variance (Schulman 2020, "k3").
    approx_kl: f32,
    is_clipped: bool,
}

/// The clipped surrogate objective, eq. 7: min(r A, clip(r, 1 − ε, 1 + ε) A), from the logarithm of the ratio
/// `r = π(a|s) / π_old(a|s)` (eq. 6) and the advantage A.
#[inline(always)]
fn clipped_surrogate(log_ratio: f32, advantage: f32, clip_range: f32) -> Surrogate {
    let log_ratio = log_ratio.clamp(-LOG_RATIO_LIMIT, LOG_RATIO_LIMIT);
    let ratio = libm::expf(log_ratio);
    let clipped = ratio.clamp(1.0 - clip_range, 1.0 + clip_range);
    let (gain, clipped_gain) = (ratio * advantage, clipped * advantage);
    Surrogate {
        loss: -gain.min(clipped_gain),
        // ∂r / ∂ log π = r; where the clipped gain is the smaller one, it does not depend on the policy.
        gradient: if gain <= clipped_gain { -gain } else { 0.0 },
        approx_kl: ratio - 1.0 - log_ratio,
        is_clipped: ratio != clipped,
    }
}

/// What the squared error of the critic (L^VF of eq. 9) makes of one sample.
struct ValueError {
    loss: f32,
    /// Its derivative with respect to the value.
    gradient: f32,
}

#[inline(always)]
fn value_error(value: f32, target: f32) -> ValueError {
    let error = value - target;
    ValueError { loss: error * error, gradient: 2.0 * error }
}

#[cfg(test)]
mod tests;
