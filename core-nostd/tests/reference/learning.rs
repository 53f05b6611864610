//! Flights of upstream's learning environments: their actions, and the physics under what became of them.

use kestrel_core::action::Setpoint;
use kestrel_core::action::{
    ACTION_LIMIT, ActionSpace, ControlMemory, Controls, Persistence, ReferenceActionKind, ReferenceActions,
    ReferenceController,
};
use kestrel_core::airframe::{CF2X, RADIANS_PER_SECOND_PER_RPM};
use kestrel_core::observation::{KinematicLayout, OBSERVATION_LIMIT, ObservationInput, ObservationLayout};
use kestrel_core::reference::bullet::{Bullet, BulletMode, BulletState, Quirks};
use kestrel_core::reference::controller::command::Precision;
use nalgebra::Vector3;
use serde_json::Value;

use crate::recording::{STEP_SECS, Table, Worst, cases, deviation, largest, placed, rotor_speeds};

/// Columns of the rotor speeds.
const RPM: [&str; 4] = ["m0", "m1", "m2", "m3"];

/// Control periods \[s\] and physics steps in each.
const SUBSTEPS: usize = 8;
const CONTROL_SECS: f64 = SUBSTEPS as f64 * STEP_SECS;

/// Where the reference puts its drones: four arms apart.
fn start(drone: usize) -> BulletState<f64> {
    let along = 4.0 * CF2X.arm * drone as f64;
    placed(&[along, along, CF2X.start_height(), 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
}

/// A recording's rows of each drone.
fn tracks(case: &Value) -> (Table, Vec<Vec<Vec<f64>>>) {
    let table = Table::read(&format!("pybullet/rl/{}.csv", case["id"].as_str().unwrap()));
    let drones = case["num_drones"].as_u64().unwrap() as usize;
    let tracks = (0..drones).map(|drone| {
        table.rows.iter().filter(|row| table.get(row, ["drone"]) == [drone as f64]).cloned().collect()
    });
    let tracks = tracks.collect();
    (table, tracks)
}

/// The action space of a recording.
fn space(kind: &str) -> ActionSpace {
    ActionSpace::Reference(ReferenceActions {
        kind: match kind {
            "rpm" => ReferenceActionKind::Rpm,
            "one_d_rpm" => ReferenceActionKind::OneDRpm,
            "pid" => ReferenceActionKind::Waypoint,
            "one_d_pid" => ReferenceActionKind::OneDPid,
            "vel" => ReferenceActionKind::Vel,
            other => panic!("unknown action {other}"),
        },
        precision: Precision::Single,
        airframe: CF2X,
        controller: ReferenceController::Dsl(CF2X),
        persistence: Persistence::Persist,
    })
}

/// The action in a row, in the place of one of any length.
fn action(table: &Table, row: &[f64]) -> [f64; ACTION_LIMIT] {
    let mut action = [0.0; ACTION_LIMIT];
    for (slot, column) in action.iter_mut().zip(table.columns_like('a')) {
        *slot = row[column];
    }
    action
}

#[test]
fn actions_become_upstreams_rotor_speeds() {
    let mut worst = Worst::new("rl, rotor speeds [RPM] of actions in recorded states");
    for case in cases("rl") {
        let (table, tracks) = tracks(&case);
        let space = space(case["act"].as_str().unwrap());
        assert_eq!(table.columns_like('a').len(), space.len());
        let controls = Controls::new(&space);
        for (drone, rows) in tracks.iter().enumerate() {
            let mut memory = ControlMemory::new();
            let mut state = start(drone).motion;
            for row in rows {
                let setpoint = Setpoint::at(Vector3::zeros());
                let action = action(&table, row);
                let speeds = controls.rotor_targets(&action, &state, &setpoint, &mut memory, CONTROL_SECS);
                let rpm = speeds.map(|speed| speed / RADIANS_PER_SECOND_PER_RPM);
                worst.add(case["id"].as_str().unwrap(), largest(&rpm, &table.get(row, RPM)));
                state = placed(&table.motion(row, "")).motion;
            }
        }
    }
    worst.within(1e-6);
}

/// Compares a drone's observation with the recorded ones of a control step, one drone after the other.
fn compare_observation(
    (name, layout): (&str, ObservationLayout),
    drone: &BulletState<f64>,
    history: &[[f64; ACTION_LIMIT]],
    recorded: &[f64],
    worst: &mut Worst,
) {
    let input = ObservationInput {
        state: &drone.motion,
        angular_velocity_in_world: drone.reported_angular_velocity,
        goal: &Vector3::zeros(),
        heading: [1.0, 0.0],
        integral: &Vector3::zeros(),
        history,
        measurements: &[],
    };
    let mut observation = [f64::NAN; OBSERVATION_LIMIT];
    layout.encode(&input, &mut observation);
    // They were recorded in single precision.
    let scaled = |(found, expected): (&f64, &f64)| (found - expected).abs() / expected.abs().max(1.0);
    assert_eq!(recorded.len(), layout.len());
    worst.add(name, observation.iter().zip(recorded).map(scaled).fold(0.0, f64::max));
}

#[test]
fn observations_are_upstreams() {
    let mut worst = Worst::new("rl, observations of recorded states and actions");
    for case in cases("rl") {
        let (table, tracks) = tracks(&case);
        let name = case["id"].as_str().unwrap();
        let action_len = table.columns_like('a').len() as u8;
        let layout = ObservationLayout::Kinematic(KinematicLayout { past_actions: 15, action_len });
        let observations = Table::read(&format!("pybullet/rl/{name}.obs.csv"));
        for (drone, rows) in tracks.iter().enumerate() {
            let actions: Vec<_> = rows.iter().map(|row| action(&table, row)).collect();
            for observed in &observations.rows {
                let [k] = observations.get(observed, ["k"]);
                let past = (k + 1.0) as usize;
                let state = match past {
                    0 => start(drone),
                    _ if past > rows.len() => continue,
                    _ => placed(&table.motion(&rows[past - 1], "")),
                };
                let recorded = &observed[1 + drone * layout.len()..][..layout.len()];
                compare_observation((name, layout), &state, &actions[..past], recorded, &mut worst);
            }
        }
    }
    worst.within(1e-7);
}

/// Rows before two drones come near enough to touch: their hulls, and a centimetre.
fn apart(table: &Table, tracks: &[Vec<Vec<f64>>]) -> usize {
    let position = |row: &[f64]| Vector3::from(table.get(row, ["px", "py", "pz"]));
    let [first, others @ ..] = tracks else { return 0 };
    let near = |index: usize| {
        let distance = |other: &Vec<Vec<f64>>| (position(&other[index]) - position(&first[index])).norm();
        others.iter().any(|other| distance(other) < 2.0 * CF2X.collision_radius + 0.01)
    };
    (0..first.len()).find(|index| near(*index)).unwrap_or(first.len())
}

#[test]
fn recorded_rotor_speeds_fly_as_in_upstreams_learning_environments() {
    let bullet = Bullet::new(&CF2X, BulletMode::Pyb, Quirks::upstream());
    let mut worst = Worst::new("rl, states under recorded rotor speeds");
    for case in cases("rl") {
        let (table, tracks) = tracks(&case);
        for (drone, rows) in tracks.iter().enumerate() {
            let mut drone = start(drone);
            for row in &rows[..apart(&table, &tracks)] {
                let speeds = rotor_speeds(table.get(row, RPM));
                drone = (0..SUBSTEPS).fold(drone, |drone, _| bullet.step(&drone, &speeds, &[], STEP_SECS));
                // Below, the collision cylinder may be on the floor, where this model does not apply.
                if drone.motion.position.z < CF2X.collision_radius {
                    break;
                }
                worst.add(case["id"].as_str().unwrap(), deviation(&drone, &table.motion(row, "")));
            }
        }
    }
    worst.within(1e-9);
}
