//! Policies for every observation layout and every action space.

use kestrel_core::action::Setpoint;
use kestrel_core::action::{
    ACTION_LIMIT, ActionSpace, ControlMemory, Controls, IntegralVelocities, Persistence, ReferenceActionKind,
    ReferenceActions, ReferenceController, RotorThrusts, ThrustTorques, Velocities,
};
use kestrel_core::airframe::{
    Airframe, CF2X, Downwash, DragCoefficients, FlightEffects, HUMMINGBIRD, Layout, RotorOrder,
};
use kestrel_core::attitude::Attitude;
use kestrel_core::crc32::crc32;
use kestrel_core::observation::{
    BodyLayout, KinematicLayout, MeasuredLayout, OBSERVATION_LIMIT, ObservationInput, ObservationLayout,
    PilotForLayout, PilotMeasuredLayout, Px4NeuralLayout, ReferenceLayout,
};
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{
    HEADER_LEN, ParameterFormat, PolicyDraft, PolicyError, PolicyFile, PolicyMetadata, PolicyScratch,
};
use kestrel_core::reference::controller::command::Precision;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;
use proptest::prelude::*;

use crate::support::{Model, PILOT, Random, metadata, rotor_speeds, seal, thrust_body_rates};

fn reference(kind: ReferenceActionKind, persistence: Persistence) -> ReferenceActions {
    ReferenceActions {
        kind,
        precision: Precision::Single,
        airframe: CF2X,
        controller: ReferenceController::Dsl(CF2X),
        persistence,
    }
}

fn hummingbird() -> ActionSpace {
    let controller = ReferenceController::Simple(HUMMINGBIRD);
    let space = reference(ReferenceActionKind::Pid, Persistence::ResetEachEpisode);
    ActionSpace::Reference(ReferenceActions { airframe: HUMMINGBIRD, controller, ..space })
}

fn spaces() -> Vec<ActionSpace> {
    let reference = ReferenceActionKind::ALL
        .map(|kind| ActionSpace::Reference(reference(kind, Persistence::ResetEachEpisode)));
    let own = vec![
        rotor_speeds(),
        thrust_body_rates(),
        rate_loop(),
        velocities(),
        integral_velocities(),
        rotor_thrusts(),
        thrust_torques(),
        hummingbird(),
    ];
    [own, reference.to_vec()].concat()
}

fn rate_loop() -> ActionSpace {
    let ActionSpace::ThrustBodyRates(rates) = thrust_body_rates() else { unreachable!() };
    ActionSpace::RateLoop(rates)
}

fn velocities() -> ActionSpace {
    let ActionSpace::ThrustBodyRates(rates) = thrust_body_rates() else { unreachable!() };
    ActionSpace::Velocities(Velocities { rates, speed_limit: 2.0, velocity_gain: 3.0, attitude_gain: 5.0 })
}

fn integral_velocities() -> ActionSpace {
    let ActionSpace::Velocities(velocities) = velocities() else { unreachable!() };
    ActionSpace::IntegralVelocities(IntegralVelocities { velocities, integral_gain: 3.0 })
}

fn rotor_thrusts() -> ActionSpace {
    ActionSpace::RotorThrusts(RotorThrusts::new(&CF2X, 0.05, 300.0))
}

fn thrust_torques() -> ActionSpace {
    ActionSpace::ThrustTorques(ThrustTorques::new(&CF2X, 0.02))
}

/// Every layout that goes with actions of a length.
fn layouts(action_len: u8) -> Vec<ObservationLayout> {
    let ObservationLayout::Pilot(scales) = PILOT else { unreachable!() };
    let of_pilot = if action_len == 4 {
        vec![PILOT, ObservationLayout::PilotMeasured(PilotMeasuredLayout { scales, measured_len: 11 })]
    } else {
        vec![ObservationLayout::PilotFor(PilotForLayout { scales, action_len })]
    };
    let others = vec![
        ObservationLayout::Reference(ReferenceLayout::of_episode(10.0)),
        ObservationLayout::Kinematic(KinematicLayout { past_actions: 0, action_len }),
        ObservationLayout::Kinematic(KinematicLayout { past_actions: 15, action_len }),
        ObservationLayout::Measured(MeasuredLayout { len: 11 }),
        ObservationLayout::Body(BodyLayout { scales, action_len, measured_len: 0 }),
        ObservationLayout::Body(BodyLayout { scales, action_len, measured_len: 11 }),
        ObservationLayout::Px4Neural(Px4NeuralLayout),
    ];
    [of_pilot, others].concat()
}

