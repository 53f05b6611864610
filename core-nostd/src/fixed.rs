//! Multilayer perceptrons in integers: 16-bit weights and activations, 32-bit sums, no floating point between the
//! observation and the action.
//!
//! A layer multiplies inputs in 2⁻ˣ with weights in 2⁻ʷ, so its sums and biases are in 2⁻⁽ʷ⁺ˣ⁾. `x` is 13 behind a
//! hidden layer and chosen for the observation, `w` is chosen per layer; the choice guarantees that no sum can leave
//! 32 bits, whatever the observation, and a policy file that breaks the guarantee is refused. Then
//!
//! ```text
//! sum in 2⁻¹⁶ = (sum in 2⁻⁽ʷ⁺ˣ⁾ · 2^(48−w−x)) >> 32        hidden layers, then tanh in 2⁻¹³
//! action      = sum · 2⁻⁽ʷ⁺ˣ⁾, limited to [-1, 1]           output layer
//! ```
//!
//! where the shift is a constant, so that it costs one instruction (`smmul`) on a Cortex-M4.
//!
//! With rectifiers in place of tangents (feature `px4`) activations are in 2⁻¹¹, from 0 to 16, and `x` is 11 behind a
//! hidden layer.
//!
//! Weights are stored as `[row block of 4][column pair][row][2]`: one pointer walks through memory and two inputs
//! serve eight products. Rows are filled up with zeros to a multiple of four, columns to a multiple of two. A pair of
//! weights is a word, which ARM's SMLAD multiplies with a pair of inputs in one instruction (feature `smlad`).

#[cfg(feature = "recurrent")]
mod gru;
mod layer;
#[cfg(feature = "learning")]
mod learner;
mod packing;
#[cfg(feature = "px4")]
mod relu;
#[cfg(all(feature = "smlad", target_arch = "arm"))]
mod smlad;
mod tanh;

#[cfg(feature = "recurrent")]
pub use gru::{FixedGru, HIDDEN_FRACTION_BITS};
#[cfg(feature = "learning")]
pub use learner::OutputLearner;
pub use tanh::TABLE as TANGENTS;

#[cfg(feature = "recurrent")]
pub(crate) use gru::gru_format;
pub(crate) use layer::layer_bytes;

use heapless::Vec;

use crate::activation::Activation;
#[cfg(feature = "recurrent")]
use crate::gru::HiddenState;
use crate::limits::{ACTION_LIMIT, LAYER_LIMIT, ROW_BLOCK, WIDTH_LIMIT};
use crate::policy_error::PolicyError;
use crate::real::Real;
use layer::{COLUMN_GROUP, FixedLayer};

/// Activations are in 2⁻¹³: a rounding of 6e-5, which leaves 18 bits for the sums of weights.
pub const ACTIVATION_FRACTION_BITS: u32 = 13;

/// Activations behind rectifiers are in 2⁻¹¹: they reach 16, more than a policy of values of order one has, and are rounded
/// by 2.4e-4.
pub const RECTIFIED_FRACTION_BITS: u32 = 11;

/// Arguments of activations are in 2⁻¹⁶.
pub const SUM_FRACTION_BITS: u32 = 16;

/// The constant shift of requantisation: sums are multiplied by two to the power of this and
/// [`SUM_FRACTION_BITS`] less their own fraction bits.
pub const REQUANTISATION_SHIFT: u32 = 32;

/// Least fraction bits of a sum: below, the multiplier of the requantisation would not fit into 31 bits.
const SUM_FRACTION_BITS_LEAST: u32 = REQUANTISATION_SHIFT + SUM_FRACTION_BITS - 30;

/// Greatest fraction bits of weights; ±2⁻⁵ is as fine as any layer needs.
pub const WEIGHT_FRACTION_BITS_LIMIT: u8 = 20;

/// Greatest fraction bits of observations: they may reach ±2 before they saturate, even if none did in calibration.
pub const INPUT_FRACTION_BITS_LIMIT: u8 = 14;

/// Greatest magnitude of a quantised observation.
const OBSERVATION_CODE_LIMIT: i16 = i16::MAX;

