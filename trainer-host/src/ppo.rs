//! Proximal policy optimisation (Schulman et al. 2017), with the details of Huang et al. 2022.
//!
//! A minibatch is a random set of *tiles*: the [`PANEL`] drones of one panel at one step. Nothing is
//! gathered, a tile is read where the rollout wrote it. That is as good as single samples: the environments of a
//! tile are independent of each other and at different moments of their episodes, and a minibatch draws its tiles
//! from all panels and all steps.
//!
//! Every sum has an order that the number of threads does not change: a minibatch is cut into a fixed number of shards,
//! and their gradients are added in order.

mod loss;
mod metrics;
mod settings;
mod shard;
mod state;

use std::time::Instant;

use kestrel_sim::PRIVILEGED_LEN;
use kestrel_sim::outcome::Episode;
use kestrel_sim::scenario::{CriticView, Scenario};
use kestrel_sim::seed::{Purpose, Seed, Stream};
use rayon::prelude::*;

pub use crate::actor_critic::{Actor, Critic};
use crate::adam::Adam;
use crate::advantage::{Moments, normalise};
use crate::rollout::{Collection, PANEL, Panel};
use loss::LossSums;
pub use metrics::UpdateMetrics;
pub use settings::{PpoSettings, SettingsError};
use shard::{Gradient, Shard};
pub use state::{RestoreError, TrainerState};

/// Parts of a minibatch: enough for the cores of a workstation, few enough that adding them up costs nothing.
const SHARDS: usize = 16;

/// An update stops when its divergence exceeds the target by this factor, as in Stable-Baselines3.
const KL_TOLERANCE: f32 = 1.5;

/// A training run between two updates.
#[derive(Clone, Debug)]
pub struct Trainer {
    settings: PpoSettings,
    seed: Seed,
    actor: Actor,
    critic: Critic,
    actor_optimiser: Adam,
    critic_optimiser: Adam,
    learning_rate: f32,
    updates: u64,
    panels: Vec<Panel>,
    shards: Vec<Shard>,
    gradient: Gradient,
}

/// One step of one panel.
#[derive(Clone, Copy, Debug)]
struct Sample {
    panel: usize,
    step: usize,
}

impl Trainer {
    /// A run at its beginning.
    ///
    /// # Panics
    /// When the settings fail [`PpoSettings::check`], or the drones of an environment do not divide [`PANEL`].
    pub fn new(scenario: &Scenario, settings: &PpoSettings, seed: Seed) -> Self {
        settings.check().expect("settings are checked where they are read");
        let weights = |network| Stream::new(seed, network, Purpose::Weights);
        let observation_len = scenario.observation.len();
        let critic_len = observation_len + privileged_len(scenario.critic);
        let lengths = (observation_len, scenario.action.len());
        let actor = Actor::new(lengths, &settings.actor_hidden, settings.initial_log_std, &mut weights(0));
        let critic = Critic::new(critic_len, &settings.critic_hidden, &mut weights(1));
        let steps = settings.steps_per_rollout;
        let panel = |first| Panel::new(scenario, seed, first, steps, (&actor, &critic));
        Self {
            settings: settings.clone(),
            seed,
            actor_optimiser: Adam::new(actor.parameters().len()),
            critic_optimiser: Adam::new(critic.parameters().len()),
            learning_rate: settings.learning_rate.initial(),
            updates: 0,
            panels: (0..settings.environments as u32).step_by(PANEL).map(panel).collect(),
            shards: vec![Shard::new(&actor, &critic); SHARDS],
            gradient: Gradient::new(&actor, &critic),
            actor,
            critic,
        }
    }

    /// One rollout and the optimisation on it. The bits do not depend on the number of threads of the current
    /// rayon pool.
    pub fn update(&mut self) -> UpdateMetrics {
        let start = Instant::now();
        self.collect();
        let rollout_secs = start.elapsed().as_secs_f64();
        let mut metrics = UpdateMetrics { learning_rate: self.learning_rate, rollout_secs, ..Default::default() };
        metrics.explained_variance = self.normalise_advantages();
        self.optimise(&mut metrics);
        self.advance(&mut metrics);
        metrics.update_secs = start.elapsed().as_secs_f64() - rollout_secs;
        metrics
    }

    /// Environment steps since the start of training.
    pub fn steps(&self) -> u64 {
        self.updates * self.settings.batch() as u64
    }

    /// Updates since the start of training.
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// The policy.
    pub fn actor(&self) -> &Actor {
        &self.actor
    }

    /// The value function.
    pub fn critic(&self) -> &Critic {
        &self.critic
    }

    /// Every panel flies the policy for a rollout.
    fn collect(&mut self) {
        let collection = Collection {
            actor: &self.actor,
            critic: &self.critic,
            first_step: self.updates * self.settings.steps_per_rollout as u64,
            reward_scale: self.settings.reward_scale,
            discount: self.settings.discount,
            gae_lambda: self.settings.gae_lambda,
        };
        self.panels.par_iter_mut().for_each(|panel| panel.collect(&collection));
    }

