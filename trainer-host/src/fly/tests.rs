use std::fs;
use std::net::UdpSocket;

use kestrel_core::action::{ACTION_LEN, ActionSpace, ThrustBodyRates};
use kestrel_core::activation::Activation;
use kestrel_core::airframe::GRAVITY;
use kestrel_core::dynamics::Integrator;
use kestrel_core::mlp::DenseLayer;
use kestrel_core::observation::{ObservationLayout, PILOT_LEN, PilotLayout};
use kestrel_core::policy_file::{ParameterFormat, PolicyDraft, PolicyMetadata};
use kestrel_experiments::experiment_config::{self, EvaluationSettings};
use kestrel_experiments::recording::Recording;
use kestrel_shim::goal::MovingGoal;
use kestrel_shim::link::LinkError;
use kestrel_shim::lockstep::SimulationRate;
use kestrel_shim::steering::Steering;
use kestrel_sim::contact::{Arena, ContactReport, Touch};
use kestrel_sim::scenario::{Aviary, Physics};
use kestrel_sim::world::{Floor, Pose, Solid, World};

use super::*;

const LAYOUT: ObservationLayout =
    ObservationLayout::Pilot(PilotLayout { position_scale_m: 1.0, velocity_scale: 1.0, body_rates_scale: 1.0 });

fn action() -> ActionSpace {
    ActionSpace::ThrustBodyRates(ThrustBodyRates::new(&CF2X, 1.0, [6.0; 3], [6.0, 6.0, 3.0]))
}

/// A policy that climbs towards its goal, and does nothing else.
fn climber(control_period_secs: f32) -> Vec<u8> {
    let mut weights = [0.0; PILOT_LEN * ACTION_LEN];
    (weights[2], weights[14]) = (-2.2 / GRAVITY as f32, -3.0 / GRAVITY as f32);
    let draft = PolicyDraft {
        metadata: PolicyMetadata {
            name: "climber",
            observation: LAYOUT,
            action: action(),
            control_period_secs,
            seed: 0,
            training_steps: 0,
            airframe: None,
        },
        parameters: ParameterFormat::Float32,
        layers: &[DenseLayer {
            inputs: PILOT_LEN,
            outputs: ACTION_LEN,
            weights: &weights,
            bias: &[0.0; ACTION_LEN],
            activation: Activation::Tanh,
        }],
        golden_observations: &[0.1; PILOT_LEN],
    };
    let mut bytes = vec![0; draft.file_len().unwrap()];
    draft.write(&mut bytes).unwrap();
    bytes
}

fn scenario() -> Scenario {
    let least = Scenario::hover(&CF2X, Physics::clean(Integrator::SemiImplicitEuler, 2, 100.0));
    let aviary = Aviary { goal: Vector3::new(1.0, 2.0, 1.0), ..least.aviary };
    Scenario { aviary, action: action(), observation: LAYOUT, ..least }
}

/// The scenario as a task.
fn task(scenario: &Scenario) -> Experiment {
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/../configs/hover.yaml");
    let hover = experiment_config::load(config.as_ref(), &[]).unwrap();
    let evaluation = EvaluationSettings { scenario: scenario.clone(), ..hover.evaluation };
    Experiment { scenario: scenario.clone(), evaluation, ..hover }
}

/// As fast as it goes, on any free port, to a ground station that is nowhere.
fn options(for_secs: f64) -> FlyOptions {
    let session = SessionOptions {
        listen: "127.0.0.1:0".parse().unwrap(),
        ground_station: "127.0.0.1:9".parse().unwrap(),
        speed: SimulationRate::Unthrottled,
        for_secs: Some(for_secs),
        ..SessionOptions::default()
    };
    FlyOptions { session, ..FlyOptions::default() }
}

#[test]
fn a_flight_begins_on_the_floor_below_the_starts_and_ends_in_time() {
    let scenario = scenario();
    let summary = fly(Place::Task(&task(&scenario)), &climber(0.01), &options(2.0), &|| false, None).unwrap();
    assert!((summary.secs - 2.0).abs() < 0.006, "{}", summary.secs);
    assert!((summary.position - Vector3::new(1.0, 2.0, 0.0125)).norm() < 2e-3, "{summary:?}");
    assert_eq!((summary.mode, summary.counts.frames), (Mode::Disarmed, 0));
}

