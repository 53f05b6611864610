//! Vision policies: a policy file of version 2 is one of version 1 with an encoder in front, one of version 4 has a memory
//! behind that.

mod header;
mod workspace;
mod writer;

pub use header::ENCODER_HEADER_LEN;
pub use workspace::EncoderWorkspace;
pub use writer::{EncoderDraft, VisionDraft};

use super::header::{Header, RECURRENT_VISION_FORMAT_VERSION, VISION_FORMAT_VERSION, u16_at};
use super::{
    Arithmetic, Network, ParameterFormat, PolicyError, PolicyFile, PolicyMemory, PolicyMetadata, PolicyScratch,
};
use crate::encoder::{Encoder, EncoderShape, FixedEncoder};
use crate::gru::HiddenState;
use crate::limits::{ACTION_LIMIT, WIDTH_LIMIT};
use header::{EncoderHeader, FrontHeaders};

/// The encoder of a policy, in its arithmetic.
#[derive(Clone, Debug)]
pub enum PolicyEncoder<'a> {
    /// In `f32`.
    Float32(Encoder<'a>),
    /// In 8-bit weights.
    Fixed16(FixedEncoder<'a>),
}

/// A policy with an encoder, whose parameters lie in borrowed bytes.
///
/// Its network reads the observation and, behind it, the features of the last image; where it has a memory also, behind
/// these, the hidden state that has taken in this observation with its features and all before.
#[derive(Clone, Debug)]
pub struct VisionPolicy<'a> {
    policy: PolicyFile<'a>,
    encoder: PolicyEncoder<'a>,
    memory: Option<PolicyMemory<'a>>,
    encoder_bytes: usize,
    control_periods_per_image: u16,
}

impl<'a> PolicyEncoder<'a> {
    fn from_parameters(
        header: &EncoderHeader,
        format: ParameterFormat,
        parameters: &'a [u8],
    ) -> Result<Self, PolicyError> {
        Ok(match format {
            ParameterFormat::Float32 => Self::Float32(Encoder::from_parameters(header.shape, parameters)?),
            ParameterFormat::Fixed16(_) => {
                Self::Fixed16(FixedEncoder::from_parameters(header.shape, &header.code_bits, parameters)?)
            }
        })
    }

    /// What it reads and what it makes of it.
    pub fn shape(&self) -> &EncoderShape {
        match self {
            Self::Float32(encoder) => encoder.shape(),
            Self::Fixed16(encoder) => encoder.shape(),
        }
    }

    fn arithmetic(&self) -> Arithmetic {
        match self {
            Self::Float32(_) => Arithmetic::Float32,
            Self::Fixed16(_) => Arithmetic::Fixed16,
        }
    }

    /// Values of memory for it, `units` of a hidden state and `network`. The work of both networks is never done at the same
    /// time, so they share what is behind features and hidden state.
    fn memory_len(&self, units: usize, network: &Network<'_>) -> usize {
        let inputs = match network {
            Network::Float32(network) => network.inputs(),
            Network::Fixed16(network) => network.inputs().next_multiple_of(2),
        };
        let shape = self.shape();
        shape.features() + units + shape.scratch_len().max(inputs).max(WIDTH_LIMIT)
    }

    /// Keeps the features of `image` at the start of `memory`, which was checked; behind them lie `units` of a hidden state.
    fn encode(&self, image: &[u8], units: usize, memory: &mut EncoderWorkspace<'_>) -> Result<(), PolicyError> {
        let features = self.shape().features();
        match (self, memory) {
            (Self::Float32(encoder), EncoderWorkspace::Float32(values)) => {
                let (features, scratch) = values.split_at_mut_checked(features).unwrap_or_default();
                Ok(encoder.encode(image, scratch.get_mut(units..).unwrap_or_default(), features)?)
            }
            (Self::Fixed16(encoder), EncoderWorkspace::Fixed16(values)) => {
                let (features, scratch) = values.split_at_mut_checked(features).unwrap_or_default();
                Ok(encoder.encode(image, scratch.get_mut(units..).unwrap_or_default(), features)?)
            }
            // Excluded by the check.
            (Self::Float32(_), EncoderWorkspace::Fixed16(_))
            | (Self::Fixed16(_), EncoderWorkspace::Float32(_)) => Ok(()),
        }
    }
}

