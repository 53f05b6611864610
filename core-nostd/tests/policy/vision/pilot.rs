//! The pilot of a vision policy.

use kestrel_core::attitude::Attitude;
use kestrel_core::encoder::EncoderError;
use kestrel_core::observation::ObservationLayout;
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{PolicyError, PolicyFile, PolicyScratch, VisionPolicy};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use super::support::{VisionModel, images, with_memory};
use crate::support::PILOT;

pub(crate) fn hovering() -> State<f32> {
    State {
        position: Vector3::new(0.1, -0.2, 0.9),
        world_from_body: Attitude::level(),
        velocity: Vector3::new(0.3, 0.0, -0.1),
        body_rates: Vector3::new(0.0, 0.5, 0.0),
        rotor_speeds: [1500.0; 4],
    }
}

#[test]
fn a_tick_acts_on_the_last_image() {
    let (state, goal) = (hovering(), Vector3::new(0.0, 0.0, 1.0));
    let model = VisionModel::typical();
    let ObservationLayout::Pilot(layout) = PILOT else { unreachable!() };
    for (fixed, bytes) in [false, true].into_iter().zip(model.files()) {
        let policy = VisionPolicy::parse(&bytes).unwrap();
        let frames = images(&model.shape, 5, 2);
        with_memory(policy.memory_len(), fixed, |memory| {
            let mut pilot = Pilot::with_encoder(policy.clone(), memory).unwrap();
            let mut previous = [0.0; 4];
            for image in frames.chunks_exact(model.shape.image().len()) {
                pilot.encode(image).unwrap();
                for _ in 0..pilot.policy().control_periods_per_image() {
                    pilot.tick(&state, &goal);
                    let action = with_memory(policy.memory_len(), fixed, |mut memory| {
                        policy.encode(image, &mut memory).unwrap();
                        let observation = layout.encode(&state, &goal, &previous);
                        policy.act(&observation, &mut memory, &mut PolicyScratch::new()).unwrap()
                    });
                    previous = [action[0], action[1], action[2], action[3]];
                    assert_eq!(pilot.previous_action(), previous);
                }
            }
        });
    }
}

#[test]
fn images_matter_and_a_reset_forgets_them() {
    let (state, goal) = (hovering(), Vector3::zeros());
    let model = VisionModel::typical();
    for (fixed, bytes) in [false, true].into_iter().zip(model.files()) {
        let policy = VisionPolicy::parse(&bytes).unwrap();
        with_memory(policy.memory_len(), fixed, |memory| {
            let mut pilot = Pilot::with_encoder(policy.clone(), memory).unwrap();
            let before_the_first_image = pilot.tick(&state, &goal);
            pilot.reset();
            pilot.encode(&images(&model.shape, 1, 1)).unwrap();
            let vision = pilot.tick(&state, &goal);
            assert_ne!(vision, before_the_first_image);
            pilot.reset();
            assert_eq!(pilot.previous_action(), [0.0; 4]);
            assert_eq!(pilot.tick(&state, &goal), before_the_first_image);
        });
    }
}

#[test]
fn an_image_of_another_length_changes_nothing() {
    let (state, goal) = (hovering(), Vector3::zeros());
    let model = VisionModel::typical();
    let bytes = model.file(true);
    let policy = VisionPolicy::parse(&bytes).unwrap();
    let image = images(&model.shape, 1, 1);
    let fly = |damaged: bool| {
        with_memory(policy.memory_len(), true, |memory| {
            let mut pilot = Pilot::with_encoder(policy.clone(), memory).expect("the memory fits");
            pilot.encode(&image).expect("the image fits");
            if damaged {
                let expected = EncoderError::ImageLength { found: 767, expected: 768 };
                assert_eq!(pilot.encode(&image[1..]), Err(PolicyError::Encoder(expected)));
            }
            pilot.tick(&state, &goal)
        })
    };
    assert_eq!(fly(true), fly(false));
}

#[test]
fn the_self_test_forgets_the_golden_images() {
    let (state, goal) = (hovering(), Vector3::zeros());
    for (fixed, bytes) in [false, true].into_iter().zip(VisionModel::typical().files()) {
        let policy = VisionPolicy::parse(&bytes).unwrap();
        with_memory(policy.memory_len(), fixed, |memory| {
            let mut pilot = Pilot::with_encoder(policy, memory).unwrap();
            let before = pilot.tick(&state, &goal);
            pilot.reset();
            assert_eq!(pilot.self_test(), Ok(()));
            assert_eq!(pilot.tick(&state, &goal), before);
        });
    }
}

#[test]
fn too_little_memory_is_refused_before_the_flight() {
    let bytes = VisionModel::tiny().file(false);
    let policy = VisionPolicy::parse(&bytes).unwrap();
    let refusal =
        with_memory(policy.memory_len() - 1, false, |memory| Pilot::with_encoder(policy, memory).map(|_| ()));
    assert!(matches!(refusal, Err(PolicyError::EncoderWorkspace { .. })));
}

/// Nobody pays for what they do not use (64-bit host); the observation is in the pilot, not on the stack of a task.
#[cfg(target_pointer_width = "64")]
#[test]
fn a_state_based_pilot_has_not_grown() {
    let sizes = (size_of::<Pilot<'static>>(), size_of::<PolicyFile<'static>>(), size_of::<PolicyScratch>());
    assert_eq!(sizes, (4688, 976, 1792));
}
