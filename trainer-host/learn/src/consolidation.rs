//! What keeps a policy from forgetting earlier tasks while it learns another.
//!
//! Between tasks a [`Consolidator`] takes in what must not be forgotten (`consolidate`); during the next task it adds
//! its pull to the gradient of every minibatch (`add_gradient`) or moves the policy after the step (`after_step`). What
//! it keeps does not grow with the number of tasks, and it says how many bytes that is.

mod action_anchor;
mod anchored;
mod coreset;
mod curvature;
mod distillation;
mod kronecker;
mod path_integral;
mod published;
mod state_model;
#[cfg(test)]
mod tests;

use kestrel_sim::seed::Seed;
use serde::{Deserialize, Serialize};

pub use action_anchor::{ActionAnchor, ActionAnchorSettings};
pub use anchored::{Anchored, AnchoredSettings, Coupling, Curvature, GradientTerm, Strength};
pub use coreset::{Coreset, CoresetSettings};
pub use distillation::{DistillationSettings, distil};
pub use path_integral::{PathIntegral, PathIntegralSettings};
pub use published::{Published, PublishedRule, PublishedSettings};

use crate::actor_critic::{Actor, Critic};
use crate::ppo::Gradient;
use crate::rollout::Rollout;

/// Standard deviation of the actions at which divergences are measured: with the policy's own, which shrinks in
/// training, the last task would always weigh most.
pub(crate) const REFERENCE_STD: f32 = 0.3;

/// What is remembered of earlier tasks, and how.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Consolidator {
    /// Nothing: plain incremental learning.
    None,
    /// One running anchor with a curvature: corrected IL-SOAR, online EWC, MAS, L2.
    Anchored(Anchored),
    /// The same with its second order in the actions.
    ActionAnchor(ActionAnchor),
    /// IL-SOAR as the thesis and its code wrote it.
    Published(Published),
    /// Synaptic intelligence.
    PathIntegral(PathIntegral),
    /// States of earlier tasks and what the policy did there.
    Coreset(Coreset),
}

/// How a consolidator works, before it has seen anything.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ConsolidatorSettings {
    /// [`Consolidator::None`].
    None,
    /// [`Consolidator::Anchored`].
    Anchored(AnchoredSettings),
    /// [`Consolidator::ActionAnchor`].
    ActionAnchor(ActionAnchorSettings),
    /// [`Consolidator::Published`].
    Published(PublishedSettings),
    /// [`Consolidator::PathIntegral`].
    PathIntegral(PathIntegralSettings),
    /// [`Consolidator::Coreset`].
    Coreset(CoresetSettings),
}

/// A task at its end.
#[derive(Clone, Copy, Debug)]
pub struct Ended<'a> {
    /// The policy that has learned it.
    pub actor: &'a Actor,
    /// Its value function.
    pub critic: &'a Critic,
    /// Gradient of PPO's loss, laid out as the actor's parameters, on a rollout of that very policy.
    pub gradient: &'a [f32],
    /// That rollout.
    pub rollouts: &'a [&'a Rollout],
    /// Seed of the task's training.
    pub seed: Seed,
}

impl ConsolidatorSettings {
    /// A consolidator that has seen nothing yet, for a policy and a value function of these shapes.
    pub fn begin(&self, actor: &Actor, critic: &Critic) -> Consolidator {
        match self {
            Self::None => Consolidator::None,
            Self::Anchored(settings) => Consolidator::Anchored(Anchored::new(settings, actor)),
            Self::ActionAnchor(settings) => Consolidator::ActionAnchor(ActionAnchor::new(settings, actor)),
            Self::Published(settings) => Consolidator::Published(Published::new(settings, actor, critic)),
            Self::PathIntegral(settings) => Consolidator::PathIntegral(PathIntegral::new(settings, actor)),
            Self::Coreset(settings) => Consolidator::Coreset(Coreset::new(settings, actor)),
        }
    }
}

impl Consolidator {
    /// Bytes that are kept from task to task beside the policy.
    pub fn stored_bytes(&self) -> usize {
        match self {
            Self::None => 0,
            Self::Anchored(anchored) => anchored.stored_bytes(),
            Self::ActionAnchor(anchor) => anchor.stored_bytes(),
            Self::Published(published) => published.stored_bytes(),
            Self::PathIntegral(path) => path.stored_bytes(),
            Self::Coreset(coreset) => coreset.stored_bytes(),
        }
    }

    /// Bytes needed while a task is learned, the stored ones included.
    pub fn training_bytes(&self) -> usize {
        match self {
            Self::PathIntegral(path) => path.training_bytes(),
            Self::ActionAnchor(anchor) => anchor.training_bytes(),
            Self::None | Self::Anchored(_) | Self::Published(_) | Self::Coreset(_) => self.stored_bytes(),
        }
    }

    /// Adds its pull to the gradient of a minibatch's loss, before that is shortened.
    pub(crate) fn add_gradient(&mut self, (actor, critic): (&Actor, &Critic), gradient: &mut Gradient) {
        match self {
            Self::None => {}
            Self::Anchored(anchored) => anchored.add_gradient(actor, &mut gradient.actor),
            Self::ActionAnchor(anchor) => anchor.add_gradient(actor, &mut gradient.actor),
            Self::Published(published) => published.add_gradient(actor, critic, gradient),
            Self::PathIntegral(path) => path.add_gradient(actor, &mut gradient.actor),
            Self::Coreset(coreset) => coreset.add_gradient(actor, &mut gradient.actor),
        }
    }

    /// After Adam has moved the policy along `gradient · scale`.
    pub(crate) fn after_step(
        &mut self,
        (actor, gradient): (&mut Actor, &Gradient),
        scale: f32,
        learning_rate: f32,
    ) {
        match self {
            Self::None | Self::ActionAnchor(_) | Self::Coreset(_) => {}
            Self::Anchored(anchored) => anchored.after_step(actor, learning_rate),
            Self::Published(published) => published.after_step(gradient, scale),
            Self::PathIntegral(path) => path.after_step(actor),
        }
    }

    /// Takes in what must not be forgotten of a task.
    pub(crate) fn consolidate(&mut self, ended: &Ended<'_>) {
        match self {
            Self::None => {}
            Self::Anchored(anchored) => anchored.consolidate(ended),
            Self::ActionAnchor(anchor) => anchor.consolidate(ended),
            Self::Published(published) => published.consolidate(ended),
            Self::PathIntegral(path) => path.consolidate(ended),
            Self::Coreset(coreset) => coreset.consolidate(ended),
        }
    }
}