impl Network<'_> {
    /// The action on `observation` and the first `features` values of `memory`, which was checked; with what remembers also
    /// on the hidden state behind them.
    fn act_on_features(
        &self,
        observation: &[f32],
        (features, remembering): (usize, Option<&PolicyMemory<'_>>),
        memory: &mut EncoderWorkspace<'_>,
        scratch: &mut PolicyScratch,
    ) -> [f32; ACTION_LIMIT] {
        let units = remembering.map_or(0, PolicyMemory::units);
        match (self, memory) {
            (Self::Float32(network), EncoderWorkspace::Float32(values)) => {
                let (features, rest) = values.split_at_mut_checked(features).unwrap_or_default();
                let (hidden, inputs) = rest.split_at_mut_checked(units).unwrap_or_default();
                let remembering = (remembering.and_then(PolicyMemory::float), hidden);
                network.act_on_features(observation, features, remembering, inputs, &mut scratch.float)
            }
            (Self::Fixed16(network), EncoderWorkspace::Fixed16(values)) => {
                let (features, rest) = values.split_at_mut_checked(features).unwrap_or_default();
                let (hidden, inputs) = rest.split_at_mut_checked(units).unwrap_or_default();
                let remembering = (remembering.and_then(PolicyMemory::fixed), hidden);
                network.act_on_features(observation, features, remembering, inputs, &mut scratch.fixed)
            }
            // Excluded by the check.
            (Self::Float32(_), EncoderWorkspace::Fixed16(_))
            | (Self::Fixed16(_), EncoderWorkspace::Float32(_)) => [0.0; ACTION_LIMIT],
        }
    }
}

