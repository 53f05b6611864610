//! The shape of an encoder: the image, its convolutions, the features, and what follows from them.

use super::EncoderError;
use super::stage::{Convolution, EncoderStage, TERM_GROUP, Volume};

/// Most convolutions of an encoder.
pub const CONVOLUTION_LIMIT: usize = 4;

/// Most stages: the convolutions, then the dense layer.
pub const STAGE_LIMIT: usize = CONVOLUTION_LIMIT + 1;

/// Most rows or columns of an image.
pub const SIDE_LIMIT: u16 = 1024;

/// Most channels of an image and most filters of a convolution.
pub const CHANNEL_LIMIT: u16 = 256;

/// Most features.
pub const FEATURE_LIMIT: u16 = 512;

/// Most products of one sum: with them, 8-bit codes and 8-bit weights cannot leave 32 bits.
pub const TERM_LIMIT: usize = 1 << 16;

/// Largest side of a kernel and largest stride.
pub const KERNEL_LIMIT: u16 = 255;

/// The shape of an encoder.
///
/// Its parameters are one slice: for each stage the weights `[filters][kernel row][kernel column][channel]`, then the
/// biases `[filters]`; the last stage is the dense layer, `[features][flattened]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EncoderShape {
    /// Zero beyond the last.
    stages: [EncoderStage; STAGE_LIMIT],
    count: usize,
}

impl EncoderShape {
    /// An encoder for `image`, with `convolutions` and then a dense layer of `features`.
    ///
    /// # Errors
    /// The variant of [`EncoderError`] that says what is too small, too large or does not fit.
    pub const fn new(image: Volume, convolutions: &[Convolution], features: u16) -> Result<Self, EncoderError> {
        let Volume { rows, columns, channels } = image;
        if rows == 0 || rows > SIDE_LIMIT || columns == 0 || columns > SIDE_LIMIT {
            return Err(EncoderError::ImageShape { rows, columns, channels });
        }
        if channels == 0 || channels > CHANNEL_LIMIT {
            return Err(EncoderError::ImageShape { rows, columns, channels });
        }
        if convolutions.is_empty() || convolutions.len() > CONVOLUTION_LIMIT {
            return Err(EncoderError::ConvolutionCount { found: convolutions.len() });
        }
        if features == 0 || features > FEATURE_LIMIT {
            return Err(EncoderError::FeatureCount { found: features });
        }
        let empty = Volume { rows: 0, columns: 0, channels: 0 };
        let absent = EncoderStage { input: empty, kernel_rows: 0, kernel_columns: 0, stride: 0, output: empty };
        let mut shape = Self { stages: [absent; STAGE_LIMIT], count: convolutions.len() + 1 };
        let mut input = image;
        let mut index = 0;
        while index < CONVOLUTION_LIMIT && index < convolutions.len() {
            match checked(index, input, convolutions[index]) {
                Ok(stage) => shape.stages[index] = stage,
                Err(error) => return Err(error),
            }
            input = shape.stages[index].output;
            index += 1;
        }
        if input.len() > TERM_LIMIT {
            return Err(EncoderError::Terms { stage: index, found: input.len() });
        }
        shape.stages[index] = EncoderStage::dense(input, features);
        Ok(shape)
    }

    /// The convolutions, then the dense layer.
    pub fn stages(&self) -> &[EncoderStage] {
        self.stages.get(..self.count).unwrap_or_default()
    }

    /// The image: bytes, of which 255 is one.
    pub const fn image(&self) -> Volume {
        self.stages[0].input
    }

