//! Writing policies with an encoder, into the caller's bytes.

use super::super::header::{HEADER_LEN, Header, ParameterFormat, VISION_FORMAT_VERSION};
use super::super::writer::{copy, seal, section};
use super::super::{Network, PolicyDraft, PolicyError, PolicyScratch};
use super::header::{ENCODER_HEADER_LEN, EncoderHeader};
use super::{EncoderWorkspace, PolicyEncoder};
use crate::encoder::{EncoderError, EncoderFormat, EncoderShape, STAGE_LIMIT, write_fixed, write_float};
use crate::fixed::{FixedFormat, INPUT_FRACTION_BITS_LIMIT};
use crate::limits::WIDTH_LIMIT;

/// What goes into the policy file of a policy with an encoder.
#[derive(Clone, Copy, Debug)]
pub struct VisionDraft<'a> {
    /// Everything behind the encoder; the first layer reads the observation, then the features.
    pub policy: PolicyDraft<'a>,
    /// What turns images into features.
    pub encoder: EncoderDraft<'a>,
}

/// The encoder of a draft.
#[derive(Clone, Copy, Debug)]
pub struct EncoderDraft<'a> {
    /// What it reads and what it makes of it.
    pub shape: EncoderShape,
    /// As the shape says.
    pub parameters: &'a [f32],
    /// Number formats in fixed point; its features are in the format of the policy's inputs. Float reads none.
    pub format: EncoderFormat,
    /// Control periods from one image to the next in training, 1 or more.
    pub control_periods_per_image: u16,
    /// An image for each golden observation, one after the other.
    pub golden_images: &'a [u8],
}

impl VisionDraft<'_> {
    /// Bytes of the file.
    ///
    /// # Errors
    /// The variant of whatever no policy file can hold.
    pub fn file_len(&self) -> Result<usize, PolicyError> {
        self.headers().map(|(policy, encoder)| policy.sections(encoder.sizes(policy.parameters)).checksum.end)
    }

    /// Values of memory with which [`Self::write`] computes the golden actions.
    pub fn memory_len(&self) -> usize {
        let inputs = self.policy.metadata.observation.len() + self.encoder.shape.features();
        let work = self.encoder.shape.scratch_len().max(inputs.next_multiple_of(2)).max(WIDTH_LIMIT);
        self.encoder.shape.features() + work
    }

    /// Writes the file to the start of `bytes` and returns its length; the same draft gives the same bytes. `memory`
    /// is of the draft's arithmetic.
    ///
    /// # Errors
    /// The variant of whatever no policy file can hold, [`PolicyError::BufferTooSmall`] or [`PolicyError::EncoderWorkspace`].
    pub fn write(&self, bytes: &mut [u8], memory: &mut EncoderWorkspace<'_>) -> Result<usize, PolicyError> {
        let (header, encoder_header) = self.headers()?;
        let sizes = encoder_header.sizes(header.parameters);
        let (file, sections) = self.policy.write_parts(&header, sizes, VISION_FORMAT_VERSION, bytes)?;
        copy(&encoder_header.encode(), section(file, HEADER_LEN..HEADER_LEN + ENCODER_HEADER_LEN));
        self.write_encoder(section(file, sections.front_parameters.clone()))?;
        self.write_actions(&header, &encoder_header, file, memory)?;
        Ok(seal(file))
    }

    /// Writes the golden observations and images, and the actions that the networks in the file give for them.
    fn write_actions(
        &self,
        header: &Header,
        encoder_header: &EncoderHeader,
        file: &mut [u8],
        memory: &mut EncoderWorkspace<'_>,
    ) -> Result<(), PolicyError> {
        let sizes = encoder_header.sizes(header.parameters);
        let sections = header.sections(sizes);
        let (front, rest) = file.split_at_mut_checked(sections.parameters.start).unwrap_or_default();
        let (parameters, rest) = rest.split_at_checked(sections.parameters.len()).unwrap_or_default();
        let encoder_parameters = rest.get(..sections.front_parameters.len()).unwrap_or_default();
        let network = Network::from_parameters(header, sizes.features, parameters)?;
        let encoder = PolicyEncoder::from_parameters(encoder_header, header.parameters, encoder_parameters)?;
        memory.check(encoder.memory_len(&network), encoder.arithmetic())?;
        let mut scratch = PolicyScratch::new();
        let act = |observation: &[f32], image: &[u8]| {
            encoder.encode(image, memory)?;
            Ok(network.act_on_features(observation, sizes.features, memory, &mut scratch))
        };
        let golden = section(front, sections.golden.clone());
        self.policy.write_golden(header, self.encoder.golden_images, golden, act)
    }

    fn headers(&self) -> Result<(Header, EncoderHeader), PolicyError> {
        let policy = self.policy.header(self.encoder.shape.features())?;
        let (found, image) = (self.encoder.golden_images.len(), self.encoder.shape.image().len());
        let expected = policy.golden_vectors * image;
        if found != expected {
            return Err(PolicyError::GoldenImages { found, expected });
        }
        if self.encoder.control_periods_per_image == 0 {
            return Err(EncoderError::Pace.into());
        }
        let code_bits = match policy.parameters {
            ParameterFormat::Float32 => [0; STAGE_LIMIT],
            ParameterFormat::Fixed16(format) => {
                self.check_feature_step(format)?;
                self.encoder.format.code_bits
            }
        };
        let (shape, control_periods_per_image) = (self.encoder.shape, self.encoder.control_periods_per_image);
        Ok((policy, EncoderHeader { shape, control_periods_per_image, code_bits }))
    }

    fn check_feature_step(&self, format: FixedFormat) -> Result<(), EncoderError> {
        let dense_stage = self.encoder.shape.stages().len().saturating_sub(1);
        let found = self.encoder.format.steps.get(dense_stage).copied().unwrap_or_default();
        let expected = 1.0 / (1_u32 << format.input_fraction_bits.min(INPUT_FRACTION_BITS_LIMIT)) as f32;
        if found == expected { Ok(()) } else { Err(EncoderError::FeatureStep { found, expected }) }
    }

    fn write_encoder(&self, bytes: &mut [u8]) -> Result<(), PolicyError> {
        let EncoderDraft { shape, parameters, format, .. } = &self.encoder;
        match self.policy.parameters {
            ParameterFormat::Float32 => write_float(shape, parameters, bytes)?,
            ParameterFormat::Fixed16(_) => write_fixed(shape, parameters, format, bytes)?,
        }
        Ok(())
    }
}
