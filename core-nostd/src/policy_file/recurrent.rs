//! Recurrent policies: a policy file of version 3 is one of version 1 with a memory in front.

use super::header::{FrontSizes, HEADER_LEN, Header, RECURRENT_FORMAT_VERSION, Sections, u8_at, u16_at};
use super::writer::{copy, copy_words, seal, section, write_layer};
use super::{
    Arithmetic, Network, ParameterFormat, PolicyDraft, PolicyError, PolicyFile, PolicyMetadata, PolicyScratch,
};
use crate::airframe::Airframe;
use crate::fixed::{FixedFormat, FixedGru, gru_format};
use crate::gru::{Gru, HiddenState, MemoryShape};
use crate::limits::ACTION_LIMIT;
use crate::mlp::DenseLayer;

/// Bytes of the memory's header, which follows the header; the metadata follow.
pub const MEMORY_HEADER_LEN: usize = 8;

/// What remembers of a policy: its hidden state takes in the observation and, in a vision policy, the features behind it.
#[derive(Clone, Debug)]
pub struct PolicyMemory<'a> {
    unit: Unit<'a>,
    header: MemoryHeader,
    /// Values that it takes in.
    observation_len: usize,
    format: ParameterFormat,
    bytes: usize,
}

/// The gated recurrent unit, in its arithmetic.
#[derive(Clone, Debug)]
enum Unit<'a> {
    /// In `f32`.
    Float32(Gru<'a>),
    /// In 16-bit weights.
    Fixed16(FixedGru<'a>),
}

/// A policy with a memory, whose parameters lie in borrowed bytes.
///
/// Its network reads the observation and, behind it, the hidden state that has taken in this observation and all before.
#[derive(Clone, Debug)]
pub struct RecurrentPolicy<'a> {
    policy: PolicyFile<'a>,
    memory: PolicyMemory<'a>,
}

/// Everything in the memory's header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MemoryHeader {
    pub(super) units: usize,
    /// Fraction bits of the weights of gates and candidate in fixed point; zero in float.
    pub(super) weight_fraction_bits: [u8; 2],
}

/// What goes into the file of a recurrent policy.
#[derive(Clone, Copy, Debug)]
pub struct RecurrentDraft<'a> {
    /// Everything behind the memory; the first layer reads the observation, then the hidden state. Golden observations follow
    /// each other in one flight.
    pub policy: PolicyDraft<'a>,
    /// What remembers.
    pub memory: MemoryDraft<'a>,
}

/// The memory of a draft.
#[derive(Clone, Copy, Debug)]
pub struct MemoryDraft<'a> {
    /// From the observation and the hidden state to the gates, `[r, z]`.
    pub gates: DenseLayer<'a>,
    /// From the observation and the gated hidden state to the candidate.
    pub candidate: DenseLayer<'a>,
    /// Fraction bits of the weights of both in fixed point. Float reads none.
    pub weight_fraction_bits: [u8; 2],
}

impl MemoryHeader {
    /// Reads it from byte `offset` of a file, for a memory that takes in `observation_len` values.
    pub(super) fn parse(
        file: &[u8],
        offset: usize,
        observation_len: usize,
        parameters: ParameterFormat,
    ) -> Result<Self, PolicyError> {
        let bytes = file.get(offset..).unwrap_or_default();
        let parsed = Self {
            units: usize::from(u16_at(bytes, 0)),
            weight_fraction_bits: [u8_at(bytes, 2), u8_at(bytes, 3)],
        };
        let used = match parameters {
            ParameterFormat::Float32 => 2,
            ParameterFormat::Fixed16(_) => 4,
        };
        if let Some(at) = (used..MEMORY_HEADER_LEN).find(|at| u8_at(bytes, *at) != 0) {
            let found = u16::from(u8_at(bytes, at));
            return Err(PolicyError::UnusedField { offset: offset + at, found });
        }
        parsed.shape(observation_len).check()?;
        Ok(parsed)
    }

    pub(super) fn encode(&self) -> [u8; MEMORY_HEADER_LEN] {
        let [low, high] = (self.units as u16).to_le_bytes();
        let [gates, candidate] = self.weight_fraction_bits;
        [low, high, gates, candidate, 0, 0, 0, 0]
    }

    fn shape(&self, observation_len: usize) -> MemoryShape {
        MemoryShape { observation_len, units: self.units }
    }

