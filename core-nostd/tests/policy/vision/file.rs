//! Writing and reading policies with an encoder.

use kestrel_core::action::{ActionSpace, RotorSpeeds};
use kestrel_core::activation::Activation;
use kestrel_core::crc32::crc32;
use kestrel_core::encoder::{EncoderError, EncoderFormat};
use kestrel_core::mlp::DenseLayer;
use kestrel_core::observation::PILOT_LEN;
use kestrel_core::policy_file::{
    Arithmetic, ENCODER_HEADER_LEN, EncoderDraft, EncoderWorkspace, HEADER_LEN, ParameterFormat, PolicyDraft,
    PolicyEncoder, PolicyError, PolicyFile, PolicyScratch, VisionDraft, VisionPolicy,
};

use super::support::{VECTORS, VisionModel, images, with_memory};
use crate::support::{golden, metadata, observations, rotor_speeds, seal};

#[test]
fn what_is_written_is_read() {
    for model in [VisionModel::tiny(), VisionModel::typical(), VisionModel::nature()] {
        for (fixed, arithmetic) in [(false, Arithmetic::Float32), (true, Arithmetic::Fixed16)] {
            let bytes = model.file(fixed);
            let policy = VisionPolicy::parse(&bytes).unwrap();
            assert_eq!((policy.arithmetic(), policy.control_periods_per_image()), (arithmetic, 4));
            assert_eq!(policy.metadata(), &metadata(&rotor_speeds()));
            assert_eq!(policy.encoder().shape(), &model.shape);
            assert_eq!(policy.shapes().next().unwrap().0, PILOT_LEN + model.shape.features());
            let mut scratch = PolicyScratch::new();
            let result = with_memory(policy.memory_len(), fixed, |mut memory| {
                policy.self_test_with(&mut memory, &mut scratch)
            });
            assert_eq!(result, Ok(()));
        }
    }
}

#[test]
fn the_float_policy_acts_on_observation_and_features() {
    for model in [VisionModel::typical(), VisionModel::nature()] {
        let bytes = model.file(false);
        let policy = VisionPolicy::parse(&bytes).unwrap();
        let mut scratch = PolicyScratch::new();
        for seed in 0..4 {
            let (observation, image) = (observations(seed, 1, 1.5), images(&model.shape, seed, 1));
            let action = with_memory(policy.memory_len(), false, |mut memory| {
                policy.encode(&image, &mut memory).unwrap();
                policy.act(&observation, &mut memory, &mut scratch).unwrap()
            });
            let inputs = [observation, model.features(&image).0].concat();
            for (found, expected) in action.into_iter().zip(model.model.reference(&inputs)) {
                assert!((f64::from(found) - expected).abs() < 2e-5, "{found} {expected}");
            }
        }
    }
}

/// Weights of random networks are rounded by up to a 254th of the largest of their filter, and nothing averages out
/// over time.
#[test]
fn the_fixed_policy_acts_almost_like_the_float_policy() {
    for (model, bound) in [(VisionModel::typical(), 0.03), (VisionModel::nature(), 0.03)] {
        let [float_file, fixed_file] = model.files();
        let (float, fixed) =
            (VisionPolicy::parse(&float_file).unwrap(), VisionPolicy::parse(&fixed_file).unwrap());
        let mut scratch = PolicyScratch::new();
        let mut act = |policy: &VisionPolicy<'_>, fixed, seed| {
            let (observation, image) = (observations(seed, 1, 1.5), images(&model.shape, seed, 1));
            with_memory(policy.memory_len(), fixed, |mut memory| {
                policy.encode(&image, &mut memory).unwrap();
                policy.act(&observation, &mut memory, &mut scratch).unwrap()
            })
        };
        for seed in 10..30 {
            for (float, fixed) in act(&float, false, seed).into_iter().zip(act(&fixed, true, seed)) {
                assert!((float - fixed).abs() < bound, "{float} {fixed}");
            }
        }
    }
}

#[test]
fn sizes_are_known() {
    let model = VisionModel::typical();
    let [float, fixed] = model.files();
    let (float, fixed) = (VisionPolicy::parse(&float).unwrap(), VisionPolicy::parse(&fixed).unwrap());
    assert_eq!(float.multiply_accumulates(), (22 + 64) * 16 + 16 * 4);
    assert_eq!(float.encoder().shape().multiply_accumulates(), 135_872);
    assert_eq!((float.parameter_bytes(), fixed.parameter_bytes()), (4 * (1440 + 20), 2 * 1440 + 4 * 20));
    assert_eq!((float.encoder_bytes(), fixed.encoder_bytes()), (4 * 27_376, 28_096));
    assert_eq!((float.memory_len(), fixed.memory_len()), (64 + 2768, 64 + 2768));
}

#[test]
fn each_reader_says_which_other_one_reads_the_file() {
    let vision = VisionModel::tiny().file(false);
    assert_eq!(PolicyFile::parse(&vision).unwrap_err(), PolicyError::Vision);
    let state_based = crate::support::Model::typical(1).float_file();
    assert_eq!(VisionPolicy::parse(&state_based).unwrap_err(), PolicyError::StateBased);
}

