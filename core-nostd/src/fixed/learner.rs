//! The output layer of a network, learning on board.

use super::{FixedMlp, FixedScratch};
use crate::anchor::fixed::{Fraction, dither, dithered};
use crate::limits::ACTION_LIMIT;
use crate::real::Real;

/// Fraction bits of errors: 1.5e-5 of the action's range.
const ERROR_FRACTION_BITS: u32 = 16;

/// With a greater rate the action would move away from its target.
const RATE_LIMIT: Fraction = Fraction::from_bits(2 * Fraction::ONE.bits());

/// A copy of a network's output layer that learns by normalised least mean squares (Nagumo and Noda 1967), in integers:
///
/// ```text
/// W' = W − rate · e hᵀ / (1 + hᵀh)       b' = b − rate · e / (1 + hᵀh)       e = action − target
/// ```
///
/// with the activations h behind the last hidden layer, which stay as they were trained. Any rate below 2 brings the
/// sum behind an action nearer to its target; after a step with rate 1 it is there, unless it lay beyond the limits of actions. Parameters are the `i16` of the network, two bytes each, and move
/// by whole units as an anchor moves them ([`crate::anchor::fixed`]): rounded down behind a dither, so that small
/// steps are not lost. With an anchor over the same parameters the layer learns without forgetting:
///
/// ```text
/// learner.learn(features, &target, rate);
/// anchor.proximal_step(learner.parameters_mut(), &shares, call);
/// ```
///
/// The same bits on every machine; never panics.
#[derive(Debug)]
pub struct OutputLearner<'m> {
    /// `[outputs][features + 1]`, the bias behind the weights of its row, all in 2⁻ʷ.
    parameters: &'m mut [i16],
    features: usize,
    feature_fraction_bits: u32,
    weight_fraction_bits: u32,
    /// Steps so far, for the dither; wraps.
    steps: u32,
}

impl FixedMlp<'_> {
    /// Activations behind the last hidden layer for `observation`, in the format that the output layer reads; an action
    /// is the output layer's answer to them. Observations are read as by [`Self::act`].
    pub fn features<'s>(&self, observation: &[f32], scratch: &'s mut FixedScratch) -> &'s [i16] {
        self.activations(self.layers.len().saturating_sub(1), observation, scratch)
    }

    /// As [`Self::features`], of any `layer`: what it reads, which is the observation where it is 0; nothing beyond the last.
    pub fn activations<'s>(&self, layer: usize, observation: &[f32], scratch: &'s mut FixedScratch) -> &'s [i16] {
        let FixedScratch { activations, sums } = scratch;
        self.read_observation(observation, activations.get_mut(..self.inputs()).unwrap_or_default());
        let Some(reader) = self.layers.get(layer) else { return &[] };
        self.hide(self.layers.get(..layer).unwrap_or_default(), activations, sums);
        activations.get(..reader.inputs).unwrap_or_default()
    }
}

impl<'m> OutputLearner<'m> {
    /// Parameters of a learner of this network's output layer.
    pub fn parameters_of(network: &FixedMlp<'_>) -> usize {
        network.outputs * (network.layers.last().map_or(0, |layer| layer.inputs) + 1)
    }

    /// A learner that begins with the network's own output layer, in `memory` of [`Self::parameters_of`] values.
    /// Biases lose what they have beyond the weights' fraction bits, half a unit at most.
    ///
    /// `None` if `memory` has another length.
    pub fn new(network: &FixedMlp<'_>, memory: &'m mut [i16]) -> Option<Self> {
        let (output_layer, hidden_layers) = network.layers.split_last()?;
        if memory.len() != Self::parameters_of(network) {
            return None;
        }
        let format = network.format;
        let output = hidden_layers.len();
        let learner = Self {
            parameters: memory,
            features: output_layer.inputs,
            feature_fraction_bits: format.fraction_bits_into(output),
            weight_fraction_bits: format.sum_fraction_bits(output).ok()? - format.fraction_bits_into(output),
            steps: 0,
        };
        for (row, parameters) in learner.parameters.chunks_exact_mut(row_len(learner.features)).enumerate() {
            let bias = network.bias_code(output, row);
            let rounded =
                (i64::from(bias) + (1 << learner.feature_fraction_bits >> 1)) >> learner.feature_fraction_bits;
            for (column, parameter) in parameters.iter_mut().enumerate() {
                *parameter = if column < learner.features {
                    output_layer.weight_code(row, column)
                } else {
                    rounded.clamp(i64::from(i16::MIN), i64::from(i16::MAX)) as i16
                };
            }
        }
        Some(learner)
    }

