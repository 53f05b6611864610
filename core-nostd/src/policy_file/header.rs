//! The fixed part at the start of a policy file, and where it says that everything else lies.

use core::ops::Range;

use heapless::Vec;

use super::metadata::{LAYOUT_COUNT, SPACE_COUNT};
#[cfg(not(feature = "px4"))]
use super::metadata::{PX4_NEURAL, ROTOR_THRUSTS};
use super::{Arithmetic, PolicyError};
use crate::activation::Activation;
use crate::crc32::crc32;
use crate::fixed::{self, FixedFormat};
use crate::limits::{ACTION_LEN, LAYER_LIMIT, WIDTH_LIMIT};
use crate::mlp;

/// The first bytes of every policy file. The first is no text, the line ends show transfers that "correct" them.
pub const MAGIC: [u8; 8] = *b"\x89KPOL\r\n\x1a";

/// The format version of policies without an encoder.
pub const FORMAT_VERSION: u16 = 1;

/// The format version of policies with an encoder.
pub const VISION_FORMAT_VERSION: u16 = 2;

/// The format version of recurrent policies.
pub const RECURRENT_FORMAT_VERSION: u16 = 3;

/// The format version of policies with an encoder and, behind it, a memory, and the newest that is read.
pub const RECURRENT_VISION_FORMAT_VERSION: u16 = 4;

/// Bytes of the header; the metadata follow.
pub const HEADER_LEN: usize = 40;

/// Most golden vectors.
pub const GOLDEN_LIMIT: usize = 64;

pub(super) const CHECKSUM_LEN: usize = 4;

/// Where the header says what follows the sums of hidden layers.
const ACTIVATION: usize = 39;

/// Number format of the parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterFormat {
    /// `f32`.
    Float32,
    /// `i16` weights and `i32` biases in these Q formats.
    Fixed16(FixedFormat),
}

/// Everything in the header that is not derived from the rest.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Header {
    pub(crate) parameters: ParameterFormat,
    pub(crate) activation: Activation,
    pub(crate) observation_layout: u16,
    pub(crate) action_space: u16,
    pub(crate) metadata_len: usize,
    pub(crate) golden_vectors: usize,
    /// Length of the observation, then the outputs of each layer.
    pub(crate) widths: Vec<u16, { LAYER_LIMIT + 1 }>,
}

/// What an encoder or a memory in front of the network adds to a file; nothing in a state-based policy.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FrontSizes {
    pub(crate) header_len: usize,
    /// Values that the first layer reads behind the observation.
    pub(crate) features: usize,
    /// Bytes of the image of a golden vector.
    pub(crate) image_len: usize,
    pub(crate) parameter_bytes: usize,
}

/// Positions of the sections in the file, each on a multiple of four.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Sections {
    pub(crate) metadata: Range<usize>,
    pub(crate) golden: Range<usize>,
    pub(crate) parameters: Range<usize>,
    pub(crate) front_parameters: Range<usize>,
    pub(crate) checksum: Range<usize>,
}

impl ParameterFormat {
    /// What it is computed with.
    pub fn arithmetic(self) -> Arithmetic {
        match self {
            Self::Float32 => Arithmetic::Float32,
            Self::Fixed16(_) => Arithmetic::Fixed16,
        }
    }

    const fn identifier(self) -> u8 {
        match self {
            Self::Float32 => 1,
            Self::Fixed16(_) => 2,
        }
    }

    pub(super) fn layer_bytes(self, inputs: usize, outputs: usize) -> usize {
        match self {
            Self::Float32 => mlp::layer_bytes(inputs, outputs),
            Self::Fixed16(_) => fixed::layer_bytes(inputs, outputs),
        }
    }

    fn fraction_bits(self) -> [u8; LAYER_LIMIT + 1] {
        let mut bits = [0; LAYER_LIMIT + 1];
        if let Self::Fixed16(format) = self {
            bits[0] = format.input_fraction_bits;
            bits[1..].copy_from_slice(&format.weight_fraction_bits);
        }
        bits
    }
}

