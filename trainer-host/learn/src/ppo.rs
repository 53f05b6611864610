//! Proximal policy optimisation (Schulman et al. 2017), with the details of Huang et al. 2022.
//!
//! A minibatch is a random set of *tiles*: up to [`PANEL`](crate::rollout::PANEL) drones of one panel at one step. Nothing is
//! gathered, a tile is read where the rollout wrote it. That is as good as single samples: the environments of a
//! tile are independent of each other and at different moments of their episodes, and a minibatch draws its tiles
//! from all panels and all steps.
//!
//! Several drones of one environment train one policy together, each from what it sees itself (IPPO with shared
//! parameters). With [`CriticScope::Team`] their critic reads what all of them see; with [`ValueScaling::PopArt`]
//! beside, that is MAPPO (Yu et al. 2022). Only the actor flies, so that nothing changes for the drones.
//!
//! Simpler methods are settings of this one. In the first gradient step of an update every ratio of probabilities is
//! one, whatever it is clipped to, and the surrogate's gradient is that of −A log π: with one epoch of one minibatch
//! there is no other step, which is synchronous advantage actor-critic (A2C, Mnih et al. 2016; Huang et al. 2022
//! "A2C is a special case of PPO"), and with `gae_lambda` 1 beside, returns take the place of estimates: REINFORCE
//! with the critic for a baseline (Williams 1992). `configs/parts/a2c.yaml` and `reinforce.yaml` are these.
//!
//! With `quantised_from` the actor flies and is differentiated with the weights of its export (`quantisation.rs`); with
//! `teacher` it also pays for its divergence from a teacher, less and less (`teacher.rs`).
//!
//! Every sum has an order that the number of threads does not change: a minibatch is cut into a fixed number of shards,
//! and their gradients are added in order. Several processes share panels and shards, to the same bits ([`crate::ranks`]).

mod desk;
mod distributed;
mod loss;
mod metrics;
mod settings;
mod shard;
mod state;

use std::sync::Arc;
use std::time::Instant;

use kestrel_sim::PRIVILEGED_LEN;
use kestrel_sim::camera::OnboardCamera;
use kestrel_sim::scenario::{CriticView, Scenario};
use kestrel_sim::seed::{Purpose, Seed, Stream};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use crate::actor_critic::{Actor, Critic};
use crate::actor_critic::{CriticSight, Eyes, Networks, Pass};
use crate::adam::Adam;
use crate::advantage::{Moments, normalise};
use crate::consolidation::{Consolidator, Ended};
use crate::perception::Perception;
use crate::quantisation::Quantised;
use crate::ranks::{self, Ranks};
pub use crate::rollout::CriticScope;
use crate::rollout::{Collection, Panel, PanelRows, Rollout, RolloutSize, panel_rows, tile_columns};
use desk::Desks;
use loss::LossSums;
pub use metrics::UpdateMetrics;
pub use settings::fits_minibatch;
pub use settings::{EyeKind, EyeSettings, EyeSharing, PpoSettings, SettingsError, ValueScaling};
pub(crate) use shard::Gradient;
use shard::Shard;
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
    /// The actor with the weights of its export, once it flies with them.
    quantised: Option<Quantised>,
    /// What they were when they were arranged last.
    eyes: Eyes,
    actor_optimiser: Adam,
    critic_optimiser: Adam,
    learning_rate: f32,
    /// Of the divergence from the teacher, in this update.
    lesson_weight: f32,
    updates: u64,
    panels: Vec<Panel>,
    shards: Vec<Shard>,
    desks: Desks,
    gradient: Gradient,
    ranks: Arc<dyn Ranks>,
}

/// Whether something of an earlier task is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Kept {
    /// The next task begins with it.
    Inherited,
    /// The next task begins afresh.
    Reset,
}

/// What a task begins with that an earlier one has learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Heritage {
    actor: Actor,
    log_std: Kept,
    /// Critic, and the optimisers of both networks.
    learner: Option<(Critic, Adam, Adam)>,
}

/// One tile of one panel.
#[derive(Clone, Copy, Debug)]
struct Sample {
    panel: usize,
    tile: usize,
}

