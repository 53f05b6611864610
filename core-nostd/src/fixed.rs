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
//! Weights are stored as `[row block of 4][column pair][row][2]`: one pointer walks through memory and two inputs
//! serve eight products. Rows are filled up with zeros to a multiple of four, columns to a multiple of two.

mod packing;
mod tanh;

use heapless::Vec;

use crate::action::ACTION_LIMIT;
use crate::mlp::{LAYER_LIMIT, ROW_BLOCK, WIDTH_LIMIT};
use crate::policy_file::PolicyError;
use crate::real::Real;

/// Activations are in 2⁻¹³: a rounding of 6e-5, which leaves 18 bits for the sums of weights.
pub const ACTIVATION_FRACTION_BITS: u32 = 13;

/// Arguments of `tanh` are in 2⁻¹⁶.
const SUM_FRACTION_BITS: u32 = 16;

/// The constant shift of requantisation.
const REQUANTISATION_SHIFT: u32 = 32;

/// Least fraction bits of a sum: below, the multiplier of the requantisation would not fit into 31 bits.
const SUM_FRACTION_BITS_LEAST: u32 = REQUANTISATION_SHIFT + SUM_FRACTION_BITS - 30;

/// Greatest fraction bits of weights; ±2⁻⁵ is as fine as any layer needs.
pub const WEIGHT_FRACTION_BITS_LIMIT: u8 = 20;

/// Greatest fraction bits of observations: they may reach ±2 before they saturate, even if none did in calibration.
pub const INPUT_FRACTION_BITS_LIMIT: u8 = 14;

/// Greatest magnitude of a quantised observation.
const OBSERVATION_CODE_LIMIT: i16 = i16::MAX;

const COLUMN_GROUP: usize = 2;

/// Bytes of one column pair of a row block.
const GROUP_BYTES: usize = ROW_BLOCK * COLUMN_GROUP * size_of::<i16>();

/// The Q formats of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FixedFormat {
    /// Fraction bits of the observation, 0 to [`INPUT_FRACTION_BITS_LIMIT`].
    pub input_fraction_bits: u8,
    /// Fraction bits of each layer's weights, 0 to [`WEIGHT_FRACTION_BITS_LIMIT`]; zero beyond the last layer.
    pub weight_fraction_bits: [u8; LAYER_LIMIT],
}

/// A network whose parameters lie in borrowed bytes.
#[derive(Clone, Debug)]
pub struct FixedMlp<'a> {
    layers: Vec<PackedLayer<'a>, LAYER_LIMIT>,
    /// Values of the action.
    outputs: usize,
    /// Quantised value of an observation of one.
    input_scale: f32,
    /// Action of an output sum of one.
    output_scale: f32,
}

/// Working memory of an inference; owned by the caller so that neither stack nor time is spent on it.
#[derive(Clone, Debug)]
pub struct Scratch {
    activations: [i16; WIDTH_LIMIT],
    sums: [i32; WIDTH_LIMIT],
}

#[derive(Clone, Copy, Debug)]
struct PackedLayer<'a> {
    inputs: usize,
    padded_outputs: usize,
    /// 2^(48−w−x).
    multiplier: i32,
    /// Little-endian `i32`.
    bias: &'a [u8],
    /// Little-endian `i16`, in blocks.
    weights: &'a [u8],
}

