//! What the networks learn from.

use rayon::prelude::*;

use super::{Actor, Critic};
use crate::network::{Accumulate, PIECE, dispatch, square};

/// The gradient of both networks, laid out as their parameters.
#[derive(Clone, Debug)]
pub struct Gradient {
    /// `[parameters]`.
    pub actor: Vec<f32>,
    /// `[parameters]`.
    pub critic: Vec<f32>,
}

impl Gradient {
    /// Zero, for networks of these shapes.
    pub fn new(actor: &Actor, critic: &Critic) -> Self {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_gradient_is_the_sum_of_all_its_parts() {
        let gradient = |shift: f32| Gradient {
            actor: (0..2 * PIECE + 7).map(|index| libm::sinf(index as f32 + shift)).collect(),
            critic: (0..PIECE + 3).map(|index| libm::cosf(index as f32 + shift)).collect(),
        };
        let (one, other) = (gradient(0.0), gradient(0.3));
        let mut sum = gradient(9.0);
        sum.sum(&[&one, &other]);
        let values = |gradient: &Gradient| [&gradient.actor[..], &gradient.critic[..]].concat();
        let (one, other, all) = (values(&one), values(&other), values(&sum));
        for ((one, other), found) in one.iter().zip(&other).zip(&all) {
            assert_eq!(*found, one + other);
        }
        let square: f64 = all.iter().map(|value| f64::from(*value) * f64::from(*value)).sum();
        assert!((f64::from(sum.norm()) / square.sqrt() - 1.0).abs() < 1e-5);
    }
}