/// The file of a random policy, or why there is none.
fn written(metadata: &PolicyMetadata<'_>, fixed: bool) -> Result<Vec<u8>, PolicyError> {
    let lengths = [metadata.observation.len(), 16, metadata.action.len()];
    let model = Model::random(5, &lengths, 1.0);
    let mut random = Random(17);
    let golden: Vec<f32> = (0..2 * lengths[0]).map(|_| random.within(1.5)).collect();
    let layers = model.layers();
    let parameters = if fixed { model.fixed_format() } else { ParameterFormat::Float32 };
    let draft = PolicyDraft { metadata: *metadata, parameters, layers: &layers, golden_observations: &golden };
    let mut bytes = vec![0; draft.file_len()?];
    draft.write(&mut bytes)?;
    Ok(bytes)
}

fn tilted() -> State<f32> {
    State {
        position: Vector3::new(0.1, -0.2, 0.9),
        world_from_body: Attitude { w: 0.98, x: 0.1, y: -0.1, z: 0.14 }.normalized(),
        velocity: Vector3::new(0.3, 0.0, -0.1),
        body_rates: Vector3::new(0.1, 0.5, -0.2),
        rotor_speeds: [1500.0; 4],
    }
}

/// What the pilot should do in its first steps, from the parts it is made of.
struct Expected {
    controls: Controls<f32>,
    memory: ControlMemory<f32>,
    history: Vec<[f32; ACTION_LIMIT]>,
    integral: Vector3<f32>,
}

impl Expected {
    fn tick(&mut self, policy: &PolicyFile<'_>, state: &State<f32>, goal: &Vector3<f32>) -> [f32; 4] {
        let metadata = policy.metadata();
        if let ObservationLayout::Body(layout) = metadata.observation {
            self.integral = layout.integrate(&self.integral, state, goal, metadata.control_period_secs);
        }
        let input = ObservationInput {
            state,
            angular_velocity_in_world: state.world_from_body.rotate(state.body_rates),
            goal,
            heading: [1.0, 0.0],
            integral: &self.integral,
            history: &self.history,
            measurements: &MEASUREMENTS,
        };
        let mut observation = [0.0; OBSERVATION_LIMIT];
        metadata.observation.encode(&input, &mut observation);
        let action = policy.act(&observation[..metadata.observation.len()], &mut PolicyScratch::new());
        assert_eq!(action[metadata.action.len()..], [0.0; ACTION_LIMIT][metadata.action.len()..]);
        self.history.push(action);
        let (setpoint, secs) = (Setpoint::at(*goal), metadata.control_period_secs);
        let targets = self.controls.rotor_targets(&action, state, &setpoint, &mut self.memory, secs);
        match &metadata.action {
            ActionSpace::RotorSpeeds(_)
            | ActionSpace::ThrustBodyRates(_)
            | ActionSpace::RateLoop(_)
            | ActionSpace::Velocities(_)
            | ActionSpace::IntegralVelocities(_)
            | ActionSpace::RotorThrusts(_)
            | ActionSpace::ThrustTorques(_) => targets,
            // The reference commands what no rotor can do: the Hummingbird's first step asks for ten times its limit.
            ActionSpace::Reference(space) => {
                targets.map(|target| target.min(space.airframe.rotor_speed_limit as f32))
            }
        }
    }
}

const MEASUREMENTS: [f32; 11] = [0.3, -0.2, 0.1, 0.0, 0.9, -1.0, 0.4, 0.2, 0.2, -0.7, 0.5];

#[test]
fn a_pilot_flies_every_layout_with_every_action_space() {
    for (action, fixed) in spaces().into_iter().zip([false, true].into_iter().cycle()) {
        for observation in layouts(action.len() as u8) {
            let metadata = PolicyMetadata { observation, ..metadata(&action) };
            let bytes = written(&metadata, fixed).unwrap();
            let policy = PolicyFile::parse(&bytes).unwrap();
            assert_eq!((policy.metadata(), policy.self_test()), (&metadata, Ok(())));
            let mut pilot = Pilot::new(policy.clone());
            let mut expected = Expected {
                controls: Controls::new(&action),
                memory: ControlMemory::new(),
                history: Vec::new(),
                integral: Vector3::zeros(),
            };
            for step in 0..20_u8 {
                let (mut state, goal) = (tilted(), Vector3::new(0.0, 0.1, 1.0));
                state.position.z += 0.01 * f32::from(step);
                let targets = pilot.tick_measured(&MEASUREMENTS, &state, &goal);
                assert_eq!(targets, expected.tick(&policy, &state, &goal), "{} {step}", action.name());
                assert_eq!(pilot.previous_action(), &expected.history[usize::from(step)][..action.len()]);
            }
        }
    }
}