#[test]
fn a_drone_is_never_inside_of_a_wall_that_stands_before_its_set_points() {
    let mut scenario = scenario();
    let wall = Solid::block("wall", Vector3::new(1.8, -10.0, 0.0), Vector3::new(1.9, 10.0, 3.0));
    scenario.aviary.world.solids.push(wall);
    // How far forward the tilted cylinder around the drone reaches.
    let front = |state: &State<f32>| {
        let up = state.world_from_body.rotate(Vector3::z()).x;
        let (radius, height) = (CF2X.collision_radius as f32, CF2X.collision_height as f32);
        state.position.x + radius * (1.0 - up * up).max(0.0).sqrt() + 0.5 * height * up.abs()
    };
    let mut plant = SimulatedFlight::new(Flight::landed(&scenario));
    let mut steering = Steering::new(&CF2X);
    let mut greatest = f32::MIN;
    for goal in [[1.0, 2.0, 1.0], [5.0, 2.0, 1.0], [3.0, 0.0, 0.5], [1.85, 1.0, 1.0]] {
        for _ in 0..500 {
            let targets = steering.toward(plant.state(), &MovingGoal::at(goal.into(), 0.0), 0.01);
            plant.step(&targets);
            greatest = greatest.max(front(plant.state()));
            assert!(greatest < 1.8 + 1e-3 && plant.state().position.z > 0.0, "{:?}", plant.state());
        }
    }
    assert!(greatest > 1.795, "it came as near as {greatest} m");
}

#[test]
fn several_vehicles_fly_in_one_aviary_or_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = scenario();
    let log = folder.path().join("true_state.jsonl");
    let options = FlyOptions { vehicles: 3, true_state_log: Some(log.clone()), ..options(1.0) };
    let task = task(&scenario);
    let (tell, glimpses) = std::sync::mpsc::channel();
    let summary = fly(Place::Aviary(&task), &climber(0.02), &options, &|| false, Some(tell)).unwrap();
    assert!((summary.secs - 0.98).abs() < 0.03, "{summary:?}");
    let lines = fs::read_to_string(log).unwrap();
    assert_eq!(lines.lines().count() % 3, 0);
    let Ok(Glimpse::Begins(_, flight)) = glimpses.recv() else { panic!("nothing is told") };
    assert_eq!((flight.drones.len(), flight.control_secs), (3, 0.02), "at the pace of the policy");
    let kept = FlyOptions { record: Some(folder.path().join("flight.recording")), ..self::options(1.0) };
    let refused = fly(Place::Aviary(&task), &climber(0.02), &kept, &|| false, None).unwrap_err();
    assert!(matches!(refused, FlyError::ControlPeriod { .. }), "a recording has the pace of its configuration");
    let error = fly(Place::FlatFloor, &climber(0.02), &FlyOptions { vehicles: 250, ..options }, &|| false, None);
    assert!(error.unwrap_err().to_string().ends_with("expected 250, 30 cm apart"));
}