impl Trainer {
    /// A run at its beginning, of one task or of several that one policy learns together: panel after panel of
    /// environments is dealt to them in turn.
    ///
    /// # Panics
    /// When the settings fail [`PpoSettings::check`], their drones do not fill panels of [`panel_rows`], there are fewer
    /// panels than tasks, the tasks differ in what policy or critic see or command, or there is no teacher for one of them.
    pub fn new(tasks: &[Scenario], settings: &PpoSettings, seed: Seed) -> Self {
        settings.check().expect("settings are checked where they are read");
        let (scope, rows) = (settings.critic_scope, panel_rows(tasks));
        assert!(
            settings.environments.is_multiple_of(rows),
            "{} drones fill no panels of {rows}",
            settings.environments
        );
        assert!(settings.environments / rows >= tasks.len(), "every task needs a panel");
        assert!(
            tasks.iter().all(|task| shape(task, scope) == shape(&tasks[0], scope)),
            "one policy needs one layout"
        );
        let weights = |network| Stream::new(seed, network, Purpose::Weights);
        let (actor, critic) = networks(tasks, settings, [weights(0), weights(1)]);
        let size = RolloutSize {
            steps: settings.steps_per_rollout,
            columns: tile_columns(settings.minibatch, actor.perception().is_some()),
        };
        let pass = Pass::new(&actor, &critic, size.columns);
        let panel = |index: usize| {
            let task = index % tasks.len();
            let drones = PanelRows { first: (index * rows) as u32, count: rows };
            let panel = Panel::new((task, &tasks[task]), seed, drones, (size, scope), pass.clone());
            if settings.teacher.is_some() { panel.taught() } else { panel }
        };
        Self {
            settings: settings.clone(),
            seed,
            actor_optimiser: Adam::new(actor.parameters().len()),
            critic_optimiser: Adam::new(critic.parameters().len()),
            learning_rate: settings.learning_rate.initial(),
            lesson_weight: 0.0,
            updates: 0,
            panels: (0..settings.environments / rows).map(panel).collect(),
            shards: vec![Shard::new(&actor, &critic); SHARDS],
            desks: Desks::default(),
            eyes: Eyes::default(),
            gradient: Gradient::new(&actor, &critic),
            ranks: ranks::alone(),
            quantised: None,
            actor,
            critic,
        }
    }

    /// One rollout and the optimisation on it. The bits do not depend on the number of threads of the current
    /// rayon pool.
    pub fn update(&mut self) -> UpdateMetrics {
        self.update_with(&mut Consolidator::None)
    }

