//! Writing policies with an encoder, into the caller's bytes.

use super::super::header::{CHECKSUM_LEN, HEADER_LEN, ParameterFormat, VISION_FORMAT_VERSION};
use super::super::writer::{copy, copy_words, section};
use super::super::{PolicyDraft, PolicyError, PolicyScratch};
use super::EncoderWorkspace;
use super::header::{ENCODER_HEADER_LEN, EncoderHeader, VisionHeader, VisionSections};
use super::network::VisionNetwork;
use crate::crc32::crc32;
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
        Ok(self.header()?.sections().checksum.end)
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
        let header = self.header()?;
        let sections = header.sections();
        let (found, expected) = (bytes.len(), sections.checksum.end);
        let file = bytes.get_mut(..expected).ok_or(PolicyError::BufferTooSmall { found, expected })?;
        file.fill(0);
        copy(&header.policy.encode(VISION_FORMAT_VERSION, expected), section(file, 0..HEADER_LEN));
        copy(&header.encoder.encode(), section(file, HEADER_LEN..HEADER_LEN + ENCODER_HEADER_LEN));
        self.policy.write_metadata(section(file, sections.metadata.clone()))?;
        self.policy.write_parameters(section(file, sections.parameters.clone()))?;
        self.write_encoder(section(file, sections.encoder_parameters.clone()))?;
        self.write_golden(&header, &sections, file, memory)?;
        let (contents, checksum) = file.split_at_mut_checked(expected - CHECKSUM_LEN).unwrap_or_default();
        copy(&crc32(contents).to_le_bytes(), checksum);
        Ok(expected)
    }

    fn header(&self) -> Result<VisionHeader, PolicyError> {
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
        Ok(VisionHeader { policy, encoder: EncoderHeader { shape, control_periods_per_image, code_bits } })
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

    /// Writes observations and images, and the actions that the networks in the file give for them.
    fn write_golden(
        &self,
        header: &VisionHeader,
        sections: &VisionSections,
        file: &mut [u8],
        memory: &mut EncoderWorkspace<'_>,
    ) -> Result<(), PolicyError> {
        let (front, rest) = file.split_at_mut_checked(sections.parameters.start).unwrap_or_default();
        let (parameters, rest) = rest.split_at_checked(sections.parameters.len()).unwrap_or_default();
        let encoder_parameters = rest.get(..sections.encoder_parameters.len()).unwrap_or_default();
        let network = VisionNetwork::from_parameters(header, parameters, encoder_parameters)?;
        let (observation_len, action_len) = (header.policy.observation_len(), header.policy.action_len());
        let vectors = section(front, sections.golden.clone()).chunks_exact_mut(header.golden_bytes());
        let observations = self.policy.golden_observations.chunks_exact(observation_len);
        let images = self.encoder.golden_images.chunks_exact(self.encoder.shape.image().len());
        let mut scratch = PolicyScratch::new();
        for (bytes, (observation, image)) in vectors.zip(observations.zip(images)) {
            let actions = copy_words(observation.iter().map(|value| value.to_le_bytes()), bytes);
            network.encode(image, memory)?;
            let action = network.act(observation, memory, &mut scratch)?;
            let rest = copy_words(action.iter().take(action_len).map(|value| value.to_le_bytes()), actions);
            copy(image, rest);
        }
        Ok(())
    }
}
