//! The end of a task, and what the next one begins with.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Actor, Critic, Trainer};
use crate::adam::Adam;
use crate::environment::Environment;
use crate::regulariser::{EndedTask, Flight, Regulariser, Visited};

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
    pub(crate) actor: Actor,
    pub(crate) log_std: CarryOver,
    /// Critic, and the optimisers of both networks.
    pub(crate) learner: Option<(Critic, Adam, Adam)>,
}

impl WarmStart {
    /// With a policy and, where they are carried over, what `learner` gives: critic, and the optimisers of both networks.
    pub(crate) fn new(
        actor: &Actor,
        log_std: CarryOver,
        carried: CarryOver,
        learner: impl FnOnce() -> (Critic, Adam, Adam),
    ) -> Self {
        let learner = match carried {
            CarryOver::CarriedOver => Some(learner()),
            CarryOver::Reinitialised => None,
        };
        Self { actor: actor.clone(), log_std, learner }
    }

    /// With the network of a policy and nothing else.
    pub fn of_policy(actor: Actor) -> Self {
        Self { actor, log_std: CarryOver::Reinitialised, learner: None }
    }

    /// Makes `actor` its policy.
    ///
    /// # Panics
    /// When that is of another shape.
    pub(crate) fn place(&self, actor: &mut Actor) {
        assert!(self.actor.is_like(actor), "a policy starts one of its shape");
        let log_std = actor.log_std().to_vec();
        actor.clone_from(&self.actor);
        if self.log_std == CarryOver::Reinitialised {
            let places = actor.log_std_places();
            actor.parameters_mut()[places].copy_from_slice(&log_std);
        }
    }
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
        let visited: Vec<Visited<'_>> = self.env_batches.iter().map(|batch| batch.rollout().visited()).collect();
        show(&EndedTask {
            actor: &self.actor,
            critic: &self.critic,
            gradient: &self.gradient.actor,
            visited: &visited,
            seed: self.seed,
        })
    }

    /// Shows a regulariser the rollout, where it looks for the end of a task; whether it has found one.
    pub(super) fn show(&self, regulariser: &mut impl Regulariser) -> bool {
        if !regulariser.watches() {
            return false;
        }
        let visited: Vec<Visited<'_>> = self.env_batches.iter().map(|batch| batch.rollout().visited()).collect();
        regulariser.watch(&Flight { actor: &self.actor, visited: &visited, seed: self.seed })
    }

    /// Flies for so many steps without learning, so that environments are at different moments of their episodes; of episodes that end
    /// nothing is reported.
    pub fn settle(&mut self, steps: u64) {
        for _ in 0..steps.div_ceil(self.settings.steps_per_rollout as u64) {
            self.collect();
        }
        self.take_episodes();
    }

    /// Begins with a policy, and what else is kept, of an earlier task.
    ///
    /// # Panics
    /// When it is of another shape.
    pub fn start_from(&mut self, earlier: &WarmStart) {
        earlier.place(&mut self.actor);
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
        WarmStart::new(&self.actor, log_std, learner, state)
    }
}
