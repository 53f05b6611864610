//! The memory of a vision policy, between the encoder and the network.

use super::super::recurrent::{MemoryHeader, PolicyMemory};
use super::super::{ParameterFormat, PolicyError};
use crate::fixed::FixedGru;
use crate::gru::Gru;

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

    pub(super) fn float(&self) -> Option<&Gru<'a>> {
        match &self.memory {
            PolicyMemory::Float32(memory) => Some(memory),
            PolicyMemory::Fixed16(_) => None,
        }
    }

    pub(super) fn fixed(&self) -> Option<&FixedGru<'a>> {
        match &self.memory {
            PolicyMemory::Fixed16(memory) => Some(memory),
            PolicyMemory::Float32(_) => None,
        }
    }
}