    pub(super) fn sizes(&self, observation_len: usize, parameters: ParameterFormat) -> FrontSizes {
        let inputs = self.shape(observation_len).inputs();
        let bytes = |outputs| parameters.layer_bytes(inputs, outputs);
        FrontSizes {
            header_len: MEMORY_HEADER_LEN,
            features: self.units,
            image_len: 0,
            parameter_bytes: bytes(2 * self.units) + bytes(self.units),
        }
    }
}

impl<'a> PolicyMemory<'a> {
    /// A memory that takes in `observation_len` values.
    pub(super) fn from_parameters(
        format: ParameterFormat,
        observation_len: usize,
        header: &MemoryHeader,
        parameters: &'a [u8],
    ) -> Result<Self, PolicyError> {
        let shape = header.shape(observation_len);
        let unit = match format {
            ParameterFormat::Float32 => Unit::Float32(Gru::from_parameters(shape, parameters)?),
            ParameterFormat::Fixed16(format) => {
                let bits = header.weight_fraction_bits;
                Unit::Fixed16(FixedGru::from_parameters(shape, format, bits, parameters)?)
            }
        };
        Ok(Self { unit, header: *header, observation_len, format, bytes: parameters.len() })
    }

    /// Values of its hidden state.
    pub fn units(&self) -> usize {
        self.header.units
    }

    /// Multiplications of a step, padding not counted.
    pub fn multiply_accumulates(&self) -> usize {
        3 * self.header.shape(self.observation_len).inputs() * self.units()
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
        match &self.unit {
            Unit::Float32(unit) => unit.layer(layer).weight(row, column),
            Unit::Fixed16(unit) => {
                let bits = self.header.weight_fraction_bits.get(layer).copied().unwrap_or_default();
                f32::from(unit.weight_code(layer, row, column)) / (1_u32 << bits) as f32
            }
        }
    }

    /// The bias that stands in `row`, as [`Self::weight`]; zero beyond the rows.
    pub fn bias(&self, layer: usize, row: usize) -> f32 {
        match (&self.unit, self.format) {
            (Unit::Fixed16(unit), ParameterFormat::Fixed16(format)) => {
                let weights = self.header.weight_fraction_bits.get(layer).copied().unwrap_or_default();
                let bits = gru_format(format, weights).sum_fraction_bits(0).unwrap_or_default();
                unit.bias_code(layer, row) as f32 / (1_u64 << bits) as f32
            }
            (Unit::Float32(unit), _) => unit.layer(layer).bias(row),
            (Unit::Fixed16(_), ParameterFormat::Float32) => 0.0,
        }
    }

    #[cfg(feature = "encoder")]
    pub(super) fn float(&self) -> Option<&Gru<'a>> {
        match &self.unit {
            Unit::Float32(unit) => Some(unit),
            Unit::Fixed16(_) => None,
        }
    }

    #[cfg(feature = "encoder")]
    pub(super) fn fixed(&self) -> Option<&FixedGru<'a>> {
        match &self.unit {
            Unit::Fixed16(unit) => Some(unit),
            Unit::Float32(_) => None,
        }
    }
}

impl Network<'_> {
    fn act_recurrent(
        &self,
        observation: &[f32],
        memory: &PolicyMemory<'_>,
        hidden: &mut HiddenState,
        scratch: &mut PolicyScratch,
    ) -> [f32; ACTION_LIMIT] {
        match (self, &memory.unit) {
            (Self::Float32(network), Unit::Float32(memory)) => {
                network.act_recurrent(observation, memory, hidden, &mut scratch.float)
            }
            (Self::Fixed16(network), Unit::Fixed16(memory)) => {
                network.act_recurrent(observation, memory, hidden, &mut scratch.fixed)
            }
            // A file has one arithmetic.
            (Self::Float32(_), Unit::Fixed16(_)) | (Self::Fixed16(_), Unit::Float32(_)) => [0.0; ACTION_LIMIT],
        }
    }
}

