//! Writing policies with an encoder, into the caller's bytes.

use super::super::header::{
    HEADER_LEN, Header, ParameterFormat, RECURRENT_VISION_FORMAT_VERSION, VISION_FORMAT_VERSION,
};
use super::super::writer::{copy, seal, section};
use super::super::{
    MEMORY_HEADER_LEN, MemoryDraft, Network, PolicyDraft, PolicyError, PolicyMemory, PolicyScratch,
};
use super::header::{ENCODER_HEADER_LEN, EncoderHeader, FrontHeaders};
use super::{EncoderWorkspace, PolicyEncoder};
use crate::encoder::{EncoderError, EncoderFormat, EncoderShape, STAGE_LIMIT, write_fixed, write_float};
use crate::fixed::{FixedFormat, INPUT_FRACTION_BITS_LIMIT};
use crate::limits::WIDTH_LIMIT;

/// What goes into the policy file of a policy with an encoder.
#[derive(Clone, Copy, Debug)]
pub struct VisionDraft<'a> {
    /// Everything behind the encoder; the first layer reads the observation, then the features, then the hidden state, if there
    /// is one. Golden observations follow each other in one flight.
    pub policy: PolicyDraft<'a>,
    /// What turns images into features.
    pub encoder: EncoderDraft<'a>,
    /// What remembers, if anything does: it reads the observation, then the features.
    pub memory: Option<MemoryDraft<'a>>,
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
        self.headers().map(|(policy, fronts)| policy.sections(fronts.sizes(policy.parameters)).checksum.end)
    }

    /// Values of memory with which [`Self::write`] computes the golden actions.
    pub fn memory_len(&self) -> usize {
        let units = self.memory.map_or(0, |memory| memory.candidate.outputs);
        let inputs = self.policy.metadata.observation.len() + self.encoder.shape.features() + units;
        let work = self.encoder.shape.scratch_len().max(inputs.next_multiple_of(2)).max(WIDTH_LIMIT);
        self.encoder.shape.features() + units + work
    }

    /// Writes the file to the start of `bytes` and returns its length; the same draft gives the same bytes. `memory`
    /// is of the draft's arithmetic.
    ///
    /// # Errors
    /// The variant of whatever no policy file can hold, [`PolicyError::BufferTooSmall`] or [`PolicyError::EncoderWorkspace`].
    pub fn write(&self, bytes: &mut [u8], memory: &mut EncoderWorkspace<'_>) -> Result<usize, PolicyError> {
        let (header, fronts) = self.headers()?;
        let sizes = fronts.sizes(header.parameters);
        let version =
            if fronts.memory.is_some() { RECURRENT_VISION_FORMAT_VERSION } else { VISION_FORMAT_VERSION };
        let (file, sections) = self.policy.write_parts(&header, sizes, version, bytes)?;
        let behind = HEADER_LEN + ENCODER_HEADER_LEN;
        copy(&fronts.encoder.encode(), section(file, HEADER_LEN..behind));
        let encoder_bytes = fronts.encoder.sizes(header.parameters).parameter_bytes;
        let parameters = section(file, sections.front_parameters.clone());
        let (of_encoder, of_memory) = parameters.split_at_mut_checked(encoder_bytes).unwrap_or_default();
        self.write_encoder(of_encoder)?;
        if let (Some(draft), Some(memory_header)) = (&self.memory, &fronts.memory) {
            draft.write(self.policy.parameters, of_memory)?;
            copy(&memory_header.encode(), section(file, behind..behind + MEMORY_HEADER_LEN));
        }
        self.write_actions(&header, &fronts, file, memory)?;
        Ok(seal(file))
    }

    /// Writes the golden observations and images, and the actions that the networks in the file give for them.
    fn write_actions(
        &self,
        header: &Header,
        fronts: &FrontHeaders,
        file: &mut [u8],
        memory: &mut EncoderWorkspace<'_>,
    ) -> Result<(), PolicyError> {
        let (format, features) = (header.parameters, fronts.encoder.shape.features());
        let sizes = fronts.sizes(format);
        let sections = header.sections(sizes);
        let (front, rest) = file.split_at_mut_checked(sections.parameters.start).unwrap_or_default();
        let (parameters, rest) = rest.split_at_checked(sections.parameters.len()).unwrap_or_default();
        let front_parameters = rest.get(..sections.front_parameters.len()).unwrap_or_default();
        let (of_encoder, of_memory) =
            front_parameters.split_at_checked(fronts.encoder.sizes(format).parameter_bytes).unwrap_or_default();
        let network = Network::from_parameters(header, sizes.features, parameters)?;
        let encoder = PolicyEncoder::from_parameters(&fronts.encoder, format, of_encoder)?;
        let remembering = fronts
            .memory
            .map(|memory| PolicyMemory::from_parameters(format, fronts.observation_len, &memory, of_memory))
            .transpose()?;
        let units = remembering.as_ref().map_or(0, PolicyMemory::units);
        memory.check(encoder.memory_len(units, &network), encoder.arithmetic())?;
        memory.clear();
        let mut scratch = PolicyScratch::new();
        let act = |observation: &[f32], image: &[u8]| {
            encoder.encode(image, units, memory)?;
            Ok(network.act_on_features(observation, (features, remembering.as_ref()), memory, &mut scratch))
        };
        let golden = section(front, sections.golden.clone());
        self.policy.write_golden(header, self.encoder.golden_images, golden, act)
    }

    fn headers(&self) -> Result<(Header, FrontHeaders), PolicyError> {
        let (features, observation_len) = (self.encoder.shape.features(), self.policy.metadata.observation.len());
        let header = |memory: MemoryDraft<'_>| memory.header(observation_len + features, self.policy.parameters);
        let memory = self.memory.map(header).transpose()?;
        let policy = self.policy.header(features + memory.map_or(0, |memory| memory.units))?;
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
        let encoder = EncoderHeader { shape, control_periods_per_image, code_bits };
        Ok((policy, FrontHeaders::new(encoder, memory, observation_len)))
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