    /// `[outputs][features + 1]`, the bias behind the weights of its row, all in 2⁻ʷ.
    pub fn parameters(&self) -> &[i16] {
        self.parameters
    }

    /// As [`Self::parameters`], for an anchor to regularise.
    pub fn parameters_mut(&mut self) -> &mut [i16] {
        self.parameters
    }

    /// The action in \[-1, 1\] for `features`; zeros follow it. Features that are missing count as zero.
    pub fn act(&self, features: &[i16]) -> [f32; ACTION_LIMIT] {
        let bits = self.feature_fraction_bits + self.weight_fraction_bits;
        let scale = 1.0 / (1_u64 << bits) as f32;
        let mut action = [0.0; ACTION_LIMIT];
        for (action, row) in action.iter_mut().zip(self.parameters.chunks_exact(row_len(self.features))) {
            *action = (self.sum(row, features) as f32 * scale).limited(-1.0, 1.0);
        }
        action
    }

    /// Brings the action for `features` nearer to `target` by a share `rate` of the way, below 2; the action before the
    /// step. A target that is no number, or missing, teaches its row nothing, and neither does one beyond an action at its limit.
    pub fn learn(&mut self, features: &[i16], target: &[f32], rate: Fraction) -> [f32; ACTION_LIMIT] {
        let action = self.act(features);
        let features = features.get(..self.features.min(features.len())).unwrap_or_default();
        let one = 1_i64 << self.feature_fraction_bits;
        let energy =
            features.iter().fold(one * one, |sum, feature| sum + i64::from(*feature) * i64::from(*feature));
        let bits = self.feature_fraction_bits + self.weight_fraction_bits;
        let mut index = 0;
        let rows = self.parameters.chunks_exact_mut(row_len(self.features));
        for ((row, action), target) in rows.zip(&action).zip(target) {
            // `as` turns NaN into zero.
            let error = ((limited(*target) - action) * (1 << ERROR_FRACTION_BITS) as f32) as i64;
            // For one unit of a feature, in 2⁻²⁴ units of a weight: 25 and 18 bits, and at most 18 more.
            let step = i64::from(rate.bits().min(RATE_LIMIT.bits())) * error;
            let step = (step << bits.saturating_sub(ERROR_FRACTION_BITS)).checked_div(energy).unwrap_or_default();
            let Some((bias, weights)) = row.split_last_mut() else { continue };
            for (weight, feature) in weights.iter_mut().zip(features) {
                *weight = dithered(*weight, step * i64::from(*feature), dither(self.steps, index));
                index += 1;
            }
            *bias = dithered(*bias, step * one, dither(self.steps, index));
            index += 1;
        }
        self.steps = self.steps.wrapping_add(1);
        action
    }

    /// `row · [features, 1]`, in the fraction bits of weights and features together.
    fn sum(&self, row: &[i16], features: &[i16]) -> i64 {
        let Some((bias, weights)) = row.split_last() else { return 0 };
        let products =
            weights.iter().zip(features).map(|(weight, feature)| i32::from(*weight) * i32::from(*feature));
        (i64::from(*bias) << self.feature_fraction_bits) + products.map(i64::from).sum::<i64>()
    }
}

/// Of a row: a weight for each feature, and the bias.
fn row_len(features: usize) -> usize {
    features.saturating_add(1)
}

/// A target in the range of actions; NaN stays.
fn limited(target: f32) -> f32 {
    if target.is_nan() { target } else { target.limited(-1.0, 1.0) }
}