#[test]
fn a_thousand_set_points_in_and_around_a_room_lead_through_nothing() {
    const SET_POINTS: u32 = 1_000;
    /// What hits at a metre per second is a few millimetres in for a period \[m\].
    const SKIN_M: f64 = 0.01;
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/../configs/aviaries/room-1.yaml");
    let scenario = kestrel_experiments::experiment_config::load(config.as_ref(), &[]).unwrap().scenario;
    let hull = Airframe {
        collision_radius: scenario.airframe.collision_radius - SKIN_M,
        collision_height: scenario.airframe.collision_height - 2.0 * SKIN_M,
        ..scenario.airframe
    };
    // It may stand on the floor.
    let world = World { floor: Floor::Absent, ..scenario.aviary.world.clone() };
    let arena = Arena::new(&world, &hull, ContactReport::Touch);
    let whole = Arena::new(&world, &scenario.airframe, ContactReport::Touch);
    let mut plant = SimulatedFlight::new(Flight::landed(&scenario));
    let mut steering = Steering::new(&scenario.airframe);
    let (launch, control_secs) = (*plant.state(), scenario.physics.control_secs());
    let (mut drawn, mut touches) = (1_u32, 0);
    // A linear congruential generator: Numerical Recipes, chapter 7.
    let mut share = || {
        drawn = drawn.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (drawn >> 8) as f32 / (1 << 24) as f32
    };
    for number in 0..SET_POINTS {
        if plant.state().world_from_body.up_cosine() < 0.2 {
            plant.flight.put(&launch); // it lies on its back
        }
        let goal = launch.position + Vector3::new(10.0 * share() - 5.0, 6.0 * share() - 3.0, 3.0 * share());
        for _ in 0..(1.5 / control_secs) as u32 {
            let targets = steering.toward(plant.state(), &MovingGoal::at(goal, 0.0), control_secs);
            plant.step(&targets);
            let State { position, world_from_body, .. } = *plant.state();
            let pose = Pose { position: position.cast(), world_from_body: world_from_body.map(f64::from) };
            assert_eq!(
                arena.touch(&pose, &[]),
                Touch::default(),
                "set-point {number}, {goal}: {:?}",
                plant.state()
            );
            touches += u32::from(whole.touch(&pose, &[]).obstacle);
        }
    }
    println!("{touches} control periods at something");
    assert!(touches > 1_000, "{touches}");
}

#[test]
fn a_room_with_walls_flies_many_times_as_fast_as_time_goes_by() {
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/../configs/aviaries/room-0.yaml");
    let scenario = kestrel_experiments::experiment_config::load(config.as_ref(), &[]).unwrap().scenario;
    let physics = Physics { control_rate_hz: 250.0, substeps: 1, ..scenario.physics };
    let mut flight = Flight::landed(&Scenario { physics, ..scenario });
    let hover_speed = flight.scenario().airframe.hover_rotor_speed() as f32;
    let begin = std::time::Instant::now();
    for period in 0..2500 {
        flight.step(&[if period < 500 { 1.02 } else { 0.99 } * hover_speed; 4]);
    }
    let secs = begin.elapsed().as_secs_f64();
    println!("10 s at 250 Hz in {secs:.3} s");
    assert!(secs < 10.0, "{secs}");
}

#[test]
fn every_task_has_a_place_from_which_a_vehicle_takes_off() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../configs/aviaries");
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "yaml") {
            continue;
        }
        let scenario = kestrel_experiments::experiment_config::load(&path, &[]).unwrap().scenario;
        let flight = Flight::landed(&scenario);
        let state = flight.state();
        let name = path.display();
        assert!(state.world_from_body.up_cosine() > 0.999 && state.velocity.norm() < 0.05, "{name}: {state:?}");
        assert!((0.0..0.3).contains(&state.position.z), "{name}: {state:?}");
        let pose = Pose::at((state.position + Vector3::new(0.0, 0.0, 0.02)).cast());
        let arena = Arena::new(&scenario.aviary.world, &scenario.airframe, ContactReport::Touch);
        assert_eq!(arena.touch(&pose, &[]), Touch::default(), "{name}: {state:?}");
    }
}

#[test]
fn without_a_task_a_drone_stands_level_at_the_origin() {
    let bytes = PolicyBytes::copy_of(&climber(0.02));
    let flight = Flight::landed(&flat_floor(bytes.policy().unwrap().metadata()));
    let state = flight.state();
    assert!((state.position - Vector3::new(0.0, 0.0, 0.0125)).norm() < 2e-3, "{state:?}");
    assert!(state.world_from_body.up_cosine() > 0.999, "{state:?}");
}

#[test]
fn an_interrupt_ends_the_flight() {
    let summary = fly(Place::FlatFloor, &climber(0.01), &options(1e9), &|| true, None).unwrap();
    assert!(summary.secs < 0.02);
}