impl<'a> RecurrentPolicy<'a> {
    /// The policy in `bytes`, which are the whole file and start on a four-byte boundary of memory.
    ///
    /// # Errors
    /// A variant per kind of damage; every altered bit and every cut is found. [`PolicyError::StateBased`] or
    /// [`PolicyError::Vision`] for a file of another kind.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, PolicyError> {
        let header = Header::parse(bytes, RECURRENT_FORMAT_VERSION)?;
        let (observation_len, format) = (header.observation_len(), header.parameters);
        let memory_header = MemoryHeader::parse(bytes, HEADER_LEN, observation_len, format)?;
        let (policy, parameters) = PolicyFile::read(bytes, header, memory_header.sizes(observation_len, format))?;
        let memory = PolicyMemory::from_parameters(format, observation_len, &memory_header, parameters)?;
        Ok(Self { policy, memory })
    }

    /// Name, observation layout (without the hidden state), action space, control period.
    pub fn metadata(&self) -> &PolicyMetadata<'a> {
        self.policy.metadata()
    }

    /// As [`PolicyFile::on`].
    #[must_use]
    pub fn on(mut self, airframe: &Airframe) -> Self {
        self.policy = self.policy.on(airframe);
        self
    }

    /// What it is computed with.
    pub fn arithmetic(&self) -> Arithmetic {
        self.policy.arithmetic()
    }

    /// Number format of the parameters of the network behind the memory.
    pub fn parameter_format(&self) -> ParameterFormat {
        self.policy.parameter_format()
    }

    /// What remembers.
    pub fn memory(&self) -> &PolicyMemory<'a> {
        &self.memory
    }

    /// Units of the memory.
    pub fn units(&self) -> usize {
        self.memory.units()
    }

    /// Inputs and outputs of each layer behind the memory; the first reads observation and hidden state.
    pub fn shapes(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.policy.shapes()
    }

    /// Multiplications of an action, the memory's included, padding not counted.
    pub fn multiply_accumulates(&self) -> usize {
        self.policy.multiply_accumulates() + self.memory.multiply_accumulates()
    }

    /// Bytes of weights and biases, the memory's and padding included.
    pub fn parameter_bytes(&self) -> usize {
        self.policy.parameter_bytes() + self.memory.bytes()
    }

    /// The network behind the memory, to read its numbers. By itself it acts on no hidden state.
    pub fn network(&self) -> &PolicyFile<'a> {
        &self.policy
    }

    /// How many values of `observation` lie beyond the range of the input format; none for a float policy.
    pub fn saturations(&self, observation: &[f32]) -> usize {
        self.policy.saturations(observation)
    }

    /// Takes an encoded observation into the `hidden` state; the action in \[-1, 1\], followed by zeros. Never panics, never
    /// returns NaN, whatever the observation. The state is the policy's own as long as it flies.
    pub fn act(
        &self,
        observation: &[f32],
        hidden: &mut HiddenState,
        scratch: &mut PolicyScratch,
    ) -> [f32; ACTION_LIMIT] {
        self.policy.network.act_recurrent(observation, &self.memory, hidden, scratch)
    }

    /// Flies the golden observations again, from an empty `hidden` state on, which it leaves empty: to the bit in fixed
    /// point, to [`super::FLOAT_SELF_TEST_TOLERANCE`] in float.
    ///
    /// # Errors
    /// [`PolicyError::SelfTest`] with the first deviation.
    pub fn self_test_with(
        &self,
        hidden: &mut HiddenState,
        scratch: &mut PolicyScratch,
    ) -> Result<(), PolicyError> {
        hidden.clear();
        let result = self.policy.compare_golden(|observation, _| Ok(self.act(observation, hidden, scratch)));
        hidden.clear();
        result
    }
}

