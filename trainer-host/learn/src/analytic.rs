//! Policy gradients through the environment itself: backpropagation through time.
//!
//! Where every step has a derivative, nothing has to be estimated from samples. [`AnalyticTrainer::update`] flies a
//! window of T steps with the mean actions, sums up the rewards, and carries the derivative of the sum from the last
//! step to the first: through the step to state and action, through the policy's network to its parameters and to what
//! it observed, and from there to the state again. One step of Adam follows (analytic policy gradient, Freeman et al.
//! 2021, "Brax"; for quadrotors Wiedemann et al. 2023).
//!
//! The window begins where the last one ended, so that episodes are longer than a window; what it starts from counts as
//! given. Some episodes are ended before each window, so that the drones are at different moments of theirs. A
//! derivative that has grown too long on its way back is shortened, row by row: in chaotic flight it would say nothing.
//!
//! A policy with a memory ([`crate::gru`]) goes back through that as well: what it remembers of a window's first steps is
//! learned from the rewards of the last. Its state at the window's beginning counts as given.
//!
//! Where a method of continual learning remembers earlier tasks, its [`Regulariser`] adds its penalty's gradient, as in
//! [`crate::ppo`].
//!
//! Sums have an order of their own for any number of threads and processes: each environment batch has its own gradient.

mod continual;
mod distributed;

use std::sync::Arc;

use kestrel_core::activation::Activation;
use kestrel_core::seed::{Purpose, Seed, Stream};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use web_time::Instant;

use crate::actor_critic::{Actor, ActorLengths, Critic, Front, Gradient};
use crate::adam::{Adam, Remembering};
use crate::environment::{Environment, Outcome, TaskShape};
use crate::gru::{Gru, GruWorkspace, forget, shorten};
use crate::network::{Accumulate, Workspace, dispatch, square};
use crate::ppo::{RestoreError, TrainerState, UpdateMetrics, restore_hidden};
use crate::ranks::{self, Ranks};
use crate::regulariser::{FineTuning, Learning, OptimiserStep, Regulariser, Visited};
use crate::schedule::Schedule;

/// Logarithm of the standard deviation that the policy is left with: actions are never drawn.
const LOG_STD: f32 = -3.0;

/// What training by gradients through the environment is made with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AnalyticSettings {
    /// Environments in parallel, a multiple of [`Differentiable::ENVIRONMENTS`].
    pub environments: usize,
    /// Steps of a window, through which derivatives go back.
    pub steps_per_window: usize,
    /// Environment steps of the whole training; a linear schedule ends there.
    pub total_steps: u64,
    /// Step size of Adam.
    pub learning_rate: Schedule,
    /// Longest gradient of the mean reward of a step; longer ones are scaled down.
    pub gradient_norm_limit: f32,
    /// Share of the environments whose episodes are ended before a window, in \[0, 1\].
    pub restart_share: f32,
    /// Longest derivative of the window's rewards by the state of a lane, in rewards per unit of the state; where a policy has a
    /// memory, also by what that remembers, and by what a lane observes.
    pub adjoint_limit: f32,
    /// Widths of the actor's hidden layers.
    pub actor_hidden: Vec<usize>,
    /// What follows them.
    pub activation: Activation,
    /// Values of the hidden state of a memory before them; 0 without one.
    pub memory_units: usize,
}

impl Default for AnalyticSettings {
    fn default() -> Self {
        Self {
            environments: 64,
            steps_per_window: 64,
            total_steps: 1_228_800,
            learning_rate: Schedule::Linear { from: 12e-3, to: 6e-4 },
            gradient_norm_limit: 1.0,
            restart_share: 0.3,
            adjoint_limit: 100.0,
            actor_hidden: vec![64, 64],
            activation: Activation::Tanh,
            memory_units: 0,
        }
    }
}

impl AnalyticSettings {
    /// Environment steps of an update, where every environment has one agent.
    pub fn batch(&self) -> usize {
        self.environments * self.steps_per_window
    }
}

/// An environment whose steps have derivatives.
pub trait Differentiable: Environment {
    /// What is remembered of a window of steps, and room to go back through it.
    type Tape: Clone + Send + std::fmt::Debug;

    /// Environments of a batch, which are differentiated together.
    const ENVIRONMENTS: usize;

    /// A tape for windows of so many steps.
    ///
    /// # Errors
    /// What of the task has no derivatives, a noun.
    fn tape(task: &Self::Task, steps: usize) -> Result<Self::Tape, String>;

