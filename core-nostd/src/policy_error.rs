//! What can be wrong with a policy file.

use thiserror::Error;

use crate::activation::Activation;
use crate::arithmetic::Arithmetic;
#[cfg(feature = "encoder")]
use crate::encoder::EncoderError;

/// One variant per kind of damage or misuse; each names what was found and what was expected.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum PolicyError {
    /// The bytes end before the file does.
    #[error("policy file is truncated: found {found} bytes, expected {expected}")]
    Truncated {
        /// Bytes given.
        found: usize,
        /// Bytes that the header announces, or that a header needs.
        expected: usize,
    },
    /// The bytes go on after the end of the file.
    #[error("policy file has trailing bytes: found {found} bytes, expected {expected}")]
    TrailingBytes {
        /// Bytes given.
        found: usize,
        /// Bytes that the header announces.
        expected: usize,
    },
    /// The file does not begin like a policy file.
    #[error("not a policy file: it begins with \"{}\", expected \"{}\"", found.escape_ascii(), expected.escape_ascii())]
    Magic {
        /// First bytes of the file.
        found: [u8; 8],
        /// First bytes of every policy file.
        expected: [u8; 8],
    },
    /// The file was written by a later release.
    #[error(
        "policy file has format version {found}, this release reads up to {newest}: update kestrel, or export again"
    )]
    NewerVersion {
        /// Version of the file.
        found: u16,
        /// Newest version that is understood.
        newest: u16,
    },
    /// No release ever wrote this version.
    #[error("policy file has format version {found}, expected 1 to {newest}")]
    Version {
        /// Version of the file.
        found: u16,
        /// Newest version that is understood.
        newest: u16,
    },
    /// The policy has an encoder, where one without was expected.
    #[error("found a vision policy, expected a state-based one: read it as a `VisionPolicy`")]
    Vision,
    /// The policy has no encoder, where one was expected.
    #[error("found a state-based policy, expected a vision policy: read it as a `PolicyFile`")]
    StateBased,
    /// The policy has a memory, where one without was expected.
    #[error("found a recurrent policy, expected one without memory: read it as a `RecurrentPolicy`")]
    Recurrent,
    #[cfg(feature = "recurrent")]
    /// The memory is of a size that no policy can have.
    #[error(
        "memory of {found} units beside {observation} observed values, expected a multiple of 4 from 4 to 64, and at most 128 together"
    )]
    Units {
        /// Units of the memory.
        found: usize,
        /// Values of the observation.
        observation: usize,
    },
    #[cfg(feature = "encoder")]
    /// The encoder is not possible, or was given what it cannot take.
    #[error(transparent)]
    Encoder(#[from] EncoderError),
    /// The memory for images is too small or for another arithmetic.
    #[error(
        "memory of {found} values for {found_arithmetic}, expected at least {expected} for {expected_arithmetic}",
        found_arithmetic = found_arithmetic.name(),
        expected_arithmetic = expected_arithmetic.name()
    )]
    EncoderWorkspace {
        /// Values given.
        found: usize,
        /// What they are for.
        found_arithmetic: Arithmetic,
        /// Values needed.
        expected: usize,
        /// Arithmetic of the policy.
        expected_arithmetic: Arithmetic,
    },
    /// There is not one image for each golden observation.
    #[error("policy has {found} bytes of golden images, expected {expected}")]
    GoldenImages {
        /// Bytes given.
        found: usize,
        /// Bytes of an image for each golden observation.
        expected: usize,
    },
    /// The contents were altered.
    #[error("policy file is damaged: its checksum is {found:08x}, expected {expected:08x}")]
    Checksum {
        /// Checksum of the contents.
        found: u32,
        /// Checksum at the end of the file.
        expected: u32,
    },
    /// The bytes do not start on a four-byte boundary of memory.
    #[error(
        "policy bytes start {found} bytes past a 4-byte boundary of memory, expected 0: keep them in `Aligned`"
    )]
    Misaligned {
        /// Address modulo four.
        found: usize,
    },
    /// The arithmetic has no known identifier.
    #[error("policy file has arithmetic {found}, expected 1 (float32) or 2 (fixed16)")]
    Arithmetic {
        /// Identifier in the file.
        found: u8,
    },
    /// What follows hidden layers has no known identifier.
    #[error("policy file has activation {found}, expected 0 (tanh) or 1 (relu)")]
    Activation {
        /// Identifier in the file.
        found: u8,
    },
    /// Hidden layers differ in what follows them.
    #[error(
        "policy layer {layer} is followed by {found}, expected {expected} as after the first",
        found = found.name(),
        expected = expected.name()
    )]
    MixedActivations {
        /// Layer, counted from zero.
        layer: usize,
        /// What follows it.
        found: Activation,
        /// What follows the first layer.
        expected: Activation,
    },
    /// The observation layout has no known identifier.
    #[error(
        "policy file has observation layout {found}, expected 1 (pilot), 2 (paper), 3 (kinematic), 4 (measured), 5 (pilot for another action), 6 (pilot measured), 7 (body) or 8 (px4_neural)"
    )]
    ObservationLayout {
        /// Identifier in the file.
        found: u16,
    },
    /// The action space has no known identifier.
    #[error(
        "policy file has action space {found}, expected 1 (rotor speeds), 2 (thrust and body rates), 3 (published), 4 (velocity) or 5 (rotor thrusts)"
    )]
    ActionSpace {
        /// Identifier in the file.
        found: u16,
    },
    /// The policy needs what this build leaves out.
    #[error("the policy needs {needs}: build kestrel-core with the feature `{feature}`")]
    MissingFeature {
        /// What it needs.
        needs: &'static str,
        /// The feature of kestrel-core that holds it.
        feature: &'static str,
    },
    /// A byte or field that must be zero is not.
    #[error("policy file has {found} in an unused field at byte {offset}, expected 0")]
    UnusedField {
        /// Position in the file.
        offset: usize,
        /// Value there.
        found: u16,
    },
    /// Too few or too many layers.
    #[error("policy has {found} layers, expected 1 to 4")]
    LayerCount {
        /// Layers found.
        found: usize,
    },
    /// A layer is empty or too wide.
    #[error("policy has a width of {found} before layer {layer}, expected 1 to 128")]
    Width {
        /// Layer that reads this width, counted from zero.
        layer: usize,
        /// Its inputs.
        found: usize,
    },
    /// The first layer does not read the observation.
    #[error("policy reads {found} values, expected the {expected} of its observation layout")]
    ObservationLength {
        /// Inputs of the first layer.
        found: usize,
        /// Values of the layout.
        expected: usize,
    },
    /// The last layer does not write an action.
    #[error("policy writes {found} values, expected the {expected} of its action space")]
    ActionLength {
        /// Outputs of the last layer.
        found: usize,
        /// Values of an action.
        expected: usize,
    },
    /// The sections do not add up to the length of the file.
    #[error("the sections of the policy take {expected} bytes, found room for {found}")]
    Length {
        /// Bytes there are.
        found: usize,
        /// Bytes that the dimensions ask for.
        expected: usize,
    },
    /// The metadata are no valid postcard message.
    #[error("policy metadata of {found} bytes cannot be decoded")]
    Metadata {
        /// Bytes of the metadata.
        found: usize,
    },
    /// The metadata contradict the identifiers of the header.
    #[error("policy metadata have {field} {found}, expected {expected} as in the header")]
    MetadataMismatch {
        /// What is contradicted.
        field: &'static str,
        /// Identifier of the metadata.
        found: u16,
        /// Identifier of the header.
        expected: u16,
    },
    /// A number of the metadata is out of range.
    #[error("policy metadata have {field} {found}, expected {expected}")]
    MetadataValue {
        /// Field with its unit.
        field: &'static str,
        /// Its value.
        found: f32,
        /// Its range.
        expected: &'static str,
    },
    /// The name is too long.
    #[error("policy name is {found} bytes long, expected at most {expected}")]
    Name {
        /// Bytes of the name.
        found: usize,
        /// Most bytes of a name.
        expected: usize,
    },
    /// No golden vectors, or too many, or an incomplete one.
    #[error("policy has {found} values of golden observations, expected 1 to 64 times {expected}")]
    GoldenObservations {
        /// Values found.
        found: usize,
        /// Values of one observation.
        expected: usize,
    },
    /// The fraction bits of a layer are out of range.
    #[error(
        "layer {layer} has weights with {weights} and inputs with {inputs} fraction bits, expected at most 20 and 14, and 18 together"
    )]
    FractionBits {
        /// Layer, counted from zero.
        layer: usize,
        /// Fraction bits of its weights.
        weights: u8,
        /// Fraction bits of its inputs.
        inputs: u8,
    },
    /// A sum of products could leave 32 bits.
    #[error("sums of row {row} of layer {layer} can reach {largest}, expected less than 2147483648")]
    Overflow {
        /// Layer, counted from zero.
        layer: usize,
        /// Row of its matrix.
        row: usize,
        /// Largest magnitude that its sum can have.
        largest: i64,
    },
    /// No fixed-point format is coarse enough for a layer.
    #[error("the weights of layer {layer} are too large for 16 bits, or no numbers")]
    WeightsTooLarge {
        /// Layer, counted from zero.
        layer: usize,
    },
    /// A parameter is infinite or no number.
    #[error("layer {layer} has a parameter that is not finite")]
    NotFinite {
        /// Layer, counted from zero.
        layer: usize,
    },
    /// A layer to be written has slices of the wrong length, or does not continue the one before.
    #[error(
        "layer {layer} has {weights} weights and {biases} biases, expected {inputs} x {outputs} and {outputs}"
    )]
    LayerShape {
        /// Layer, counted from zero.
        layer: usize,
        /// Weights given.
        weights: usize,
        /// Biases given.
        biases: usize,
        /// Inputs expected (the outputs of the layer before).
        inputs: usize,
        /// Outputs stated.
        outputs: usize,
    },
    /// The buffer to write into is too small.
    #[error("buffer has {found} bytes, the policy file needs {expected}")]
    BufferTooSmall {
        /// Bytes of the buffer.
        found: usize,
        /// Bytes of the file.
        expected: usize,
    },
    /// The policy does not compute what it did where it was exported.
    #[error("self-test failed: golden vector {vector} gives {found} as output {output}, expected {expected}")]
    SelfTest {
        /// Golden vector, counted from zero.
        vector: usize,
        /// Output, counted from zero.
        output: usize,
        /// Action computed here.
        found: f32,
        /// Action computed by the exporter.
        expected: f32,
    },
}