/// Everything from small integers, so that every machine makes the same file. Recorded when format version 2 was
/// defined; a change here asks for a new version.
#[test]
fn the_format_has_not_moved() {
    let model = VisionModel::tiny();
    let numbers = |count: usize, step: usize| -> Vec<f32> {
        (0..count).map(|i| ((i * step) % 17) as f32 / 64.0 - 0.125).collect()
    };
    let parameters = numbers(model.shape.parameter_count(), 5);
    let (weights, bias) = (numbers(27 * 4, 3), numbers(4, 7));
    let layers =
        [DenseLayer { inputs: 27, outputs: 4, weights: &weights, bias: &bias, activation: Activation::Tanh }];
    let golden_observations = numbers(VECTORS * PILOT_LEN, 7);
    let golden_images: Vec<u8> =
        (0..VECTORS * model.shape.image().len()).map(|at| (at * 37 % 251) as u8).collect();
    model.with_draft(true, |draft| {
        let ParameterFormat::Fixed16(format) = draft.policy.parameters else { unreachable!() };
        let bits = format.input_fraction_bits;
        let action = ActionSpace::RotorSpeeds(RotorSpeeds {
            hover_rotor_speed: 1500.0,
            rotor_speed_limit: 2250.0,
            fraction: 0.25,
        });
        let policy = PolicyDraft {
            metadata: metadata(&action),
            layers: &layers,
            golden_observations: &golden_observations,
            ..draft.policy
        };
        let format = EncoderFormat::calibrated(&model.shape, &parameters, &[1.0; 5], bits).unwrap();
        let encoder =
            EncoderDraft { parameters: &parameters, format, golden_images: &golden_images, ..draft.encoder };
        let draft = VisionDraft { policy, encoder, memory: None };
        let mut bytes = vec![0; draft.file_len().unwrap()];
        with_memory(draft.memory_len(), true, |mut memory| draft.write(&mut bytes, &mut memory)).unwrap();
        assert_eq!((bytes.len(), crc32(&bytes[..bytes.len() - 4])), (1_008, 0xBFDE_0B5E));
    });
}

#[test]
fn altered_golden_images_fail_the_self_test() {
    let model = VisionModel::typical();
    for (fixed, intact) in [false, true].into_iter().zip(model.files()) {
        let metadata_len = usize::from(u16::from_le_bytes([intact[20], intact[21]])).next_multiple_of(4);
        let golden = HEADER_LEN + ENCODER_HEADER_LEN + metadata_len;
        let mut bytes = intact;
        for pixel in &mut bytes[golden + 4 * (PILOT_LEN + 4)..][..24 * 32] {
            *pixel = !*pixel;
        }
        seal(&mut bytes);
        let policy = VisionPolicy::parse(&bytes).unwrap();
        let result = with_memory(policy.memory_len(), fixed, |mut memory| {
            policy.self_test_with(&mut memory, &mut PolicyScratch::new())
        });
        assert!(matches!(result, Err(PolicyError::SelfTest { vector: 0, .. })), "{result:?}");
    }
}

#[test]
fn drafts_that_no_file_can_hold_are_refused() {
    let model = VisionModel::tiny();
    let images = images(&model.shape, 1, VECTORS);
    model.with_draft(true, |valid| {
        let refusal = |draft: VisionDraft<'_>| draft.file_len().unwrap_err();
        let short = EncoderDraft { golden_images: &images[1..], ..valid.encoder };
        assert_eq!(
            refusal(VisionDraft { encoder: short, ..valid }),
            PolicyError::GoldenImages { found: 89, expected: 90 }
        );
        let still = EncoderDraft { control_periods_per_image: 0, ..valid.encoder };
        assert_eq!(refusal(VisionDraft { encoder: still, ..valid }), PolicyError::Encoder(EncoderError::Pace));
        let mut format = valid.encoder.format;
        format.steps[1] *= 0.5;
        let finer = EncoderDraft { format, ..valid.encoder };
        assert!(matches!(
            refusal(VisionDraft { encoder: finer, ..valid }),
            PolicyError::Encoder(EncoderError::FeatureStep { .. })
        ));
        let observations = golden();
        let policy = PolicyDraft { golden_observations: &observations[1..], ..valid.policy };
        assert!(matches!(refusal(VisionDraft { policy, ..valid }), PolicyError::GoldenObservations { .. }));
        let policy = PolicyDraft { layers: &valid.policy.layers[1..], ..valid.policy };
        let expected = PolicyError::ObservationLength { found: 4, expected: PILOT_LEN + 5 };
        assert_eq!(refusal(VisionDraft { policy, ..valid }), expected);
        let mut bytes = vec![0; valid.file_len().unwrap() - 1];
        let result = with_memory(valid.memory_len(), true, |mut memory| valid.write(&mut bytes, &mut memory));
        assert!(matches!(result, Err(PolicyError::BufferTooSmall { .. })));
    });
}

#[test]
fn memory_of_another_kind_is_refused() {
    let bytes = VisionModel::tiny().file(true);
    let policy = VisionPolicy::parse(&bytes).unwrap();
    assert!(matches!(policy.encoder(), PolicyEncoder::Fixed16(_)));
    let expected = policy.memory_len();
    let refusal = |found, found_arithmetic| PolicyError::EncoderWorkspace {
        found,
        found_arithmetic,
        expected,
        expected_arithmetic: Arithmetic::Fixed16,
    };
    let (mut floats, mut integers) = (vec![0.0; expected], vec![0; expected - 1]);
    let mut wrong = EncoderWorkspace::Float32(&mut floats);
    assert_eq!(policy.encode(&[0; 30], &mut wrong), Err(refusal(expected, Arithmetic::Float32)));
    let mut short = EncoderWorkspace::Fixed16(&mut integers);
    let error = policy.act(&[], &mut short, &mut PolicyScratch::new()).unwrap_err();
    assert_eq!(error, refusal(expected - 1, Arithmetic::Fixed16));
    assert_eq!(
        error.to_string(),
        format!("memory of {} values for fixed16, expected at least {expected} for fixed16", expected - 1)
    );
}