    /// As [`Environment::step`], remembered as a step of the window.
    fn step_on(&mut self, tape: &mut Self::Tape, step: usize, actions: &[f32]);

    /// Carries derivatives of the rewards through a step of the window, from the last to the first; nothing that came
    /// after an ended episode counts.
    ///
    /// `by_observations [observation_len][rows]` are those by what was observed after the step; those by the actions go
    /// to `by_actions [action_len][rows]`. Those by the state stay on the tape, none longer than `limit`.
    fn pull_back(tape: &mut Self::Tape, step: usize, by_observations: &[f32], limit: f32, by_actions: &mut [f32]);

    /// Ends the episodes of some environments and begins new ones.
    fn restart(&mut self, environments: &[usize]);
}

/// A training run between two updates.
#[derive(Clone, Debug)]
pub struct AnalyticTrainer<E: Differentiable> {
    settings: AnalyticSettings,
    seed: Seed,
    actor: Actor,
    /// Not trained; the state of a run has one.
    critic: Critic,
    optimiser: Adam,
    learning_rate: f32,
    updates: u64,
    batches: Vec<Batch<E>>,
    gradient: Vec<f32>,
    ranks: Arc<dyn Ranks>,
}

/// Environments that are differentiated together, by one thread.
#[derive(Clone, Debug)]
struct Batch<E: Differentiable> {
    environment: E,
    tape: E::Tape,
    /// What each step of the window began with, and what the network made of it.
    steps: Vec<Step>,
    /// Derivatives by the actions of a step `[action_len][rows]`.
    by_actions: Vec<f32>,
    /// Derivatives by what a step observed and by the state of the memory after it, `[observation_len + units][rows]`.
    by_inputs: Vec<f32>,
    memory: Option<WindowMemory>,
    gradient: Vec<f32>,
    /// Sum of the rewards of the window.
    reward: f64,
}

/// What is remembered between windows, and the place where a window goes through a memory.
#[derive(Clone, Debug)]
struct WindowMemory {
    /// `[units][rows]`.
    hidden: Vec<f32>,
    workspace: GruWorkspace,
    /// Of the derivatives of the rows.
    lengths: Vec<f32>,
}

#[derive(Clone, Debug)]
struct Step {
    /// What was observed, then the state of the memory after it, `[observation_len + units][rows]`.
    inputs: Vec<f32>,
    network: Workspace,
    /// How the step ended, `[rows]`.
    outcomes: Vec<Outcome>,
}

/// Why a task cannot be trained so.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AnalyticError {
    /// What of the task has no derivatives.
    #[error("no gradients go through {0}")]
    Task(String),
    /// Images are not differentiated.
    #[error("a policy with a camera cannot be trained by derivatives of its flight yet")]
    Images,
    /// Environments that fill no batches.
    #[error("{found} environments: expected a multiple of {expected}")]
    Environments {
        /// In the settings.
        found: usize,
        /// Environments of a batch.
        expected: usize,
    },
    /// A state that does not fit.
    #[error(transparent)]
    Restore(#[from] RestoreError),
}

impl<E: Differentiable> AnalyticTrainer<E> {
    /// A run at its beginning, of one task or of several that one policy learns together: one batch of environments after
    /// the other is dealt to them in turn.
    ///
    /// # Errors
    /// When a task cannot be trained so.
    ///
    /// # Panics
    /// When there are fewer batches than tasks, or the tasks differ in what is observed or commanded.
    pub fn new(tasks: &[E::Task], settings: &AnalyticSettings, seed: Seed) -> Result<Self, AnalyticError> {
        let shape = E::shape(&tasks[0]);
        assert!(tasks.iter().all(|task| E::shape(task) == shape), "one policy needs one layout");
        if shape.image.is_some() {
            return Err(AnalyticError::Images);
        }
        if settings.environments == 0 || !settings.environments.is_multiple_of(E::ENVIRONMENTS) {
            return Err(AnalyticError::Environments { found: settings.environments, expected: E::ENVIRONMENTS });
        }
        let batches = settings.environments / E::ENVIRONMENTS;
        assert!(batches >= tasks.len(), "every task needs a batch of environments");
        let weights = |network| Stream::new(seed, network, Purpose::Weights);
        let lengths = ActorLengths { observation: shape.observation_len, action: shape.action_len };
        let hidden = &settings.actor_hidden;
        let front = match settings.memory_units {
            0 => Front::Nothing,
            units => Front::Memory(Gru::new(shape.observation_len, units)),
        };
        let actor = Actor::new(lengths, front, hidden, LOG_STD, &mut weights(0));
        let actor = actor.with_activation(settings.activation);
        let critic = Critic::state_based(shape.observation_len + shape.privileged_len, hidden, 1, &mut weights(1));
        let tape = |task| E::tape(task, settings.steps_per_window).map_err(AnalyticError::Task);
        let tapes = tasks.iter().map(tape).collect::<Result<Vec<_>, _>>()?;
        let batch = |index: usize| {
            let task = index % tasks.len();
            let environment = E::begin(&tasks[task], seed, (index * E::ENVIRONMENTS) as u32, E::ENVIRONMENTS);
            Batch::new(environment, tapes[task].clone(), (&actor, &shape), settings.steps_per_window)
        };
        Ok(Self {
            batches: (0..batches).map(batch).collect(),
            settings: settings.clone(),
            seed,
            optimiser: Adam::new(actor.parameters().len()),
            gradient: vec![0.0; actor.parameters().len()],
            learning_rate: settings.learning_rate.initial(),
            updates: 0,
            ranks: ranks::alone(),
            critic,
            actor,
        })
    }

