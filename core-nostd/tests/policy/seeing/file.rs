//! Writing and reading policies with an eye.

use kestrel_core::action::{ActionSpace, RotorSpeeds};
use kestrel_core::crc32::crc32;
use kestrel_core::eye::{EyeError, EyeFormat};
use kestrel_core::mlp::DenseLayer;
use kestrel_core::observation::PILOT_LEN;
use kestrel_core::policy_file::{
    Arithmetic, EYE_HEADER_LEN, EyeDraft, EyeMemory, HEADER_LEN, ParameterFormat, PolicyDraft, PolicyError,
    PolicyEye, PolicyFile, Scratch, SeeingDraft, SeeingPolicy,
};

use super::support::{SeeingModel, VECTORS, images, with_memory};
use crate::support::{golden, metadata, observations, rotor_speeds, seal};

#[test]
fn what_is_written_is_read() {
    for model in [SeeingModel::tiny(), SeeingModel::typical(), SeeingModel::nature()] {
        for (fixed, arithmetic) in [(false, Arithmetic::Float32), (true, Arithmetic::Fixed16)] {
            let bytes = model.file(fixed);
            let policy = SeeingPolicy::parse(&bytes).unwrap();
            assert_eq!((policy.arithmetic(), policy.control_periods_per_image()), (arithmetic, 4));
            assert_eq!(policy.metadata(), &metadata(&rotor_speeds()));
            assert_eq!(policy.eye().shape(), &model.shape);
            assert_eq!(policy.shapes().next().unwrap().0, PILOT_LEN + model.shape.features());
            let mut scratch = Scratch::new();
            let result = with_memory(policy.memory_len(), fixed, |mut memory| {
                policy.self_test_with(&mut memory, &mut scratch)
            });
            assert_eq!(result, Ok(()));
        }
    }
}

