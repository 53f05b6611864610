//! The pilot: encode, act, mix.

use kestrel_core::action::ActionSpace;
use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;
use kestrel_core::observation::ObservationLayout;
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{ParameterFormat, PolicyFile, PolicyScratch};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;
use proptest::prelude::*;

use crate::support::{Model, PILOT, draft, golden, metadata, rotor_speeds, thrust_body_rates, write};

fn file(action: &ActionSpace, fixed: bool) -> Vec<u8> {
    let model = Model::typical(11);
    let layers = model.layers();
    let golden = golden();
    let parameters = if fixed { model.fixed_format() } else { ParameterFormat::Float32 };
    let mut draft = draft(&layers, parameters, &golden);
    draft.metadata = metadata(action);
    write(&draft)
}

fn hovering() -> State<f32> {
    State {
        position: Vector3::new(0.1, -0.2, 0.9),
        world_from_body: Attitude::level(),
        velocity: Vector3::new(0.3, 0.0, -0.1),
        body_rates: Vector3::new(0.0, 0.5, 0.0),
        rotor_speeds: [1500.0; 4],
    }
}

fn state_of(v: &[f32]) -> State<f32> {
    State {
        position: Vector3::new(v[0], v[1], v[2]),
        world_from_body: Attitude { w: v[3], x: v[4], y: v[5], z: v[6] },
        velocity: Vector3::new(v[7], v[8], v[9]),
        body_rates: Vector3::new(v[10], v[11], v[12]),
        rotor_speeds: [v[13], v[14], v[15], v[16]],
    }
}

/// Any bits at all, infinities and NaN often.
fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => -3.0_f32..3.0,
        1 => any::<u32>().prop_map(f32::from_bits),
        1 => prop::sample::select(vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, -0.0]),
    ]
}

proptest! {
    #[test]
    fn rotor_targets_are_in_range_whatever_the_state(
        values in prop::collection::vec(number(), 20),
        fixed: bool,
        rates: bool,
    ) {
        let bytes = file(&if rates { thrust_body_rates() } else { rotor_speeds() }, fixed);
        let mut pilot = Pilot::new(PolicyFile::parse(&bytes).unwrap());
        let goal = Vector3::new(values[17], values[18], values[19]);
        for state in [state_of(&values), hovering(), state_of(&values)] {
            let targets = pilot.tick(&state, &goal);
            let limit = CF2X.rotor_speed_limit as f32 * 1.000_001;
            prop_assert!(targets.iter().all(|target| (0.0..=limit).contains(target)), "{:?}", targets);
            prop_assert!(pilot.previous_action().iter().all(|value| (-1.0..=1.0).contains(value)));
        }
    }
}

#[test]
fn a_tick_is_encode_act_and_mix() {
    let bytes = file(&rotor_speeds(), true);
    let policy = PolicyFile::parse(&bytes).unwrap();
    let mut pilot = Pilot::new(policy.clone());
    let (state, goal) = (hovering(), Vector3::new(0.0, 0.0, 1.0));
    let (ObservationLayout::Pilot(layout), ActionSpace::RotorSpeeds(space)) = (PILOT, rotor_speeds()) else {
        unreachable!()
    };
    let mut previous = [0.0; 4];
    for _ in 0..3 {
        let targets = pilot.tick(&state, &goal);
        let action = policy.act(&layout.encode(&state, &goal, &previous), &mut PolicyScratch::new());
        previous = [action[0], action[1], action[2], action[3]];
        assert_eq!(pilot.previous_action(), previous);
        assert_eq!(action[4..], [0.0; 2]);
        assert_eq!(targets, space.rotor_targets(&previous));
    }
}

#[test]
fn after_a_reset_the_flight_repeats_itself() {
    let bytes = file(&thrust_body_rates(), false);
    let mut pilot = Pilot::new(PolicyFile::parse(&bytes).unwrap());
    let goal = Vector3::zeros();
    let first = [pilot.tick(&hovering(), &goal), pilot.tick(&hovering(), &goal)];
    assert_ne!(first[0], first[1], "the previous action matters");
    pilot.reset();
    assert_eq!(pilot.previous_action(), [0.0; 4]);
    assert_eq!([pilot.tick(&hovering(), &goal), pilot.tick(&hovering(), &goal)], first);
}

#[test]
fn the_self_test_leaves_the_flight_alone() {
    let bytes = file(&rotor_speeds(), true);
    let mut pilot = Pilot::new(PolicyFile::parse(&bytes).unwrap());
    pilot.tick(&hovering(), &Vector3::zeros());
    let before = pilot.previous_action().to_vec();
    assert_eq!(pilot.self_test(), Ok(()));
    assert_eq!(pilot.previous_action(), before);
    assert_eq!(pilot.policy().metadata().name, "hover");
}