#[test]
fn a_policy_on_another_drone_turns_the_rotors_of_that() {
    for action in spaces() {
        let metadata = PolicyMetadata { observation: layouts(action.len() as u8)[0], ..metadata(&action) };
        let bytes = written(&metadata, false).unwrap();
        let policy = PolicyFile::parse(&bytes).unwrap();
        let moved = policy.clone().on(&HUMMINGBIRD);
        let expected = if matches!(action, ActionSpace::ThrustTorques(_)) {
            ActionSpace::ThrustTorques(ThrustTorques::new(&HUMMINGBIRD, 0.02))
        } else {
            action
        };
        assert_eq!(moved.metadata().action, expected, "{}", action.name());
        let fly = |policy| Pilot::new(policy).tick(&tilted(), &Vector3::zeros());
        assert_eq!(fly(moved) == fly(policy), expected == action, "{}", action.name());
    }
}

#[test]
fn only_a_controller_that_was_trained_to_persists_through_a_reset() {
    for (persistence, forgets) in [(Persistence::ResetEachEpisode, true), (Persistence::Persist, false)] {
        let action = ActionSpace::Reference(reference(ReferenceActionKind::Pid, persistence));
        let observation = ObservationLayout::Reference(ReferenceLayout::of_episode(5.0));
        let bytes = written(&PolicyMetadata { observation, ..metadata(&action) }, false).unwrap();
        let mut pilot = Pilot::new(PolicyFile::parse(&bytes).unwrap());
        let first = pilot.tick(&tilted(), &Vector3::zeros());
        pilot.reset();
        assert_eq!(pilot.tick(&tilted(), &Vector3::zeros()) == first, forgets);
    }
}

#[test]
fn lengths_that_contradict_each_other_are_refused() {
    let rotors = rotor_speeds();
    let one = ActionSpace::Reference(reference(ReferenceActionKind::OneDRpm, Persistence::Persist));
    let ObservationLayout::Pilot(scales) = PILOT else { unreachable!() };
    let pilot_for = |action_len| ObservationLayout::PilotFor(PilotForLayout { scales, action_len });
    let pilot_measured =
        |measured_len| ObservationLayout::PilotMeasured(PilotMeasuredLayout { scales, measured_len });
    let kinematic =
        |past_actions, action_len| ObservationLayout::Kinematic(KinematicLayout { past_actions, action_len });
    let refused = [
        (PILOT, &one, "values of an action"),
        (pilot_for(4), &rotors, "action_len"),
        (pilot_for(3), &rotors, "action_len"),
        (pilot_measured(0), &rotors, "measured_len"),
        (pilot_measured(2), &one, "values of an action"),
        (kinematic(2, 3), &rotors, "action_len"),
        (kinematic(33, 1), &one, "past_actions"),
        (ObservationLayout::Measured(MeasuredLayout { len: 0 }), &rotors, "len"),
        (ObservationLayout::Reference(ReferenceLayout::of_episode(f32::NAN)), &rotors, "planar_limit_m"),
    ];
    for (observation, action, expected) in refused {
        let error = written(&PolicyMetadata { observation, ..metadata(action) }, false).unwrap_err();
        assert!(matches!(error, PolicyError::MetadataValue { field, .. } if field == expected), "{error}");
    }
    let observation = ObservationLayout::Measured(MeasuredLayout { len: 129 });
    let error = written(&PolicyMetadata { observation, ..metadata(&rotors) }, false).unwrap_err();
    assert_eq!(error, PolicyError::Width { layer: 0, found: 129 });
}

#[test]
fn the_network_writes_as_many_values_as_the_action_has() {
    let action = ActionSpace::Reference(reference(ReferenceActionKind::Tun, Persistence::Persist));
    let observation = ObservationLayout::Reference(ReferenceLayout::of_episode(5.0));
    let model = Model::random(1, &[12, 4], 1.0);
    let draft = PolicyDraft {
        metadata: PolicyMetadata { observation, ..metadata(&action) },
        parameters: ParameterFormat::Float32,
        layers: &model.layers(),
        golden_observations: &[0.5; 12],
    };
    assert_eq!(draft.file_len(), Err(PolicyError::ActionLength { found: 4, expected: 6 }));
}

type Spoil = fn(&mut Airframe);

#[test]
fn airframes_that_cannot_fly_are_refused() {
    let broken: [(Spoil, &str); 4] = [
        (|airframe| airframe.mass = 0.0, "mass"),
        (|airframe| airframe.thrust_coefficient = f64::NAN, "thrust_coefficient"),
        (|airframe| airframe.rotor_speed_limit = f64::INFINITY, "rotor_speed_limit"),
        (|airframe| airframe.inertia[1] = f64::NAN, "an airframe number"),
    ];
    for (spoil, expected) in broken {
        let mut space = reference(ReferenceActionKind::Pid, Persistence::Persist);
        let mut airframe = CF2X;
        spoil(&mut airframe);
        for of_controller in [false, true] {
            if of_controller {
                space.controller = ReferenceController::Dsl(airframe);
            } else {
                space.airframe = airframe;
            }
            let observation = ObservationLayout::Reference(ReferenceLayout::of_episode(5.0));
            let metadata = PolicyMetadata { observation, ..metadata(&ActionSpace::Reference(space)) };
            let error = written(&metadata, false).unwrap_err();
            assert!(matches!(error, PolicyError::MetadataValue { field, .. } if field == expected), "{error}");
            space.airframe = CF2X;
        }
    }
}