impl FixedMlp<'_> {
    /// The action in \[-1, 1\] on `observation`, the same bits on every machine; zeros follow it.
    ///
    /// Values beyond the range of the input format saturate; a NaN is read as zero, and so are the values that are
    /// missing when the observation is too short. Never panics.
    pub fn act(&self, observation: &[f32], scratch: &mut Scratch) -> [f32; ACTION_LIMIT] {
        let Scratch { activations, sums } = scratch;
        self.read_observation(observation, activations.get_mut(..self.inputs()).unwrap_or_default());
        self.forward(activations, sums)
    }

    /// As [`Self::act`], with `features` in the format of the inputs behind the observation. `activations` is memory
    /// for all of them, filled up to an even number, and at least [`WIDTH_LIMIT`] values.
    pub(crate) fn act_on_features(
        &self,
        observation: &[f32],
        features: &[i16],
        activations: &mut [i16],
        scratch: &mut Scratch,
    ) -> [f32; ACTION_LIMIT] {
        let observed = self.inputs().saturating_sub(features.len());
        let (front, back) = activations.split_at_mut_checked(observed).unwrap_or_default();
        self.read_observation(observation, front);
        for (slot, feature) in back.iter_mut().zip(features) {
            *slot = *feature;
        }
        self.forward(activations, &mut scratch.sums)
    }

    /// The stored weight in `row` and `column` of `layer`; zero beyond the matrix.
    pub(crate) fn weight_code(&self, layer: usize, row: usize, column: usize) -> i16 {
        self.layers.get(layer).map_or(0, |layer| layer.weight_code(row, column))
    }

    /// The stored bias in `row` of `layer`; zero beyond the rows.
    pub(crate) fn bias_code(&self, layer: usize, row: usize) -> i32 {
        let word = self.layers.get(layer).and_then(|layer| layer.bias.as_chunks::<4>().0.get(row));
        word.map_or(0, |word| i32::from_le_bytes(*word))
    }

    /// Values that the first layer reads.
    pub(crate) fn inputs(&self) -> usize {
        self.layers.first().map_or(0, |layer| layer.inputs)
    }

    /// The action on what lies in `activations`.
    fn forward(&self, activations: &mut [i16], sums: &mut [i32; WIDTH_LIMIT]) -> [f32; ACTION_LIMIT] {
        let Some((output_layer, hidden_layers)) = self.layers.split_last() else { return [0.0; ACTION_LIMIT] };
        for layer in hidden_layers {
            layer.apply(activations, sums);
            for (activation, sum) in activations.iter_mut().zip(sums.iter().take(layer.padded_outputs)) {
                *activation = tanh::tanh(requantised(*sum, layer.multiplier));
            }
        }
        output_layer.apply(activations, sums);
        let mut action = [0.0; ACTION_LIMIT];
        for (action, sum) in action.iter_mut().zip(sums.iter().take(self.outputs)) {
            *action = (*sum as f32 * self.output_scale).limited(-1.0, 1.0);
        }
        action
    }

    /// How many values of `observation` lie beyond the range of the input format.
    pub fn saturations(&self, observation: &[f32]) -> usize {
        let limit = f32::from(OBSERVATION_CODE_LIMIT) + 0.5;
        observation.iter().filter(|value| (*value * self.input_scale).abs() >= limit).count()
    }

    fn read_observation(&self, observation: &[f32], inputs: &mut [i16]) {
        for (input, value) in inputs.iter_mut().zip(observation.iter().chain(core::iter::repeat(&0.0))) {
            *input = quantised(value * self.input_scale);
        }
    }
}

/// The nearest integer, halves away from zero, limited to ±[`OBSERVATION_CODE_LIMIT`]; zero for NaN.
#[inline(always)]
fn quantised(value: f32) -> i16 {
    // `as` saturates and turns NaN into zero.
    ((value + 0.5_f32.copysign(value)) as i16).max(-OBSERVATION_CODE_LIMIT)
}

#[inline(always)]
fn requantised(sum: i32, multiplier: i32) -> i32 {
    ((i64::from(sum) * i64::from(multiplier)) >> REQUANTISATION_SHIFT) as i32
}

impl PackedLayer<'_> {
    fn apply(&self, activations: &[i16], sums: &mut [i32; WIDTH_LIMIT]) {
        let groups = self.inputs.div_ceil(COLUMN_GROUP);
        let inputs = activations.as_chunks::<COLUMN_GROUP>().0.get(..groups).unwrap_or_default();
        let sums = sums.get_mut(..self.padded_outputs).unwrap_or_default();
        dense(self.weights, self.bias, inputs, sums);
    }
}

/// `sums = bias + weights · inputs`.
///
/// Wraps where a sum leaves 32 bits, which the formats of a parsed policy exclude.
#[inline(never)]
fn dense(weights: &[u8], bias: &[u8], inputs: &[[i16; COLUMN_GROUP]], sums: &mut [i32]) {
    let mut groups = weights.as_chunks::<2>().0.as_chunks::<{ ROW_BLOCK * COLUMN_GROUP }>().0.iter();
    let biases = bias.as_chunks::<4>().0.as_chunks::<ROW_BLOCK>().0;
    for (bias, sums) in biases.iter().zip(sums.as_chunks_mut::<ROW_BLOCK>().0) {
        let mut block_sums = bias.map(i32::from_le_bytes);
        for inputs in inputs {
            let Some(group) = groups.next() else { break };
            block_sums = with_products(block_sums, group.map(i16::from_le_bytes), *inputs);
        }
        *sums = block_sums;
    }
}

/// Adds one column pair to the sums of a row block.
#[inline(always)]
fn with_products(
    sums: [i32; ROW_BLOCK],
    weights: [i16; ROW_BLOCK * COLUMN_GROUP],
    [first, second]: [i16; COLUMN_GROUP],
) -> [i32; ROW_BLOCK] {
    core::array::from_fn(|row| {
        let products = i32::from(weights[COLUMN_GROUP * row])
            .wrapping_mul(i32::from(first))
            .wrapping_add(i32::from(weights[COLUMN_GROUP * row + 1]).wrapping_mul(i32::from(second)));
        sums[row].wrapping_add(products)
    })
}

impl Scratch {
    /// Contents do not matter: every inference writes before it reads, or multiplies by the zeros of the padding.
    pub const fn new() -> Self {
        Self { activations: [0; WIDTH_LIMIT], sums: [0; WIDTH_LIMIT] }
    }
}

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