impl RecurrentDraft<'_> {
    /// Bytes of the file.
    ///
    /// # Errors
    /// The variant of whatever no policy file can hold.
    pub fn file_len(&self) -> Result<usize, PolicyError> {
        let (header, memory_header) = self.headers()?;
        let sizes = memory_header.sizes(header.observation_len(), header.parameters);
        Ok(header.sections(sizes).checksum.end)
    }

    /// Writes the file to the start of `bytes`, which start on a four-byte boundary of memory, and returns its length; the
    /// same draft gives the same bytes.
    ///
    /// # Errors
    /// The variant of whatever no policy file can hold, [`PolicyError::Misaligned`] or [`PolicyError::BufferTooSmall`].
    pub fn write(&self, bytes: &mut [u8]) -> Result<usize, PolicyError> {
        let (header, memory_header) = self.headers()?;
        let sizes = memory_header.sizes(header.observation_len(), header.parameters);
        let (file, sections) = self.policy.write_parts(&header, sizes, RECURRENT_FORMAT_VERSION, bytes)?;
        copy(&memory_header.encode(), section(file, HEADER_LEN..HEADER_LEN + MEMORY_HEADER_LEN));
        self.memory.write(self.policy.parameters, section(file, sections.front_parameters.clone()))?;
        self.write_actions(&header, &memory_header, &sections, file)?;
        Ok(seal(file))
    }

    /// Writes the golden observations, and the actions that the networks in the file give for them.
    fn write_actions(
        &self,
        header: &Header,
        memory_header: &MemoryHeader,
        sections: &Sections,
        file: &mut [u8],
    ) -> Result<(), PolicyError> {
        let (front, rest) = file.split_at_mut_checked(sections.parameters.start).unwrap_or_default();
        let (parameters, rest) = rest.split_at_checked(sections.parameters.len()).unwrap_or_default();
        let memory_parameters = rest.get(..sections.front_parameters.len()).unwrap_or_default();
        let network = Network::from_parameters(header, memory_header.units, parameters)?;
        let (format, len) = (header.parameters, header.observation_len());
        let memory = PolicyMemory::from_parameters(format, len, memory_header, memory_parameters)?;
        let (mut hidden, mut scratch) = (HiddenState::new(), PolicyScratch::new());
        let act = |observation: &[f32], _: &[u8]| {
            Ok(network.act_recurrent(observation, &memory, &mut hidden, &mut scratch))
        };
        self.policy.write_golden(header, &[], section(front, sections.golden.clone()), act)
    }

    fn headers(&self) -> Result<(Header, MemoryHeader), PolicyError> {
        let memory_header = self.memory.header(self.policy.metadata.observation.len(), self.policy.parameters)?;
        Ok((self.policy.header(memory_header.units)?, memory_header))
    }
}

impl MemoryDraft<'_> {
    /// Of a memory that takes in `observation_len` values.
    pub(super) fn header(
        &self,
        observation_len: usize,
        parameters: ParameterFormat,
    ) -> Result<MemoryHeader, PolicyError> {
        let Self { gates, candidate, weight_fraction_bits } = self;
        let shape = MemoryShape { observation_len, units: candidate.outputs };
        shape.check()?;
        let (inputs, units) = (shape.inputs(), shape.units);
        for (index, (layer, outputs)) in [(gates, 2 * units), (candidate, units)].into_iter().enumerate() {
            if !layer.is_complete() || (layer.inputs, layer.outputs) != (inputs, outputs) {
                let (weights, biases) = (layer.weights.len(), layer.bias.len());
                return Err(PolicyError::LayerShape { layer: index, weights, biases, inputs, outputs });
            }
        }
        let weight_fraction_bits = match parameters {
            ParameterFormat::Float32 => [0; 2],
            ParameterFormat::Fixed16(_) => *weight_fraction_bits,
        };
        Ok(MemoryHeader { units, weight_fraction_bits })
    }

    /// Writes the parameters of both layers beside a network in this format.
    pub(super) fn write(&self, parameters: ParameterFormat, bytes: &mut [u8]) -> Result<(), PolicyError> {
        let Self { gates, candidate, weight_fraction_bits: [gate_bits, candidate_bits] } = self;
        let mut rest = bytes;
        for (layer, bits) in [(gates, gate_bits), (candidate, candidate_bits)] {
            rest = match parameters {
                ParameterFormat::Float32 => copy_words(layer.packed().map(f32::to_le_bytes), rest),
                ParameterFormat::Fixed16(format) => write_layer(layer, gru_format(format, *bits), 0, rest)?,
            };
        }
        Ok(())
    }

    /// The finest formats of its weights beside a network in `format`, in which no weight saturates and no sum can leave
    /// 32 bits.
    ///
    /// # Errors
    /// [`PolicyError::WeightsTooLarge`] of layer 0, the gates, or 1, the candidate.
    pub fn finest_bits(&self, format: FixedFormat) -> Result<[u8; 2], PolicyError> {
        let finest = |layer: &DenseLayer<'_>, index: usize| {
            let bits = format.finest_weight_bits(layer);
            bits.ok_or(PolicyError::WeightsTooLarge { layer: index })
        };
        Ok([finest(&self.gates, 0)?, finest(&self.candidate, 1)?])
    }
}
