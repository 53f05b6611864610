//! The eye in `f32`.

use heapless::Vec;

use super::stage::FILTER_BLOCK;
use super::walk::walk;
use super::{EyeError, EyeShape, STAGE_LIMIT, Stage};
use crate::mlp;

/// What a byte of an image is: a 255th each, rounded once.
const LEVELS: [f32; 256] = levels();

/// An eye whose parameters lie in borrowed bytes.
#[derive(Clone, Debug)]
pub struct Eye<'a> {
    shape: EyeShape,
    layers: Vec<Layer<'a>, STAGE_LIMIT>,
}

#[derive(Clone, Copy, Debug)]
struct Layer<'a> {
    stage: Stage,
    /// Little-endian `f32`.
    bias: &'a [u8],
    /// Little-endian `f32`, in blocks, as in [`crate::mlp`].
    weights: &'a [u8],
}

impl<'a> Eye<'a> {
    /// A view of `parameters`, the stages of `shape` one after the other as in a policy file.
    ///
    /// # Errors
    /// [`EyeError::ParameterLength`] or [`EyeError::NotFinite`].
    pub fn from_parameters(shape: EyeShape, parameters: &'a [u8]) -> Result<Self, EyeError> {
        let (found, expected) = (parameters.len(), shape.float_bytes());
        if found != expected {
            return Err(EyeError::ParameterLength { found, expected, unit: "bytes" });
        }
        let mut layers = Vec::new();
        let mut rest = parameters;
        for (index, stage) in shape.stages().iter().enumerate() {
            let (bytes, following) = rest.split_at_checked(stage.float_bytes()).unwrap_or_default();
            let finite = bytes.as_chunks::<4>().0.iter().all(|&word| f32::from_le_bytes(word).is_finite());
            if !finite {
                return Err(EyeError::NotFinite { stage: index });
            }
            // Cannot fail: a shape has no more stages.
            let _ = layers.push(Layer::new(*stage, bytes));
            rest = following;
        }
        Ok(Self { shape, layers })
    }

    /// What it looks at and what it makes of it.
    pub fn shape(&self) -> &EyeShape {
        &self.shape
    }

    /// Writes what it sees in `image` `[rows][columns][channels]` to `features`, each at least zero.
    ///
    /// `scratch` has [`EyeShape::scratch_len`] values, whose contents do not matter. The features are finite while
    /// no sum exceeds the range of `f32`, and never NaN.
    ///
    /// # Errors
    /// [`EyeError::ImageLength`], [`EyeError::ScratchLength`] or [`EyeError::FeatureLength`].
    pub fn see(&self, image: &[u8], scratch: &mut [f32], features: &mut [f32]) -> Result<(), EyeError> {
        self.see_each(image, scratch, features, |_, _| {})
    }

    /// As [`Self::see`], and shows each stage's activations `[rows][columns][filters]` behind its number.
    ///
    /// # Errors
    /// As [`Self::see`].
    pub fn see_each(
        &self,
        image: &[u8],
        scratch: &mut [f32],
        features: &mut [f32],
        show: impl FnMut(usize, &[f32]),
    ) -> Result<(), EyeError> {
        let sums = |index: usize, terms: &[f32], output: &mut [f32]| {
            if let Some(layer) = self.layers.get(index) {
                layer.sums(terms, output);
            }
        };
        walk(&self.shape, (image, scratch, features), |byte| LEVELS[usize::from(byte)], sums, show)
    }
}

impl<'a> Layer<'a> {
    fn new(stage: Stage, bytes: &'a [u8]) -> Self {
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