    /// A window of flight, the derivative of its rewards, and a step along it. The bits do not depend on the number of
    /// threads of the current rayon pool.
    pub fn update(&mut self) -> UpdateMetrics {
        self.update_with(&mut FineTuning)
    }

    /// As [`Self::update`], regularised towards what earlier tasks left behind.
    pub fn update_with(&mut self, regulariser: &mut impl Regulariser) -> UpdateMetrics {
        let start = Instant::now();
        self.fly();
        let rollout_secs = start.elapsed().as_secs_f64();
        self.differentiate();
        let mut metrics =
            UpdateMetrics { learning_rate: self.learning_rate, rollout_secs, ..UpdateMetrics::without_ppo() };
        metrics.boundary = self.show(regulariser);
        self.descend(regulariser, &mut metrics);
        self.updates += 1;
        let progress = self.steps() as f64 / self.settings.total_steps.max(1) as f64;
        self.learning_rate = self.settings.learning_rate.next(self.learning_rate, progress, 0.0);
        (metrics.steps, metrics.updates) = (self.steps(), self.updates);
        let episodes = self.take_episodes();
        metrics.describe(&episodes);
        metrics.update_secs = start.elapsed().as_secs_f64() - rollout_secs;
        metrics
    }

    /// A window of my batches, before which some episodes end.
    fn fly(&mut self) {
        let mine = self.mine();
        let Self { batches, actor, seed, settings, updates, .. } = self;
        let first = *updates * batches.len() as u64 + mine.start as u64;
        batches[mine].par_iter_mut().enumerate().for_each(|(index, batch)| {
            let mut stream = Stream::new(*seed, (first + index as u64) as u32, Purpose::Shuffle);
            batch.restart(settings.restart_share, &mut stream);
            batch.fly(actor);
        });
    }

    /// Back through the window of my batches; afterwards all ranks know the gradients and the rewards of all.
    fn differentiate(&mut self) {
        let mine = self.mine();
        let (actor, limit) = (&self.actor, self.settings.adjoint_limit);
        self.batches[mine].par_iter_mut().for_each(|batch| batch.differentiate(actor, limit));
        self.share(|batch| &mut batch.gradient);
        self.share_rewards();
    }

    /// One step of Adam along the mean gradient, clipped to the longest.
    fn descend(&mut self, regulariser: &mut impl Regulariser, metrics: &mut UpdateMetrics) {
        self.sum_gradients();
        let samples = (self.steps_in_update() as f32).max(1.0);
        let mut loss = Gradient::new(&self.actor, &self.critic);
        regulariser.add_gradient(Learning { actor: &self.actor, critic: &self.critic }, &mut loss);
        for (sum, penalty) in self.gradient.iter_mut().zip(&mut loss.actor) {
            *sum -= samples * *penalty;
            *penalty = -*sum / samples;
        }
        let norm = square(&self.gradient).sqrt() / samples;
        let reward: f64 = self.batches.iter().map(|batch| batch.reward).sum();
        (metrics.gradient_norm, metrics.policy_loss) = (norm, -(reward / f64::from(samples)) as f32);
        // Descent, along the negative gradient of what is paid.
        let scale = (self.settings.gradient_norm_limit / (norm + 1e-6)).min(1.0);
        let gradient = (&self.gradient[..], -scale / samples);
        if norm.is_finite() {
            let parameters = self.actor.parameters_mut();
            self.optimiser.step_remembering(Remembering::Short, parameters, gradient, self.learning_rate);
            let step = OptimiserStep { gradient: &loss, scale, learning_rate: self.learning_rate };
            regulariser.after_step(&mut self.actor, &step);
        }
    }

