//! One part of a minibatch, differentiated by one thread.

use crate::actor_critic::{Actor, Critic};
use crate::network::{Accumulate, dispatch, square};

use super::loss::LossSums;

/// The gradient of both networks, laid out as their parameters.
#[derive(Clone, Debug)]
pub(crate) struct Gradient {
    pub(crate) actor: Vec<f32>,
    pub(crate) critic: Vec<f32>,
}

impl Gradient {
    pub(crate) fn new(actor: &Actor, critic: &Critic) -> Self {
        Self { actor: vec![0.0; actor.parameters().len()], critic: vec![0.0; critic.parameters().len()] }
    }

    pub(crate) fn clear(&mut self) {
        self.actor.fill(0.0);
        self.critic.fill(0.0);
    }

    pub(crate) fn add(&mut self, other: &Self) {
        dispatch(Accumulate { values: &other.actor, sums: &mut self.actor });
        dispatch(Accumulate { values: &other.critic, sums: &mut self.critic });
    }

    /// Euclidean length over both networks.
    pub(crate) fn norm(&self) -> f32 {
        (square(&self.actor) + square(&self.critic)).sqrt()
    }
}

/// What one part of a minibatch adds to the whole.
#[derive(Clone, Debug)]
pub(crate) struct Shard {
    pub(crate) gradient: Gradient,
    pub(crate) sums: LossSums,
}

impl Shard {
    pub(crate) fn new(actor: &Actor, critic: &Critic) -> Self {
        Self { gradient: Gradient::new(actor, critic), sums: LossSums::default() }
    }

    /// Forgets the gradient and the sums of the last minibatch.
    pub(crate) fn clear(&mut self) {
        self.gradient.clear();
        self.sums = LossSums::default();
    }
}
