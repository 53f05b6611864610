//! One part of a minibatch, differentiated by one thread.

use rayon::prelude::*;

use crate::actor_critic::{Actor, Critic};
use crate::network::{Accumulate, dispatch, square};

use super::loss::LossSums;

/// Values that one thread adds up at a time: those of a large network are shared among all threads, those of a small one
/// are one piece.
const PIECE: usize = 1 << 15;

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

    /// Becomes the sum of some, added in their order.
    pub(crate) fn sum(&mut self, parts: &[&Self]) {
        let Self { actor, critic } = self;
        add_up(actor, parts, |part| &part.actor);
        add_up(critic, parts, |part| &part.critic);
    }

    /// Euclidean length over both networks.
    pub(crate) fn norm(&self) -> f32 {
        let sum = |values: &[f32]| -> f32 {
            // The pieces are added in their order.
            values.par_chunks(PIECE).map(square).collect::<Vec<f32>>().iter().sum()
        };
        (sum(&self.actor) + sum(&self.critic)).sqrt()
    }
}

fn add_up<'a>(sums: &mut [f32], parts: &[&'a Gradient], values: impl Fn(&'a Gradient) -> &'a [f32] + Sync) {
    sums.par_chunks_mut(PIECE).enumerate().for_each(|(piece, sums)| {
        sums.fill(0.0);
        for part in parts {
            dispatch(Accumulate { values: &values(part)[piece * PIECE..][..sums.len()], sums });
        }
    });
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