/// Metadata from small integers; a change of the checksums asks for a new number of the layout or of the space.
#[test]
fn the_references_metadata_have_not_moved() {
    let airframe = Airframe {
        mass: 1.0,
        inertia: [2.0, 3.0, 4.0],
        layout: Layout::Cross { x: 5.0, y: 6.0 },
        rotor_order: RotorOrder::CounterClockwise,
        arm: 7.0,
        thrust_coefficient: 8.0,
        torque_coefficient: -9.0,
        rotor_speed_limit: 10.0,
        rotor_rise_secs: 11.0,
        rotor_fall_secs: 12.0,
        drag_coefficients: DragCoefficients { planar: 13.0, axial: 14.0 },
        propeller_radius: 15.0,
        ground_effect_coefficient: 16.0,
        downwash: Downwash { strength: 17.0, width_slope: 18.0, width_offset: 19.0 },
        collision_radius: 20.0,
        collision_height: 21.0,
        collision_offset: 22.0,
        nominal_speed: 23.0,
        effects: FlightEffects::NONE,
    };
    let action = ActionSpace::Reference(ReferenceActions {
        kind: ReferenceActionKind::Tun,
        precision: Precision::AllSingle,
        airframe,
        controller: ReferenceController::Simple(airframe),
        persistence: Persistence::Persist,
    });
    let found: Vec<(usize, u32)> = layouts(6)
        .into_iter()
        .map(|observation| {
            let bytes = written(&PolicyMetadata { observation, ..metadata(&action) }, false).unwrap();
            let len = usize::from(u16::from_le_bytes([bytes[20], bytes[21]]));
            (len, crc32(&bytes[HEADER_LEN..HEADER_LEN + len]))
        })
        .collect();
    let recorded = [
        (406, 0xE9AD_EE34),
        (401, 0x6B3F_E947),
        (395, 0x6911_A969),
        (395, 0x2D8C_0AB9),
        (394, 0x7D4D_EC9B),
        (407, 0x5D3E_BCE7),
        (407, 0x1E02_3664),
        (393, 0xB6C3_EB0D),
    ];
    assert_eq!(found, recorded);
}

proptest! {
    #[test]
    fn rotors_get_what_they_can_do_whatever_the_state(
        bits in prop::collection::vec(any::<u32>(), 20),
        space in 0_usize..13,
        layout in 0_usize..7,
    ) {
        let v: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
        let action = spaces()[space];
        let observation = layouts(action.len() as u8)[layout];
        let bytes = written(&PolicyMetadata { observation, ..metadata(&action) }, false).unwrap();
        let mut pilot = Pilot::new(PolicyFile::parse(&bytes).unwrap());
        let state = State {
            position: Vector3::new(v[0], v[1], v[2]),
            world_from_body: Attitude { w: v[3], x: v[4], y: v[5], z: v[6] },
            velocity: Vector3::new(v[7], v[8], v[9]),
            body_rates: Vector3::new(v[10], v[11], v[12]),
            rotor_speeds: [0.0; 4],
        };
        let limit = CF2X.rotor_speed_limit.max(HUMMINGBIRD.rotor_speed_limit) as f32 * 1.000_001;
        for _ in 0..2 {
            let targets = pilot.tick(&state, &Vector3::new(v[13], v[14], v[15]));
            prop_assert!(targets.iter().all(|target| (0.0..=limit).contains(target)), "{:?}", targets);
        }
    }

    #[test]
    fn forged_files_of_the_references_spaces_never_panic(
        space in 2_usize..13,
        layout in 0_usize..7,
        changes in prop::collection::vec((8_usize..500, any::<u8>()), 1..6),
    ) {
        let action = spaces()[space];
        let observation = layouts(action.len() as u8)[layout];
        let mut bytes = written(&PolicyMetadata { observation, ..metadata(&action) }, space % 2 == 0).unwrap();
        for (at, value) in changes {
            bytes[at] = value;
        }
        seal(&mut bytes);
        if let Ok(policy) = PolicyFile::parse(&bytes) {
            let mut pilot = Pilot::new(policy);
            let targets = pilot.tick(&tilted(), &Vector3::zeros());
            prop_assert!(targets.iter().all(|target| target.is_finite()));
            prop_assert!(pilot.self_test().is_ok() || pilot.self_test().is_err());
        }
    }
}
