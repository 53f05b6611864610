//! Multilayer perceptrons in `f32`: an activation function between layers, a linear output limited to \[-1, 1\].
//!
//! Weights stay where the policy file has them (flash, usually). Each layer is a bias per row, then the weights in
//! blocks of sixteen rows, then of four (rows are filled up with zeros to a multiple of four), each block column by
//! column. So one pointer walks through memory, an input serves sixteen rows, and the sums vectorise on hosts
//! although every row adds its products in the order of the columns: the same bits everywhere.

use heapless::Vec;

#[cfg(feature = "px4")]
use crate::activation::relu;
use crate::activation::{Activation, tanh};
#[cfg(feature = "recurrent")]
use crate::gru::{Gru, HiddenState};
use crate::limits::{ACTION_LIMIT, ROW_BLOCK};
pub use crate::limits::{LAYER_LIMIT, WIDTH_LIMIT};
use crate::policy_error::PolicyError;
use crate::real::Real;

const WIDE_ROW_BLOCK: usize = 16;

/// Observations are of order one; what lies beyond this is a broken sensor, and is kept from overflowing the sums.
const INPUT_LIMIT: f32 = 1e4;

/// One dense layer as training has it: `weights` row by row `[outputs][inputs]`, `bias` `[outputs]`.
#[derive(Clone, Copy, Debug)]
pub struct DenseLayer<'a> {
    /// Columns.
    pub inputs: usize,
    /// Rows.
    pub outputs: usize,
    /// `[outputs][inputs]`, row-major.
    pub weights: &'a [f32],
    /// `[outputs]`.
    pub bias: &'a [f32],
    /// What follows the sums; nothing does where the layer is the last of a network.
    pub activation: Activation,
}

/// A network whose parameters lie in borrowed bytes; without the feature `float` there is none.
#[derive(Clone, Debug)]
pub struct Mlp<'a> {
    _supported: Supported,
    layers: Vec<FloatLayer<'a>, LAYER_LIMIT>,
    /// Values of the action.
    outputs: usize,
    #[cfg(feature = "px4")]
    activation: Activation,
}

/// What every network in float has: without the feature `float` it has no value, and then no network has.
#[derive(Clone, Copy, Debug)]
enum Supported {
    #[cfg(feature = "float")]
    Float,
}

#[cfg(feature = "float")]
const SUPPORTED: Option<Supported> = Some(Supported::Float);

#[cfg(not(feature = "float"))]
const SUPPORTED: Option<Supported> = None;

/// Values of the scratch at either end of a layer.
const SCRATCH_LEN: usize = if cfg!(feature = "float") { WIDTH_LIMIT } else { 0 };

/// The two ends of a layer; owned by the caller so that neither stack nor time is spent on it.
#[derive(Clone, Debug)]
pub struct FloatScratch {
    inputs: [f32; SCRATCH_LEN],
    outputs: [f32; SCRATCH_LEN],
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct FloatLayer<'a> {
    inputs: usize,
    padded_outputs: usize,
    /// Little-endian `f32`.
    bias: &'a [u8],
    /// Little-endian `f32`, in blocks.
    weights: &'a [u8],
}