    /// Gives the advantages of the whole batch mean zero and unit spread; returns the explained variance.
    fn normalise_advantages(&mut self) -> f32 {
        let (mut advantages, mut returns) = (Moments::default(), Moments::default());
        for panel in &self.panels {
            advantages.add(panel.rollout().advantages());
            returns.add(panel.rollout().returns());
        }
        self.panels.par_iter_mut().for_each(|panel| normalise(panel.rollout_mut().advantages_mut(), &advantages));
        // An advantage is what its return has beyond the critic's value.
        let unexplained = advantages.variance() / returns.variance();
        if returns.variance() > 0.0 { (1.0 - unexplained) as f32 } else { 0.0 }
    }

    /// Several epochs of minibatches: gradient, then Adam.
    fn optimise(&mut self, metrics: &mut UpdateMetrics) {
        let (mut all, mut norms, mut minibatches) = (LossSums::default(), 0.0, 0_u32);
        'epochs: for epoch in 0..self.settings.epochs {
            let mut this_epoch = LossSums::default();
            for minibatch in self.shuffled(epoch).chunks(self.settings.minibatch / PANEL) {
                let sums = self.differentiate(minibatch);
                let norm = self.gradient.norm();
                (norms, minibatches) = (norms + norm, minibatches + 1);
                all.add(&sums);
                this_epoch.add(&sums);
                metrics.approx_kl = this_epoch.mean(this_epoch.approx_kl);
                if self.settings.target_kl.is_some_and(|target| sums.mean(sums.approx_kl) > KL_TOLERANCE * target)
                {
                    break 'epochs;
                }
                self.descend(norm);
            }
        }
        metrics.gradient_norm = norms / minibatches.max(1) as f32;
        metrics.policy_loss = all.mean(all.policy_loss);
        metrics.value_loss = all.mean(all.value_loss);
        metrics.clip_fraction = all.mean(all.clipped);
    }

    /// All samples of the rollout in random order.
    fn shuffled(&self, epoch: u32) -> Vec<Sample> {
        let steps = self.settings.steps_per_rollout;
        let samples = (0..self.panels.len()).flat_map(|panel| (0..steps).map(move |step| Sample { panel, step }));
        let mut samples: Vec<Sample> = samples.collect();
        let pass = self.updates * u64::from(self.settings.epochs) + u64::from(epoch);
        let mut stream = Stream::new(self.seed, pass as u32, Purpose::Shuffle);
        for last in (1..samples.len()).rev() {
            samples.swap(last, stream.below(last as u32 + 1) as usize);
        }
        samples
    }

    /// The gradient of a minibatch's loss: clipped surrogate, value error and entropy.
    fn differentiate(&mut self, minibatch: &[Sample]) -> LossSums {
        let Self { settings, panels, shards, actor, critic, gradient, .. } = self;
        let sample_weight = 1.0 / (minibatch.len() * PANEL) as f32;
        shards.par_iter_mut().enumerate().for_each(|(index, shard)| {
            shard.clear();
            let part = index * minibatch.len() / SHARDS..(index + 1) * minibatch.len() / SHARDS;
            for sample in &minibatch[part] {
                let tile = panels[sample.panel].rollout().tile(sample.step);
                shard.add(tile, (actor, critic), settings, sample_weight);
            }
        });
        gradient.clear();
        let mut sums = LossSums::default();
        for shard in shards {
            gradient.add(&shard.gradient);
            sums.add(&shard.sums);
        }
        for log_std in &mut gradient.actor[actor.mlp().parameter_count()..] {
            // Each nat of log_std is a nat of entropy.
            *log_std -= settings.entropy_weight;
        }
        sums
    }

    /// One Adam step along the gradient, shortened to the limit.
    fn descend(&mut self, gradient_norm: f32) {
        // As in PyTorch: the small number keeps a vanished gradient finite.
        let scale = (self.settings.gradient_norm_limit / (gradient_norm + 1e-6)).min(1.0);
        let rate = self.learning_rate;
        self.actor_optimiser.step(self.actor.parameters_mut(), &self.gradient.actor, scale, rate);
        self.critic_optimiser.step(self.critic.parameters_mut(), &self.gradient.critic, scale, rate);
        self.actor.limit_log_std(self.settings.lowest_log_std, self.settings.highest_log_std);
    }

    /// Counts the update, moves the learning rate and reports the rest.
    fn advance(&mut self, metrics: &mut UpdateMetrics) {
        self.updates += 1;
        let progress = self.steps() as f64 / self.settings.total_steps.max(1) as f64;
        self.learning_rate = self.settings.learning_rate.next(self.learning_rate, progress, metrics.approx_kl);
        metrics.steps = self.steps();
        metrics.updates = self.updates;
        metrics.entropy = self.actor.gaussian().entropy();
        metrics.log_std = self.actor.log_std().iter().sum::<f32>() / self.actor.action_len() as f32;
        let episodes: Vec<Episode> = self.panels.iter_mut().flat_map(Panel::take_episodes).collect();
        metrics.describe(&episodes);
    }
}

/// Number of values that the critic sees beside the observation.
fn privileged_len(critic: CriticView) -> usize {
    match critic {
        CriticView::Observation => 0,
        CriticView::Privileged => PRIVILEGED_LEN,
    }
}

#[cfg(test)]
mod tests;
