//! From trained parameters to the bytes of a policy file: choosing formats, rounding, laying out.

use super::fixed::{CODE_BITS, REQUANTISATION_SHIFT, limit_of};
use super::stage::{FILTER_BLOCK, TERM_GROUP};
use super::{EncoderError, EncoderShape, EncoderStage, STAGE_LIMIT};
use crate::activation::Activation;
use crate::fixed::INPUT_FRACTION_BITS_LIMIT;
use crate::mlp::DenseLayer;

/// Greatest magnitude of a weight.
const WEIGHT_LIMIT: f64 = 127.0;

/// Activations may reach this many times the largest of the calibration before they saturate: one of 15 bits, which
/// are finer than what 8-bit weights compute.
const HEADROOM: f64 = 2.0;

/// Greatest magnitude of a bias without its half unit.
const BIAS_LIMIT: f64 = (1_u32 << 29) as f64;

/// Least multiplier: the half unit in the bias, 2³¹ divided by it, stays below 2²⁴.
const MULTIPLIER_LEAST: f64 = 256.0;

/// What biases leave of 31 bits for the products.
const PRODUCT_LIMIT: f64 = ((1_u32 << 31) - (1 << 29) - (1 << 24)) as f64;

/// Units of a sum in a unit of its activation, at least: the multiplier stays below 31 bits.
const UNITS_PER_OUTPUT: f64 = 2.001;

/// Value of one unit of a byte of the image.
const IMAGE_STEP: f64 = 1.0 / 255.0;

/// Number formats of the activations behind each stage; zero beyond the last.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EncoderFormat {
    /// Value of one unit; a power of two for the features, which are inputs of the network.
    pub steps: [f32; STAGE_LIMIT],
    /// Activations are below two to this power, 8 to 15.
    pub code_bits: [u8; STAGE_LIMIT],
}

/// A filter in integers: `(bias + Σ weight · term) · multiplier · 2⁻³²`.
struct Filter {
    /// Value of one unit of a weight.
    step: f64,
    multiplier: f64,
    bias: f64,
}

impl EncoderFormat {
    /// The finest formats for an encoder whose activations reach `largest` behind each stage, with features in
    /// 2^-`feature_fraction_bits`: activations may reach twice as much before they saturate, and no sum can leave 32
    /// bits, whatever the image.
    ///
    /// # Errors
    /// [`EncoderError::ParameterLength`], [`EncoderError::NotFinite`], [`EncoderError::NoFormat`], or
    /// [`EncoderError::FeatureFractionBits`] where fewer would do.
    pub fn calibrated(
        shape: &EncoderShape,
        parameters: &[f32],
        largest: &[f32; STAGE_LIMIT],
        feature_fraction_bits: u8,
    ) -> Result<Self, EncoderError> {
        check_parameters(shape, parameters)?;
        let mut format = Self::default();
        let mut input_step = IMAGE_STEP;
        let mut layers = layers(shape, parameters).map(|(_, layer)| layer).enumerate().peekable();
        while let Some((index, layer)) = layers.next() {
            if index == 0 && largest_weight_sum(&layer) * f64::from(limit_of(8)) > PRODUCT_LIMIT {
                return Err(EncoderError::NoFormat { stage: 0 });
            }
            let (bits, step) = if let Some((_, next)) = layers.peek() {
                let bits = finest_bits(next).ok_or(EncoderError::NoFormat { stage: index + 1 })?;
                let activation = f64::from(largest.get(index).copied().unwrap_or_default());
                (bits, output_step(&layer, input_step, activation, bits))
            } else {
                let step = feature_step(feature_fraction_bits);
                if finest_step(&layer, input_step) > step {
                    return Err(EncoderError::FeatureFractionBits { found: feature_fraction_bits });
                }
                (*CODE_BITS.end(), step)
            };
            let step = step as f32;
            if !step.is_normal() {
                return Err(EncoderError::NoFormat { stage: index });
            }
            format.set(index, bits, step);
            input_step = f64::from(step);
        }
        Ok(format)
    }

    fn set(&mut self, stage: usize, bits: u8, step: f32) {
        if let (Some(code_bits), Some(slot)) = (self.code_bits.get_mut(stage), self.steps.get_mut(stage)) {
            (*code_bits, *slot) = (bits, step);
        }
    }
}

