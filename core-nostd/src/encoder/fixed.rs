//! The encoder in integers.

use heapless::Vec;

use super::stage::{FILTER_BLOCK, TERM_GROUP};
use super::walk::walk;
use super::{EncoderError, EncoderShape, EncoderStage, STAGE_LIMIT};

/// Least and greatest bits of an activation. With the least, no weights of a stage can overflow its sums.
pub(super) const CODE_BITS: core::ops::RangeInclusive<u8> = 8..=15;

/// Bits of a byte of the image.
const IMAGE_BITS: u8 = 8;

/// The constant shift of requantisation: one instruction (`smmul`) on a Cortex-M4.
pub(super) const REQUANTISATION_SHIFT: u32 = 32;

/// An encoder with 8-bit weights whose parameters lie in borrowed bytes.
#[derive(Clone, Debug)]
pub struct FixedEncoder<'a> {
    shape: EncoderShape,
    layers: Vec<FixedStage<'a>, STAGE_LIMIT>,
}

#[derive(Clone, Copy, Debug)]
struct FixedStage<'a> {
    stage: EncoderStage,
    /// Greatest activation.
    limit: i16,
    /// Little-endian `i32`, a half of the output's unit included.
    bias: &'a [u8],
    /// Little-endian `i32`, at least zero.
    multipliers: &'a [u8],
    /// `i8`, in blocks.
    weights: &'a [u8],
}

impl<'a> FixedEncoder<'a> {
    /// A view of `parameters`, the stages of `shape` one after the other as in a policy file, with activations of
    /// `code_bits` \[bits\] behind each stage.
    ///
    /// # Errors
    /// [`EncoderError::ParameterLength`], [`EncoderError::CodeBits`], [`EncoderError::Multiplier`], [`EncoderError::Padding`], or [`EncoderError::Overflow`]
    /// where some image might make a sum leave 32 bits.
    pub fn from_parameters(
        shape: EncoderShape,
        code_bits: &[u8; STAGE_LIMIT],
        parameters: &'a [u8],
    ) -> Result<Self, EncoderError> {
        let (found, expected) = (parameters.len(), shape.fixed_bytes());
        if found != expected {
            return Err(EncoderError::ParameterLength { found, expected, unit: "bytes" });
        }
        let mut layers = Vec::new();
        let mut rest = parameters;
        let mut input_limit = limit_of(IMAGE_BITS);
        let last = shape.stages().len().saturating_sub(1);
        for (index, (stage, bits)) in shape.stages().iter().zip(code_bits).enumerate() {
            if !CODE_BITS.contains(bits) || (index == last && bits != CODE_BITS.end()) {
                return Err(EncoderError::CodeBits { stage: index, found: *bits });
            }
            let (bytes, following) = rest.split_at_checked(stage.fixed_bytes()).unwrap_or_default();
            let layer = FixedStage::new(*stage, limit_of(*bits), bytes);
            layer.check(index, input_limit)?;
            // Cannot fail: a shape has no more stages.
            let _ = layers.push(layer);
            (rest, input_limit) = (following, layer.limit);
        }
        Ok(Self { shape, layers })
    }

    /// What it reads and what it makes of it.
    pub fn shape(&self) -> &EncoderShape {
        &self.shape
    }

    /// Writes the features of `image` `[rows][columns][channels]` to `features`, 0 to 32767 in the format of the
    /// network's inputs; the same bits on every machine.
    ///
    /// `scratch` has [`EncoderShape::scratch_len`] values, whose contents do not matter.
    ///
    /// # Errors
    /// [`EncoderError::ImageLength`], [`EncoderError::ScratchLength`] or [`EncoderError::FeatureLength`].
    pub fn encode(&self, image: &[u8], scratch: &mut [i16], features: &mut [i16]) -> Result<(), EncoderError> {
        self.encode_each(image, scratch, features, |_, _| {})
    }

    /// As [`Self::encode`], and shows each stage's activations `[rows][columns][filters]` behind its number.
    ///
    /// # Errors
    /// As [`Self::encode`].
    pub fn encode_each(
        &self,
        image: &[u8],
        scratch: &mut [i16],
        features: &mut [i16],
        show: impl FnMut(usize, &[i16]),
    ) -> Result<(), EncoderError> {
        let sums = |index: usize, terms: &[i16], output: &mut [i16]| {
            if let Some(layer) = self.layers.get(index) {
                layer.sums(terms, output);
            }
        };
        walk(&self.shape, (image, scratch, features), i16::from, sums, show)
    }
}

/// Greatest activation of so many bits.
pub(super) const fn limit_of(bits: u8) -> i16 {
    (i16::MAX as u16 >> (*CODE_BITS.end() - bits)) as i16
}