impl Header {
    /// Reads the header of a file of `version`.
    ///
    /// # Errors
    /// The variant of whatever is wrong.
    pub(super) fn parse(bytes: &[u8], version: u16) -> Result<Self, PolicyError> {
        check_envelope(bytes, version)?;
        let header = Self {
            parameters: parse_parameter_format(bytes)?,
            activation: parse_activation(bytes)?,
            observation_layout: u16_at(bytes, 16),
            action_space: u16_at(bytes, 18),
            metadata_len: usize::from(u16_at(bytes, 20)),
            golden_vectors: usize::from(u16_at(bytes, 22)),
            widths: parse_widths(bytes)?,
        };
        check_unused(bytes, header.widths.len() - 1, header.parameters)?;
        header.check()?;
        Ok(header)
    }

    /// Refuses identifiers and dimensions that no policy can have.
    pub(crate) fn check(&self) -> Result<(), PolicyError> {
        if !(1..=LAYOUT_COUNT).contains(&self.observation_layout) {
            return Err(PolicyError::ObservationLayout { found: self.observation_layout });
        }
        if !(1..=SPACE_COUNT).contains(&self.action_space) {
            return Err(PolicyError::ActionSpace { found: self.action_space });
        }
        #[cfg(not(feature = "reference"))]
        check_reference(self.observation_layout, self.action_space)?;
        #[cfg(not(feature = "px4"))]
        self.check_px4()?;
        for (layer, width) in self.widths.iter().map(|width| usize::from(*width)).enumerate() {
            if !(1..=WIDTH_LIMIT).contains(&width) {
                return Err(PolicyError::Width { layer, found: width });
            }
        }
        // The other spaces say in the metadata which of several lengths they have.
        let found = self.action_len();
        if self.action_space <= 2 && found != ACTION_LEN {
            return Err(PolicyError::ActionLength { found, expected: ACTION_LEN });
        }
        if !(1..=GOLDEN_LIMIT).contains(&self.golden_vectors) {
            let expected = self.observation_len();
            return Err(PolicyError::GoldenObservations { found: self.golden_vectors * expected, expected });
        }
        Ok(())
    }

    /// Refuses what only a policy for PX4 has.
    #[cfg(not(feature = "px4"))]
    fn check_px4(&self) -> Result<(), PolicyError> {
        let missing = |needs| Err(PolicyError::MissingFeature { needs, feature: "px4" });
        match (self.activation, self.observation_layout, self.action_space) {
            (Activation::Relu, _, _) => missing("rectifiers"),
            (Activation::Tanh, PX4_NEURAL, _) => missing("the observation layout px4_neural"),
            (Activation::Tanh, _, ROTOR_THRUSTS) => missing("the action space rotor_thrusts"),
            (Activation::Tanh, _, _) => Ok(()),
        }
    }

    /// Values of an observation.
    pub(crate) fn observation_len(&self) -> usize {
        usize::from(self.widths.first().copied().unwrap_or_default())
    }

    /// Values of an action.
    pub(crate) fn action_len(&self) -> usize {
        usize::from(self.widths.last().copied().unwrap_or_default())
    }

    /// Inputs and outputs of each layer, the first of which reads `features` values behind the observation.
    pub(crate) fn shapes(&self, features: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        let outputs = self.widths.iter().skip(1);
        let inputs = self.widths.iter().zip(core::iter::once(features).chain(core::iter::repeat(0)));
        inputs.zip(outputs).map(|((&inputs, more), &outputs)| (usize::from(inputs) + more, usize::from(outputs)))
    }

    /// Bytes of all layers, the first of which reads `features` values behind the observation.
    pub(super) fn parameter_bytes(&self, features: usize) -> usize {
        self.shapes(features).map(|(inputs, outputs)| self.parameters.layer_bytes(inputs, outputs)).sum()
    }