/// Writes `parameters` (see [`EncoderShape`]) as [`Encoder`](super::Encoder) reads them, into [`EncoderShape::float_bytes`] bytes.
///
/// # Errors
/// [`EncoderError::ParameterLength`] or [`EncoderError::NotFinite`].
pub fn write_float(shape: &EncoderShape, parameters: &[f32], bytes: &mut [u8]) -> Result<(), EncoderError> {
    check_parameters(shape, parameters)?;
    check_bytes(bytes, shape.float_bytes())?;
    let words = layers(shape, parameters).map(|(_, layer)| layer);
    let mut slots = bytes.as_chunks_mut::<4>().0.iter_mut();
    for layer in words {
        for (word, slot) in layer.packed().zip(slots.by_ref()) {
            *slot = word.to_le_bytes();
        }
    }
    Ok(())
}

/// Writes `parameters` (see [`EncoderShape`]) in `format` as [`FixedEncoder`](super::FixedEncoder) reads them, into
/// [`EncoderShape::fixed_bytes`] bytes; each weight is rounded to the nearest of 255 steps of its filter.
///
/// # Errors
/// [`EncoderError::ParameterLength`] or [`EncoderError::NotFinite`]. A format that is not of these parameters is found out
/// when the bytes are read.
pub fn write_fixed(
    shape: &EncoderShape,
    parameters: &[f32],
    format: &EncoderFormat,
    bytes: &mut [u8],
) -> Result<(), EncoderError> {
    check_parameters(shape, parameters)?;
    check_bytes(bytes, shape.fixed_bytes())?;
    bytes.fill(0);
    let mut rest = bytes;
    let mut input_step = IMAGE_STEP;
    for ((stage, layer), step) in layers(shape, parameters).zip(format.steps) {
        let (own, following) = rest.split_at_mut_checked(stage.fixed_bytes()).unwrap_or_default();
        write_stage(&stage, &layer, (input_step, f64::from(step)), own);
        input_step = f64::from(step);
        rest = following;
    }
    Ok(())
}

fn write_stage(
    stage: &EncoderStage,
    layer: &DenseLayer<'_>,
    (input_step, output_step): (f64, f64),
    bytes: &mut [u8],
) {
    let words = size_of::<i32>() * stage.filters().next_multiple_of(FILTER_BLOCK);
    let (biases, rest) = bytes.split_at_mut_checked(words).unwrap_or_default();
    let (multipliers, weights) = rest.split_at_mut_checked(words).unwrap_or_default();
    let biases = biases.as_chunks_mut::<4>().0.iter_mut();
    let words = biases.zip(multipliers.as_chunks_mut::<4>().0);
    let weights = weights.as_chunks_mut::<TERM_GROUP>().0;
    let groups = stage.terms().div_ceil(TERM_GROUP);
    for (row, (bias, multiplier)) in words.enumerate().take(layer.outputs) {
        let filter = Filter::new(layer, row, input_step, output_step);
        *bias = (filter.bias as i32).to_le_bytes();
        *multiplier = (filter.multiplier as i32).to_le_bytes();
        let first = row / FILTER_BLOCK * FILTER_BLOCK * groups + row % FILTER_BLOCK;
        let own = weights.iter_mut().skip(first).step_by(FILTER_BLOCK).flatten();
        for (slot, term) in own.zip(0..layer.inputs) {
            *slot = code(layer.weight(row, term), filter.step).to_le_bytes()[0];
        }
    }
}

impl Filter {
    fn new(layer: &DenseLayer<'_>, row: usize, input_step: f64, output_step: f64) -> Self {
        let multiplier_unit = (1_u64 << REQUANTISATION_SHIFT) as f64 * input_step / output_step;
        let step = finest_filter_step(layer, row, input_step).max(MULTIPLIER_LEAST / multiplier_unit);
        let multiplier = libm::round(step * multiplier_unit);
        let half = (1_u64 << (REQUANTISATION_SHIFT - 1)) as f64 / multiplier;
        Self { step, multiplier, bias: libm::round(f64::from(layer.bias_of(row)) / (step * input_step) + half) }
    }
}