    /// As [`Self::update`], held back by what earlier tasks left behind.
    pub fn update_with(&mut self, memory: &mut Consolidator) -> UpdateMetrics {
        let start = Instant::now();
        self.collect();
        let rollout_secs = start.elapsed().as_secs_f64();
        let mut metrics = UpdateMetrics { learning_rate: self.learning_rate, rollout_secs, ..Default::default() };
        metrics.explained_variance = self.normalise_advantages();
        self.optimise(memory, &mut metrics);
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

    /// The policy, to be replaced by another of its shape.
    pub fn actor_mut(&mut self) -> &mut Actor {
        &mut self.actor
    }

    /// What Adam knows of the actor's parameters.
    pub fn actor_optimiser(&self) -> &Adam {
        &self.actor_optimiser
    }

    /// As [`Self::actor_optimiser`].
    pub fn actor_optimiser_mut(&mut self) -> &mut Adam {
        &mut self.actor_optimiser
    }

    /// The value function.
    pub fn critic(&self) -> &Critic {
        &self.critic
    }

    /// Samples of a tile.
    fn columns(&self) -> usize {
        self.panels[0].rollout().columns()
    }

    /// Number of tasks.
    fn tasks(&self) -> usize {
        self.critic.mlp().outputs()
    }

    /// Every panel flies the policy for a rollout.
    fn collect(&mut self) {
        let progress = self.steps() as f64 / self.settings.total_steps.max(1) as f64;
        let is_due = self.settings.quantised_from.is_some_and(|share| progress >= f64::from(share));
        self.lesson_weight = self.settings.teacher.map_or(0.0, |teacher| teacher.weight_at(progress));
        self.quantised = is_due.then(|| Quantised::new(&self.actor));
        let actor = self.quantised.as_ref().map_or(&self.actor, Quantised::actor);
        self.eyes.arrange(actor, &self.critic);
        let collection = Collection {
            networks: Networks { actor, critic: &self.critic, eyes: &self.eyes },
            first_step: self.updates * self.settings.steps_per_rollout as u64,
            reward_scale: self.settings.reward_scale,
            discount: self.settings.discount,
            gae_lambda: self.settings.gae_lambda,
            is_taught: self.lesson_weight > 0.0,
        };
        let mine = ranks::part(&self.ranks, self.panels.len());
        self.panels[mine].par_iter_mut().for_each(|panel| panel.collect(&collection));
        self.share_rollouts();
    }

    /// Gives the advantages of each task mean zero and unit spread, so that no task drowns the others; returns the
    /// explained variance, the mean over the tasks.
    fn normalise_advantages(&mut self) -> f32 {
        let mut moments = vec![(Moments::default(), Moments::default()); self.tasks()];
        for panel in &self.panels {
            let (advantages, returns) = &mut moments[panel.rollout().task()];
            advantages.add(panel.rollout().advantages());
            returns.add(panel.rollout().returns());
        }
        self.panels.par_iter_mut().for_each(|panel| {
            let rollout = panel.rollout_mut();
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

    /// Several epochs of minibatches: gradient, then Adam.
    fn optimise(&mut self, memory: &mut Consolidator, metrics: &mut UpdateMetrics) {
        let (mut all, mut norms, mut minibatches) = (LossSums::default(), 0.0, 0_u32);
        'epochs: for epoch in 0..self.settings.epochs {
            let mut this_epoch = LossSums::default();
            for minibatch in self.shuffled(epoch).chunks(self.settings.minibatch / self.columns()) {
                let sums = self.differentiate(minibatch);
                memory.add_gradient((&self.actor, &self.critic), &mut self.gradient);
                let norm = self.gradient.norm();
                (norms, minibatches) = (norms + norm, minibatches + 1);
                all.add(&sums);
                this_epoch.add(&sums);
                metrics.approx_kl = this_epoch.mean(this_epoch.approx_kl);
                if self.settings.target_kl.is_some_and(|target| sums.mean(sums.approx_kl) > KL_TOLERANCE * target)
                {
                    break 'epochs;
                }
                let scale = self.descend(norm);
                memory.after_step((&mut self.actor, &self.gradient), scale, self.learning_rate);
            }
        }
        metrics.gradient_norm = norms / minibatches.max(1) as f32;
        metrics.policy_loss = all.mean(all.policy_loss);
        metrics.value_loss = all.mean(all.value_loss);
        metrics.clip_fraction = all.mean(all.clipped);
    }

    /// All samples of the rollout in random order.
    fn shuffled(&self, epoch: u32) -> Vec<Sample> {
        let tiles =
            |(panel, flown): (usize, &Panel)| (0..flown.rollout().tiles()).map(move |tile| Sample { panel, tile });
        let mut samples: Vec<Sample> = self.panels.iter().enumerate().flat_map(tiles).collect();
        let pass = self.updates * u64::from(self.settings.epochs) + u64::from(epoch);
        let mut stream = Stream::new(self.seed, pass as u32, Purpose::Shuffle);
        for last in (1..samples.len()).rev() {
            samples.swap(last, stream.below(last as u32 + 1) as usize);
        }
        samples
    }

    /// The gradient of a minibatch's loss: clipped surrogate, value error and entropy.
    fn differentiate(&mut self, minibatch: &[Sample]) -> LossSums {
        let mine = ranks::part(&self.ranks, SHARDS);
        let columns = self.columns();
        let Self { settings, panels, shards, desks, actor, critic, quantised, eyes, lesson_weight, .. } = self;
        let actor = quantised.as_mut().map_or(&*actor, |quantised| {
            quantised.follow(actor);
            quantised.actor()
        });
        eyes.arrange(actor, critic);
        let networks = Networks { actor, critic, eyes };
        desks.provide(&networks, columns);
        let weights = (1.0 / (minibatch.len() * columns) as f32, *lesson_weight);
        let part = |shard: usize| shard * minibatch.len() / SHARDS..(shard + 1) * minibatch.len() / SHARDS;
        shards[mine.clone()].par_iter_mut().zip(mine).for_each(|(shard, index)| {
            let mut desk = desks.mine();
            if !part(index).is_empty() {
                shard.clear();
            }
            for sample in &minibatch[part(index)] {
                let tile = panels[sample.panel].rollout().tile(sample.tile);
                desk.add(shard, tile, &networks, settings, weights);
            }
        });
        self.share_shards();
        let Self { shards, actor, gradient, settings, .. } = self;
        let filled = || shards.iter().enumerate().filter(|(index, _)| !part(*index).is_empty());
        gradient.sum(&filled().map(|(_, shard)| &shard.gradient).collect::<Vec<_>>());
        let mut sums = LossSums::default();
        for (_, shard) in filled() {
            sums.add(&shard.sums);
        }
        for log_std in &mut gradient.actor[actor.log_std_places()] {
            // Each nat of log_std is a nat of entropy.
            *log_std -= settings.entropy_weight;
        }
        sums
    }

    /// One Adam step along the gradient, shortened to the limit; returns the factor by which it was.
    fn descend(&mut self, gradient_norm: f32) -> f32 {
        // As in PyTorch: the small number keeps a vanished gradient finite.
        let scale = (self.settings.gradient_norm_limit / (gradient_norm + 1e-6)).min(1.0);
        let rate = self.learning_rate;
        self.actor_optimiser.step(self.actor.parameters_mut(), &self.gradient.actor, scale, rate);
        self.critic_optimiser.step(self.critic.parameters_mut(), &self.gradient.critic, scale, rate);
        self.actor.limit_log_std(self.settings.lowest_log_std, self.settings.highest_log_std);
        scale
    }

    /// Flies the policy once more and lets `memory` take in what must not be forgotten of the task that ends.
    pub fn consolidate(&mut self, memory: &mut Consolidator) {
        self.ended(|ended| memory.consolidate(ended));
    }

    /// Flies the policy once more and shows the task at its end.
    pub fn ended<T>(&mut self, show: impl FnOnce(&Ended<'_>) -> T) -> T {
        self.collect();
        self.normalise_advantages();
        self.lesson_weight = 0.0;
        let all = self.shuffled(0);
        // Nothing has moved since the rollout: every ratio is one, so that this is the policy gradient itself.
        self.differentiate(&all);
        let rollouts: Vec<&Rollout> = self.panels.iter().map(Panel::rollout).collect();
        show(&Ended {
            actor: &self.actor,
            critic: &self.critic,
            gradient: &self.gradient.actor,
            rollouts: &rollouts,
            seed: self.seed,
        })
    }

    /// Begins with a policy, and what else is kept, of an earlier task.
    ///
    /// # Panics
    /// When it is of another shape.
    pub fn inherit(&mut self, earlier: &Heritage) {
        assert!(earlier.actor.is_like(&self.actor), "a policy is inherited by one of its shape");
        let log_std = self.actor.log_std().to_vec();
        self.actor.clone_from(&earlier.actor);
        if earlier.log_std == Kept::Reset {
            let places = self.actor.log_std_places();
            self.actor.parameters_mut()[places].copy_from_slice(&log_std);
        }
        if let Some((critic, actor_optimiser, critic_optimiser)) = &earlier.learner {
            assert!(critic.is_like(&self.critic), "a critic is inherited by one of its shape");
            self.critic.clone_from(critic);
            self.actor_optimiser.clone_from(actor_optimiser);
            self.critic_optimiser.clone_from(critic_optimiser);
        }
    }

    /// What a later task may begin with.
    pub fn heritage(&self, log_std: Kept, learner: Kept) -> Heritage {
        let state = || (self.critic.clone(), self.actor_optimiser.clone(), self.critic_optimiser.clone());
        Heritage {
            actor: self.actor.clone(),
            log_std,
            learner: match learner {
                Kept::Inherited => Some(state()),
                Kept::Reset => None,
            },
        }
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
        metrics.describe(&self.take_episodes());
    }
}

/// Actor and critic of a run at its beginning.
fn networks(tasks: &[Scenario], settings: &PpoSettings, streams: [Stream; 2]) -> (Actor, Critic) {
    let [mut of_actor, mut of_critic] = streams;
    let [observation_len, action_len, critic_len, _] = shape(&tasks[0], settings.critic_scope);
    let eye = tasks[0].camera.as_ref().map(|camera| {
        let eye = settings.eye.kind.eye(camera).expect("eyes are checked where they are read");
        Perception::new(eye, &settings.eye.trunk, observation_len)
    });
    let sight = match (&eye, settings.eye.sharing) {
        (None, _) => CriticSight::None,
        (Some(eye), EyeSharing::Shared) => CriticSight::Shared(eye),
        (Some(eye), EyeSharing::Separate) => CriticSight::Separate(eye),
    };
    let lengths = (observation_len, critic_len);
    let critic = Critic::new(lengths, sight, &settings.critic_hidden, tasks.len(), &mut of_critic);
    let lengths = (observation_len, action_len);
    (Actor::new(lengths, eye, &settings.actor_hidden, settings.initial_log_std, &mut of_actor), critic)
}

/// Values of an observation, of an action, of what the critic reads, and of an image.
fn shape(scenario: &Scenario, scope: CriticScope) -> [usize; 4] {
    let observation_len = scenario.observation.len();
    let critic_len = scope.drones(scenario.agents.count) * (observation_len + privileged_len(scenario.critic));
    let image_len = scenario.camera.as_ref().map_or(0, OnboardCamera::image_len);
    [observation_len, scenario.action.len(), critic_len, image_len]
}

/// Number of values that the critic sees beside the observation of a drone.
fn privileged_len(critic: CriticView) -> usize {
    match critic {
        CriticView::Observation => 0,
        CriticView::Privileged => PRIVILEGED_LEN,
    }
}

#[cfg(test)]
mod tests;
