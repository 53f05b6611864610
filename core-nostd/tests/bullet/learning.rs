//! Flights of upstream's learning environments: their actions, and the physics under what became of them.

use kestrel_core::airframe::{CF2X, RADIANS_PER_SECOND_PER_RPM};
use kestrel_core::bullet::{Bullet, BulletState, Mode, Quirks};
use kestrel_core::controller::{DslPid, DslPidMemory, command};
use kestrel_core::vehicle::State;
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

/// Rotor speeds \[rad/s\] of an action.
fn act(kind: &str, memory: &mut DslPidMemory<f64>, state: &State<f64>, action: &[f64]) -> [f64; 4] {
    let setpoint = match kind {
        "rpm" => return command::rotor_speeds_in_single(&CF2X, &action.try_into().unwrap()),
        "one_d_rpm" => return command::rotor_speeds_in_single(&CF2X, &[action[0]; 4]),
        "pid" => command::waypoint(state, [action[0], action[1], action[2]].into()),
        "one_d_pid" => command::vertical_offset(state, action[0]),
        "vel" => command::velocity_in_single(&CF2X, state, &action.try_into().unwrap()),
        other => panic!("unknown action {other}"),
    };
    DslPid::new(&CF2X).command(memory, state, &setpoint, CONTROL_SECS).rotor_speeds
}

#[test]
fn actions_become_upstreams_rotor_speeds() {
    let mut worst = Worst::new("rl, rotor speeds [RPM] of actions in recorded states");
    for case in cases("rl") {
        let (table, tracks) = tracks(&case);
        let actions = table.columns_like('a');
        for (drone, rows) in tracks.iter().enumerate() {
            let mut memory = DslPidMemory::new();
            let mut state = start(drone).motion;
            for row in rows {
                let action: Vec<f64> = actions.iter().map(|column| row[*column]).collect();
                let speeds = act(case["act"].as_str().unwrap(), &mut memory, &state, &action);
                let rpm = speeds.map(|speed| speed / RADIANS_PER_SECOND_PER_RPM);
                worst.add(case["id"].as_str().unwrap(), largest(&rpm, &table.get(row, RPM)));
                state = placed(&table.motion(row, "")).motion;
            }
        }
    }
    worst.within(1e-6);
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
    let bullet = Bullet::new(&CF2X, Mode::Pyb, Quirks::upstream());
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