impl Mlp<'_> {
    /// The action in \[-1, 1\] on `observation`; zeros follow it.
    ///
    /// A NaN is read as zero, and so are the values that are missing when the observation is too short; infinities
    /// are limited. Never panics, never returns NaN while the weights are finite.
    pub fn act(&self, observation: &[f32], scratch: &mut FloatScratch) -> [f32; ACTION_LIMIT] {
        let FloatScratch { inputs, outputs } = scratch;
        read_observation(observation, inputs.get_mut(..self.inputs()).unwrap_or_default());
        self.forward(inputs, outputs)
    }

    #[cfg(feature = "recurrent")]
    /// As [`Self::act`], with the `hidden` state behind the observation, which `memory` has taken in before.
    pub(crate) fn act_recurrent(
        &self,
        observation: &[f32],
        memory: &Gru<'_>,
        hidden: &mut HiddenState,
        scratch: &mut FloatScratch,
    ) -> [f32; ACTION_LIMIT] {
        let FloatScratch { inputs, outputs } = scratch;
        read_observation(observation, inputs.get_mut(..memory.observation_len()).unwrap_or_default());
        memory.advance(inputs, outputs, &mut hidden.float);
        self.forward(inputs, outputs)
    }

    #[cfg(feature = "encoder")]
    /// As [`Self::act`], with `features` behind the observation and, behind these, the hidden state of a memory that has taken in
    /// both before, if there is one. `inputs` is memory for all of them, and at least [`WIDTH_LIMIT`] values.
    pub(crate) fn act_on_features(
        &self,
        observation: &[f32],
        features: &[f32],
        (memory, hidden): (Option<&Gru<'_>>, &mut [f32]),
        inputs: &mut [f32],
        scratch: &mut FloatScratch,
    ) -> [f32; ACTION_LIMIT] {
        let observed = self.inputs().saturating_sub(features.len() + hidden.len());
        let (front, back) = inputs.split_at_mut_checked(observed).unwrap_or_default();
        read_observation(observation, front);
        read_observation(features, back.get_mut(..features.len()).unwrap_or_default());
        if let Some(memory) = memory {
            memory.advance(inputs, &mut scratch.outputs, hidden);
        }
        self.forward(inputs, &mut scratch.outputs)
    }

    /// The weight in `row` and `column` of `layer`; zero beyond the matrix.
    pub(crate) fn weight(&self, layer: usize, row: usize, column: usize) -> f32 {
        self.layers.get(layer).map_or(0.0, |layer| layer.weight(row, column))
    }

    /// The bias in `row` of `layer`; zero beyond the rows.
    pub(crate) fn bias(&self, layer: usize, row: usize) -> f32 {
        self.layers.get(layer).map_or(0.0, |layer| layer.bias(row))
    }

    /// Values that the first layer reads.
    pub(crate) fn inputs(&self) -> usize {
        self.layers.first().map_or(0, |layer| layer.inputs)
    }

    /// The action on what lies in `inputs`.
    fn forward<'s>(&self, mut inputs: &'s mut [f32], mut outputs: &'s mut [f32]) -> [f32; ACTION_LIMIT] {
        let Some((output_layer, hidden_layers)) = self.layers.split_last() else { return [0.0; ACTION_LIMIT] };
        for layer in hidden_layers {
            layer.apply(inputs, outputs);
            self.activate(outputs.iter_mut().take(layer.padded_outputs));
            core::mem::swap(&mut inputs, &mut outputs);
        }
        output_layer.apply(inputs, outputs);
        let mut action = [0.0; ACTION_LIMIT];
        for (action, output) in action.iter_mut().zip(outputs.iter().take(self.outputs)) {
            *action = output.limited(-1.0, 1.0);
        }
        action
    }

    /// What follows the sums of a hidden layer.
    #[inline(always)]
    fn activate<'s>(&self, sums: impl Iterator<Item = &'s mut f32>) {
        #[cfg(feature = "px4")]
        if self.activation == Activation::Relu {
            return sums.for_each(|sum| *sum = relu(*sum));
        }
        sums.for_each(|sum| *sum = tanh(*sum));
    }
}

fn read_observation(observation: &[f32], inputs: &mut [f32]) {
    for (input, value) in inputs.iter_mut().zip(observation.iter().chain(core::iter::repeat(&0.0))) {
        *input = if value.is_nan() { 0.0 } else { value.limited(-INPUT_LIMIT, INPUT_LIMIT) };
    }
}

impl<'a> FloatLayer<'a> {
    pub(crate) fn apply(&self, inputs: &[f32], outputs: &mut [f32]) {
        let inputs = inputs.get(..self.inputs).unwrap_or_default();
        let outputs = outputs.get_mut(..self.padded_outputs).unwrap_or_default();
        dense(self.weights, self.bias, inputs, outputs);
    }

    /// Splits the parameters of a layer off `bytes`.
    pub(crate) fn split(bytes: &'a [u8], inputs: usize, outputs: usize) -> Result<(Self, &'a [u8]), PolicyError> {
        let expected = layer_bytes(inputs, outputs);
        let found = bytes.len();
        let (layer, rest) = bytes.split_at_checked(expected).ok_or(PolicyError::Length { found, expected })?;
        let padded_outputs = outputs.next_multiple_of(ROW_BLOCK);
        let (bias, weights) = layer.split_at_checked(4 * padded_outputs).unwrap_or_default();
        Ok((Self { inputs, padded_outputs, bias, weights }, rest))
    }

    pub(crate) fn weight(&self, row: usize, column: usize) -> f32 {
        if column >= self.inputs {
            return 0.0;
        }
        let wide = self.padded_outputs - self.padded_outputs % WIDE_ROW_BLOCK;
        let (start, row, height) =
            if row < wide { (0, row, WIDE_ROW_BLOCK) } else { (wide * self.inputs, row - wide, ROW_BLOCK) };
        word_at(self.weights, start + (row / height * self.inputs + column) * height + row % height)
    }

    /// The bias in `row`; zero beyond the rows.
    pub(crate) fn bias(&self, row: usize) -> f32 {
        word_at(self.bias, row)
    }

    pub(crate) fn check(&self, layer: usize) -> Result<(), PolicyError> {
        let finite =
            |bytes: &[u8]| bytes.as_chunks::<4>().0.iter().all(|&word| f32::from_le_bytes(word).is_finite());
        let valid = finite(self.bias) && finite(self.weights);
        valid.then_some(()).ok_or(PolicyError::NotFinite { layer })
    }
}

/// Zero beyond the end.
fn word_at(bytes: &[u8], index: usize) -> f32 {
    bytes.as_chunks::<4>().0.get(index).map_or(0.0, |word| f32::from_le_bytes(*word))
}

