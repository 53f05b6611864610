//! The end of a task, and what the next one begins with.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Actor, Critic, Trainer};
use crate::adam::Adam;
use crate::environment::Environment;
use crate::regulariser::{EndedTask, Regulariser};
use crate::rollout::{EnvBatch, Rollout};

/// Whether something of an earlier task is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CarryOver {
    /// The next task begins with it.
    #[serde(rename = "inherited")]
    CarriedOver,
    /// The next task begins afresh.
    #[serde(rename = "reset")]
    Reinitialised,
}

/// What a task begins with that an earlier one has learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WarmStart {
    actor: Actor,
    log_std: CarryOver,
    /// Critic, and the optimisers of both networks.
    learner: Option<(Critic, Adam, Adam)>,
}

impl<E: Environment> Trainer<E> {
    /// Flies the policy once more and lets `regulariser` take in what must not be forgotten of the task that ends.
    pub fn consolidate(&mut self, regulariser: &mut impl Regulariser) {
        self.ended(|ended| regulariser.consolidate(ended));
    }

    /// Flies the policy once more and shows the task at its end.
    pub fn ended<T>(&mut self, show: impl FnOnce(&EndedTask<'_>) -> T) -> T {
        self.collect();
        self.normalise_advantages();
        self.imitation_weight = 0.0;
        let all = self.shuffled(0);
        // Nothing has moved since the rollout: every ratio is one, so that this is the policy gradient itself.
        self.differentiate(&all);
        let rollouts: Vec<&Rollout> = self.env_batches.iter().map(EnvBatch::rollout).collect();
        show(&EndedTask {
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
    pub fn start_from(&mut self, earlier: &WarmStart) {
        assert!(earlier.actor.is_like(&self.actor), "a policy starts one of its shape");
        let log_std = self.actor.log_std().to_vec();
        self.actor.clone_from(&earlier.actor);
        if earlier.log_std == CarryOver::Reinitialised {
            let places = self.actor.log_std_places();
            self.actor.parameters_mut()[places].copy_from_slice(&log_std);
        }
        if let Some((critic, actor_optimiser, critic_optimiser)) = &earlier.learner {
            assert!(critic.is_like(&self.critic), "a critic starts one of its shape");
            self.critic.clone_from(critic);
            self.actor_optimiser.clone_from(actor_optimiser);
            self.critic_optimiser.clone_from(critic_optimiser);
        }
    }

    /// What a later task may begin with.
    pub fn warm_start(&self, log_std: CarryOver, learner: CarryOver) -> WarmStart {
        let state = || (self.critic.clone(), self.actor_optimiser.clone(), self.critic_optimiser.clone());
        WarmStart {
            actor: self.actor.clone(),
            log_std,
            learner: match learner {
                CarryOver::CarriedOver => Some(state()),
                CarryOver::Reinitialised => None,
            },
        }
    }
}