/// The Q formats of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FixedFormat {
    /// Fraction bits of the observation, 0 to [`INPUT_FRACTION_BITS_LIMIT`].
    pub input_fraction_bits: u8,
    /// Fraction bits of each layer's weights, 0 to [`WEIGHT_FRACTION_BITS_LIMIT`]; zero beyond the last layer.
    pub weight_fraction_bits: [u8; LAYER_LIMIT],
    /// What follows the sums of hidden layers, and with it the format of what the next layer reads.
    pub activation: Activation,
}

/// A network whose parameters lie in borrowed bytes.
#[derive(Clone, Debug)]
pub struct FixedMlp<'a> {
    layers: Vec<FixedLayer<'a>, LAYER_LIMIT>,
    /// Values of the action.
    outputs: usize,
    #[cfg(any(feature = "learning", feature = "px4"))]
    format: FixedFormat,
    /// Quantised value of an observation of one.
    input_scale: f32,
    /// Action of an output sum of one.
    output_scale: f32,
}

/// Working memory of an inference; owned by the caller so that neither stack nor time is spent on it.
#[derive(Clone, Debug)]
pub struct FixedScratch {
    activations: [i16; WIDTH_LIMIT],
    sums: [i32; WIDTH_LIMIT],
}

impl FixedMlp<'_> {
    /// The action in \[-1, 1\] on `observation`, the same bits on every machine; zeros follow it.
    ///
    /// Values beyond the range of the input format saturate; a NaN is read as zero, and so are the values that are
    /// missing when the observation is too short. Never panics.
    pub fn act(&self, observation: &[f32], scratch: &mut FixedScratch) -> [f32; ACTION_LIMIT] {
        let FixedScratch { activations, sums } = scratch;
        self.read_observation(observation, activations.get_mut(..self.inputs()).unwrap_or_default());
        self.forward(activations, sums)
    }

    #[cfg(feature = "recurrent")]
    /// As [`Self::act`], with the `hidden` state behind the observation, which `memory` has taken in before.
    pub(crate) fn act_recurrent(
        &self,
        observation: &[f32],
        memory: &FixedGru<'_>,
        hidden: &mut HiddenState,
        scratch: &mut FixedScratch,
    ) -> [f32; ACTION_LIMIT] {
        let FixedScratch { activations, sums } = scratch;
        self.read_observation(observation, activations.get_mut(..memory.observation_len()).unwrap_or_default());
        memory.advance(activations, sums, &mut hidden.fixed);
        self.forward(activations, sums)
    }

    #[cfg(feature = "encoder")]
    /// As [`Self::act`], with `features` in the format of the inputs behind the observation and, behind these, the hidden state
    /// of a memory that has taken in both before, if there is one. `activations` is memory for all of them, filled up to an
    /// even number, and at least [`WIDTH_LIMIT`] values.
    pub(crate) fn act_on_features(
        &self,
        observation: &[f32],
        features: &[i16],
        (memory, hidden): (Option<&FixedGru<'_>>, &mut [i16]),
        activations: &mut [i16],
        scratch: &mut FixedScratch,
    ) -> [f32; ACTION_LIMIT] {
        let observed = self.inputs().saturating_sub(features.len() + hidden.len());
        let (front, back) = activations.split_at_mut_checked(observed).unwrap_or_default();
        self.read_observation(observation, front);
        for (slot, feature) in back.iter_mut().zip(features) {
            *slot = *feature;
        }
        if let Some(memory) = memory {
            memory.advance(activations, &mut scratch.sums, hidden);
        }
        self.forward(activations, &mut scratch.sums)
    }

    /// The stored weight in `row` and `column` of `layer`; zero beyond the matrix.
    pub(crate) fn weight_code(&self, layer: usize, row: usize, column: usize) -> i16 {
        self.layers.get(layer).map_or(0, |layer| layer.weight_code(row, column))
    }

    /// The stored bias in `row` of `layer`; zero beyond the rows.
    pub(crate) fn bias_code(&self, layer: usize, row: usize) -> i32 {
        let biases = self.layers.get(layer).map_or(&[][..], |layer| layer.bias.as_flattened());
        biases.get(row).copied().unwrap_or_default()
    }

    /// Values that the first layer reads.
    pub(crate) fn inputs(&self) -> usize {
        self.layers.first().map_or(0, |layer| layer.inputs)
    }

    /// The action on what lies in `activations`.
    fn forward(&self, activations: &mut [i16], sums: &mut [i32; WIDTH_LIMIT]) -> [f32; ACTION_LIMIT] {
        let Some((output_layer, hidden_layers)) = self.layers.split_last() else { return [0.0; ACTION_LIMIT] };
        self.hide(hidden_layers, activations, sums);
        output_layer.apply(activations, sums);
        let mut action = [0.0; ACTION_LIMIT];
        for (action, sum) in action.iter_mut().zip(sums.iter().take(self.outputs)) {
            *action = (*sum as f32 * self.output_scale).limited(-1.0, 1.0);
        }
        action
    }

    /// Takes `activations` through the hidden layers.
    #[inline(always)]
    fn hide(&self, layers: &[FixedLayer<'_>], activations: &mut [i16], sums: &mut [i32; WIDTH_LIMIT]) {
        #[cfg(feature = "px4")]
        if self.format.activation == Activation::Relu {
            return relu::hide(layers, activations, sums);
        }
        Self::hide_by_tangents(layers, activations, sums);
    }

    /// A function of its own, which has more registers.
    #[inline(never)]
    fn hide_by_tangents(layers: &[FixedLayer<'_>], activations: &mut [i16], sums: &mut [i32; WIDTH_LIMIT]) {
        for layer in layers {
            layer.apply(activations, sums);
            let sums = sums.get(..layer.padded_outputs).unwrap_or_default();
            let blocks =
                activations.as_chunks_mut::<ROW_BLOCK>().0.iter_mut().zip(sums.as_chunks::<ROW_BLOCK>().0);
            for (activations, sums) in blocks {
                *activations = sums.map(|sum| tanh::tanh(requantised(sum, layer.multiplier)));
            }
        }
    }

    /// How many values of `observation` lie beyond the range of the input format.
    pub fn saturations(&self, observation: &[f32]) -> usize {
        let limit = f32::from(OBSERVATION_CODE_LIMIT) + 0.5;
        observation.iter().filter(|value| (*value * self.input_scale).abs() >= limit).count()
    }

    fn read_observation(&self, observation: &[f32], inputs: &mut [i16]) {
        let present = observation.len().min(inputs.len());
        let (front, missing) = inputs.split_at_mut_checked(present).unwrap_or_default();
        for (input, value) in front.iter_mut().zip(observation) {
            *input = quantised(value * self.input_scale);
        }
        // Usually none is: then not even the function that fills memory is called.
        if !missing.is_empty() {
            missing.fill(0);
        }
    }
}

/// The nearest integer, halves away from zero, limited to ±[`OBSERVATION_CODE_LIMIT`]; zero for NaN.
#[inline(always)]
fn quantised(value: f32) -> i16 {
    // `as` saturates and turns NaN into zero; to 32 bits it is one instruction, and so is the limit of 16 bits.
    let nearest = (value + 0.5_f32.copysign(value)) as i32;
    (nearest.clamp(i32::from(i16::MIN), i32::from(i16::MAX)) as i16).max(-OBSERVATION_CODE_LIMIT)
}

#[inline(always)]
fn requantised(sum: i32, multiplier: i32) -> i32 {
    ((i64::from(sum) * i64::from(multiplier)) >> REQUANTISATION_SHIFT) as i32
}

impl FixedScratch {
    /// Contents do not matter: every inference writes before it reads, or multiplies by the zeros of the padding.
    pub const fn new() -> Self {
        Self { activations: [0; WIDTH_LIMIT], sums: [0; WIDTH_LIMIT] }
    }
}

impl Default for FixedScratch {
    fn default() -> Self {
        Self::new()
    }
}

impl FixedFormat {
    /// Fraction bits of the inputs of a layer.
    pub fn fraction_bits_into(self, layer: usize) -> u32 {
        match (layer, self.activation) {
            (0, _) => u32::from(self.input_fraction_bits),
            (_, Activation::Tanh) => ACTIVATION_FRACTION_BITS,
            (_, Activation::Relu) => RECTIFIED_FRACTION_BITS,
        }
    }

    /// Greatest magnitude of a quantised input of layer number `layer`.
    const fn input_limit(self, layer: usize) -> i16 {
        match (layer, self.activation) {
            (0, _) => OBSERVATION_CODE_LIMIT,
            (_, Activation::Tanh) => 1 << ACTIVATION_FRACTION_BITS,
            (_, Activation::Relu) => i16::MAX,
        }
    }

    /// Fraction bits of the sums and biases of a layer.
    ///
    /// # Errors
    /// [`PolicyError::FractionBits`] where the formats are out of range.
    pub fn sum_fraction_bits(self, layer: usize) -> Result<u32, PolicyError> {
        let weight_bits = self.weight_fraction_bits.get(layer).copied().unwrap_or_default();
        let bits = self.fraction_bits_into(layer) + u32::from(weight_bits);
        let allowed = weight_bits <= WEIGHT_FRACTION_BITS_LIMIT
            && self.input_fraction_bits <= INPUT_FRACTION_BITS_LIMIT
            && bits >= SUM_FRACTION_BITS_LEAST;
        let into = self.fraction_bits_into(layer) as u8;
        allowed.then_some(bits).ok_or(PolicyError::FractionBits { layer, weights: weight_bits, inputs: into })
    }
}

impl<'a> FixedMlp<'a> {
    /// A view of `parameters`, the layers between `widths` one after the other, on a four-byte boundary of memory. For
    /// firmwares that have no policy file but its numbers; [`crate::policy_file::PolicyFile::parse`] checks far more.
    ///
    /// # Errors
    /// [`PolicyError::Width`], [`PolicyError::FractionBits`], [`PolicyError::Overflow`], [`PolicyError::Misaligned`],
    /// [`PolicyError::LayerCount`], or [`PolicyError::Length`] where the parameters end too early.
    pub fn from_parameters(
        widths: &[u16],
        format: FixedFormat,
        parameters: &'a [u8],
    ) -> Result<Self, PolicyError> {
        let input_scale = (1_u32 << format.input_fraction_bits.min(INPUT_FRACTION_BITS_LIMIT)) as f32;
        let outputs = usize::from(widths.last().copied().unwrap_or_default());
        let mut network = Self {
            layers: Vec::new(),
            outputs,
            #[cfg(any(feature = "learning", feature = "px4"))]
            format,
            input_scale,
            output_scale: 1.0,
        };
        let mut rest = parameters;
        for (index, (&inputs, &outputs)) in widths.iter().zip(widths.iter().skip(1)).enumerate() {
            let (inputs, outputs) = (usize::from(inputs), usize::from(outputs));
            if !(1..=WIDTH_LIMIT).contains(&outputs) {
                return Err(PolicyError::Width { layer: index + 1, found: outputs });
            }
            let bits = format.sum_fraction_bits(index)?;
            let (bytes, following) = split_layer(rest, inputs, outputs)?;
            let layer = FixedLayer::new(bytes, inputs, outputs, bits)?;
            layer.check(index, format.input_limit(index))?;
            network.layers.push(layer).map_err(|_| PolicyError::LayerCount { found: LAYER_LIMIT + 1 })?;
            network.output_scale = 1.0 / (1_u64 << bits) as f32;
            rest = following;
        }
        Ok(network)
    }
}

/// The parameters of the first layer, and what follows them.
fn split_layer(bytes: &[u8], inputs: usize, outputs: usize) -> Result<(&[u8], &[u8]), PolicyError> {
    let expected = layer_bytes(inputs, outputs);
    bytes.split_at_checked(expected).ok_or(PolicyError::Length { found: bytes.len(), expected })
}
