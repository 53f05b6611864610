//! Training with the weights that an export in fixed point will have.
//!
//! The actor that flies and is differentiated has rounded weights, the optimiser moves exact ones: the gradient passes the
//! rounding as if it were not there (the straight-through estimator, Bengio et al. 2013). Dense layers are rounded to
//! 16 bits with the fraction bits that their export would choose, encoders to 8 bits with the step of each filter. Activations
//! are not rounded: 13 and 15 bits are finer than what weights of 8 bits compute.

use kestrel_core::encoder::round_weights;
use kestrel_core::fixed::FixedFormat;
use kestrel_core::mlp::DenseLayer;

use crate::actor_critic::Actor;

/// Observations are of order one, and an export lets them reach so far as a rule.
const LARGEST_OBSERVATION: f32 = 2.0;

/// An actor as it will fly on board.
#[derive(Clone, Debug)]
pub(crate) struct Quantised {
    actor: Actor,
    /// Fraction bits of each dense layer's weights and biases; none where no export has room for them.
    bits: Vec<(i32, i32)>,
}

impl Quantised {
    /// Of an actor, with the formats of its weights as they are now.
    pub(crate) fn new(actor: &Actor) -> Self {
        let mut quantised = Self { bits: formats(actor), actor: actor.clone() };
        quantised.round();
        quantised
    }

    /// Becomes that of an actor that has moved a little, in the same formats.
    pub(crate) fn follow(&mut self, actor: &Actor) {
        self.actor.parameters_mut().copy_from_slice(actor.parameters());
        self.round();
    }

    pub(crate) fn actor(&self) -> &Actor {
        &self.actor
    }

    fn round(&mut self) {
        for ((weights, biases), (weight_bits, bias_bits)) in self.actor.layers_mut().into_iter().zip(&self.bits) {
            round_to(weights, *weight_bits);
            round_to(biases, *bias_bits);
        }
        if let Some((encoder, parameters)) = self.actor.cnn_mut() {
            round_weights(encoder.shape(), parameters);
        }
    }
}

fn formats(actor: &Actor) -> Vec<(i32, i32)> {
    let layers: Vec<DenseLayer<'_>> = actor.layers().into_iter().map(DenseLayer::from).collect();
    let Ok(format) = FixedFormat::finest(&layers, LARGEST_OBSERVATION) else { return Vec::new() };
    let bits = |layer: usize| {
        let sum_bits = format.sum_fraction_bits(layer).unwrap_or_default();
        (i32::from(format.weight_fraction_bits[layer]), sum_bits as i32)
    };
    (0..layers.len()).map(bits).collect()
}

/// To the nearest multiple of 2^-`bits`, halves away from zero.
fn round_to(values: &mut [f32], bits: i32) {
    let unit = f64::from(bits).exp2();
    for value in values {
        *value = ((f64::from(*value) * unit).round() / unit) as f32;
    }
}

#[cfg(test)]
mod tests {
    use kestrel_core::seed::{Purpose, Seed, Stream};

    use super::*;
    use crate::actor_critic::ActorLengths;

    fn actor() -> Actor {
        Actor::state_based(
            ActorLengths { observation: 9, action: 4 },
            &[16, 16],
            -0.5,
            &mut Stream::new(Seed(3), 0, Purpose::Weights),
        )
    }

    #[test]
    fn a_rounded_actor_is_rounded_already() {
        let exact = actor();
        let once = Quantised::new(&exact);
        assert_ne!(once.actor(), &exact);
        let twice = Quantised::new(once.actor());
        assert_eq!(once.actor(), twice.actor());
        let far = |(one, other): (&f32, &f32)| (one - other).abs();
        let differences = once.actor().parameters().iter().zip(exact.parameters()).map(far);
        assert!(differences.fold(0.0, f32::max) < 1e-3);
    }

    #[test]
    fn it_follows_an_actor_that_moves() {
        let mut moved = actor();
        for parameter in moved.parameters_mut() {
            *parameter *= 0.99;
        }
        let mut quantised = Quantised::new(&actor());
        quantised.follow(&moved);
        assert_eq!(quantised.actor().log_std(), moved.log_std());
        let unit = f64::from(quantised.bits[1].0).exp2();
        let whole = |weight: &f32| (f64::from(*weight) * unit).fract() == 0.0;
        assert!(quantised.actor().layers()[1].weights.iter().all(whole));
    }

    #[test]
    fn weights_without_a_format_stay() {
        let mut broken = actor();
        broken.parameters_mut()[0] = f32::NAN;
        assert_eq!(Quantised::new(&broken).actor().parameters()[1..], broken.parameters()[1..]);
    }
}