/// `outputs = bias + weights · inputs`.
#[inline(never)]
pub(crate) fn dense(weights: &[u8], bias: &[u8], inputs: &[f32], outputs: &mut [f32]) {
    let wide = outputs.len() - outputs.len() % WIDE_ROW_BLOCK;
    let (wide_weights, narrow_weights) = weights.split_at_checked(4 * wide * inputs.len()).unwrap_or_default();
    let (wide_bias, narrow_bias) = bias.split_at_checked(4 * wide).unwrap_or_default();
    let (wide_outputs, narrow_outputs) = outputs.split_at_mut_checked(wide).unwrap_or_default();
    row_blocks::<WIDE_ROW_BLOCK>(wide_weights, wide_bias, inputs, wide_outputs);
    row_blocks::<ROW_BLOCK>(narrow_weights, narrow_bias, inputs, narrow_outputs);
}

#[inline(always)]
fn row_blocks<const ROWS: usize>(weights: &[u8], bias: &[u8], inputs: &[f32], outputs: &mut [f32]) {
    let mut columns = weights.as_chunks::<4>().0.as_chunks::<ROWS>().0.iter();
    let biases = bias.as_chunks::<4>().0.as_chunks::<ROWS>().0;
    for (bias, outputs) in biases.iter().zip(outputs.as_chunks_mut::<ROWS>().0) {
        let mut sums = bias.map(f32::from_le_bytes);
        for input in inputs {
            let Some(column) = columns.next() else { break };
            for (sum, weight) in sums.iter_mut().zip(column) {
                *sum += f32::from_le_bytes(*weight) * input;
            }
        }
        *outputs = sums;
    }
}

impl FloatScratch {
    /// Contents do not matter: every inference writes before it reads.
    pub const fn new() -> Self {
        Self { inputs: [0.0; SCRATCH_LEN], outputs: [0.0; SCRATCH_LEN] }
    }
}

impl Default for FloatScratch {
    fn default() -> Self {
        Self::new()
    }
}

/// Bytes of the parameters of a layer in a policy file.
pub(crate) const fn layer_bytes(inputs: usize, outputs: usize) -> usize {
    4 * outputs.next_multiple_of(ROW_BLOCK) * (inputs + 1)
}

impl<'a> Mlp<'a> {
    /// A view of `parameters`, the layers between `widths` one after the other, with `activation` between them.
    ///
    /// # Errors
    /// [`PolicyError::NotFinite`], or [`PolicyError::Length`] where the parameters end too early; [`PolicyError::MissingFeature`]
    /// without the feature `float`.
    #[cfg_attr(not(feature = "px4"), expect(unused_variables, reason = "there is one activation"))]
    pub(crate) fn from_parameters(
        widths: &[u16],
        activation: Activation,
        parameters: &'a [u8],
    ) -> Result<Self, PolicyError> {
        let missing = PolicyError::MissingFeature { needs: "float32 arithmetic", feature: "float" };
        let supported = SUPPORTED.ok_or(missing)?;
        let mut layers = Vec::new();
        let mut rest = parameters;
        for (index, (&inputs, &outputs)) in widths.iter().zip(widths.iter().skip(1)).enumerate() {
            let (layer, following) = FloatLayer::split(rest, usize::from(inputs), usize::from(outputs))?;
            layer.check(index)?;
            layers.push(layer).map_err(|_| PolicyError::LayerCount { found: LAYER_LIMIT + 1 })?;
            rest = following;
        }
        Ok(Self {
            _supported: supported,
            layers,
            outputs: usize::from(widths.last().copied().unwrap_or_default()),
            #[cfg(feature = "px4")]
            activation,
        })
    }
}

/// What follows the sums of hidden layers; a network without one counts as one with tangents.
pub(crate) fn hidden_activation(layers: &[DenseLayer<'_>]) -> Activation {
    match layers {
        [first, _, ..] => first.activation,
        [] | [_] => Activation::Tanh,
    }
}

impl DenseLayer<'_> {
    /// Whether the slices have the lengths that the shape asks for.
    pub fn is_complete(&self) -> bool {
        self.weights.len() == self.inputs * self.outputs && self.bias.len() == self.outputs
    }

    /// A weight; zero beyond the matrix, which is what padding is filled with.
    pub(crate) fn weight(&self, row: usize, column: usize) -> f32 {
        if row >= self.outputs || column >= self.inputs {
            return 0.0;
        }
        self.weights.get(row * self.inputs + column).copied().unwrap_or(0.0)
    }

    /// A bias; zero beyond the rows.
    pub(crate) fn bias_of(&self, row: usize) -> f32 {
        self.bias.get(row).copied().unwrap_or(0.0)
    }

    /// The parameters in the order of the policy file, padding included.
    pub(crate) fn packed(&self) -> impl Iterator<Item = f32> + '_ {
        let padded_outputs = self.outputs.next_multiple_of(ROW_BLOCK);
        let wide = padded_outputs - padded_outputs % WIDE_ROW_BLOCK;
        let blocks = |rows: core::ops::Range<usize>, height: usize| {
            rows.step_by(height).flat_map(move |first| {
                (0..self.inputs)
                    .flat_map(move |column| (first..first + height).map(move |row| self.weight(row, column)))
            })
        };
        (0..padded_outputs)
            .map(|row| self.bias_of(row))
            .chain(blocks(0..wide, WIDE_ROW_BLOCK))
            .chain(blocks(wide..padded_outputs, ROW_BLOCK))
    }
}