    /// The convolutions, first to last.
    pub fn convolutions(&self) -> impl Iterator<Item = Convolution> + '_ {
        let stages = self.stages.iter().take(self.count.saturating_sub(1));
        stages.map(|stage| Convolution {
            filters: stage.output.channels,
            kernel: stage.kernel_rows,
            stride: stage.stride,
        })
    }

    /// Number of features.
    pub fn features(&self) -> usize {
        self.stages().last().map_or(0, EncoderStage::filters)
    }

    /// Number of weights and biases.
    pub const fn parameter_count(&self) -> usize {
        let mut count = 0;
        let mut index = 0;
        while index < STAGE_LIMIT {
            count += self.stages[index].parameter_count();
            index += 1;
        }
        count
    }

    /// Multiplications for one image, padding not counted.
    pub const fn multiply_accumulates(&self) -> usize {
        let mut count = 0;
        let mut index = 0;
        while index < STAGE_LIMIT {
            count += self.stages[index].multiply_accumulates();
            index += 1;
        }
        count
    }

    /// Bytes of the parameters in a policy file, in `f32`.
    pub const fn float_bytes(&self) -> usize {
        let mut bytes = 0;
        let mut index = 0;
        while index < STAGE_LIMIT {
            bytes += self.stages[index].float_bytes();
            index += 1;
        }
        bytes
    }

    /// Bytes of the parameters in a policy file, in 8-bit weights.
    pub const fn fixed_bytes(&self) -> usize {
        let mut bytes = 0;
        let mut index = 0;
        while index < STAGE_LIMIT {
            bytes += self.stages[index].fixed_bytes();
            index += 1;
        }
        bytes
    }

    /// Values of working memory, `f32` in float and `i16` in fixed point: what one filter reads, then two buffers
    /// that stages read and write in turn.
    pub const fn scratch_len(&self) -> usize {
        self.patch_len() + self.buffer_len(0) + self.buffer_len(1)
    }

    /// Values of the longest filter of a convolution, which are gathered so that they lie side by side.
    pub(super) const fn patch_len(&self) -> usize {
        let mut longest = 0;
        let mut index = 0;
        // The last stage is dense: its input lies side by side.
        while index < STAGE_LIMIT && index + 1 < self.count {
            longest = larger(longest, self.stages[index].terms().next_multiple_of(TERM_GROUP));
            index += 1;
        }
        longest
    }

    /// Values of the buffer that stages number `first`, `first` + 2, … write.
    pub(super) const fn buffer_len(&self, first: usize) -> usize {
        let mut longest = 0;
        let mut index = first;
        while index < STAGE_LIMIT {
            longest = larger(longest, self.stages[index].buffer_len());
            index += 2;
        }
        longest
    }

    pub(super) fn check_lengths(&self, image: usize, scratch: usize, features: usize) -> Result<(), EncoderError> {
        if image != self.image().len() {
            return Err(EncoderError::ImageLength { found: image, expected: self.image().len() });
        }
        if scratch < self.scratch_len() {
            return Err(EncoderError::ScratchLength { found: scratch, expected: self.scratch_len() });
        }
        if features != self.features() {
            return Err(EncoderError::FeatureLength { found: features, expected: self.features() });
        }
        Ok(())
    }
}

const fn checked(stage: usize, input: Volume, convolution: Convolution) -> Result<EncoderStage, EncoderError> {
    let Convolution { filters, kernel, stride } = convolution;
    if filters == 0 || filters > CHANNEL_LIMIT {
        return Err(EncoderError::FilterCount { stage, found: filters });
    }
    if stride == 0 || stride > KERNEL_LIMIT {
        return Err(EncoderError::Stride { stage, found: stride });
    }
    let side = if input.rows < input.columns { input.rows } else { input.columns };
    if kernel == 0 || kernel > KERNEL_LIMIT || kernel > side {
        return Err(EncoderError::Kernel { stage, found: kernel, side });
    }
    let checked = EncoderStage::of(input, convolution);
    if checked.terms() > TERM_LIMIT {
        return Err(EncoderError::Terms { stage, found: checked.terms() });
    }
    Ok(checked)
}

const fn larger(a: usize, b: usize) -> usize {
    if a > b { a } else { b }
}
