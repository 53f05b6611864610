//! From a trained actor with an eye to policy files.

mod report;

use kestrel_core::encoder::{EncoderError, EncoderFormat, EncoderShape, STAGE_LIMIT};
use kestrel_core::fixed::FixedFormat;
use kestrel_core::policy_file::{
    EncoderDraft, EncoderWorkspace, MemoryDraft, ParameterFormat, PolicyDraft, PolicyEncoder, PolicyError,
    PolicyMetadata, PolicyScratch, VisionDraft, VisionPolicy,
};

pub use report::{EyeReport, SeeingReport, StageReport};

use super::{DenseLayer, ExportError, check_calibration, golden_observations, largest_magnitude};

/// Golden vectors in a file: fewer than without an eye, because each has an image.
const GOLDEN_VECTORS: usize = 4;

/// Features may reach this many times the largest of the calibration before they saturate.
const FEATURE_HEADROOM: f32 = 2.0;

/// A trained actor with an eye.
#[derive(Clone, Copy, Debug)]
pub struct SeeingActor<'a> {
    /// What it looks at and what it makes of it.
    pub shape: EncoderShape,
    /// Of the eye: for each convolution the weights `[filters][kernel row][kernel column][channel]`, then the biases
    /// `[filters]`; of the dense layer `[features][flattened]` and `[features]`.
    pub encoder_parameters: &'a [f32],
    /// Gates and candidate of a memory, if there is one; both read the observation, then the features, then the hidden state.
    pub memory: Option<[DenseLayer<'a>; 2]>,
    /// Tangents between them; the first reads the observation, then the features, then the hidden state.
    pub layers: &'a [DenseLayer<'a>],
    /// Control periods from one image to the next.
    pub control_periods_per_image: u16,
}

/// What the actor saw on flights, by which number formats are chosen; one flight for who remembers.
#[derive(Clone, Copy, Debug)]
pub struct SeeingCalibration<'a> {
    /// `[n][observation]`, without features.
    pub observations: &'a [f32],
    /// `[n][rows][columns][channels]`: what it saw then.
    pub images: &'a [u8],
}

/// Two policy files of one actor with an eye.
#[derive(Clone, Debug, PartialEq)]
pub struct SeeingExport {
    /// The file with `f32` weights.
    pub float_policy: Vec<u8>,
    /// The file with 8-bit weights in the eye and 16-bit weights behind it.
    pub fixed_policy: Vec<u8>,
    /// How the two differ.
    pub report: SeeingReport,
}

/// Writes `actor` as policy files and measures their difference on `calibration`, stage by stage. The same arguments
/// give the same bytes.
///
/// # Errors
/// [`ExportError`], with what was found and expected.
pub fn export_seeing(
    actor: &SeeingActor<'_>,
    metadata: &PolicyMetadata<'_>,
    calibration: SeeingCalibration<'_>,
) -> Result<SeeingExport, ExportError> {
    let samples = checked_samples(actor, metadata, calibration)?;
    let write = |parameters, format| {
        let observations =
            golden_observations(calibration.observations, metadata.observation.len(), GOLDEN_VECTORS);
        let images = golden_images(calibration.images, samples, actor.shape.image().len());
        let (layers, golden_observations) = (actor.layers, observations.as_slice());
        written(&VisionDraft {
            policy: PolicyDraft { metadata: *metadata, parameters, layers, golden_observations },
            encoder: EncoderDraft {
                shape: actor.shape,
                parameters: actor.encoder_parameters,
                format,
                control_periods_per_image: actor.control_periods_per_image,
                golden_images: &images,
            },
            memory: memory_draft(actor, parameters)?,
        })
    };
    let float_policy = write(ParameterFormat::Float32, EncoderFormat::default())?;
    let largest = largest_activations(&VisionPolicy::parse(&float_policy)?, calibration.images)?;
    let (format, eye_format) = formats(actor, largest_magnitude(calibration.observations), &largest)?;
    let fixed_policy = write(ParameterFormat::Fixed16(format), eye_format)?;
    let report = report::measured(actor, (&float_policy, &fixed_policy), &eye_format, calibration)?;
    Ok(SeeingExport { float_policy, fixed_policy, report })
}