    /// The derivative of the window's rewards by the parameters, of all batches in their order.
    fn sum_gradients(&mut self) {
        self.gradient.fill(0.0);
        for batch in &self.batches {
            dispatch(Accumulate { values: &batch.gradient, sums: &mut self.gradient });
        }
    }

    fn steps_in_update(&self) -> usize {
        self.batches.iter().map(|batch| batch.steps.len() * batch.environment.rewards().len()).sum()
    }

    /// Environment steps since the start of training.
    pub fn steps(&self) -> u64 {
        self.updates * self.steps_in_update() as u64
    }

    /// Updates since the start of training.
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// The policy.
    pub fn actor(&self) -> &Actor {
        &self.actor
    }

    /// A value function, which nothing trains.
    pub fn critic(&self) -> &Critic {
        &self.critic
    }

    /// Goes on with a saved run, to the bits that it would have come to without the interruption.
    ///
    /// # Errors
    /// When the task cannot be trained so, or the state is of another one or of settings of another shape.
    pub fn restore(
        tasks: &[E::Task],
        settings: &AnalyticSettings,
        state: TrainerState<E::State>,
    ) -> Result<Self, AnalyticError> {
        let mut trainer = Self::new(tasks, settings, state.seed())?;
        state.check((&trainer.actor, &trainer.critic), trainer.batches.len())?;
        for (index, (batch, saved)) in trainer.batches.iter_mut().zip(&state.env_batches).enumerate() {
            if !batch.environment.restore(saved) {
                return Err(RestoreError::Task { task: E::name(&tasks[index % tasks.len()]).to_owned() }.into());
            }
        }
        let memories = trainer.batches.iter_mut().filter_map(|batch| batch.memory.as_mut());
        restore_hidden(&state.hidden, memories.map(|memory| memory.hidden.as_mut_slice()).collect())?;
        trainer.actor = state.actor;
        trainer.optimiser = state.actor_optimiser;
        trainer.learning_rate = state.learning_rate;
        trainer.updates = state.updates;
        Ok(trainer)
    }

    /// The run between two updates.
    pub fn save(&self) -> TrainerState<E::State> {
        let (env_batches, hidden) = self.batch_states();
        TrainerState {
            seed: self.seed,
            actor: self.actor.clone(),
            critic: self.critic.clone(),
            actor_optimiser: self.optimiser.clone(),
            critic_optimiser: Adam::new(self.critic.parameters().len()),
            learning_rate: self.learning_rate,
            updates: self.updates,
            env_batches,
            hidden,
        }
    }
}

impl<E: Differentiable> Batch<E> {
    fn new(environment: E, tape: E::Tape, (actor, shape): (&Actor, &TaskShape), steps: usize) -> Self {
        let rows = E::ENVIRONMENTS * shape.agents;
        let step = Step {
            inputs: vec![0.0; actor.mlp().inputs() * rows],
            network: Workspace::new(actor.mlp(), rows),
            outcomes: vec![Outcome::Running; rows],
        };
        let memory = |memory: &Gru| WindowMemory {
            hidden: vec![0.0; memory.units() * rows],
            workspace: GruWorkspace::new(memory, rows, steps),
            lengths: vec![0.0; rows],
        };
        Self {
            environment,
            tape,
            by_actions: vec![0.0; shape.action_len * rows],
            by_inputs: step.inputs.clone(),
            memory: actor.memory().map(memory),
            steps: vec![step; steps],
            gradient: vec![0.0; actor.parameters().len()],
            reward: 0.0,
        }
    }

    /// Ends the episodes of a share of the environments.
    fn restart(&mut self, share: f32, stream: &mut Stream) {
        let chosen: Vec<usize> = (0..E::ENVIRONMENTS).filter(|_| stream.uniform() < share).collect();
        self.environment.restart(&chosen);
        if let Some(memory) = &mut self.memory {
            // Row `agent * ENVIRONMENTS + environment` of each unit.
            for values in memory.hidden.chunks_exact_mut(E::ENVIRONMENTS) {
                for environment in &chosen {
                    values[*environment] = 0.0;
                }
            }
        }
    }