impl<'a> VisionPolicy<'a> {
    /// The policy in `bytes`, which are the whole file and start on a four-byte boundary of memory.
    ///
    /// # Errors
    /// A variant per kind of damage; every altered bit and every cut is found. [`PolicyError::StateBased`] for a file that
    /// [`super::PolicyFile`] reads.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, PolicyError> {
        let remembers = u16_at(bytes, 8) == RECURRENT_VISION_FORMAT_VERSION;
        let version = if remembers { RECURRENT_VISION_FORMAT_VERSION } else { VISION_FORMAT_VERSION };
        let header = Header::parse(bytes, version)?;
        let fronts = FrontHeaders::parse(bytes, remembers, &header)?;
        let FrontHeaders { encoder, memory, observation_len } = fronts;
        let format = header.parameters;
        let (policy, parameters) = PolicyFile::read(bytes, header, fronts.sizes(format))?;
        let encoder_bytes = encoder.sizes(format).parameter_bytes;
        let (of_encoder, of_memory) = parameters.split_at_checked(encoder_bytes).unwrap_or_default();
        let memory =
            memory.map(|memory| PolicyMemory::from_parameters(format, observation_len, &memory, of_memory));
        Ok(Self {
            policy,
            encoder: PolicyEncoder::from_parameters(&encoder, format, of_encoder)?,
            memory: memory.transpose()?,
            encoder_bytes,
            control_periods_per_image: encoder.control_periods_per_image,
        })
    }

    /// Name, observation layout (without the features), action space, control period.
    pub fn metadata(&self) -> &PolicyMetadata<'a> {
        self.policy.metadata()
    }

    /// What both networks are computed with.
    pub fn arithmetic(&self) -> Arithmetic {
        self.policy.arithmetic()
    }

    /// Number format of the parameters of the network behind the encoder.
    pub fn parameter_format(&self) -> ParameterFormat {
        self.policy.parameter_format()
    }

    /// What turns images into features.
    pub fn encoder(&self) -> &PolicyEncoder<'a> {
        &self.encoder
    }

    /// Control periods from one image to the next in training.
    pub fn control_periods_per_image(&self) -> u16 {
        self.control_periods_per_image
    }

    /// Units of the memory; none where nothing is remembered.
    pub fn units(&self) -> usize {
        self.memory.as_ref().map_or(0, PolicyMemory::units)
    }

    /// Inputs and outputs of each layer behind the encoder; the first reads observation, features and hidden state.
    pub fn shapes(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.policy.shapes()
    }

    /// Multiplications of an action, the memory's included, without those of an image, padding not counted.
    pub fn multiply_accumulates(&self) -> usize {
        self.policy.multiply_accumulates() + self.memory.as_ref().map_or(0, PolicyMemory::multiply_accumulates)
    }

    /// Bytes of weights and biases behind the encoder, the memory's and padding included.
    pub fn parameter_bytes(&self) -> usize {
        self.policy.parameter_bytes() + self.memory.as_ref().map_or(0, PolicyMemory::bytes)
    }

    /// What remembers, if anything does.
    pub fn memory(&self) -> Option<&PolicyMemory<'a>> {
        self.memory.as_ref()
    }

    /// The network behind encoder and memory, to read its numbers. By itself it acts on no features.
    pub fn network(&self) -> &PolicyFile<'a> {
        &self.policy
    }

    /// Bytes of the encoder's parameters, padding included.
    pub fn encoder_bytes(&self) -> usize {
        self.encoder_bytes
    }

    /// Values that [`EncoderWorkspace`] must have: the features, the hidden state, and room for the encoder's or the network's
    /// work.
    pub fn memory_len(&self) -> usize {
        self.encoder.memory_len(self.units(), &self.policy.network)
    }

    /// Whether `memory` is of the right kind and long enough.
    ///
    /// # Errors
    /// [`PolicyError::EncoderWorkspace`].
    pub fn check_memory(&self, memory: &EncoderWorkspace<'_>) -> Result<(), PolicyError> {
        memory.check(self.memory_len(), self.encoder.arithmetic())
    }

    /// Keeps the features of `image` `[rows][columns][channels]` in `memory`, for the actions that follow.
    ///
    /// # Errors
    /// [`PolicyError::EncoderWorkspace`], or [`PolicyError::Encoder`] for an image of another length; the features are then
    /// those of before.
    pub fn encode(&self, image: &[u8], memory: &mut EncoderWorkspace<'_>) -> Result<(), PolicyError> {
        self.check_memory(memory)?;
        self.encoder.encode(image, self.units(), memory)
    }

    /// The action in \[-1, 1\] on an encoded observation and the features in `memory`, followed by zeros; the hidden state, if
    /// there is one, takes both in before. Never returns NaN, whatever the observation.
    ///
    /// # Errors
    /// [`PolicyError::EncoderWorkspace`].
    pub fn act(
        &self,
        observation: &[f32],
        memory: &mut EncoderWorkspace<'_>,
        scratch: &mut PolicyScratch,
    ) -> Result<[f32; ACTION_LIMIT], PolicyError> {
        self.check_memory(memory)?;
        let features = self.encoder.shape().features();
        let remembering = self.memory.as_ref();
        Ok(self.policy.network.act_on_features(observation, (features, remembering), memory, scratch))
    }

    /// Puts the `hidden` state of a flight into `memory`, for the actions that follow; nothing where nothing is remembered.
    ///
    /// # Errors
    /// [`PolicyError::EncoderWorkspace`].
    pub fn remember(&self, hidden: &HiddenState, memory: &mut EncoderWorkspace<'_>) -> Result<(), PolicyError> {
        self.check_memory(memory)?;
        let units = self.hidden_places();
        match memory {
            EncoderWorkspace::Float32(values) => {
                let places = values.get_mut(units).unwrap_or_default();
                places.iter_mut().zip(&hidden.float).for_each(|(place, value)| *place = *value);
            }
            EncoderWorkspace::Fixed16(values) => {
                let places = values.get_mut(units).unwrap_or_default();
                places.iter_mut().zip(&hidden.fixed).for_each(|(place, value)| *place = *value);
            }
        }
        Ok(())
    }

    /// The hidden state in `memory` after the last action; zeros where nothing is remembered.
    ///
    /// # Errors
    /// [`PolicyError::EncoderWorkspace`].
    pub fn hidden(&self, memory: &EncoderWorkspace<'_>) -> Result<HiddenState, PolicyError> {
        self.check_memory(memory)?;
        let (units, mut hidden) = (self.hidden_places(), HiddenState::new());
        match memory {
            EncoderWorkspace::Float32(values) => {
                let places = values.get(units).unwrap_or_default();
                hidden.float.iter_mut().zip(places).for_each(|(value, place)| *value = *place);
            }
            EncoderWorkspace::Fixed16(values) => {
                let places = values.get(units).unwrap_or_default();
                hidden.fixed.iter_mut().zip(places).for_each(|(value, place)| *value = *place);
            }
        }
        Ok(hidden)
    }

    fn hidden_places(&self) -> core::ops::Range<usize> {
        let features = self.encoder.shape().features();
        features..features + self.units()
    }

    /// Encodes the golden images and computes the golden actions again: to the bit in fixed point, to
    /// [`super::FLOAT_SELF_TEST_TOLERANCE`] in float, as one flight where something is remembered. What is in `memory` is lost.
    ///
    /// # Errors
    /// [`PolicyError::SelfTest`] with the first deviation, or [`PolicyError::EncoderWorkspace`].
    pub fn self_test_with(
        &self,
        memory: &mut EncoderWorkspace<'_>,
        scratch: &mut PolicyScratch,
    ) -> Result<(), PolicyError> {
        let image_len = self.encoder.shape().image().len();
        memory.clear();
        self.policy.compare_golden(|observation, image| {
            self.encode(image.get(..image_len).unwrap_or_default(), memory)?;
            self.act(observation, memory, scratch)
        })
    }
}