#[test]
fn the_float_policy_acts_on_observation_and_features() {
    for model in [SeeingModel::typical(), SeeingModel::nature()] {
        let bytes = model.file(false);
        let policy = SeeingPolicy::parse(&bytes).unwrap();
        let mut scratch = Scratch::new();
        for seed in 0..4 {
            let (observation, image) = (observations(seed, 1, 1.5), images(&model.shape, seed, 1));
            let action = with_memory(policy.memory_len(), false, |mut memory| {
                policy.see(&image, &mut memory).unwrap();
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
    for (model, bound) in [(SeeingModel::typical(), 0.03), (SeeingModel::nature(), 0.03)] {
        let [float_file, fixed_file] = model.files();
        let (float, fixed) =
            (SeeingPolicy::parse(&float_file).unwrap(), SeeingPolicy::parse(&fixed_file).unwrap());
        let mut scratch = Scratch::new();
        let mut act = |policy: &SeeingPolicy<'_>, fixed, seed| {
            let (observation, image) = (observations(seed, 1, 1.5), images(&model.shape, seed, 1));
            with_memory(policy.memory_len(), fixed, |mut memory| {
                policy.see(&image, &mut memory).unwrap();
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
    let model = SeeingModel::typical();
    let [float, fixed] = model.files();
    let (float, fixed) = (SeeingPolicy::parse(&float).unwrap(), SeeingPolicy::parse(&fixed).unwrap());
    assert_eq!(float.multiply_accumulates(), (22 + 64) * 16 + 16 * 4);
    assert_eq!(float.eye().shape().multiply_accumulates(), 135_872);
    assert_eq!((float.parameter_bytes(), fixed.parameter_bytes()), (4 * (1440 + 20), 2 * 1440 + 4 * 20));
    assert_eq!((float.eye_bytes(), fixed.eye_bytes()), (4 * 27_376, 28_096));
    assert_eq!((float.memory_len(), fixed.memory_len()), (64 + 2768, 64 + 2768));
}

#[test]
fn each_reader_says_which_other_one_reads_the_file() {
    let seeing = SeeingModel::tiny().file(false);
    assert_eq!(PolicyFile::parse(&seeing).unwrap_err(), PolicyError::Seeing);
    let blind = crate::support::Model::typical(1).float_file();
    assert_eq!(SeeingPolicy::parse(&blind).unwrap_err(), PolicyError::Blind);
}

/// Everything from small integers, so that every machine makes the same file. Recorded when format version 2 was
/// defined; a change here asks for a new version.
#[test]
fn the_format_has_not_moved() {
    let model = SeeingModel::tiny();
    let numbers = |count: usize, step: usize| -> Vec<f32> {
        (0..count).map(|i| ((i * step) % 17) as f32 / 64.0 - 0.125).collect()
    };
    let parameters = numbers(model.shape.parameter_count(), 5);
    let (weights, bias) = (numbers(27 * 4, 3), numbers(4, 7));
    let layers = [DenseLayer { inputs: 27, outputs: 4, weights: &weights, bias: &bias }];
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
        let format = EyeFormat::calibrated(&model.shape, &parameters, &[1.0; 5], bits).unwrap();
        let eye = EyeDraft { parameters: &parameters, format, golden_images: &golden_images, ..draft.eye };
        let draft = SeeingDraft { policy, eye };
        let mut bytes = vec![0; draft.file_len().unwrap()];
        with_memory(draft.memory_len(), true, |mut memory| draft.write(&mut bytes, &mut memory)).unwrap();
        assert_eq!((bytes.len(), crc32(&bytes[..bytes.len() - 4])), (1_008, 0xBFDE_0B5E));
    });
}

#[test]
fn altered_golden_images_fail_the_self_test() {
    let model = SeeingModel::typical();
    for (fixed, intact) in [false, true].into_iter().zip(model.files()) {
        let metadata_len = usize::from(u16::from_le_bytes([intact[20], intact[21]])).next_multiple_of(4);
        let golden = HEADER_LEN + EYE_HEADER_LEN + metadata_len;
        let mut bytes = intact;
        for pixel in &mut bytes[golden + 4 * (PILOT_LEN + 4)..][..24 * 32] {
            *pixel = !*pixel;
        }
        seal(&mut bytes);
        let policy = SeeingPolicy::parse(&bytes).unwrap();
        let result = with_memory(policy.memory_len(), fixed, |mut memory| {
            policy.self_test_with(&mut memory, &mut Scratch::new())
        });
        assert!(matches!(result, Err(PolicyError::SelfTest { vector: 0, .. })), "{result:?}");
    }
}

#[test]
fn drafts_that_no_file_can_hold_are_refused() {
    let model = SeeingModel::tiny();
    let images = images(&model.shape, 1, VECTORS);
    model.with_draft(true, |valid| {
        let refusal = |draft: SeeingDraft<'_>| draft.file_len().unwrap_err();
        let short = EyeDraft { golden_images: &images[1..], ..valid.eye };
        assert_eq!(
            refusal(SeeingDraft { eye: short, ..valid }),
            PolicyError::GoldenImages { found: 89, expected: 90 }
        );
        let still = EyeDraft { control_periods_per_image: 0, ..valid.eye };
        assert_eq!(refusal(SeeingDraft { eye: still, ..valid }), PolicyError::Eye(EyeError::Pace));
        let mut format = valid.eye.format;
        format.steps[1] *= 0.5;
        let finer = EyeDraft { format, ..valid.eye };
        assert!(matches!(
            refusal(SeeingDraft { eye: finer, ..valid }),
            PolicyError::Eye(EyeError::FeatureStep { .. })
        ));
        let observations = golden();
        let policy = PolicyDraft { golden_observations: &observations[1..], ..valid.policy };
        assert!(matches!(refusal(SeeingDraft { policy, ..valid }), PolicyError::GoldenObservations { .. }));
        let policy = PolicyDraft { layers: &valid.policy.layers[1..], ..valid.policy };
        let expected = PolicyError::ObservationLength { found: 4, expected: PILOT_LEN + 5 };
        assert_eq!(refusal(SeeingDraft { policy, ..valid }), expected);
        let mut bytes = vec![0; valid.file_len().unwrap() - 1];
        let result = with_memory(valid.memory_len(), true, |mut memory| valid.write(&mut bytes, &mut memory));
        assert!(matches!(result, Err(PolicyError::BufferTooSmall { .. })));
    });
}

#[test]
fn memory_of_another_kind_is_refused() {
    let bytes = SeeingModel::tiny().file(true);
    let policy = SeeingPolicy::parse(&bytes).unwrap();
    assert!(matches!(policy.eye(), PolicyEye::Fixed16(_)));
    let expected = policy.memory_len();
    let refusal = |found, found_arithmetic| PolicyError::EyeMemory {
        found,
        found_arithmetic,
        expected,
        expected_arithmetic: Arithmetic::Fixed16,
    };
    let (mut floats, mut integers) = (vec![0.0; expected], vec![0; expected - 1]);
    let mut wrong = EyeMemory::Float32(&mut floats);
    assert_eq!(policy.see(&[0; 30], &mut wrong), Err(refusal(expected, Arithmetic::Float32)));
    let mut short = EyeMemory::Fixed16(&mut integers);
    let error = policy.act(&[], &mut short, &mut Scratch::new()).unwrap_err();
    assert_eq!(error, refusal(expected - 1, Arithmetic::Fixed16));
    assert_eq!(
        error.to_string(),
        format!("memory of {} values for fixed16, expected at least {expected} for fixed16", expected - 1)
    );
}