/// Bytes of the parameters of a layer in a policy file.
pub(crate) const fn layer_bytes(inputs: usize, outputs: usize) -> usize {
    let padded_outputs = outputs.next_multiple_of(ROW_BLOCK);
    padded_outputs * (size_of::<i32>() + size_of::<i16>() * inputs.next_multiple_of(COLUMN_GROUP))
}

impl FixedFormat {
    /// Fraction bits of the inputs of a layer.
    pub fn fraction_bits_into(self, layer: usize) -> u32 {
        if layer == 0 { u32::from(self.input_fraction_bits) } else { ACTIVATION_FRACTION_BITS }
    }

    /// Fraction bits of the sums and biases of a layer.
    ///
    /// # Errors
    /// [`PolicyError::FractionBits`] where the formats are out of range.
    pub(crate) fn sum_fraction_bits(self, layer: usize) -> Result<u32, PolicyError> {
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
    /// A view of `parameters`, the layers between `widths` one after the other.
    ///
    /// # Errors
    /// [`PolicyError::FractionBits`], [`PolicyError::Overflow`], or [`PolicyError::Length`] where the parameters end
    /// too early.
    pub(crate) fn from_parameters(
        widths: &[u16],
        format: FixedFormat,
        parameters: &'a [u8],
    ) -> Result<Self, PolicyError> {
        let input_scale = (1_u32 << format.input_fraction_bits.min(INPUT_FRACTION_BITS_LIMIT)) as f32;
        let outputs = usize::from(widths.last().copied().unwrap_or_default());
        let mut network = Self { layers: Vec::new(), outputs, input_scale, output_scale: 1.0 };
        let mut rest = parameters;
        for (index, (&inputs, &outputs)) in widths.iter().zip(widths.iter().skip(1)).enumerate() {
            let bits = format.sum_fraction_bits(index)?;
            let (bytes, following) = split_layer(rest, usize::from(inputs), usize::from(outputs))?;
            let layer = PackedLayer::new(bytes, usize::from(inputs), usize::from(outputs), bits);
            layer.check(index)?;
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

impl<'a> PackedLayer<'a> {
    fn new(parameters: &'a [u8], inputs: usize, outputs: usize, sum_fraction_bits: u32) -> Self {
        let padded_outputs = outputs.next_multiple_of(ROW_BLOCK);
        let (bias, weights) = parameters.split_at_checked(size_of::<i32>() * padded_outputs).unwrap_or_default();
        let multiplier = 1 << (REQUANTISATION_SHIFT + SUM_FRACTION_BITS - sum_fraction_bits);
        Self { inputs, padded_outputs, multiplier, bias, weights }
    }

    fn weight_code(&self, row: usize, column: usize) -> i16 {
        if column >= self.inputs {
            return 0;
        }
        let groups = self.inputs.div_ceil(COLUMN_GROUP);
        let group = row / ROW_BLOCK * groups + column / COLUMN_GROUP;
        let index = (group * ROW_BLOCK + row % ROW_BLOCK) * COLUMN_GROUP + column % COLUMN_GROUP;
        self.weights.as_chunks::<2>().0.get(index).map_or(0, |code| i16::from_le_bytes(*code))
    }

    /// Refuses a layer of which a sum could leave 32 bits with the inputs that layer number `layer` can have.
    fn check(&self, layer: usize) -> Result<(), PolicyError> {
        let block_bytes = GROUP_BYTES * self.inputs.div_ceil(COLUMN_GROUP);
        for (row, bias) in self.bias.as_chunks::<4>().0.iter().enumerate() {
            let block = self.weights.chunks_exact(block_bytes.max(1)).nth(row / ROW_BLOCK).unwrap_or_default();
            let pairs = block.as_chunks::<4>().0.iter().skip(row % ROW_BLOCK).step_by(ROW_BLOCK);
            let magnitude: i64 = pairs.map(|pair| magnitude_of_pair(*pair)).sum();
            let bias = i64::from(i32::from_le_bytes(*bias).unsigned_abs());
            let largest = magnitude * i64::from(input_limit(layer)) + bias;
            if largest > i64::from(i32::MAX) {
                return Err(PolicyError::Overflow { layer, row, largest });
            }
        }
        Ok(())
    }
}

/// Greatest magnitude of a quantised input of layer number `layer`.
const fn input_limit(layer: usize) -> i16 {
    if layer == 0 { OBSERVATION_CODE_LIMIT } else { 1 << ACTIVATION_FRACTION_BITS }
}

fn magnitude_of_pair([first_low, first_high, second_low, second_high]: [u8; 4]) -> i64 {
    let magnitude = |low, high| i64::from(i16::from_le_bytes([low, high]).unsigned_abs());
    magnitude(first_low, first_high) + magnitude(second_low, second_high)
}