    /// Bytes of a golden vector: observation, action, image.
    pub(super) fn golden_bytes(&self, image_len: usize) -> usize {
        4 * (self.observation_len() + self.action_len()) + image_len.next_multiple_of(4)
    }

    pub(crate) fn sections(&self, front: FrontSizes) -> Sections {
        let metadata = HEADER_LEN + front.header_len;
        let golden = metadata + self.metadata_len.next_multiple_of(4);
        let parameters = golden + self.golden_vectors * self.golden_bytes(front.image_len);
        let front_parameters = parameters + self.parameter_bytes(front.features);
        let checksum = front_parameters + front.parameter_bytes;
        Sections {
            metadata: metadata..metadata + self.metadata_len,
            golden: golden..parameters,
            parameters: parameters..front_parameters,
            front_parameters: front_parameters..checksum,
            checksum: checksum..checksum + CHECKSUM_LEN,
        }
    }

    /// The bytes of the header of a file of `version` and `file_len` bytes.
    pub(crate) fn encode(&self, version: u16, file_len: usize) -> [u8; HEADER_LEN] {
        let mut bytes = [0; HEADER_LEN];
        bytes[..8].copy_from_slice(&MAGIC);
        bytes[8..10].copy_from_slice(&version.to_le_bytes());
        bytes[10] = self.parameters.identifier();
        bytes[11] = (self.widths.len().saturating_sub(1)) as u8;
        bytes[12..16].copy_from_slice(&(file_len as u32).to_le_bytes());
        bytes[16..18].copy_from_slice(&self.observation_layout.to_le_bytes());
        bytes[18..20].copy_from_slice(&self.action_space.to_le_bytes());
        bytes[20..22].copy_from_slice(&(self.metadata_len as u16).to_le_bytes());
        bytes[22..24].copy_from_slice(&(self.golden_vectors as u16).to_le_bytes());
        for (slot, width) in bytes[24..34].as_chunks_mut::<2>().0.iter_mut().zip(&self.widths) {
            *slot = width.to_le_bytes();
        }
        bytes[34..ACTIVATION].copy_from_slice(&self.parameters.fraction_bits());
        bytes[ACTIVATION] = self.activation as u8;
        bytes
    }
}

/// Refuses what only compares with the reference system: layouts 2 and 3, space 3.
#[cfg(not(feature = "reference"))]
fn check_reference(observation_layout: u16, action_space: u16) -> Result<(), PolicyError> {
    let missing = |needs| Err(PolicyError::MissingFeature { needs, feature: "reference" });
    match (observation_layout, action_space) {
        (2 | 3, _) => missing("an observation layout of the reference system"),
        (_, 3) => missing("an action space of the reference system"),
        (_, _) => Ok(()),
    }
}

/// Magic, version, length and checksum, in this order: the first thing wrong is what the user should read about.
pub(super) fn check_envelope(bytes: &[u8], version: u16) -> Result<(), PolicyError> {
    let truncated = PolicyError::Truncated { found: bytes.len(), expected: HEADER_LEN };
    let found = *bytes.first_chunk::<8>().ok_or(truncated)?;
    if found != MAGIC {
        return Err(PolicyError::Magic { found, expected: MAGIC });
    }
    if bytes.len() < HEADER_LEN {
        return Err(truncated);
    }
    let (found, newest) = (u16_at(bytes, 8), RECURRENT_VISION_FORMAT_VERSION);
    match found {
        0 => return Err(PolicyError::Version { found, newest }),
        _ if found == version => {}
        FORMAT_VERSION => return Err(PolicyError::StateBased),
        VISION_FORMAT_VERSION | RECURRENT_VISION_FORMAT_VERSION => return Err(PolicyError::Vision),
        RECURRENT_FORMAT_VERSION => return Err(PolicyError::Recurrent),
        _ => return Err(PolicyError::NewerVersion { found, newest }),
    }
    check_length_and_checksum(bytes)
}