    /// What the policy read in the last window.
    fn visited(&self) -> Visited<'_> {
        let slice = |index: usize| match &self.memory {
            None => self.steps[index].inputs.as_slice(),
            Some(memory) => memory.workspace.inputs(index),
        };
        Visited { columns: self.environment.rewards().len(), slices: (0..self.steps.len()).map(slice).collect() }
    }

    /// The same of one step, to be written.
    fn visited_mut(&mut self, index: usize) -> &mut [f32] {
        match &mut self.memory {
            None => &mut self.steps[index].inputs,
            Some(memory) => memory.workspace.inputs_mut(index),
        }
    }

    /// A window of steps with the mean actions.
    fn fly(&mut self, actor: &Actor) {
        let Self { environment, tape, steps, memory, .. } = self;
        self.reward = 0.0;
        for index in 0..steps.len() {
            let (past, now) = steps.split_at_mut(index);
            let Step { inputs, network, outcomes } = &mut now[0];
            let observations = environment.observations();
            let (observed, remembered) = inputs.split_at_mut(observations.len());
            observed.copy_from_slice(observations);
            if let (Some(gru), Some(WindowMemory { hidden, workspace, .. })) = (actor.memory(), memory.as_mut()) {
                match past.last() {
                    None => workspace.begin(gru, actor.front_parameters(), observed, hidden),
                    Some(last) => workspace.go_on(gru, actor.front_parameters(), observed, &last.outcomes),
                }
                remembered.copy_from_slice(workspace.hidden());
            }
            let actions = actor.mlp().forward(actor.parameters(), inputs, network);
            environment.step_on(tape, index, actions);
            outcomes.copy_from_slice(environment.outcomes());
            self.reward += environment.rewards().iter().map(|reward| f64::from(*reward)).sum::<f64>();
        }
        if let (Some(WindowMemory { hidden, workspace, .. }), Some(last)) = (memory, steps.last()) {
            hidden.copy_from_slice(workspace.hidden());
            forget(hidden, &last.outcomes);
        }
    }

    /// From the last step to the first.
    fn differentiate(&mut self, actor: &Actor, limit: f32) {
        let Self { tape, steps, by_actions, by_inputs, memory, gradient, .. } = self;
        gradient.fill(0.0);
        by_inputs.fill(0.0);
        let remembered = memory.as_ref().map_or(0, |memory| memory.hidden.len());
        let (of_network, of_front) = gradient.split_at_mut(actor.log_std_places().end);
        if let Some(WindowMemory { workspace, .. }) = memory {
            workspace.begin_backward();
        }
        for index in (0..steps.len()).rev() {
            let (past, now) = steps.split_at_mut(index);
            let Step { inputs, network, .. } = &mut now[0];
            let observed = inputs.len() - remembered;
            E::pull_back(tape, index, &by_inputs[..observed], limit, by_actions);
            let (actions, deltas) = network.output_delta();
            for ((delta, action), by_action) in deltas.iter_mut().zip(actions).zip(&*by_actions) {
                *delta = heard(*action, *by_action);
            }
            let of_layers = &mut of_network[..actor.mlp().parameter_count()];
            actor.mlp().backward_to_inputs(actor.parameters(), inputs, network, of_layers, by_inputs);
            if let (Some(gru), Some(WindowMemory { workspace, lengths, .. })) = (actor.memory(), memory.as_mut()) {
                let (by_observation, by_state) = by_inputs.split_at_mut(observed);
                workspace.keep_deltas(index, by_state);
                workspace.step_back(gru, actor.front_parameters(), index, of_front, by_observation);
                workspace.limit(limit);
                // What was done is observed, and what is observed is done: a way back that the state's limit does not see.
                shorten(by_observation, lengths, limit);
                if let Some(last) = past.last() {
                    workspace.forget(&last.outcomes);
                }
            }
        }
    }
}

/// The derivative that an action beyond its range hears: that of the limit, where it leads back.
fn heard(action: f32, derivative: f32) -> f32 {
    let leads_out = (action > 1.0 && derivative > 0.0) || (action < -1.0 && derivative < 0.0);
    if leads_out { 0.0 } else { derivative }
}

#[cfg(test)]
mod tests;