impl<'a> FixedStage<'a> {
    fn new(stage: EncoderStage, limit: i16, bytes: &'a [u8]) -> Self {
        let words = size_of::<i32>() * stage.filters().next_multiple_of(FILTER_BLOCK);
        let (bias, rest) = bytes.split_at_checked(words).unwrap_or_default();
        let (multipliers, weights) = rest.split_at_checked(words).unwrap_or_default();
        Self { stage, limit, bias, multipliers, weights }
    }

    fn groups(&self) -> usize {
        self.stage.terms().div_ceil(TERM_GROUP)
    }

    /// `terms` may go on beyond the last with anything: weights of padding are zero.
    fn sums(&self, terms: &[i16], output: &mut [i16]) {
        let groups = terms.as_chunks::<TERM_GROUP>().0.get(..self.groups()).unwrap_or_default();
        dense(self, groups, output);
    }

    /// Refuses a negative multiplier, weights in the padding, and a filter of which a sum could leave 32 bits with inputs in
    /// \[0, `input_limit`\].
    fn check(&self, stage: usize, input_limit: i16) -> Result<(), EncoderError> {
        let block_bytes = FILTER_BLOCK * TERM_GROUP * self.groups();
        let words = self.bias.as_chunks::<4>().0.iter().zip(self.multipliers.as_chunks::<4>().0);
        for (filter, (bias, multiplier)) in words.enumerate() {
            let found = i32::from_le_bytes(*multiplier);
            if found < 0 {
                return Err(EncoderError::Multiplier { stage, filter, found });
            }
            let block = self.weights.chunks_exact(block_bytes.max(1)).nth(filter / FILTER_BLOCK);
            let groups = block.unwrap_or_default().as_chunks::<TERM_GROUP>().0.iter();
            let own = groups.skip(filter % FILTER_BLOCK).step_by(FILTER_BLOCK).flatten();
            if own.clone().skip(self.stage.terms()).any(|code| *code != 0) {
                return Err(EncoderError::Padding { stage, filter });
            }
            let magnitude: i64 = own.map(|code| i64::from(i8::from_le_bytes([*code]).unsigned_abs())).sum();
            let bias = i64::from(i32::from_le_bytes(*bias).unsigned_abs());
            let largest = magnitude * i64::from(input_limit) + bias;
            if largest > i64::from(i32::MAX) {
                return Err(EncoderError::Overflow { stage, filter, largest });
            }
        }
        Ok(())
    }
}

/// `output = (bias + weights · terms) · multiplier · 2⁻³²`, limited to \[0, limit\], for every row of the matrix.
///
/// Wraps where a sum leaves 32 bits, which [`FixedStage::check`] excludes.
#[inline(never)]
fn dense(layer: &FixedStage<'_>, terms: &[[i16; TERM_GROUP]], output: &mut [i16]) {
    let limit = i32::from(layer.limit);
    let mut weights = layer.weights.as_chunks::<TERM_GROUP>().0.as_chunks::<FILTER_BLOCK>().0;
    let biases = layer.bias.as_chunks::<4>().0.as_chunks::<FILTER_BLOCK>().0;
    let multipliers = layer.multipliers.as_chunks::<4>().0.as_chunks::<FILTER_BLOCK>().0;
    let outputs = output.as_chunks_mut::<FILTER_BLOCK>().0;
    for ((bias, multipliers), outputs) in biases.iter().zip(multipliers).zip(outputs) {
        let (block, following) = weights.split_at_checked(terms.len()).unwrap_or_default();
        weights = following;
        let mut sums = bias.map(i32::from_le_bytes);
        for (group, terms) in block.iter().zip(terms) {
            sums = with_products(sums, group, *terms);
        }
        for ((output, sum), multiplier) in outputs.iter_mut().zip(sums).zip(multipliers) {
            let product = i64::from(sum) * i64::from(i32::from_le_bytes(*multiplier));
            *output = ((product >> REQUANTISATION_SHIFT) as i32).max(0).min(limit) as i16;
        }
    }
}

/// Adds four terms to the sums of a block of filters.
#[inline(always)]
fn with_products(
    sums: [i32; FILTER_BLOCK],
    weights: &[[u8; TERM_GROUP]; FILTER_BLOCK],
    terms: [i16; TERM_GROUP],
) -> [i32; FILTER_BLOCK] {
    core::array::from_fn(|filter| {
        let mut sum = sums[filter];
        for (code, term) in weights[filter].iter().zip(terms) {
            sum = sum.wrapping_add(i32::from(i8::from_le_bytes([*code])).wrapping_mul(i32::from(term)));
        }
        sum
    })
}
