//! The headers of a policy with an encoder, and where they say that everything else lies.

use core::ops::Range;

use super::super::PolicyError;
use super::super::header::{
    CHECKSUM_LEN, HEADER_LEN, Header, ParameterFormat, VISION_FORMAT_VERSION, check_envelope, u8_at, u16_at,
};
use crate::encoder::{CONVOLUTION_LIMIT, Convolution, EncoderError, EncoderShape, STAGE_LIMIT, Volume};

/// Bytes of the encoder's header, which follows the header; the metadata follow.
pub const ENCODER_HEADER_LEN: usize = 32;

/// Where the bits of activations and the convolutions begin in the encoder's header.
const CODE_BITS: usize = 11;
const CONVOLUTIONS: usize = 16;
const CONVOLUTION_LEN: usize = 4;

/// Both headers.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct VisionHeader {
    /// Its first width is the length of the observation, without the features.
    pub(super) policy: Header,
    pub(super) encoder: EncoderHeader,
}

/// Everything in the encoder's header.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EncoderHeader {
    pub(super) shape: EncoderShape,
    pub(super) control_periods_per_image: u16,
    /// Bits of each stage's activations in fixed point; zero in float and beyond the last stage.
    pub(super) code_bits: [u8; STAGE_LIMIT],
}

/// Positions of the sections in the file, each on a multiple of four.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct VisionSections {
    pub(super) metadata: Range<usize>,
    pub(super) golden: Range<usize>,
    pub(super) parameters: Range<usize>,
    pub(super) encoder_parameters: Range<usize>,
    pub(super) checksum: Range<usize>,
}

impl VisionHeader {
    /// Reads the headers of a policy with an encoder.
    ///
    /// # Errors
    /// The variant of whatever is wrong.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, PolicyError> {
        check_envelope(bytes, VISION_FORMAT_VERSION)?;
        let policy = Header::fields(bytes)?;
        let encoder = EncoderHeader::parse(bytes.get(HEADER_LEN..).unwrap_or_default(), policy.parameters)?;
        let header = Self { policy, encoder };
        let expected = header.sections().checksum.end;
        if bytes.len() != expected {
            return Err(PolicyError::Length { found: bytes.len(), expected });
        }
        Ok(header)
    }

    pub(super) fn sections(&self) -> VisionSections {
        let shape = &self.encoder.shape;
        let metadata = HEADER_LEN + ENCODER_HEADER_LEN;
        let golden = metadata + self.policy.metadata_len.next_multiple_of(4);
        let parameters = golden + self.policy.golden_vectors * self.golden_bytes();
        let encoder_parameters = parameters + self.policy.parameter_bytes(shape.features());
        let checksum = encoder_parameters
            + match self.policy.parameters {
                ParameterFormat::Float32 => shape.float_bytes(),
                ParameterFormat::Fixed16(_) => shape.fixed_bytes(),
            };
        VisionSections {
            metadata: metadata..metadata + self.policy.metadata_len,
            golden: golden..parameters,
            parameters: parameters..encoder_parameters,
            encoder_parameters: encoder_parameters..checksum,
            checksum: checksum..checksum + CHECKSUM_LEN,
        }
    }

    /// Bytes of a golden vector: observation, action, image.
    pub(super) fn golden_bytes(&self) -> usize {
        let numbers = self.policy.observation_len() + self.policy.action_len();
        4 * numbers + self.encoder.shape.image().len().next_multiple_of(4)
    }
}

impl EncoderHeader {
    fn parse(bytes: &[u8], parameters: ParameterFormat) -> Result<Self, PolicyError> {
        let found = usize::from(u8_at(bytes, 10));
        if !(1..=CONVOLUTION_LIMIT).contains(&found) {
            return Err(EncoderError::ConvolutionCount { found }.into());
        }
        let convolutions: [Convolution; CONVOLUTION_LIMIT] = core::array::from_fn(|index| {
            let at = CONVOLUTIONS + CONVOLUTION_LEN * index;
            let (kernel, stride) = (u16::from(u8_at(bytes, at + 2)), u16::from(u8_at(bytes, at + 3)));
            Convolution { filters: u16_at(bytes, at), kernel, stride }
        });
        check_unused(bytes, found, parameters)?;
        let image = Volume { rows: u16_at(bytes, 0), columns: u16_at(bytes, 2), channels: u16_at(bytes, 4) };
        let convolutions = convolutions.get(..found).unwrap_or_default();
        let control_periods_per_image = u16_at(bytes, 8);
        if control_periods_per_image == 0 {
            return Err(EncoderError::Pace.into());
        }
        Ok(Self {
            shape: EncoderShape::new(image, convolutions, u16_at(bytes, 6))?,
            control_periods_per_image,
            code_bits: core::array::from_fn(|stage| u8_at(bytes, CODE_BITS + stage)),
        })
    }

    /// The bytes of the encoder's header.
    pub(super) fn encode(&self) -> [u8; ENCODER_HEADER_LEN] {
        let mut bytes = [0; ENCODER_HEADER_LEN];
        let Volume { rows, columns, channels } = self.shape.image();
        let features = self.shape.features() as u16;
        let words = [rows, columns, channels, features, self.control_periods_per_image];
        for (slot, word) in bytes.as_chunks_mut::<2>().0.iter_mut().zip(words) {
            *slot = word.to_le_bytes();
        }
        bytes[10] = self.shape.convolutions().count() as u8;
        bytes[CODE_BITS..CONVOLUTIONS].copy_from_slice(&self.code_bits);
        let slots = bytes[CONVOLUTIONS..].as_chunks_mut::<CONVOLUTION_LEN>().0;
        for (slot, convolution) in slots.iter_mut().zip(self.shape.convolutions()) {
            let [low, high] = convolution.filters.to_le_bytes();
            *slot = [low, high, convolution.kernel as u8, convolution.stride as u8];
        }
        bytes
    }
}

/// Refuses anything but zero where nothing is stored.
fn check_unused(bytes: &[u8], convolutions: usize, parameters: ParameterFormat) -> Result<(), PolicyError> {
    let used_bits = match parameters {
        ParameterFormat::Float32 => 0,
        ParameterFormat::Fixed16(_) => convolutions + 1,
    };
    let bits = CODE_BITS + used_bits..CONVOLUTIONS;
    let rest = CONVOLUTIONS + CONVOLUTION_LEN * convolutions..ENCODER_HEADER_LEN;
    match bits.chain(rest).find(|at| u8_at(bytes, *at) != 0) {
        Some(at) => Err(PolicyError::UnusedField { offset: HEADER_LEN + at, found: u16::from(u8_at(bytes, at)) }),
        None => Ok(()),
    }
}
