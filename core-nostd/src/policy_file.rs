//! The policy file: a network, what it observes and commands, and proof that it computes what it did when exported.
//!
//! `POLICY_FORMAT.md` in this package is the specification. Nothing is copied when a file is parsed: the weights
//! are read where they lie, in flash or in a host's buffer.

mod airframe;
mod header;
mod metadata;
mod parameters;
#[cfg(feature = "recurrent")]
mod recurrent;
#[cfg(feature = "encoder")]
mod vision;
mod writer;

pub use crate::activation::Activation;
pub use crate::arithmetic::{Arithmetic, FLOAT_SELF_TEST_TOLERANCE};
pub use crate::policy_error::PolicyError;
pub use airframe::PolicyAirframe;
pub use header::{
    FORMAT_VERSION, GOLDEN_LIMIT, HEADER_LEN, MAGIC, ParameterFormat, RECURRENT_FORMAT_VERSION,
    RECURRENT_VISION_FORMAT_VERSION, VISION_FORMAT_VERSION,
};
pub use metadata::{NAME_LIMIT, PolicyMetadata};
#[cfg(feature = "recurrent")]
pub use recurrent::{MEMORY_HEADER_LEN, MemoryDraft, PolicyMemory, RecurrentDraft, RecurrentPolicy};
#[cfg(feature = "encoder")]
pub use vision::{ENCODER_HEADER_LEN, EncoderDraft, EncoderWorkspace, PolicyEncoder, VisionDraft, VisionPolicy};
pub use writer::PolicyDraft;

use crate::airframe::Airframe;
use crate::fixed::{self, FixedMlp};
use crate::limits::{ACTION_LIMIT, WIDTH_LIMIT};
use crate::mlp::{self, Mlp};
use header::{FrontSizes, Header, Sections};
use metadata::{action_identifier, layout_identifier};

/// A policy whose parameters lie in borrowed bytes.
#[derive(Clone, Debug)]
pub struct PolicyFile<'a> {
    header: Header,
    metadata: PolicyMetadata<'a>,
    network: Network<'a>,
    golden: &'a [u8],
}

/// Working memory of an inference in either arithmetic (1.8 kB); contents do not matter between calls.
#[derive(Clone, Debug, Default)]
pub struct PolicyScratch {
    float: mlp::FloatScratch,
    fixed: fixed::FixedScratch,
}

/// Bytes on a four-byte boundary of memory, for policies compiled into a program:
/// `static POLICY: Aligned<{ include_bytes!("…").len() }> = Aligned(*include_bytes!("…"));`
#[derive(Clone, Copy, Debug)]
#[repr(C, align(4))]
pub struct Aligned<const N: usize>(pub [u8; N]);

