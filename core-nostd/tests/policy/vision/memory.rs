//! Vision policies that remember.

use kestrel_core::observation::PILOT_LEN;
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{
    ENCODER_HEADER_LEN, HEADER_LEN, PolicyError, PolicyFile, PolicyScratch, RecurrentPolicy, VisionPolicy,
};
use nalgebra::Vector3;
use proptest::prelude::*;

use super::pilot::hovering;
use super::support::{VisionModel, images, with_memory};
use crate::recurrent::reference;
use crate::support::{Model, observations, seal};

fn tiny() -> VisionModel {
    VisionModel::tiny().remembering(4, 4)
}

#[test]
fn both_arithmetics_remember_what_they_saw_as_the_equations_say() {
    let model = VisionModel::typical().remembering(32, 16);
    let (flight, frames) = (observations(5, 60, 1.5), images(&model.shape, 6, 60));
    let frames: Vec<&[u8]> = frames.chunks_exact(model.shape.image().len()).collect();
    let seen: Vec<Vec<f32>> = flight
        .chunks_exact(PILOT_LEN)
        .zip(&frames)
        .map(|(observation, image)| [observation, &model.features(image).0].concat())
        .collect();
    let [gates, candidate] = model.memory.as_ref().unwrap();
    let wanted = reference([gates, candidate, &model.model], seen.iter().map(Vec::as_slice));
    for (fixed, tolerance) in [(false, 2e-5), (true, 0.05)] {
        let bytes = model.file(fixed);
        let policy = VisionPolicy::parse(&bytes).unwrap();
        let inputs = PILOT_LEN + 64 + 32;
        assert_eq!((policy.units(), policy.multiply_accumulates()), (32, inputs * 96 + inputs * 16 + 16 * 4));
        let mut scratch = PolicyScratch::new();
        with_memory(policy.memory_len(), fixed, |mut memory| {
            // Golden vectors are one flight, and leave nothing behind for the next.
            for _ in 0..2 {
                assert_eq!(policy.self_test_with(&mut memory, &mut scratch), Ok(()));
            }
            memory.clear();
            let flown = flight.chunks_exact(PILOT_LEN).zip(&frames).zip(&wanted);
            for (step, ((observation, image), wanted)) in flown.enumerate() {
                let hidden = policy.hidden(&memory).unwrap();
                memory.clear();
                policy.encode(image, &mut memory).unwrap();
                policy.remember(&hidden, &mut memory).unwrap();
                let action = policy.act(observation, &mut memory, &mut scratch).unwrap();
                for (found, wanted) in action.into_iter().zip(wanted) {
                    let off = (f64::from(found) - wanted.clamp(-1.0, 1.0)).abs();
                    assert!(off < tolerance, "step {step}, fixed {fixed}: {found}, not {wanted}");
                }
            }
        });
    }
}

#[test]
fn what_is_stored_can_be_read_back() {
    let model = tiny();
    for (fixed, tolerance) in [(false, 0.0), (true, 1e-3)] {
        let bytes = model.file(fixed);
        let policy = VisionPolicy::parse(&bytes).unwrap();
        let memory = policy.memory().unwrap();
        for (index, layers) in model.memory.as_ref().unwrap().iter().map(Model::layers).enumerate() {
            let layer = layers[0];
            for row in 0..layer.outputs {
                assert!((memory.bias(index, row) - layer.bias[row]).abs() <= tolerance);
                for column in 0..layer.inputs {
                    let weight = layer.weights[row * layer.inputs + column];
                    assert!((memory.weight(index, row, column) - weight).abs() <= tolerance);
                }
            }
        }
    }
}

#[test]
fn a_pilot_forgets_when_it_is_reset() {
    let state = hovering();
    let model = VisionModel::typical().remembering(16, 16);
    for (fixed, bytes) in [false, true].into_iter().zip(model.files()) {
        let policy = VisionPolicy::parse(&bytes).unwrap();
        let image = images(&model.shape, 7, 1);
        with_memory(policy.memory_len(), fixed, |memory| {
            let mut pilot = Pilot::with_encoder(policy.clone(), memory).unwrap();
            pilot.self_test().unwrap();
            let mut fly = || {
                pilot.reset();
                pilot.encode(&image).unwrap();
                [0; 5].map(|_| pilot.tick(&state, &Vector3::new(0.0, 0.0, 1.0)))
            };
            let first = fly();
            assert!(first.windows(2).all(|pair| pair[0] != pair[1]), "what it remembers changes");
            assert_eq!(first, fly());
        });
    }
}

#[test]
fn others_say_who_reads_it() {
    for bytes in tiny().files() {
        assert_eq!(PolicyFile::parse(&bytes).unwrap_err(), PolicyError::Vision);
        assert_eq!(RecurrentPolicy::parse(&bytes).unwrap_err(), PolicyError::Vision);
    }
}

#[test]
fn every_flipped_bit_and_every_cut_is_found() {
    for mut bytes in tiny().files() {
        for bit in 0..bytes.len() * 8 {
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(VisionPolicy::parse(&bytes).is_err(), "bit {bit}");
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        assert!((0..bytes.len()).all(|len| VisionPolicy::parse(&bytes[..len]).is_err()));
        assert!(VisionPolicy::parse(&bytes).is_ok());
    }
}

#[test]
fn a_memory_that_no_policy_has_is_refused() {
    let at = HEADER_LEN + ENCODER_HEADER_LEN;
    let forged = |mut bytes: Vec<u8>, at: usize, value: u8| {
        bytes[at] = value;
        seal(&mut bytes);
        VisionPolicy::parse(&bytes).unwrap_err()
    };
    let [float, fixed] = tiny().files();
    let units = PolicyError::Units { found: 6, observation: PILOT_LEN + 5 };
    assert_eq!(forged(float.clone(), at, 6), units);
    assert!(matches!(forged(float.clone(), at, 8), PolicyError::Length { .. }));
    assert_eq!(forged(float, at + 2, 1), PolicyError::UnusedField { offset: at + 2, found: 1 });
    assert!(matches!(forged(fixed, at + 2, 21), PolicyError::FractionBits { .. }));
    // More than a network reads: an encoder of 64 features leaves 40 units.
    VisionModel::typical().remembering(44, 8).with_draft(false, |draft| {
        let expected = PolicyError::Units { found: 44, observation: PILOT_LEN + 64 };
        assert_eq!(draft.file_len(), Err(expected));
    });
}

proptest! {
    #[test]
    fn no_observation_and_no_forged_file_panics(
        fixed: bool,
        changes in prop::collection::vec((8_usize..200, any::<u8>()), 0..4),
        flight in prop::collection::vec(any::<f32>(), 3 * PILOT_LEN),
    ) {
        let mut bytes = tiny().file(fixed);
        for (at, value) in changes {
            bytes[at] = value;
        }
        seal(&mut bytes);
        if let Ok(policy) = VisionPolicy::parse(&bytes) {
            let image = vec![200; policy.encoder().shape().image().len()];
            with_memory(policy.memory_len(), fixed, |mut memory| {
                memory.clear();
                for observation in flight.chunks_exact(PILOT_LEN) {
                    policy.encode(&image, &mut memory).unwrap();
                    let action = policy.act(observation, &mut memory, &mut PolicyScratch::new()).unwrap();
                    assert!(action.iter().all(|value| (-1.0..=1.0).contains(value)));
                }
            });
        }
    }
}