impl PolicyError {
    /// A number for the kind of damage, from 1 on, for firmwares that have no room for text. Numbers are never given to
    /// another kind.
    pub const fn code(&self) -> u8 {
        match self {
            Self::Truncated { .. } => 1,
            Self::TrailingBytes { .. } => 2,
            Self::Magic { .. } => 3,
            Self::NewerVersion { .. } => 4,
            Self::Version { .. } => 5,
            Self::Checksum { .. } => 6,
            Self::Misaligned { .. } => 7,
            Self::Arithmetic { .. } => 8,
            Self::ObservationLayout { .. } => 9,
            Self::ActionSpace { .. } => 10,
            Self::UnusedField { .. } => 11,
            Self::LayerCount { .. } => 12,
            Self::Width { .. } => 13,
            Self::ObservationLength { .. } => 14,
            Self::ActionLength { .. } => 15,
            Self::Length { .. } => 16,
            Self::Metadata { .. } => 17,
            Self::MetadataMismatch { .. } => 18,
            Self::MetadataValue { .. } => 19,
            Self::Name { .. } => 20,
            Self::GoldenObservations { .. } => 21,
            Self::FractionBits { .. } => 22,
            Self::Overflow { .. } => 23,
            Self::WeightsTooLarge { .. } => 24,
            Self::NotFinite { .. } => 25,
            Self::LayerShape { .. } => 26,
            Self::BufferTooSmall { .. } => 27,
            Self::SelfTest { .. } => 28,
            Self::Vision => 29,
            Self::StateBased => 30,
            #[cfg(feature = "encoder")]
            Self::Encoder(_) => 31,
            Self::EncoderWorkspace { .. } => 32,
            Self::GoldenImages { .. } => 33,
            Self::MissingFeature { .. } => 34,
            Self::Recurrent => 35,
            #[cfg(feature = "recurrent")]
            Self::Units { .. } => 36,
            Self::Activation { .. } => 37,
            Self::MixedActivations { .. } => 38,
        }
    }
}

pub(crate) fn holds(
    condition: bool,
    field: &'static str,
    found: usize,
    expected: &'static str,
) -> Result<(), PolicyError> {
    condition.then_some(()).ok_or(PolicyError::MetadataValue { field, found: found as f32, expected })
}

pub(crate) fn positive(field: &'static str, found: f32) -> Result<(), PolicyError> {
    // Subnormal scales would turn into infinite factors.
    let valid = found.is_normal() && found > 0.0;
    valid.then_some(()).ok_or(PolicyError::MetadataValue { field, found, expected: "a positive number" })
}

pub(crate) fn finite(field: &'static str, found: f32) -> Result<(), PolicyError> {
    found.is_finite().then_some(()).ok_or(PolicyError::MetadataValue { field, found, expected: "a finite number" })
}
