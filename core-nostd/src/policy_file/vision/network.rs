//! An encoder and the network behind it.

use super::super::{Arithmetic, Network, ParameterFormat, PolicyError, PolicyScratch};
use super::EncoderWorkspace;
use super::header::VisionHeader;
use crate::encoder::{Encoder, EncoderShape, FixedEncoder};
use crate::fixed::FixedMlp;
use crate::limits::{ACTION_LIMIT, WIDTH_LIMIT};
use crate::mlp::Mlp;

/// The encoder of a policy, in its arithmetic.
#[derive(Clone, Debug)]
pub enum PolicyEncoder<'a> {
    /// In `f32`.
    Float32(Encoder<'a>),
    /// In 8-bit weights.
    Fixed16(FixedEncoder<'a>),
}

/// Both networks in the same arithmetic.
#[derive(Clone, Debug)]
pub(super) struct VisionNetwork<'a> {
    encoder: PolicyEncoder<'a>,
    network: Network<'a>,
}

impl PolicyEncoder<'_> {
    /// What it reads and what it makes of it.
    pub fn shape(&self) -> &EncoderShape {
        match self {
            Self::Float32(encoder) => encoder.shape(),
            Self::Fixed16(encoder) => encoder.shape(),
        }
    }
}

impl<'a> VisionNetwork<'a> {
    pub(super) fn from_parameters(
        header: &VisionHeader,
        parameters: &'a [u8],
        encoder_parameters: &'a [u8],
    ) -> Result<Self, PolicyError> {
        let shape = header.encoder.shape;
        let network = Network::from_parameters(&header.policy, shape.features() as u16, parameters)?;
        let encoder = match header.policy.parameters {
            ParameterFormat::Float32 => {
                PolicyEncoder::Float32(Encoder::from_parameters(shape, encoder_parameters)?)
            }
            ParameterFormat::Fixed16(_) => PolicyEncoder::Fixed16(FixedEncoder::from_parameters(
                shape,
                &header.encoder.code_bits,
                encoder_parameters,
            )?),
        };
        Ok(Self { encoder, network })
    }

    pub(super) fn encoder(&self) -> &PolicyEncoder<'a> {
        &self.encoder
    }

    /// The encoder's work and the network's are never done at the same time, so they share what is behind the features.
    pub(super) fn memory_len(&self) -> usize {
        let inputs = match &self.network {
            Network::Float32(network) => network.inputs(),
            Network::Fixed16(network) => network.inputs().next_multiple_of(2),
        };
        let shape = self.encoder.shape();
        shape.features() + shape.scratch_len().max(inputs).max(WIDTH_LIMIT)
    }

    pub(super) fn encode(&self, image: &[u8], memory: &mut EncoderWorkspace<'_>) -> Result<(), PolicyError> {
        memory.check(self.memory_len(), self.arithmetic())?;
        let features = self.encoder.shape().features();
        match (&self.encoder, memory) {
            (PolicyEncoder::Float32(encoder), EncoderWorkspace::Float32(values)) => {
                let (features, scratch) = values.split_at_mut_checked(features).unwrap_or_default();
                Ok(encoder.encode(image, scratch, features)?)
            }
            (PolicyEncoder::Fixed16(encoder), EncoderWorkspace::Fixed16(values)) => {
                let (features, scratch) = values.split_at_mut_checked(features).unwrap_or_default();
                Ok(encoder.encode(image, scratch, features)?)
            }
            // Excluded by the check.
            (PolicyEncoder::Float32(_), EncoderWorkspace::Fixed16(_))
            | (PolicyEncoder::Fixed16(_), EncoderWorkspace::Float32(_)) => Ok(()),
        }
    }

    pub(super) fn act(
        &self,
        observation: &[f32],
        memory: &mut EncoderWorkspace<'_>,
        scratch: &mut PolicyScratch,
    ) -> Result<[f32; ACTION_LIMIT], PolicyError> {
        memory.check(self.memory_len(), self.arithmetic())?;
        Ok(match (&self.network, memory) {
            (Network::Float32(network), EncoderWorkspace::Float32(values)) => {
                self.act_in_float(network, observation, values, scratch)
            }
            (Network::Fixed16(network), EncoderWorkspace::Fixed16(values)) => {
                self.act_in_fixed(network, observation, values, scratch)
            }
            // Excluded by the check.
            (Network::Float32(_), EncoderWorkspace::Fixed16(_))
            | (Network::Fixed16(_), EncoderWorkspace::Float32(_)) => [0.0; ACTION_LIMIT],
        })
    }

    fn act_in_float(
        &self,
        network: &Mlp<'a>,
        observation: &[f32],
        memory: &mut [f32],
        scratch: &mut PolicyScratch,
    ) -> [f32; ACTION_LIMIT] {
        let split = memory.split_at_mut_checked(self.encoder.shape().features());
        let (features, inputs) = split.unwrap_or_default();
        network.act_on_features(observation, features, inputs, &mut scratch.float)
    }

    fn act_in_fixed(
        &self,
        network: &FixedMlp<'a>,
        observation: &[f32],
        memory: &mut [i16],
        scratch: &mut PolicyScratch,
    ) -> [f32; ACTION_LIMIT] {
        let split = memory.split_at_mut_checked(self.encoder.shape().features());
        let (features, inputs) = split.unwrap_or_default();
        network.act_on_features(observation, features, inputs, &mut scratch.fixed)
    }

    fn arithmetic(&self) -> Arithmetic {
        match self.encoder {
            PolicyEncoder::Float32(_) => Arithmetic::Float32,
            PolicyEncoder::Fixed16(_) => Arithmetic::Fixed16,
        }
    }
}