fn check_length_and_checksum(bytes: &[u8]) -> Result<(), PolicyError> {
    let (found, expected) = (bytes.len(), u32_at(bytes, 12) as usize);
    if found < expected {
        return Err(PolicyError::Truncated { found, expected });
    }
    if found > expected {
        return Err(PolicyError::TrailingBytes { found, expected });
    }
    let (contents, checksum) = bytes.split_at_checked(found - CHECKSUM_LEN).unwrap_or_default();
    let (found, expected) = (crc32(contents), u32_at(checksum, 0));
    if found == expected { Ok(()) } else { Err(PolicyError::Checksum { found, expected }) }
}

fn parse_parameter_format(bytes: &[u8]) -> Result<ParameterFormat, PolicyError> {
    match u8_at(bytes, 10) {
        1 => Ok(ParameterFormat::Float32),
        2 => Ok(ParameterFormat::Fixed16(FixedFormat {
            input_fraction_bits: u8_at(bytes, 34),
            weight_fraction_bits: core::array::from_fn(|layer| u8_at(bytes, 35 + layer)),
            activation: parse_activation(bytes)?,
        })),
        found => Err(PolicyError::Arithmetic { found }),
    }
}

fn parse_activation(bytes: &[u8]) -> Result<Activation, PolicyError> {
    match u8_at(bytes, ACTIVATION) {
        0 => Ok(Activation::Tanh),
        1 => Ok(Activation::Relu),
        found => Err(PolicyError::Activation { found }),
    }
}

fn parse_widths(bytes: &[u8]) -> Result<Vec<u16, { LAYER_LIMIT + 1 }>, PolicyError> {
    let found = usize::from(u8_at(bytes, 11));
    if !(1..=LAYER_LIMIT).contains(&found) {
        return Err(PolicyError::LayerCount { found });
    }
    Ok(collected((0..=found).map(|index| u16_at(bytes, 24 + 2 * index))))
}

/// The first of `widths`, as many as a header holds.
pub(crate) fn collected(widths: impl Iterator<Item = u16>) -> Vec<u16, { LAYER_LIMIT + 1 }> {
    let mut collected = Vec::new();
    for width in widths.take(LAYER_LIMIT + 1) {
        // Cannot fail, and `collect` would bring a panic into the firmware.
        let _ = collected.push(width);
    }
    collected
}

/// Refuses anything but zero where nothing is stored, so that a file has one meaning and room to grow.
fn check_unused(bytes: &[u8], layers: usize, parameters: ParameterFormat) -> Result<(), PolicyError> {
    let used_bits = match parameters {
        ParameterFormat::Float32 => 0,
        ParameterFormat::Fixed16(_) => 1 + layers,
    };
    let widths = (1 + layers..=LAYER_LIMIT).map(|index| 24 + 2 * index).map(|at| (at, u16_at(bytes, at)));
    let bits = (34 + used_bits..ACTIVATION).map(|at| (at, u16::from(u8_at(bytes, at))));
    match widths.chain(bits).find(|(_, value)| *value != 0) {
        Some((offset, found)) => Err(PolicyError::UnusedField { offset, found }),
        None => Ok(()),
    }
}

/// Zero beyond the end, which the check of the length excludes.
pub(super) fn u8_at(bytes: &[u8], offset: usize) -> u8 {
    bytes.get(offset).copied().unwrap_or_default()
}

pub(super) fn u16_at(bytes: &[u8], offset: usize) -> u16 {
    u16::from_le_bytes([u8_at(bytes, offset), u8_at(bytes, offset + 1)])
}

fn u32_at(bytes: &[u8], offset: usize) -> u32 {
    u32::from(u16_at(bytes, offset)) | u32::from(u16_at(bytes, offset + 2)) << 16
}
