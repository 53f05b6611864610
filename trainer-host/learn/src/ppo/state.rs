//! Saving a run and going on with it.

use std::fmt;
use std::marker::PhantomData;

use kestrel_core::seed::Seed;
use serde::de::{Error as _, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use thiserror::Error;

use super::{Actor, Critic, PpoSettings, SettingsError, Trainer};
use crate::adam::Adam;
use crate::environment::Environment;
use crate::rollout::EnvBatch;

/// Everything that a run needs to go on to the same bits, beside its scenarios and settings.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrainerState<S> {
    pub(crate) seed: Seed,
    pub(crate) actor: Actor,
    pub(crate) critic: Critic,
    pub(crate) actor_optimiser: Adam,
    pub(crate) critic_optimiser: Adam,
    pub(crate) learning_rate: f32,
    pub(crate) updates: u64,
    pub(crate) env_batches: Vec<S>,
    /// What the agents of all environment batches remember; not written without memory, as before there was any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) hidden: Vec<f32>,
}

impl<'de, S: Deserialize<'de>> Deserialize<'de> for TrainerState<S> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        const FIELDS: usize = 9;
        deserializer.deserialize_tuple(FIELDS, Fields(PhantomData))
    }
}

/// The fields of a [`TrainerState`] one after the other; the last only where the actor has a memory.
struct Fields<S>(PhantomData<S>);

impl<'de, S: Deserialize<'de>> Visitor<'de> for Fields<S> {
    type Value = TrainerState<S>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the state of a trainer")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut fields: A) -> Result<TrainerState<S>, A::Error> {
        let mut read = 0;
        macro_rules! next {
            () => {{
                read += 1;
                fields.next_element()?.ok_or_else(|| A::Error::invalid_length(read - 1, &self))?
            }};
        }
        let mut state = TrainerState {
            seed: next!(),
            actor: next!(),
            critic: next!(),
            actor_optimiser: next!(),
            critic_optimiser: next!(),
            learning_rate: next!(),
            updates: next!(),
            env_batches: next!(),
            hidden: Vec::new(),
        };
        if state.actor.memory().is_some() {
            state.hidden = next!();
        }
        Ok(state)
    }
}

/// A state that does not belong to the scenario and settings it is restored with.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum RestoreError {
    /// The settings themselves are unusable.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The networks have other shapes.
    #[error("the saved {network} has layers {found:?}, the settings ask for {expected:?}")]
    Network {
        /// Actor or critic.
        network: &'static str,
        /// Widths in the saved state.
        found: Vec<usize>,
        /// Widths by scenario and settings.
        expected: Vec<usize>,
    },
    /// Another encoder, or a trunk behind it.
    #[error("the saved {network} looks at images in another way than scenario and settings ask for")]
    Encoder {
        /// Actor or critic.
        network: &'static str,
    },
    /// Another number of environments.
    #[error("the saved run has {found} environment batches, the settings ask for {expected}")]
    EnvBatches {
        /// In the saved state.
        found: usize,
        /// By the settings.
        expected: usize,
    },
    /// The environments are of another task.
    #[error("the saved environments do not fit the scenario {task:?}")]
    Task {
        /// Name of the task.
        task: String,
    },
    /// Parameters or optimiser state of the wrong length.
    #[error("the saved {network} holds {found} numbers, its layers need {expected}")]
    Parameters {
        /// Actor or critic.
        network: &'static str,
        /// In the saved state.
        found: usize,
        /// By its layers.
        expected: usize,
    },
}

impl<S> TrainerState<S> {
    /// Whether it has these shapes, and so many environment batches.
    pub(crate) fn check(
        &self,
        (actor, critic): (&Actor, &Critic),
        env_batches: usize,
    ) -> Result<(), RestoreError> {
        let (found, expected) = (self.env_batches.len(), env_batches);
        if found != expected {
            return Err(RestoreError::EnvBatches { found, expected });
        }
        let actors = (self.actor.is_like(actor), self.actor.mlp(), actor.mlp());
        let critics = (self.critic.is_like(critic), self.critic.mlp(), critic.mlp());
        for (network, (is_like, found, expected)) in [("actor", actors), ("critic", critics)] {
            if found != expected {
                let (found, expected) = (found.widths().to_vec(), expected.widths().to_vec());
                return Err(RestoreError::Network { network, found, expected });
            }
            if !is_like {
                return Err(RestoreError::Encoder { network });
            }
        }
        let lengths = [
            ("actor", self.actor.parameters().len(), actor.parameters().len()),
            ("actor", self.actor_optimiser.parameter_count(), actor.parameters().len()),
            ("critic", self.critic.parameters().len(), critic.parameters().len()),
            ("critic", self.critic_optimiser.parameter_count(), critic.parameters().len()),
        ];
        match lengths.into_iter().find(|(_, found, expected)| found != expected) {
            Some((network, found, expected)) => Err(RestoreError::Parameters { network, found, expected }),
            None => Ok(()),
        }
    }

    /// The saved policy.
    pub fn actor(&self) -> &Actor {
        &self.actor
    }

    /// The seed of the run.
    pub fn seed(&self) -> Seed {
        self.seed
    }

    /// Updates made before saving.
    pub fn updates(&self) -> u64 {
        self.updates
    }
}

/// Takes saved hidden states to where they were, memory after memory.
pub(crate) fn restore_hidden(saved: &[f32], memories: Vec<&mut [f32]>) -> Result<(), RestoreError> {
    let (found, expected) = (saved.len(), memories.iter().map(|memory| memory.len()).sum());
    if found != expected {
        return Err(RestoreError::Parameters { network: "memory", found, expected });
    }
    let mut rest = saved;
    for memory in memories {
        let (mine, others) = rest.split_at(memory.len());
        memory.copy_from_slice(mine);
        rest = others;
    }
    Ok(())
}

impl<E: Environment> Trainer<E> {
    /// The run between two updates; all its ranks save at once.
    pub fn save(&self) -> TrainerState<E::State> {
        let (env_batches, hidden) = self.batch_states();
        TrainerState {
            seed: self.seed,
            actor: self.actor.clone(),
            critic: self.critic.clone(),
            actor_optimiser: self.actor_optimiser.clone(),
            critic_optimiser: self.critic_optimiser.clone(),
            learning_rate: self.learning_rate,
            updates: self.updates,
            env_batches,
            hidden,
        }
    }

    /// Goes on with a saved run, to the bits that it would have come to without the interruption.
    ///
    /// # Errors
    /// When the state is of other scenarios or of settings of another shape.
    pub fn restore(
        tasks: &[E::Task],
        settings: &PpoSettings,
        state: TrainerState<E::State>,
    ) -> Result<Self, RestoreError> {
        settings.check()?;
        let mut trainer = Self::new(tasks, settings, state.seed);
        state.check((&trainer.actor, &trainer.critic), trainer.env_batches.len())?;
        for (env_batch, saved) in trainer.env_batches.iter_mut().zip(&state.env_batches) {
            if !env_batch.restore(saved) {
                let task = E::name(&tasks[env_batch.rollout().task()]).to_owned();
                return Err(RestoreError::Task { task });
            }
        }
        let memories = trainer.env_batches.iter_mut().map(EnvBatch::hidden_mut).collect();
        restore_hidden(&state.hidden, memories)?;
        trainer.actor = state.actor;
        trainer.critic = state.critic;
        trainer.actor_optimiser = state.actor_optimiser;
        trainer.critic_optimiser = state.critic_optimiser;
        trainer.learning_rate = state.learning_rate;
        trainer.updates = state.updates;
        Ok(trainer)
    }
}
