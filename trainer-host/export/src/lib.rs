//! From a trained actor to policy files: once in float, once in fixed point, with a report of what rounding costs.

pub mod cost;
pub mod cycles;
pub mod exchange;
pub mod inspection;
pub mod layers;
pub mod policy;
pub mod px4;
pub mod recurrent;
mod report;
pub mod seeing;
pub mod source;

use kestrel_core::fixed::FixedFormat;
pub use kestrel_core::mlp::DenseLayer;
use kestrel_core::policy_file::{ParameterFormat, PolicyDraft, PolicyError, PolicyFile, PolicyMetadata};
use thiserror::Error;

pub use report::{ExportReport, FileSize, LayerReport};

/// Golden vectors in a file, taken evenly from the calibration observations: enough to reach every weight, and a
/// kilobyte of flash.
const GOLDEN_VECTORS: usize = 8;

/// Two policy files of one actor.
#[derive(Clone, Debug, PartialEq)]
pub struct Export {
    /// The file with `f32` weights.
    pub float_policy: Vec<u8>,
    /// The file with 16-bit weights.
    pub fixed_policy: Vec<u8>,
    /// How the two differ.
    pub report: ExportReport,
}

/// Why an actor cannot be exported.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ExportError {
    /// The calibration observations are missing or incomplete.
    #[error("found {found} calibration values, expected a positive multiple of the {expected} of an observation")]
    CalibrationLength {
        /// Values given.
        found: usize,
        /// Values of one observation.
        expected: usize,
    },
    /// A calibration value is infinite or no number.
    #[error("value {value} of calibration observation {observation} is {found}, expected a finite number")]
    CalibrationValue {
        /// Observation, counted from zero.
        observation: usize,
        /// Value in it, counted from zero.
        value: usize,
        /// What is there.
        found: f32,
    },
    /// There is not one image for each calibration observation.
    #[error("found {found} bytes of calibration images, expected {expected}: one for each observation")]
    CalibrationImages {
        /// Bytes given.
        found: usize,
        /// Bytes of an image for each observation.
        expected: usize,
    },
    /// The policy file cannot hold the actor.
    #[error(transparent)]
    Policy(#[from] PolicyError),
}

