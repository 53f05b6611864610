//! The memory of a vision policy, between the encoder and the network.

use super::super::recurrent::{MemoryHeader, PolicyMemory};
use super::super::{Network, ParameterFormat, PolicyError, PolicyScratch};
use super::EncoderWorkspace;
use crate::limits::ACTION_LIMIT;

/// What remembers of a vision policy: its hidden state takes in the observation and the features behind it.
#[derive(Clone, Debug)]
pub struct VisionMemory<'a> {
    memory: PolicyMemory<'a>,
    header: MemoryHeader,
    /// Values that it takes in.
    observation_len: usize,
    format: ParameterFormat,
    bytes: usize,
}

impl<'a> VisionMemory<'a> {
    pub(super) fn from_parameters(
        format: ParameterFormat,
        observation_len: usize,
        header: &MemoryHeader,
        parameters: &'a [u8],
    ) -> Result<Self, PolicyError> {
        let memory = PolicyMemory::from_parameters(format, observation_len, header, parameters)?;
        Ok(Self { memory, header: *header, observation_len, format, bytes: parameters.len() })
    }

    /// Values of its hidden state.
    pub fn units(&self) -> usize {
        self.header.units
    }

    /// Multiplications of a step, padding not counted.
    pub fn multiply_accumulates(&self) -> usize {
        self.header.multiply_accumulates(self.observation_len)
    }

    /// Bytes of weights and biases, padding included.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Fraction bits of the weights of gates and candidate in fixed point; zero in float.
    pub fn weight_fraction_bits(&self) -> [u8; 2] {
        self.header.weight_fraction_bits
    }

    /// The weight that stands in `row` and `column` of the gates (layer 0) or the candidate (1); zero beyond the matrix.
    pub fn weight(&self, layer: usize, row: usize, column: usize) -> f32 {
        self.memory.weight(&self.header, layer, row, column)
    }

    /// The bias that stands in `row`, as [`Self::weight`]; zero beyond the rows.
    pub fn bias(&self, layer: usize, row: usize) -> f32 {
        self.memory.bias(&self.header, self.format, layer, row)
    }

    /// The action of `network` on an observation, the `features` at the start of the workspace, which was checked, and the
    /// hidden state behind them, which takes both in before.
    pub(super) fn act(
        &self,
        network: &Network<'_>,
        (observation, features): (&[f32], usize),
        workspace: &mut EncoderWorkspace<'_>,
        scratch: &mut PolicyScratch,
    ) -> [f32; ACTION_LIMIT] {
        match (network, &self.memory, workspace) {
            (Network::Float32(network), PolicyMemory::Float32(memory), EncoderWorkspace::Float32(values)) => {
                let (features, rest) = values.split_at_mut_checked(features).unwrap_or_default();
                let (hidden, inputs) = rest.split_at_mut_checked(self.units()).unwrap_or_default();
                let remembering = (memory, hidden);
                network.act_on_features_recurrent(observation, features, remembering, inputs, &mut scratch.float)
            }
            (Network::Fixed16(network), PolicyMemory::Fixed16(memory), EncoderWorkspace::Fixed16(values)) => {
                let (features, rest) = values.split_at_mut_checked(features).unwrap_or_default();
                let (hidden, inputs) = rest.split_at_mut_checked(self.units()).unwrap_or_default();
                let remembering = (memory, hidden);
                network.act_on_features_recurrent(observation, features, remembering, inputs, &mut scratch.fixed)
            }
            // A file has one arithmetic, and the workspace was checked.
            (Network::Float32(_) | Network::Fixed16(_), _, _) => [0.0; ACTION_LIMIT],
        }
    }
}
