//! A run at its beginning, and what it has to show.

use kestrel_core::seed::{Purpose, Seed, Stream};

use super::minibatch::{SHARDS, Shard};
use super::workspace::Workspaces;
use super::{Actor, ActorLengths, Critic, PpoSettings, Trainer};
use crate::actor_critic::{ActorCriticWorkspace, EncoderWeights, Front, Gradient};
use crate::adam::Adam;
use crate::encoder::Encoder;
use crate::environment::{Environment, TaskShape};
use crate::gru::Gru;
use crate::ranks;
use crate::rollout::{BatchRows, EnvBatch, Lengths, RolloutPlan, batch_rows, slice_columns};

impl<E: Environment> Trainer<E> {
    /// A run at its beginning, of one task or of several that one policy learns together: one environment batch after
    /// the other is dealt to them in turn.
    ///
    /// # Panics
    /// When the settings fail [`PpoSettings::check`], their agents do not fill environment batches of [`batch_rows`],
    /// there are fewer of these than tasks, the tasks differ in what policy or critic observe or command, or one of
    /// them has no teacher where the settings ask for it.
    pub fn new(tasks: &[E::Task], settings: &PpoSettings, seed: Seed) -> Self {
        settings.check().expect("settings are checked where they are read");
        let shapes: Vec<TaskShape> = tasks.iter().map(E::shape).collect();
        let rows = batch_rows(shapes.iter().map(|shape| shape.agents));
        let lengths = |shape: &TaskShape| Lengths::new(shape, settings.critic_scope);
        let has_teacher = |task: &E::Task| settings.teacher.is_none() || E::has_teacher(task);
        assert!(
            settings.environments.is_multiple_of(rows),
            "{} agents fill no environment batches of {rows}",
            settings.environments
        );
        assert!(settings.environments / rows >= tasks.len(), "every task needs an environment batch");
        assert!(shapes.iter().all(|shape| lengths(shape) == lengths(&shapes[0])), "one policy needs one layout");
        assert!(tasks.iter().all(has_teacher), "the tasks are checked to have a teacher");
        let weights = |network| Stream::new(seed, network, Purpose::Weights);
        let (actor, critic) = networks(&shapes, settings, [weights(0), weights(1)]);
        let plan = RolloutPlan {
            steps: settings.steps_per_rollout,
            columns: slice_columns(settings.minibatch / settings.steps_per_window(), actor.encoder().is_some()),
            critic_scope: settings.critic_scope,
            memory: settings.memory,
            has_teacher: settings.teacher.is_some(),
        };
        let workspace = ActorCriticWorkspace::new(&actor, &critic, plan.columns);
        let env_batch = |index: usize| {
            let task = index % tasks.len();
            let rows = BatchRows { task, first: (index * rows) as u32, count: rows };
            EnvBatch::new(&tasks[task], plan, seed, rows, workspace.clone())
        };
        Self {
            settings: settings.clone(),
            seed,
            actor_optimiser: Adam::new(actor.parameters().len()),
            critic_optimiser: Adam::new(critic.parameters().len()),
            learning_rate: settings.learning_rate.initial(),
            imitation_weight: 0.0,
            updates: 0,
            env_batches: (0..settings.environments / rows).map(env_batch).collect(),
            shards: vec![Shard::new(&actor, &critic); SHARDS],
            workspaces: Workspaces::default(),
            encoders: EncoderWeights::default(),
            gradient: Gradient::new(&actor, &critic),
            ranks: ranks::alone(),
            quantised: None,
            actor,
            critic,
        }
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

    /// Samples of a slice.
    pub(super) fn columns(&self) -> usize {
        self.env_batches[0].rollout().columns()
    }

    /// Samples of a window.
    pub(super) fn window_samples(&self) -> usize {
        self.columns() * self.settings.steps_per_window()
    }

    /// Number of tasks.
    pub(super) fn tasks(&self) -> usize {
        self.critic.mlp().outputs()
    }

    /// Share of the training that is done.
    pub(super) fn progress(&self) -> f64 {
        self.steps() as f64 / self.settings.total_steps.max(1) as f64
    }
}

/// Actor and critic of a run at its beginning.
fn networks(shapes: &[TaskShape], settings: &PpoSettings, streams: [Stream; 2]) -> (Actor, Critic) {
    let [mut of_actor, mut of_critic] = streams;
    let Lengths { observation, action, features, .. } = Lengths::new(&shapes[0], settings.critic_scope);
    let front = match (shapes[0].image, settings.memory) {
        (None, None) => Front::Nothing,
        (None, Some(memory)) => Front::Memory(Gru::new(observation, memory.units)),
        (Some(image), memory) => {
            let cnn = settings.encoder.kind.cnn(image).expect("encoders are checked where they are read");
            let encoder = Encoder::new(cnn, &settings.encoder.trunk, observation);
            match memory {
                None => Front::Encoder(encoder),
                Some(memory) => {
                    let gru = Gru::new(observation + encoder.outputs(), memory.units);
                    Front::EncoderMemory(encoder, gru)
                }
            }
        }
    };
    let (hidden, tasks, sharing) = (&settings.critic_hidden, shapes.len(), settings.encoder.sharing);
    let critic = Critic::new((observation, features), (&front, sharing), hidden, tasks, &mut of_critic);
    let (hidden, log_std) = (&settings.actor_hidden, settings.initial_log_std);
    let actor = Actor::new(ActorLengths { observation, action }, front, hidden, log_std, &mut of_actor);
    (actor.with_activation(settings.activation), critic.with_activation(settings.activation))
}
