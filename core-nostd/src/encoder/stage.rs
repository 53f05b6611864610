//! A layer of an encoder: what it reads, how its filters walk over it, what it writes.

use serde::{Deserialize, Serialize};

/// Filters are stored in multiples of this.
pub(super) const FILTER_BLOCK: usize = crate::limits::ROW_BLOCK;

/// Terms of a fixed-point sum are stored in multiples of this.
pub(super) const TERM_GROUP: usize = 4;

/// An image, or activations: interleaved, `[rows][columns][channels]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Volume {
    /// From top to bottom.
    pub rows: u16,
    /// From left to right.
    pub columns: u16,
    /// Colours of a pixel, or filters that looked at it.
    pub channels: u16,
}

/// A convolution without padding, followed by a rectifier.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Convolution {
    /// Channels of its output, 1 to [`super::CHANNEL_LIMIT`].
    pub filters: u16,
    /// Rows and columns of a filter, 1 to [`super::KERNEL_LIMIT`].
    pub kernel: u16,
    /// Rows and columns between two places of a filter, 1 to [`super::KERNEL_LIMIT`].
    pub stride: u16,
}

/// A layer with weights. The dense layer is a convolution whose kernel is all of its input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EncoderStage {
    /// What it reads.
    pub input: Volume,
    /// Rows of a filter.
    pub kernel_rows: u16,
    /// Columns of a filter.
    pub kernel_columns: u16,
    /// Rows and columns between two places of a filter.
    pub stride: u16,
    /// What it writes; the channels are the filters.
    pub output: Volume,
}

impl Volume {
    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "no volume of an encoder is empty")]
    pub const fn len(&self) -> usize {
        self.rows as usize * self.columns as usize * self.channels as usize
    }
}

impl EncoderStage {
    /// Products in one sum: the length of a filter.
    pub const fn terms(&self) -> usize {
        self.kernel_rows as usize * self.kernel_columns as usize * self.input.channels as usize
    }

    /// Filters, which are the rows of the matrix of weights.
    pub const fn filters(&self) -> usize {
        self.output.channels as usize
    }

    /// Multiplications for one image, padding not counted.
    pub const fn multiply_accumulates(&self) -> usize {
        self.output.len() * self.terms()
    }

    /// Number of weights and biases.
    pub const fn parameter_count(&self) -> usize {
        self.filters() * (self.terms() + 1)
    }

    /// Bytes of the stage in a policy file, in `f32`.
    pub const fn float_bytes(&self) -> usize {
        crate::mlp::layer_bytes(self.terms(), self.filters())
    }

    /// Bytes of the stage in a policy file, in 8-bit weights: a bias and a multiplier per filter, then the weights.
    pub const fn fixed_bytes(&self) -> usize {
        let padded_terms = self.terms().next_multiple_of(TERM_GROUP);
        self.filters().next_multiple_of(FILTER_BLOCK) * (size_of::<i32>() + size_of::<i32>() + padded_terms)
    }

    /// Values that the activations take while they are written: every pixel is written with all filters of a block,
    /// and the next one over what is too much.
    pub(super) const fn buffer_len(&self) -> usize {
        let before_last = self.output.len().saturating_sub(self.filters());
        (before_last + self.filters().next_multiple_of(FILTER_BLOCK)).next_multiple_of(TERM_GROUP)
    }

    pub(super) const fn of(input: Volume, convolution: Convolution) -> Self {
        let Convolution { filters, kernel, stride } = convolution;
        let output = Volume {
            rows: (input.rows - kernel) / stride + 1,
            columns: (input.columns - kernel) / stride + 1,
            channels: filters,
        };
        Self { input, kernel_rows: kernel, kernel_columns: kernel, stride, output }
    }

    pub(super) const fn dense(input: Volume, features: u16) -> Self {
        let output = Volume { rows: 1, columns: 1, channels: features };
        Self { input, kernel_rows: input.rows, kernel_columns: input.columns, stride: 1, output }
    }
}