#[derive(Clone, Debug)]
enum Network<'a> {
    Float32(Mlp<'a>),
    Fixed16(FixedMlp<'a>),
}

impl<'a> PolicyFile<'a> {
    /// The policy in `bytes`, which are the whole file and start on a four-byte boundary of memory.
    ///
    /// # Errors
    /// A variant per kind of damage; every altered bit and every cut is found.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, PolicyError> {
        let header = Header::parse(bytes, FORMAT_VERSION)?;
        Self::read(bytes, header, FrontSizes::default()).map(|(policy, _)| policy)
    }

    /// The policy behind an encoder or a memory of these sizes, and the parameters of that.
    fn read(bytes: &'a [u8], header: Header, front: FrontSizes) -> Result<(Self, &'a [u8]), PolicyError> {
        let Sections { metadata, golden, parameters, front_parameters, checksum } = header.sections(front);
        let (found, expected) = (bytes.len(), checksum.end);
        if found != expected {
            return Err(PolicyError::Length { found, expected });
        }
        let found = bytes.as_ptr().addr() % 4;
        if found != 0 {
            return Err(PolicyError::Misaligned { found });
        }
        let section = |range| bytes.get(range).unwrap_or_default();
        let metadata = read_metadata(section(metadata), &header)?;
        let network = Network::from_parameters(&header, front.features, section(parameters))?;
        Ok((Self { metadata, network, golden: section(golden), header }, section(front_parameters)))
    }

    /// Name, observation layout, action space, control period.
    pub fn metadata(&self) -> &PolicyMetadata<'a> {
        &self.metadata
    }

    /// The same policy on another drone ([`ActionSpace::on`](crate::action::ActionSpace::on)).
    #[must_use]
    pub fn on(mut self, airframe: &Airframe) -> Self {
        self.metadata.action = self.metadata.action.on(airframe);
        self
    }

    /// What it is computed with.
    pub fn arithmetic(&self) -> Arithmetic {
        self.header.parameters.arithmetic()
    }

    /// Number format of the parameters.
    pub fn parameter_format(&self) -> ParameterFormat {
        self.header.parameters
    }

    /// What follows the sums of hidden layers.
    pub fn activation(&self) -> Activation {
        self.header.activation
    }

    /// Inputs and outputs of each layer.
    pub fn shapes(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.header.shapes(self.features())
    }

    /// Multiplications per inference, padding not counted.
    pub fn multiply_accumulates(&self) -> usize {
        self.shapes().map(|(inputs, outputs)| inputs * outputs).sum()
    }

    /// Bytes of weights and biases, padding included.
    pub fn parameter_bytes(&self) -> usize {
        self.header.parameter_bytes(self.features())
    }

    /// Values that the first layer reads behind the observation.
    fn features(&self) -> usize {
        self.network.inputs().saturating_sub(self.header.observation_len())
    }

    /// The action in \[-1, 1\] on an encoded observation, followed by zeros. Never panics, never returns NaN, whatever the observation.
    pub fn act(&self, observation: &[f32], scratch: &mut PolicyScratch) -> [f32; ACTION_LIMIT] {
        self.network.act(observation, scratch)
    }

    /// The network where it is computed in fixed point, for who learns with it.
    pub fn fixed(&self) -> Option<&FixedMlp<'a>> {
        match &self.network {
            Network::Fixed16(network) => Some(network),
            Network::Float32(_) => None,
        }
    }

    /// Working memory for [`Self::act`], of the same size for every policy.
    pub const fn scratch(&self) -> PolicyScratch {
        PolicyScratch::new()
    }

    /// How many values of `observation` lie beyond the range of the input format; none for a float policy.
    pub fn saturations(&self, observation: &[f32]) -> usize {
        match &self.network {
            Network::Float32(_) => 0,
            Network::Fixed16(network) => network.saturations(observation),
        }
    }

    /// Computes the golden vectors again: to the bit in fixed point, to [`FLOAT_SELF_TEST_TOLERANCE`] in float.
    ///
    /// Puts 1.8 kB of scratch on the stack; [`Self::self_test_with`] does not.
    ///
    /// # Errors
    /// [`PolicyError::SelfTest`] with the first deviation.
    pub fn self_test(&self) -> Result<(), PolicyError> {
        self.self_test_with(&mut PolicyScratch::default())
    }

    /// [`Self::self_test`] in the caller's scratch.
    ///
    /// # Errors
    /// [`PolicyError::SelfTest`] with the first deviation.
    pub fn self_test_with(&self, scratch: &mut PolicyScratch) -> Result<(), PolicyError> {
        self.compare_golden(|observation, _| Ok(self.act(observation, scratch)))
    }

    /// Compares what `act` makes of the golden observations and images with the golden actions.
    fn compare_golden(
        &self,
        mut act: impl FnMut(&[f32], &[u8]) -> Result<[f32; ACTION_LIMIT], PolicyError>,
    ) -> Result<(), PolicyError> {
        let tolerance = self.arithmetic().self_test_tolerance();
        let action_len = self.header.action_len();
        for (vector, (observation, expected, image)) in self.golden().enumerate() {
            let action = act(&observation, image)?;
            compare(vector, action.get(..action_len).unwrap_or_default(), expected, tolerance)?;
        }
        Ok(())
    }
}

