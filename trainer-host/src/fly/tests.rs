use std::fs;
use std::net::UdpSocket;

use kestrel_core::action::{ACTION_LEN, ActionSpace, ThrustBodyRates};
use kestrel_core::airframe::GRAVITY;
use kestrel_core::dynamics::Integrator;
use kestrel_core::mlp::DenseLayer;
use kestrel_core::observation::{ObservationLayout, PILOT_LEN, PilotLayout};
use kestrel_core::policy_file::{ParameterFormat, PolicyDraft, PolicyMetadata};
use kestrel_shim::link::LinkError;
use kestrel_shim::lockstep::SimulationRate;
use kestrel_sim::scenario::{
    Agents, Aviary, Clock, CriticView, Goals, Physics, Randomisation, Start, StartPosition, Success, TimeLimit,
};
use kestrel_sim::sensor::SensorSuite;
use kestrel_sim::world::{Cuboid, World};

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
        },
        parameters: ParameterFormat::Float32,
        layers: &[DenseLayer {
            inputs: PILOT_LEN,
            outputs: ACTION_LEN,
            weights: &weights,
            bias: &[0.0; ACTION_LEN],
        }],
        golden_observations: &[0.1; PILOT_LEN],
    };
    let mut bytes = vec![0; draft.file_len().unwrap()];
    draft.write(&mut bytes).unwrap();
    bytes
}

fn scenario() -> Scenario {
    Scenario {
        name: "hover".into(),
        aviary: Aviary { goal: Vector3::new(1.0, 2.0, 1.0), routes: Vec::new(), world: World::empty() },
        airframe: CF2X,
        physics: Physics::clean(Integrator::SemiImplicitEuler, 2, 100.0),
        goals: Goals::Fixed,
        agents: Agents::ONE,
        sensors: SensorSuite::none(),
        clock: Clock::Elapsed,
        time_limit: TimeLimit::Truncates,
        action: action(),
        observation: LAYOUT,
        camera: None,
        critic: CriticView::Observation,
        start: Start {
            position: StartPosition::AroundGoal { nearest_m: 0.0, farthest_m: 0.5 },
            heading_limit: core::f32::consts::PI,
            tilt_limit: 0.0,
            speed_limit: 0.0,
            body_rates_limit: 0.0,
        },
        randomisation: Randomisation { mass: 0.0, inertia: 0.0, thrust: 0.0, rotor_lag: 0.0, wind_speed: 0.0 },
        rewards: Vec::new(),
        terminations: Vec::new(),
        episode_secs: 1.0,
        success: Success::Settle { radius_m: 0.05, within_secs: 4.0 },
    }
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
    let summary = fly(Place::Scenario(&scenario), &climber(0.01), &options(2.0), &|| false).unwrap();
    assert!((summary.secs - 2.0).abs() < 0.006, "{}", summary.secs);
    assert!((summary.position - Vector3::new(1.0, 2.0, 0.0125)).norm() < 1e-6);
    assert_eq!((summary.mode, summary.counts.frames), (Mode::Disarmed, 0));
}

#[test]
fn a_region_of_starts_has_a_middle() {
    let mut scenario = scenario();
    let region = Cuboid { low: Vector3::new(-1.0, 2.0, 0.3), high: Vector3::new(3.0, 4.0, 0.9) };
    scenario.start.position = StartPosition::Within(region);
    assert_eq!(launch_site(&scenario), Vector3::new(1.0, 3.0, 0.0));
}

#[test]
fn an_interrupt_ends_the_flight() {
    let summary = fly(Place::FlatFloor, &climber(0.01), &options(1e9), &|| true).unwrap();
    assert!(summary.secs < 0.02);
}

#[test]
fn the_log_has_a_line_per_control_period() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("true.jsonl");
    let options = FlyOptions { true_state_log: Some(path.clone()), ..options(1.0) };
    fly(Place::FlatFloor, &climber(0.02), &options, &|| false).unwrap();
    let lines: Vec<serde_json::Value> =
        fs::read_to_string(path).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 51, "both ends");
    assert!((lines[50]["secs"].as_f64().unwrap() - 1.0).abs() < 1e-5);
    assert_eq!(lines[50]["mode"], "disarmed");
    assert_eq!(lines[50]["armed"], false);
    assert!((lines[50]["position"][2].as_f64().unwrap() - 0.0125).abs() < 1e-6);
}

#[test]
fn a_log_that_cannot_be_written_is_named() {
    let missing = FlyOptions { true_state_log: Some("no/such/folder/true.jsonl".into()), ..options(1.0) };
    let error = fly(Place::FlatFloor, &climber(0.01), &missing, &|| false).unwrap_err();
    assert!(
        error.to_string().starts_with("cannot write the true-state log no/such/folder/true.jsonl: "),
        "{error}"
    );
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_flight_with_an_error() {
    let full = FlyOptions { true_state_log: Some("/dev/full".into()), ..options(1e9) };
    let error = fly(Place::FlatFloor, &climber(0.01), &full, &|| false).unwrap_err();
    assert!(matches!(error, FlyError::Log { .. }), "{error}");
}

#[test]
fn a_policy_of_another_pace_is_refused() {
    let scenario = scenario();
    let error = fly(Place::Scenario(&scenario), &climber(0.02), &options(1.0), &|| false).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("every 0.02 s") && text.contains("0.01 s") && text.contains("hover"), "{text}");
}

#[test]
fn a_damaged_policy_is_refused() {
    let mut policy = climber(0.01);
    policy[40] ^= 1;
    let error = fly(Place::FlatFloor, &policy, &options(1.0), &|| false).unwrap_err();
    assert!(matches!(error, FlyError::Policy(_)), "{error}");
}

#[test]
fn a_busy_port_is_refused() {
    let other = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut options = options(1.0);
    options.session.listen = other.local_addr().unwrap();
    let error = fly(Place::FlatFloor, &climber(0.01), &options, &|| false).unwrap_err();
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
        fly(Place::Scenario(&scenario), &climber(0.01), &options, &|| false).unwrap();
        fs::read(path).unwrap()
    };
    assert_eq!(log("first"), log("second"));
}
