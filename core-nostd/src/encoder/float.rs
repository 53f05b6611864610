//! The encoder in `f32`.

use heapless::Vec;

use super::stage::FILTER_BLOCK;
use super::walk::walk;
use super::{EncoderError, EncoderShape, EncoderStage, STAGE_LIMIT};
use crate::mlp;

/// What a byte of an image is: a 255th each, rounded once.
const LEVELS: [f32; 256] = levels();

/// An encoder whose parameters lie in borrowed bytes.
#[derive(Clone, Debug)]
pub struct Encoder<'a> {
    shape: EncoderShape,
    layers: Vec<FloatStage<'a>, STAGE_LIMIT>,
}

#[derive(Clone, Copy, Debug)]
struct FloatStage<'a> {
    stage: EncoderStage,
    /// Little-endian `f32`.
    bias: &'a [u8],
    /// Little-endian `f32`, in blocks, as in [`crate::mlp`].
    weights: &'a [u8],
}

impl<'a> Encoder<'a> {
    /// A view of `parameters`, the stages of `shape` one after the other as in a policy file.
    ///
    /// # Errors
    /// [`EncoderError::ParameterLength`] or [`EncoderError::NotFinite`].
    pub fn from_parameters(shape: EncoderShape, parameters: &'a [u8]) -> Result<Self, EncoderError> {
        let (found, expected) = (parameters.len(), shape.float_bytes());
        if found != expected {
            return Err(EncoderError::ParameterLength { found, expected, unit: "bytes" });
        }
        let mut layers = Vec::new();
        let mut rest = parameters;
        for (index, stage) in shape.stages().iter().enumerate() {
            let (bytes, following) = rest.split_at_checked(stage.float_bytes()).unwrap_or_default();
            let finite = bytes.as_chunks::<4>().0.iter().all(|&word| f32::from_le_bytes(word).is_finite());
            if !finite {
                return Err(EncoderError::NotFinite { stage: index });
            }
            // Cannot fail: a shape has no more stages.
            let _ = layers.push(FloatStage::new(*stage, bytes));
            rest = following;
        }
        Ok(Self { shape, layers })
    }

    /// What it reads and what it makes of it.
    pub fn shape(&self) -> &EncoderShape {
        &self.shape
    }

    /// Writes the features of `image` `[rows][columns][channels]` to `features`, each at least zero.
    ///
    /// `scratch` has [`EncoderShape::scratch_len`] values, whose contents do not matter. The features are finite while
    /// no sum exceeds the range of `f32`, and never NaN.
    ///
    /// # Errors
    /// [`EncoderError::ImageLength`], [`EncoderError::ScratchLength`] or [`EncoderError::FeatureLength`].
    pub fn encode(&self, image: &[u8], scratch: &mut [f32], features: &mut [f32]) -> Result<(), EncoderError> {
        self.encode_each(image, scratch, features, |_, _| {})
    }

    /// As [`Self::encode`], and shows each stage's activations `[rows][columns][filters]` behind its number.
    ///
    /// # Errors
    /// As [`Self::encode`].
    pub fn encode_each(
        &self,
        image: &[u8],
        scratch: &mut [f32],
        features: &mut [f32],
        show: impl FnMut(usize, &[f32]),
    ) -> Result<(), EncoderError> {
        let sums = |index: usize, terms: &[f32], output: &mut [f32]| {
            if let Some(layer) = self.layers.get(index) {
                layer.sums(terms, output);
            }
        };
        walk(&self.shape, (image, scratch, features), |byte| LEVELS[usize::from(byte)], sums, show)
    }
}

impl<'a> FloatStage<'a> {
    fn new(stage: EncoderStage, bytes: &'a [u8]) -> Self {
        let padded_filters = stage.filters().next_multiple_of(FILTER_BLOCK);
        let (bias, weights) = bytes.split_at_checked(size_of::<f32>() * padded_filters).unwrap_or_default();
        Self { stage, bias, weights }
    }

    /// `output = max(bias + weights · terms, 0)`; NaN becomes zero.
    fn sums(&self, terms: &[f32], output: &mut [f32]) {
        mlp::dense(self.weights, self.bias, terms.get(..self.stage.terms()).unwrap_or_default(), output);
        for value in output {
            *value = if *value > 0.0 { *value } else { 0.0 };
        }
    }
}

const fn levels() -> [f32; 256] {
    let mut levels = [0.0; 256];
    let mut byte = 0;
    while byte < levels.len() {
        levels[byte] = byte as f32 / 255.0;
        byte += 1;
    }
    levels
}