fn compare(
    vector: usize,
    action: &[f32],
    expected: [f32; ACTION_LIMIT],
    tolerance: f32,
) -> Result<(), PolicyError> {
    for (output, (&found, expected)) in action.iter().zip(expected).enumerate() {
        // Written so that a NaN among the golden values fails.
        let close = (found - expected).abs() <= tolerance;
        if !close {
            return Err(PolicyError::SelfTest { vector, output, found, expected });
        }
    }
    Ok(())
}

/// The observation, followed by zeros, and the action of a golden vector, followed by NaN.
fn read_golden(bytes: &[u8], observation_len: usize) -> ([f32; WIDTH_LIMIT], [f32; ACTION_LIMIT]) {
    let mut values = bytes.as_chunks::<4>().0.iter().map(|word| f32::from_le_bytes(*word));
    let mut observation = [0.0; WIDTH_LIMIT];
    for (slot, value) in observation.iter_mut().zip(values.by_ref().take(observation_len)) {
        *slot = value;
    }
    (observation, core::array::from_fn(|_| values.next().unwrap_or(f32::NAN)))
}

fn read_metadata<'a>(bytes: &'a [u8], header: &Header) -> Result<PolicyMetadata<'a>, PolicyError> {
    let undecodable = PolicyError::Metadata { found: bytes.len() };
    let (mut metadata, rest) = postcard::take_from_bytes::<PolicyMetadata<'a>>(bytes).map_err(|_| undecodable)?;
    if !rest.is_empty() {
        let (airframe, rest) = postcard::take_from_bytes(rest).map_err(|_| undecodable)?;
        if !rest.is_empty() {
            return Err(undecodable);
        }
        metadata.airframe = Some(airframe);
    }
    check_identifiers(&metadata, header)?;
    metadata.check()?;
    Ok(metadata)
}

fn check_identifiers(metadata: &PolicyMetadata<'_>, header: &Header) -> Result<(), PolicyError> {
    let pairs = [
        ("observation layout", layout_identifier(&metadata.observation), header.observation_layout),
        ("action space", action_identifier(&metadata.action), header.action_space),
    ];
    for (field, found, expected) in pairs {
        if found != expected {
            return Err(PolicyError::MetadataMismatch { field, found, expected });
        }
    }
    let (found, expected) = (header.observation_len(), metadata.observation.len());
    if found != expected {
        return Err(PolicyError::ObservationLength { found, expected });
    }
    let (found, expected) = (header.action_len(), metadata.action.len());
    if found == expected { Ok(()) } else { Err(PolicyError::ActionLength { found, expected }) }
}

impl<'a> Network<'a> {
    /// The network whose first layer reads `features` values behind the observation.
    fn from_parameters(header: &Header, features: usize, parameters: &'a [u8]) -> Result<Self, PolicyError> {
        let mut widths = header.widths.clone();
        if let Some(inputs) = widths.first_mut() {
            *inputs += features as u16;
        }
        match &header.parameters {
            ParameterFormat::Float32 => {
                Mlp::from_parameters(&widths, header.activation, parameters).map(Self::Float32)
            }
            ParameterFormat::Fixed16(format) => {
                FixedMlp::from_parameters(&widths, *format, parameters).map(Self::Fixed16)
            }
        }
    }

    /// Values that the first layer reads.
    fn inputs(&self) -> usize {
        match self {
            Self::Float32(network) => network.inputs(),
            Self::Fixed16(network) => network.inputs(),
        }
    }

    fn act(&self, observation: &[f32], scratch: &mut PolicyScratch) -> [f32; ACTION_LIMIT] {
        match self {
            Self::Float32(network) => network.act(observation, &mut scratch.float),
            Self::Fixed16(network) => network.act(observation, &mut scratch.fixed),
        }
    }
}

impl PolicyScratch {
    /// Usable as the initial value of a static.
    pub const fn new() -> Self {
        Self { float: mlp::FloatScratch::new(), fixed: fixed::FixedScratch::new() }
    }
}
