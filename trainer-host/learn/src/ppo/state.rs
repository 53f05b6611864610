//! Saving a run and going on with it.

use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;
use kestrel_sim::simulation::SimulationState;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Actor, Critic, PpoSettings, SettingsError, Trainer};
use crate::adam::Adam;

/// Everything that a run needs to go on to the same bits, beside its scenarios and settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainerState {
    seed: Seed,
    actor: Actor,
    critic: Critic,
    actor_optimiser: Adam,
    critic_optimiser: Adam,
    learning_rate: f32,
    updates: u64,
    panels: Vec<SimulationState>,
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
    /// Another eye, or a trunk behind it.
    #[error("the saved {network} looks at images in another way than scenario and settings ask for")]
    Eye {
        /// Actor or critic.
        network: &'static str,
    },
    /// Another number of environments.
    #[error("the saved run has {found} panels of environments, the settings ask for {expected}")]
    Panels {
        /// In the saved state.
        found: usize,
        /// By the settings.
        expected: usize,
    },
    /// The simulations are of another scenario.
    #[error("the saved environments do not fit the scenario {scenario:?}")]
    Scenario {
        /// Name of the scenario.
        scenario: String,
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

impl TrainerState {
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

impl Trainer {
    /// The run between two updates; all its ranks save at once.
    pub fn save(&self) -> TrainerState {
        TrainerState {
            seed: self.seed,
            actor: self.actor.clone(),
            critic: self.critic.clone(),
            actor_optimiser: self.actor_optimiser.clone(),
            critic_optimiser: self.critic_optimiser.clone(),
            learning_rate: self.learning_rate,
            updates: self.updates,
            panels: self.simulations(),
        }
    }

    /// Goes on with a saved run, to the bits that it would have come to without the interruption.
    ///
    /// # Errors
    /// When the state is of other scenarios or of settings of another shape.
    pub fn restore(tasks: &[Scenario], settings: &PpoSettings, state: TrainerState) -> Result<Self, RestoreError> {
        settings.check()?;
        let mut trainer = Self::new(tasks, settings, state.seed);
        trainer.check(&state)?;
        for (panel, saved) in trainer.panels.iter_mut().zip(&state.panels) {
            if !panel.restore(saved) {
                let scenario = tasks[panel.rollout().task()].name.clone();
                return Err(RestoreError::Scenario { scenario });
            }
        }
        trainer.actor = state.actor;
        trainer.critic = state.critic;
        trainer.actor_optimiser = state.actor_optimiser;
        trainer.critic_optimiser = state.critic_optimiser;
        trainer.learning_rate = state.learning_rate;
        trainer.updates = state.updates;
        Ok(trainer)
    }

    /// Whether the state has this run's shapes.
    fn check(&self, state: &TrainerState) -> Result<(), RestoreError> {
        let (found, expected) = (state.panels.len(), self.panels.len());
        if found != expected {
            return Err(RestoreError::Panels { found, expected });
        }
        let actors = (state.actor.is_like(&self.actor), state.actor.mlp(), self.actor.mlp());
        let critics = (state.critic.is_like(&self.critic), state.critic.mlp(), self.critic.mlp());
        for (network, (is_like, found, expected)) in [("actor", actors), ("critic", critics)] {
            if found != expected {
                let (found, expected) = (found.widths().to_vec(), expected.widths().to_vec());
                return Err(RestoreError::Network { network, found, expected });
            }
            if !is_like {
                return Err(RestoreError::Eye { network });
            }
        }
        let lengths = [
            ("actor", state.actor.parameters().len(), self.actor.parameters().len()),
            ("actor", state.actor_optimiser.parameter_count(), self.actor.parameters().len()),
            ("critic", state.critic.parameters().len(), self.critic.parameters().len()),
            ("critic", state.critic_optimiser.parameter_count(), self.critic.parameters().len()),
        ];
        match lengths.into_iter().find(|(_, found, expected)| found != expected) {
            Some((network, found, expected)) => Err(RestoreError::Parameters { network, found, expected }),
            None => Ok(()),
        }
    }
}