#[test]
fn the_log_has_a_line_per_control_period() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("true.jsonl");
    let options = FlyOptions { true_state_log: Some(path.clone()), ..options(1.0) };
    fly(Place::FlatFloor, &climber(0.02), &options, &|| false, None).unwrap();
    let lines: Vec<serde_json::Value> =
        fs::read_to_string(path).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 51, "both ends");
    assert!((lines[50]["secs"].as_f64().unwrap() - 1.0).abs() < 1e-5);
    assert_eq!(lines[50]["mode"], "disarmed");
    assert_eq!(lines[50]["armed"], false);
    assert!((lines[50]["position"][2].as_f64().unwrap() - 0.0125).abs() < 2e-3);
}

#[test]
fn a_log_that_cannot_be_written_is_named() {
    let missing = FlyOptions { true_state_log: Some("no/such/folder/true.jsonl".into()), ..options(1.0) };
    let error = fly(Place::FlatFloor, &climber(0.01), &missing, &|| false, None).unwrap_err();
    assert!(
        error.to_string().starts_with("cannot write the true-state log no/such/folder/true.jsonl: "),
        "{error}"
    );
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_flight_with_an_error() {
    let full = FlyOptions { true_state_log: Some("/dev/full".into()), ..options(1e9) };
    let error = fly(Place::FlatFloor, &climber(0.01), &full, &|| false, None).unwrap_err();
    assert!(matches!(error, FlyError::Log { .. }), "{error}");
}

#[test]
fn a_policy_of_another_pace_is_refused() {
    let scenario = scenario();
    let error = fly(Place::Task(&task(&scenario)), &climber(0.02), &options(1.0), &|| false, None).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("every 0.02 s") && text.contains("0.01 s") && text.contains("hover"), "{text}");
}

#[test]
fn a_damaged_policy_is_refused() {
    let mut policy = climber(0.01);
    policy[40] ^= 1;
    let error = fly(Place::FlatFloor, &policy, &options(1.0), &|| false, None).unwrap_err();
    assert!(matches!(error, FlyError::Policy(_)), "{error}");
}

#[test]
fn a_busy_port_is_refused() {
    let other = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut options = options(1.0);
    options.session.listen = other.local_addr().unwrap();
    let error = fly(Place::FlatFloor, &climber(0.01), &options, &|| false, None).unwrap_err();
    let FlyError::Session(error) = error else { panic!("{error}") };
    assert!(matches!(*error, SessionError::Link(LinkError::Busy { .. })), "{error}");
    assert!(error.to_string().contains("in use"), "{error}");
}

#[test]
fn the_same_flight_has_the_same_log() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = scenario();
    let log = |name: &str| {
        let path = folder.path().join(name);
        let options = FlyOptions { true_state_log: Some(path.clone()), ..options(3.0) };
        fly(Place::Task(&task(&scenario)), &climber(0.01), &options, &|| false, None).unwrap();
        fs::read(path).unwrap()
    };
    assert_eq!(log("first"), log("second"));
}

#[test]
fn a_flight_is_kept_with_its_aviary_and_is_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.recording");
    let options = FlyOptions { record: Some(path.clone()), ..options(1.0) };
    let task = task(&scenario());
    let summary = fly(Place::Task(&task), &climber(0.01), &options, &|| false, None).unwrap();
    let recording = Recording::read(&path).unwrap();
    let [track] = &recording.drones[..] else { panic!("{} drones", recording.drones.len()) };
    assert_eq!((track.moments.len(), track.steps.len()), (100, 99));
    let last = track.moments.last().unwrap().placed.position;
    assert!((Vector3::from(last) - summary.position.map(f64::from)).norm() < 1e-6, "{last:?}");
    assert_eq!(recording.experiment(&path).unwrap().name, task.name);
    let refused = fly(Place::FlatFloor, &climber(0.01), &options, &|| false, None).unwrap_err();
    assert!(refused.to_string().contains("--record for a policy file"), "{refused}");
    for nowhere in ["no/such/folder/flight".into(), folder.path().to_owned()] {
        let options = FlyOptions { record: Some(nowhere), ..options.clone() };
        let error = fly(Place::Task(&task), &climber(0.01), &options, &|| panic!("it flies"), None).unwrap_err();
        assert!(matches!(error, FlyError::Recording(_)), "{error}");
    }
}
