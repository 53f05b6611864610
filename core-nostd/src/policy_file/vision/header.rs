//! The header of an encoder, which follows that of the policy.

use super::super::PolicyError;
use super::super::header::{FrontSizes, HEADER_LEN, Header, ParameterFormat, u8_at, u16_at};
use super::super::recurrent::MemoryHeader;
use crate::encoder::{CONVOLUTION_LIMIT, Convolution, EncoderError, EncoderShape, STAGE_LIMIT, Volume};

/// Bytes of the encoder's header, which follows the header; the metadata follow.
pub const ENCODER_HEADER_LEN: usize = 32;

/// Where the bits of activations and the convolutions begin in the encoder's header.
const CODE_BITS: usize = 11;
const CONVOLUTIONS: usize = 16;
const CONVOLUTION_LEN: usize = 4;

/// Everything in the encoder's header.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EncoderHeader {
    pub(super) shape: EncoderShape,
    pub(super) control_periods_per_image: u16,
    /// Bits of each stage's activations in fixed point; zero in float and beyond the last stage.
    pub(super) code_bits: [u8; STAGE_LIMIT],
}

/// The headers of what stands in front of the network.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FrontHeaders {
    pub(super) encoder: EncoderHeader,
    /// Behind the encoder, where something is remembered.
    pub(super) memory: Option<MemoryHeader>,
    /// Values that a memory takes in: the observation and the features.
    pub(super) observation_len: usize,
}

impl FrontHeaders {
    /// Of an observation of so many values.
    pub(super) fn new(encoder: EncoderHeader, memory: Option<MemoryHeader>, observation_len: usize) -> Self {
        Self { encoder, memory, observation_len: observation_len + encoder.shape.features() }
    }

    /// Reads them from a file with this header.
    pub(super) fn parse(file: &[u8], remembers: bool, header: &Header) -> Result<Self, PolicyError> {
        let format = header.parameters;
        let encoder = EncoderHeader::parse(file.get(HEADER_LEN..).unwrap_or_default(), format)?;
        let fronts = Self::new(encoder, None, header.observation_len());
        let offset = HEADER_LEN + ENCODER_HEADER_LEN;
        let memory = remembers.then(|| MemoryHeader::parse(file, offset, fronts.observation_len, format));
        Ok(Self { memory: memory.transpose()?, ..fronts })
    }

    /// What both add to a file with these parameters.
    pub(super) fn sizes(&self, parameters: ParameterFormat) -> FrontSizes {
        let encoder = self.encoder.sizes(parameters);
        let Some(memory) = &self.memory else { return encoder };
        let memory = memory.sizes(self.observation_len, parameters);
        FrontSizes {
            header_len: encoder.header_len + memory.header_len,
            features: encoder.features + memory.features,
            image_len: encoder.image_len,
            parameter_bytes: encoder.parameter_bytes + memory.parameter_bytes,
        }
    }
}

impl EncoderHeader {
    /// Reads it from the start of `bytes`.
    pub(super) fn parse(bytes: &[u8], parameters: ParameterFormat) -> Result<Self, PolicyError> {
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

    /// What the encoder adds to a file with these parameters.
    pub(super) fn sizes(&self, parameters: ParameterFormat) -> FrontSizes {
        FrontSizes {
            header_len: ENCODER_HEADER_LEN,
            features: self.shape.features(),
            image_len: self.shape.image().len(),
            parameter_bytes: match parameters {
                ParameterFormat::Float32 => self.shape.float_bytes(),
                ParameterFormat::Fixed16(_) => self.shape.fixed_bytes(),
            },
        }
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