/// The memory beside a network in this format.
fn memory_draft<'a>(
    actor: &SeeingActor<'a>,
    parameters: ParameterFormat,
) -> Result<Option<MemoryDraft<'a>>, PolicyError> {
    let Some([gates, candidate]) = actor.memory else { return Ok(None) };
    let memory = MemoryDraft { gates, candidate, weight_fraction_bits: [0; 2] };
    Ok(Some(match parameters {
        ParameterFormat::Float32 => memory,
        ParameterFormat::Fixed16(format) => {
            MemoryDraft { weight_fraction_bits: memory.finest_bits(format)?, ..memory }
        }
    }))
}

/// How many observations with an image there are.
fn checked_samples(
    actor: &SeeingActor<'_>,
    metadata: &PolicyMetadata<'_>,
    calibration: SeeingCalibration<'_>,
) -> Result<usize, ExportError> {
    let observation_len = metadata.observation.len();
    check_calibration(calibration.observations, observation_len)?;
    let samples = calibration.observations.len() / observation_len;
    let (found, expected) = (calibration.images.len(), samples * actor.shape.image().len());
    if found == expected { Ok(samples) } else { Err(ExportError::CalibrationImages { found, expected }) }
}

/// The images of [`golden_observations`].
fn golden_images(images: &[u8], samples: usize, image_len: usize) -> Vec<u8> {
    let vectors = samples.min(GOLDEN_VECTORS);
    let image = |index: usize| &images[index * image_len..][..image_len];
    (0..vectors).flat_map(|vector| image(vector * samples / vectors)).copied().collect()
}

/// The finest formats of the network and the eye in which neither observations nor features saturate: the network
/// reads both in one.
fn formats(
    actor: &SeeingActor<'_>,
    largest_observation: f32,
    largest: &[f32; STAGE_LIMIT],
) -> Result<(FixedFormat, EncoderFormat), PolicyError> {
    let dense_stage = actor.shape.stages().len() - 1;
    let mut reach = largest_observation.max(FEATURE_HEADROOM * largest[dense_stage]);
    loop {
        let format = FixedFormat::finest(actor.layers, reach)?;
        let bits = format.input_fraction_bits;
        match EncoderFormat::calibrated(&actor.shape, actor.encoder_parameters, largest, bits) {
            // Finer than what the eye computes: a range twice as wide asks for a bit less.
            Err(EncoderError::FeatureFractionBits { found }) if found > 0 => reach = reach.max(1.0) * 2.0,
            result => return Ok((format, result?)),
        }
    }
}

fn written(draft: &VisionDraft<'_>) -> Result<Vec<u8>, PolicyError> {
    let mut bytes = vec![0; draft.file_len()?];
    let mut memory = Memory::new(draft.policy.parameters, draft.memory_len());
    draft.write(&mut bytes, &mut memory.borrowed())?;
    VisionPolicy::parse(&bytes)?.self_test_with(&mut memory.borrowed(), &mut PolicyScratch::new())?;
    Ok(bytes)
}

/// The largest activation behind each stage of a float policy.
fn largest_activations(policy: &VisionPolicy<'_>, images: &[u8]) -> Result<[f32; STAGE_LIMIT], PolicyError> {
    let PolicyEncoder::Float32(eye) = policy.encoder() else { unreachable!("the policy was written in float") };
    let shape = eye.shape();
    let (mut scratch, mut features) = (vec![0.0; shape.scratch_len()], vec![0.0; shape.features()]);
    let mut largest = [0.0; STAGE_LIMIT];
    for image in images.chunks_exact(shape.image().len()) {
        eye.encode_each(image, &mut scratch, &mut features, |stage, activations| {
            largest[stage] = activations.iter().copied().fold(largest[stage], f32::max);
        })?;
    }
    Ok(largest)
}

/// Memory for a policy with an eye, of its arithmetic.
#[derive(Clone, Debug)]
pub enum Memory {
    /// For float.
    Float32(Vec<f32>),
    /// For fixed point.
    Fixed16(Vec<i16>),
}

impl Memory {
    /// `len` values, all zero.
    pub fn new(parameters: ParameterFormat, len: usize) -> Self {
        match parameters {
            ParameterFormat::Float32 => Self::Float32(vec![0.0; len]),
            ParameterFormat::Fixed16(_) => Self::Fixed16(vec![0; len]),
        }
    }

    /// Of a policy.
    pub fn of(policy: &VisionPolicy<'_>) -> Self {
        Self::new(policy.parameter_format(), policy.memory_len())
    }

    /// As the core takes it.
    pub fn borrowed(&mut self) -> EncoderWorkspace<'_> {
        match self {
            Self::Float32(values) => EncoderWorkspace::Float32(values),
            Self::Fixed16(values) => EncoderWorkspace::Fixed16(values),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