/// Writes the actor `layers` (tangents between them) as policy files and measures their difference on
/// `calibration [n][observation]`, which should come from flights: Q formats are chosen by its range.
///
/// The same arguments give the same bytes.
///
/// # Errors
/// [`ExportError`], with what was found and expected.
pub fn export(
    layers: &[DenseLayer<'_>],
    metadata: &PolicyMetadata<'_>,
    calibration: &[f32],
) -> Result<Export, ExportError> {
    let observation_len = metadata.observation.len();
    check_calibration(calibration, observation_len)?;
    let format = FixedFormat::finest(layers, largest_magnitude(calibration))?;
    let golden = golden_observations(calibration, observation_len, GOLDEN_VECTORS);
    let write = |parameters| {
        let draft = PolicyDraft { metadata: *metadata, parameters, layers, golden_observations: &golden };
        written(&draft)
    };
    let float_policy = write(ParameterFormat::Float32)?;
    let fixed_policy = write(ParameterFormat::Fixed16(format))?;
    let report = report(layers, format, &float_policy, &fixed_policy, calibration)?;
    Ok(Export { float_policy, fixed_policy, report })
}

fn check_calibration(calibration: &[f32], observation_len: usize) -> Result<(), ExportError> {
    if calibration.is_empty() || !calibration.len().is_multiple_of(observation_len) {
        return Err(ExportError::CalibrationLength { found: calibration.len(), expected: observation_len });
    }
    match calibration.iter().position(|value| !value.is_finite()) {
        Some(at) => Err(ExportError::CalibrationValue {
            observation: at / observation_len,
            value: at % observation_len,
            found: calibration[at],
        }),
        None => Ok(()),
    }
}

fn largest_magnitude(values: &[f32]) -> f32 {
    values.iter().fold(0.0, |largest, value| value.abs().max(largest))
}

/// At most `limit` of the observations, taken evenly.
fn golden_observations(calibration: &[f32], observation_len: usize, limit: usize) -> Vec<f32> {
    let count = calibration.len() / observation_len;
    let vectors = count.min(limit);
    let observation = |index: usize| &calibration[index * observation_len..][..observation_len];
    (0..vectors).flat_map(|vector| observation(vector * count / vectors)).copied().collect()
}

fn written(draft: &PolicyDraft<'_>) -> Result<Vec<u8>, PolicyError> {
    let mut bytes = vec![0; draft.file_len()?];
    draft.write(&mut bytes)?;
    PolicyFile::parse(&bytes)?.self_test()?;
    Ok(bytes)
}

fn report(
    layers: &[DenseLayer<'_>],
    format: FixedFormat,
    float_policy: &[u8],
    fixed_policy: &[u8],
    calibration: &[f32],
) -> Result<ExportReport, PolicyError> {
    let (float, fixed) = (PolicyFile::parse(float_policy)?, PolicyFile::parse(fixed_policy)?);
    let contents = Contents {
        multiply_accumulates: fixed.multiply_accumulates(),
        float: FileSize { weight_bytes: float.parameter_bytes(), file_bytes: float_policy.len() },
        fixed: FileSize { weight_bytes: fixed.parameter_bytes(), file_bytes: fixed_policy.len() },
        layers: layers.iter().enumerate().map(|(index, layer)| layer_report(layer, format, index)).collect(),
    };
    Ok(contents.report(float.metadata(), calibration, &Difference::between(&float, &fixed, calibration)))
}

/// What is in two files of one actor.
struct Contents {
    multiply_accumulates: usize,
    float: FileSize,
    fixed: FileSize,
    layers: Vec<LayerReport>,
}

impl Contents {
    /// With how the files differ on some observations.
    fn report(self, metadata: &PolicyMetadata<'_>, calibration: &[f32], difference: &Difference) -> ExportReport {
        let Self { multiply_accumulates, float, fixed, layers } = self;
        let observations = calibration.len() / metadata.observation.len();
        ExportReport {
            name: metadata.name.to_owned(),
            calibration_observations: observations,
            largest_observation: largest_magnitude(calibration),
            saturations: difference.saturations,
            largest_action_error: difference.largest,
            mean_action_error: difference.sum / (observations * metadata.action.len()) as f64,
            multiply_accumulates,
            float,
            fixed,
            layers,
        }
    }
}

fn layer_report(layer: &DenseLayer<'_>, format: FixedFormat, index: usize) -> LayerReport {
    LayerReport {
        inputs: layer.inputs,
        outputs: layer.outputs,
        input_fraction_bits: format.fraction_bits_into(index),
        weight_fraction_bits: u32::from(format.weight_fraction_bits[index]),
        largest_weight: largest_magnitude(layer.weights),
    }
}

/// How far the fixed-point actions are from the float ones.
#[derive(Default)]
struct Difference {
    largest: f32,
    sum: f64,
    saturations: usize,
}

impl Difference {
    fn between(float: &PolicyFile<'_>, fixed: &PolicyFile<'_>, calibration: &[f32]) -> Self {
        let (mut scratch, mut difference) = (float.scratch(), Self::default());
        for observation in calibration.chunks_exact(float.metadata().observation.len()) {
            let wanted = float.act(observation, &mut scratch);
            let found = fixed.act(observation, &mut scratch);
            difference.add(&wanted, &found, fixed.saturations(observation));
        }
        difference
    }

    /// Adds two actions on one observation, of which so many values lie beyond the range of the input format.
    fn add(&mut self, wanted: &[f32], found: &[f32], saturations: usize) {
        for (wanted, found) in wanted.iter().zip(found) {
            self.largest = self.largest.max((found - wanted).abs());
            self.sum += f64::from((found - wanted).abs());
        }
        self.saturations += saturations;
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use kestrel_core::action::{ActionSpace, RotorSpeeds};
    use kestrel_core::activation::Activation;
    use kestrel_core::observation::{ObservationLayout, PILOT_LEN, PilotLayout};
    use kestrel_core::policy_file::Arithmetic;
    use kestrel_sim::seed::{Purpose, Seed, Stream};

    use super::*;
    use kestrel_learn::actor_critic::{Actor, ActorLengths};
    use kestrel_learn::network::InputBatch;

    pub(crate) const METADATA: PolicyMetadata<'static> = PolicyMetadata {
        name: "hover",
        observation: ObservationLayout::Pilot(PilotLayout {
            position_scale_m: 0.5,
            velocity_scale: 2.0,
            body_rates_scale: 10.0,
        }),
        action: ActionSpace::RotorSpeeds(RotorSpeeds {
            hover_rotor_speed: 1500.0,
            rotor_speed_limit: 2250.0,
            fraction: 0.3,
        }),
        control_period_secs: 0.01,
        seed: 1,
        training_steps: 1_000_000,
        airframe: None,
    };

    fn actor() -> Actor {
        Actor::state_based(
            ActorLengths { observation: PILOT_LEN, action: 4 },
            &[64, 64],
            0.0,
            &mut Stream::new(Seed(3), 0, Purpose::Weights),
        )
    }

    fn calibration(count: usize) -> Vec<f32> {
        let mut stream = Stream::new(Seed(4), 0, Purpose::Evaluation);
        (0..count * PILOT_LEN).map(|_| stream.between(-1.5, 1.5)).collect()
    }

    fn exported(calibration: &[f32]) -> Result<Export, ExportError> {
        let actor = actor();
        let layers: Vec<_> = actor.layers().into_iter().map(DenseLayer::from).collect();
        export(&layers, &METADATA, calibration)
    }

    #[test]
    fn both_files_fly_and_pass_their_self_tests() {
        let export = exported(&calibration(100)).unwrap();
        for (bytes, arithmetic) in
            [(&export.float_policy, Arithmetic::Float32), (&export.fixed_policy, Arithmetic::Fixed16)]
        {
            let policy = PolicyFile::parse(bytes).unwrap();
            assert_eq!((policy.arithmetic(), policy.metadata()), (arithmetic, &METADATA));
            assert_eq!(policy.self_test(), Ok(()));
        }
    }

    #[test]
    fn the_float_file_acts_like_the_actor() {
        let calibration = calibration(16);
        let export = exported(&calibration).unwrap();
        let policy = PolicyFile::parse(&export.float_policy).unwrap();
        let mut scratch = policy.scratch();
        for observation in calibration.chunks_exact(PILOT_LEN) {
            let mut mean = [0.0; 4];
            actor().act_mean(InputBatch::without_images(observation), &mut mean);
            for (found, expected) in policy.act(observation, &mut scratch).into_iter().zip(mean) {
                assert!((found - expected.clamp(-1.0, 1.0)).abs() < 2e-6);
            }
        }
    }

    #[test]
    fn the_report_counts_what_is_in_the_files() {
        let calibration = calibration(200);
        let Export { float_policy, fixed_policy, report } = exported(&calibration).unwrap();
        assert_eq!(report.multiply_accumulates, 22 * 64 + 64 * 64 + 64 * 4);
        assert_eq!(report.float.file_bytes, float_policy.len());
        assert_eq!(report.fixed.file_bytes, fixed_policy.len());
        assert_eq!(report.fixed.weight_bytes, 2 * report.multiply_accumulates + 4 * 132);
        assert_eq!(report.calibration_observations, 200);
        assert_eq!(report.saturations, 0);
        assert_eq!(report.layers[0].input_fraction_bits, 14);
        assert_eq!(report.layers[1].input_fraction_bits, 13);
        assert!(report.largest_action_error > 0.0 && report.largest_action_error < 1e-3, "{report}");
        assert!(report.mean_action_error < f64::from(report.largest_action_error) / 2.0, "{report}");
    }

    #[test]
    fn the_report_survives_json_and_reads_well() {
        let report = exported(&calibration(20)).unwrap().report;
        let json = serde_json::to_string(&report).unwrap();
        assert_eq!(serde_json::from_str::<ExportReport>(&json).unwrap(), report);
        let text = report.to_string();
        assert!(text.contains("5760 multiply-accumulates per step"), "{text}");
        assert!(text.contains("22 -> 64: inputs Q14, weights Q"), "{text}");
    }

    #[test]
    fn exporting_twice_gives_the_same_bytes() {
        assert_eq!(exported(&calibration(50)), exported(&calibration(50)));
    }

    #[test]
    fn a_wide_calibration_takes_a_coarser_input_format() {
        let mut calibration = calibration(10);
        calibration[5] = -70.0;
        let report = exported(&calibration).unwrap().report;
        assert_eq!((report.layers[0].input_fraction_bits, report.saturations), (8, 0));
    }

    #[test]
    fn an_unusable_calibration_is_named() {
        assert_eq!(
            exported(&[]).unwrap_err().to_string(),
            "found 0 calibration values, expected a positive multiple of the 22 of an observation"
        );
        let mut broken = calibration(3);
        broken[PILOT_LEN + 7] = f32::NAN;
        assert_eq!(
            exported(&broken).unwrap_err().to_string(),
            "value 7 of calibration observation 1 is NaN, expected a finite number"
        );
    }

    #[test]
    fn what_the_file_cannot_hold_is_said() {
        let weights = [0.0; PILOT_LEN * 4];
        let layer = DenseLayer {
            inputs: PILOT_LEN,
            outputs: 4,
            weights: &weights,
            bias: &[f32::NAN; 4],
            activation: Activation::Tanh,
        };
        let error = export(&[layer], &METADATA, &calibration(1)).unwrap_err();
        assert_eq!(error, ExportError::Policy(PolicyError::WeightsTooLarge { layer: 0 }));
    }
}