/// Rounds each weight to the nearest of 255 steps of its filter, as [`write_fixed`] does where the largest weight sets the
/// step; biases stay. Parameters that are not of the shape are left as they are.
pub fn round_weights(shape: &EncoderShape, parameters: &mut [f32]) {
    if parameters.len() != shape.parameter_count() {
        return;
    }
    let mut rest = parameters;
    for stage in shape.stages() {
        let (inputs, outputs) = (stage.terms(), stage.filters());
        let (weights, following) = rest.split_at_mut_checked(inputs * outputs).unwrap_or_default();
        for filter in weights.chunks_exact_mut(inputs.max(1)) {
            let largest = filter.iter().fold(0.0, |largest: f32, weight| largest.max(weight.abs()));
            let step = f64::from(largest) / WEIGHT_LIMIT;
            if step > 0.0 {
                for weight in filter {
                    *weight = (f64::from(code(*weight, step)) * step) as f32;
                }
            }
        }
        (_, rest) = following.split_at_mut_checked(outputs).unwrap_or_default();
    }
}

/// The nearest integer, halves away from zero.
fn code(weight: f32, step: f64) -> i8 {
    // `as` saturates.
    libm::round(f64::from(weight) / step) as i8
}

/// The step with which no weight is beyond ±127 and the bias not beyond its limit.
fn finest_filter_step(layer: &DenseLayer<'_>, row: usize, input_step: f64) -> f64 {
    let bias = f64::from(layer.bias_of(row)).abs();
    (largest_weight(layer, row) / WEIGHT_LIMIT).max(bias / (input_step * BIAS_LIMIT))
}

fn largest_weight(layer: &DenseLayer<'_>, row: usize) -> f64 {
    let weights = (0..layer.inputs).map(|column| f64::from(layer.weight(row, column)).abs());
    weights.fold(0.0, f64::max)
}

/// The step of activations with which every multiplier is below 31 bits.
fn finest_step(layer: &DenseLayer<'_>, input_step: f64) -> f64 {
    let steps = (0..layer.outputs).map(|row| finest_filter_step(layer, row, input_step));
    UNITS_PER_OUTPUT * input_step * steps.fold(0.0, f64::max)
}

fn output_step(layer: &DenseLayer<'_>, input_step: f64, largest: f64, bits: u8) -> f64 {
    // What was never active gets the range of what is of order one.
    let reach = if largest > 0.0 { HEADROOM * largest } else { HEADROOM };
    (reach / f64::from(limit_of(bits))).max(finest_step(layer, input_step))
}

fn feature_step(fraction_bits: u8) -> f64 {
    1.0 / f64::from(1_u32 << fraction_bits.min(INPUT_FRACTION_BITS_LIMIT))
}

/// The most bits that a layer's inputs can have.
fn finest_bits(layer: &DenseLayer<'_>) -> Option<u8> {
    let sum = largest_weight_sum(layer);
    CODE_BITS.rev().find(|bits| sum * f64::from(limit_of(*bits)) <= PRODUCT_LIMIT)
}

/// Largest sum of a filter's weights in units, with the finest steps.
fn largest_weight_sum(layer: &DenseLayer<'_>) -> f64 {
    let sum = |row| {
        let step = largest_weight(layer, row) / WEIGHT_LIMIT;
        let codes = (0..layer.inputs).map(|column| f64::from(code(layer.weight(row, column), step)).abs());
        codes.sum::<f64>()
    };
    (0..layer.outputs).map(sum).fold(0.0, f64::max)
}

/// The stages with their parameters, whose number was checked.
fn layers<'a>(
    shape: &'a EncoderShape,
    parameters: &'a [f32],
) -> impl Iterator<Item = (EncoderStage, DenseLayer<'a>)> + 'a {
    let mut rest = parameters;
    let mut take = move |count: usize| {
        let (taken, left) = rest.split_at_checked(count).unwrap_or_default();
        rest = left;
        taken
    };
    shape.stages().iter().map(move |stage| {
        let (inputs, outputs) = (stage.terms(), stage.filters());
        let (weights, bias) = (take(inputs * outputs), take(outputs));
        (*stage, DenseLayer { inputs, outputs, weights, bias, activation: Activation::Relu })
    })
}

fn check_parameters(shape: &EncoderShape, parameters: &[f32]) -> Result<(), EncoderError> {
    let (found, expected) = (parameters.len(), shape.parameter_count());
    if found != expected {
        return Err(EncoderError::ParameterLength { found, expected, unit: "values" });
    }
    let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
    let broken = layers(shape, parameters).position(|(_, layer)| !finite(layer.weights) || !finite(layer.bias));
    broken.map_or(Ok(()), |stage| Err(EncoderError::NotFinite { stage }))
}

fn check_bytes(bytes: &[u8], expected: usize) -> Result<(), EncoderError> {
    let found = bytes.len();
    if found == expected { Ok(()) } else { Err(EncoderError::ParameterLength { found, expected, unit: "bytes" }) }
}
