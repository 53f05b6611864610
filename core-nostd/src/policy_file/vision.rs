//! Policies with an encoder: a policy file of version 2, and how its two networks compute together.

mod header;
mod network;
mod workspace;
mod writer;

pub use header::ENCODER_HEADER_LEN;
pub use network::PolicyEncoder;
pub use workspace::EncoderWorkspace;
pub use writer::{EncoderDraft, VisionDraft};

use super::{
    Arithmetic, ParameterFormat, PolicyError, PolicyMetadata, PolicyScratch, compare, read_golden, read_metadata,
};
use crate::limits::ACTION_LIMIT;
use header::{VisionHeader, VisionSections};
use network::VisionNetwork;

/// A policy with an encoder, whose parameters lie in borrowed bytes.
///
/// Its network reads the observation and, behind it, the features of the last image.
#[derive(Clone, Debug)]
pub struct VisionPolicy<'a> {
    header: VisionHeader,
    metadata: PolicyMetadata<'a>,
    network: VisionNetwork<'a>,
    golden: &'a [u8],
}

impl<'a> VisionPolicy<'a> {
    /// The policy in `bytes`, which are the whole file and start on a four-byte boundary of memory.
    ///
    /// # Errors
    /// A variant per kind of damage; every altered bit and every cut is found. [`PolicyError::StateBased`] for a file that
    /// [`super::PolicyFile`] reads.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, PolicyError> {
        let header = VisionHeader::parse(bytes)?;
        let found = bytes.as_ptr().addr() % 4;
        if found != 0 {
            return Err(PolicyError::Misaligned { found });
        }
        let VisionSections { metadata, golden, parameters, encoder_parameters, .. } = header.sections();
        let section = |range| bytes.get(range).unwrap_or_default();
        let metadata = read_metadata(section(metadata), &header.policy)?;
        let network = VisionNetwork::from_parameters(&header, section(parameters), section(encoder_parameters))?;
        Ok(Self { metadata, network, golden: section(golden), header })
    }

    /// Name, observation layout (without the features), action space, control period.
    pub fn metadata(&self) -> &PolicyMetadata<'a> {
        &self.metadata
    }

    /// What both networks are computed with.
    pub fn arithmetic(&self) -> Arithmetic {
        self.header.policy.parameters.arithmetic()
    }

    /// Number format of the parameters of the network behind the encoder.
    pub fn parameter_format(&self) -> ParameterFormat {
        self.header.policy.parameters
    }

    /// What turns images into features.
    pub fn encoder(&self) -> &PolicyEncoder<'a> {
        self.network.encoder()
    }

    /// Control periods from one image to the next in training.
    pub fn control_periods_per_image(&self) -> u16 {
        self.header.encoder.control_periods_per_image
    }

    /// Inputs and outputs of each layer behind the encoder; the first reads observation and features.
    pub fn shapes(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.header.policy.shapes(self.header.encoder.shape.features())
    }

    /// Multiplications of an action, without those of an image, padding not counted.
    pub fn multiply_accumulates(&self) -> usize {
        self.shapes().map(|(inputs, outputs)| inputs * outputs).sum()
    }

    /// Bytes of weights and biases behind the encoder, padding included.
    pub fn parameter_bytes(&self) -> usize {
        self.header.sections().parameters.len()
    }

    /// Bytes of the encoder's parameters, padding included.
    pub fn encoder_bytes(&self) -> usize {
        self.header.sections().encoder_parameters.len()
    }

    /// Values that [`EncoderWorkspace`] must have: the features, and room for the encoder's or the network's work.
    pub fn memory_len(&self) -> usize {
        self.network.memory_len()
    }

    /// Whether `memory` is of the right kind and long enough.
    ///
    /// # Errors
    /// [`PolicyError::EncoderWorkspace`].
    pub fn check_memory(&self, memory: &EncoderWorkspace<'_>) -> Result<(), PolicyError> {
        memory.check(self.memory_len(), self.arithmetic())
    }

    /// Keeps the features of `image` `[rows][columns][channels]` in `memory`, for the actions that follow.
    ///
    /// # Errors
    /// [`PolicyError::EncoderWorkspace`], or [`PolicyError::Encoder`] for an image of another length; the features are then
    /// those of before.
    pub fn encode(&self, image: &[u8], memory: &mut EncoderWorkspace<'_>) -> Result<(), PolicyError> {
        self.network.encode(image, memory)
    }

    /// The action in \[-1, 1\] on an encoded observation and the features in `memory`, followed by zeros. Never
    /// returns NaN, whatever the observation.
    ///
    /// # Errors
    /// [`PolicyError::EncoderWorkspace`].
    pub fn act(
        &self,
        observation: &[f32],
        memory: &mut EncoderWorkspace<'_>,
        scratch: &mut PolicyScratch,
    ) -> Result<[f32; ACTION_LIMIT], PolicyError> {
        self.network.act(observation, memory, scratch)
    }

    /// Encodes the golden images and computes the golden actions again: to the bit in fixed point, to
    /// [`super::FLOAT_SELF_TEST_TOLERANCE`] in float. The features in `memory` are lost.
    ///
    /// # Errors
    /// [`PolicyError::SelfTest`] with the first deviation, or [`PolicyError::EncoderWorkspace`].
    pub fn self_test_with(
        &self,
        memory: &mut EncoderWorkspace<'_>,
        scratch: &mut PolicyScratch,
    ) -> Result<(), PolicyError> {
        let (observation_len, action_len) =
            (self.header.policy.observation_len(), self.header.policy.action_len());
        let image_len = self.header.encoder.shape.image().len();
        let vectors = self.golden.chunks_exact(self.header.golden_bytes());
        for (vector, golden) in vectors.enumerate() {
            let (numbers, image) = golden.split_at_checked(4 * (observation_len + action_len)).unwrap_or_default();
            let (observation, expected) = read_golden(numbers, observation_len);
            self.encode(image.get(..image_len).unwrap_or_default(), memory)?;
            let observation = observation.get(..observation_len).unwrap_or_default();
            let action = self.act(observation, memory, scratch)?;
            let action = action.get(..action_len).unwrap_or_default();
            compare(vector, action, expected, self.arithmetic().self_test_tolerance())?;
        }
        Ok(())
    }
}
