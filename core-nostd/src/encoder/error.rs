//! What can be wrong with an encoder, or with what it is given.

use thiserror::Error;

/// One variant per kind of misuse; each names what was found and what was expected.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum EncoderError {
    /// The image is empty or too large.
    #[error(
        "the encoder's image has {rows} rows, {columns} columns and {channels} channels, expected 1 to 1024, 1 to 1024 and 1 to 256"
    )]
    ImageShape {
        /// Rows found.
        rows: u16,
        /// Columns found.
        columns: u16,
        /// Channels found.
        channels: u16,
    },
    /// Too few or too many convolutions.
    #[error("the encoder has {found} convolutions, expected 1 to 4")]
    ConvolutionCount {
        /// Convolutions found.
        found: usize,
    },
    /// Too few or too many features.
    #[error("the encoder has {found} features, expected 1 to 512")]
    FeatureCount {
        /// Features found.
        found: u16,
    },
    /// Too few or too many filters.
    #[error("convolution {stage} of the encoder has {found} filters, expected 1 to 256")]
    FilterCount {
        /// Convolution, counted from zero.
        stage: usize,
        /// Filters found.
        found: u16,
    },
    /// A stride that is zero or too large.
    #[error("convolution {stage} of the encoder has a stride of {found}, expected 1 to 255")]
    Stride {
        /// Convolution, counted from zero.
        stage: usize,
        /// Stride found.
        found: u16,
    },
    /// A kernel that is empty or does not fit into what it reads.
    #[error("convolution {stage} of the encoder has a kernel of {found}, expected 1 to {side}, and at most 255")]
    Kernel {
        /// Convolution, counted from zero.
        stage: usize,
        /// Kernel found.
        found: u16,
        /// The shorter side of its input.
        side: u16,
    },
    /// A sum has too many products.
    #[error("sums of stage {stage} of the encoder have {found} terms, expected at most 65536")]
    Terms {
        /// Stage, counted from zero.
        stage: usize,
        /// Terms found.
        found: usize,
    },
    /// The image is not of the encoder's shape.
    #[error("the image has {found} bytes, the encoder reads {expected}")]
    ImageLength {
        /// Bytes given.
        found: usize,
        /// Rows times columns times channels.
        expected: usize,
    },
    /// The working memory is too small.
    #[error("the encoder's scratch has {found} values, expected at least {expected}")]
    ScratchLength {
        /// Values given.
        found: usize,
        /// Values needed.
        expected: usize,
    },
    /// The place for the features has another length.
    #[error("there is room for {found} features, the encoder has {expected}")]
    FeatureLength {
        /// Values given.
        found: usize,
        /// Features of the encoder.
        expected: usize,
    },
    /// There are more or fewer parameters than the shape asks for.
    #[error("the encoder has {found} {unit} of parameters, its shape asks for {expected}")]
    ParameterLength {
        /// Values or bytes given.
        found: usize,
        /// Values or bytes needed.
        expected: usize,
        /// What is counted.
        unit: &'static str,
    },
    /// A parameter is infinite or no number.
    #[error("stage {stage} of the encoder has a parameter that is not finite")]
    NotFinite {
        /// Stage, counted from zero.
        stage: usize,
    },
    /// The bits of a stage's activations are out of range.
    #[error(
        "activations of stage {stage} of the encoder have {found} bits, expected 8 to 15, and 15 for the features"
    )]
    CodeBits {
        /// Stage, counted from zero.
        stage: usize,
        /// Bits found.
        found: u8,
    },
    /// A multiplier is negative.
    #[error("filter {filter} of stage {stage} of the encoder has the multiplier {found}, expected 0 or more")]
    Multiplier {
        /// Stage, counted from zero.
        stage: usize,
        /// Filter, counted from zero.
        filter: usize,
        /// Multiplier found.
        found: i32,
    },
    /// A weight that is only there to fill up a group is not zero.
    #[error("filter {filter} of stage {stage} of the encoder has weights behind its last, expected zeros")]
    Padding {
        /// Stage, counted from zero.
        stage: usize,
        /// Filter, counted from zero.
        filter: usize,
    },
    /// A sum of products could leave 32 bits.
    #[error(
        "sums of filter {filter} of stage {stage} of the encoder can reach {largest}, expected less than 2147483648"
    )]
    Overflow {
        /// Stage, counted from zero.
        stage: usize,
        /// Filter, counted from zero.
        filter: usize,
        /// Largest magnitude that its sum can have.
        largest: i64,
    },
    /// No fixed-point format suits a stage.
    #[error("no fixed-point format suits stage {stage} of the encoder: its weights or biases are too large")]
    NoFormat {
        /// Stage, counted from zero.
        stage: usize,
    },
    /// The features would be finer than the sums they are made of.
    #[error("features with {found} fraction bits are finer than their sums: choose fewer")]
    FeatureFractionBits {
        /// Fraction bits asked for.
        found: u8,
    },
    /// The features are not in the format of the network's inputs.
    #[error("features are in units of {found}, expected {expected} as the network's inputs")]
    FeatureStep {
        /// Value of one unit of a feature.
        found: f32,
        /// Value of one unit of an input.
        expected: f32,
    },
    /// Images are given at no pace.
    #[error("the encoder has 0 control periods per image, expected 1 or more")]
    Pace,
}
