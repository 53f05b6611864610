//! Flights of the thesis's fork, one row per control step of five physics steps.

use kestrel_core::action::Setpoint;
use kestrel_core::action::{
    ACTION_LIMIT, ActionSpace, ControlMemory, Controls, Persistence, ReferenceActionKind, ReferenceActions,
    ReferenceController,
};
use kestrel_core::airframe::{Airframe, RADIANS_PER_SECOND_PER_RPM, RotorOrder};
use kestrel_core::observation::{ObservationInput, REFERENCE_LEN, ReferenceLayout};
use kestrel_core::reference::bullet::{Bullet, BulletState, Quirks, RotorPrecision};
use kestrel_core::reference::controller::command::{self, Precision};
use kestrel_core::reference::euler::EulerAngles;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;
use serde_json::Value;

use crate::recording::{
    STEP_SECS, Table, Worst, airframe, deviation, json, largest, mode, numbers, placed, rotor_speeds,
};

const SUBSTEPS: usize = 5;

/// Quick check of the fact sheet, section 15: 24 control steps from (0, 0, 1) with this action.
const ACTION: [f64; 4] = [0.012, -0.02, 0.03, 0.005];

fn model(name: &str) -> Airframe {
    airframe(name).numbered(RotorOrder::CounterClockwise)
}

/// The physics of a recording, from its name: `roll_SEQUENCE_MODE[_MODEL]` and the like.
fn physics(name: &str) -> Bullet<f64> {
    let known = ["cf2p", "hb"].into_iter().find(|model| name.ends_with(model)).unwrap_or("cf2x");
    let modes = [("PYB_GND_DRAG_DW", "pyb_gnd_drag_dw"), ("PYB_GND", "pyb_gnd"), ("PYB_DRAG", "pyb_drag")];
    let dyn_mode = [("a_DYN", "dyn"), ("b_DYN", "dyn")];
    let found = modes.iter().chain(&dyn_mode).find(|(key, _)| name.contains(key)).map_or("pyb", |(_, mode)| mode);
    Bullet::new(&model(known), mode(found), Quirks::fork())
}

/// Pose and motion of a 16-number state, and its angles.
fn logged(value: &Value) -> ([f64; 13], [f64; 3]) {
    let [px, py, pz, x, y, z, w, roll, pitch, yaw, vx, vy, vz, wx, wy, wz] = numbers(value);
    ([px, py, pz, x, y, z, w, vx, vy, vz, wx, wy, wz], [roll, pitch, yaw])
}

fn error(drone: &BulletState<f64>, value: &Value) -> f64 {
    let (motion, angles) = logged(value);
    let computed = EulerAngles::of(&drone.motion.world_from_body).to_array();
    deviation(drone, &motion).max(largest(&computed, &angles))
}

/// Flies a recording; `act` chooses rotor speeds \[rad/s\] from the state and the control step.
fn fly(
    recording: &Value,
    bullet: &Bullet<f64>,
    substeps: usize,
    mut act: impl FnMut(&BulletState<f64>, usize) -> [f64; 4],
) -> f64 {
    let states = recording["state16"].as_array().unwrap();
    let mut drone = placed(&logged(&states[0]).0);
    let mut worst = 0.0_f64;
    for (index, state) in states[1..].iter().enumerate() {
        let speeds = act(&drone, index);
        for _ in 0..substeps {
            drone = bullet.step(&drone, &speeds, &[], STEP_SECS);
        }
        worst = worst.max(error(&drone, state));
    }
    worst
}

#[test]
fn recorded_rotor_speeds_fly_as_in_the_fork() {
    let golden = json("fork/physics_golden.json");
    let mut worst = Worst::new("fork/physics_golden, rotor speeds given");
    for (name, recording) in golden.as_object().unwrap() {
        // The drop ends on the floor, where this model does not apply.
        if recording.get("state16").is_none() || name == "drop_to_ground_PYB" {
            continue;
        }
        let substeps = if name == "roll_240Hz_PYB" { 1 } else { SUBSTEPS };
        let speeds = |_: &BulletState<f64>, index: usize| rotor_speeds(numbers(&recording["rpm"][index]));
        worst.add(name, fly(recording, &physics(name), substeps, speeds));
    }
    worst.within(1e-9);
}

#[test]
fn the_upper_drone_pushes_the_lower_one_down() {
    let golden = json("fork/physics_golden.json");
    let airframe = model("cf2x");
    let bullet = Bullet::new(&airframe, mode("pyb_dw"), Quirks::fork());
    let start = |x, z| placed(&[x, 0.0, z, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let mut drones = [start(0.0, 1.0), start(0.05, 1.5)];
    let mut worst = Worst::new("fork/physics_golden, downwash");
    for row in golden["downwash_2drones_PYB_DW"].as_array().unwrap() {
        for _ in 0..SUBSTEPS {
            let swarm: Vec<Vector3<f64>> = drones.iter().map(|drone| drone.motion.position).collect();
            drones =
                drones.map(|drone| bullet.step(&drone, &[airframe.hover_rotor_speed(); 4], &swarm, STEP_SECS));
        }
        for (drone, logged) in drones.iter().zip(row.as_array().unwrap()) {
            worst.add("downwash_2drones_PYB_DW", error(drone, logged));
        }
    }
    worst.within(1e-9);
}

/// What the fork makes of actions on a Crazyflie.
fn controls(kind: ReferenceActionKind, precision: Precision) -> Controls<f64> {
    let airframe = model("cf2x");
    Controls::new(&ActionSpace::Reference(ReferenceActions {
        kind,
        precision,
        airframe,
        controller: ReferenceController::Dsl(airframe),
        persistence: Persistence::Persist,
    }))
}

/// Rotor speeds \[RPM\] that become of an action.
fn act(controls: &Controls<f64>, memory: &mut ControlMemory<f64>, state: &State<f64>, values: &[f64]) -> [f64; 4] {
    let mut action = [0.0; ACTION_LIMIT];
    action[..values.len()].copy_from_slice(values);
    let (setpoint, secs) = (Setpoint::at(Vector3::zeros()), SUBSTEPS as f64 * STEP_SECS);
    let speeds = controls.rotor_targets(&action, state, &setpoint, memory, secs);
    speeds.map(|speed| speed / RADIANS_PER_SECOND_PER_RPM)
}

#[test]
fn actions_become_the_forks_rotor_speeds() {
    let golden = json("fork/physics_golden.json");
    let mut worst = Worst::new("fork/physics_golden, rotor speeds [RPM] of actions in recorded states");
    for (kind, flight, actions) in [
        (ReferenceActionKind::Pid, "roll_PID_PYB", "pid_actions"),
        (ReferenceActionKind::Vel, "roll_VEL_PYB", "vel_actions"),
        (ReferenceActionKind::Dyn, "roll_DYNact_PYB", "dyn_actions"),
    ] {
        let (controls, mut memory) = (controls(kind, Precision::Exact), ControlMemory::new());
        let recorded = |key: &str| golden[flight][key].as_array().unwrap();
        let actions = golden[actions].as_array().unwrap();
        for ((state, action), rpm) in recorded("state16").iter().zip(actions).zip(recorded("rpm")) {
            let action: Vec<f64> =
                action.as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect();
            assert_eq!(action.len(), kind.len());
            let found = act(&controls, &mut memory, &placed(&logged(state).0).motion, &action);
            worst.add(flight, largest(&found, &numbers::<4>(rpm)));
        }
    }
    worst.within(1e-9);
}

/// Rows before the control step in which the first contact was seen, and before the recording is thinned out.
fn free_rows(table: &Table) -> usize {
    let touching = table.rows.iter().position(|row| table.get(row, ["nc"]) != [0.0]);
    let thinned = (0..table.rows.len()).find(|index| table.get(&table.rows[*index], ["k"]) != [*index as f64]);
    let all = table.rows.len();
    touching.map_or(all, |index| index.saturating_sub(1)).min(thinned.unwrap_or(all))
}

/// Compares one flight of the thesis: states under recorded rotor speeds, and rotor speeds in recorded states.
fn compare_flight(case: &Value, flights: &mut Worst, commands: &mut Worst) {
    let airframe = model("cf2x");
    let name = case["id"].as_str().unwrap();
    let table = Table::read(&format!("pybullet/thesis/{name}.csv"));
    let by_rotor = case["act"] == "rpm";
    let rotor_precision = if by_rotor { RotorPrecision::Single } else { RotorPrecision::Full };
    let bullet = Bullet::new(&airframe, mode("pyb"), Quirks { rotor_precision, ..Quirks::fork() });
    let kind = if by_rotor { ReferenceActionKind::Rpm } else { ReferenceActionKind::Vel };
    let (controls, mut memory) = (controls(kind, Precision::AllSingle), ControlMemory::new());
    let [x, y, z] = numbers(&case["init_xyz"][0]);
    let mut drone = placed(&[x, y, z, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let mut recorded = drone.motion;
    for row in &table.rows[..free_rows(&table)] {
        let action = table.get(row, ["a0", "a1", "a2", "a3"]);
        let rpm = table.get(row, ["m0", "m1", "m2", "m3"]);
        commands.add(name, largest(&act(&controls, &mut memory, &recorded, &action), &rpm));
        let speeds = rotor_speeds(rpm);
        drone = (0..SUBSTEPS).fold(drone, |drone, _| bullet.step(&drone, &speeds, &[], STEP_SECS));
        recorded = placed(&table.motion(row, "")).motion;
        flights.add(name, deviation(&drone, &table.motion(row, "")));
    }
}

#[test]
fn flights_through_the_thesis_worlds_are_reproduced_up_to_the_first_contact() {
    let mut flights = Worst::new("thesis, states under recorded rotor speeds");
    let mut commands = Worst::new("thesis, rotor speeds [RPM] of actions in recorded states");
    for case in json("pybullet/thesis/index.json")["cases"].as_array().unwrap() {
        compare_flight(case, &mut flights, &mut commands);
    }
    flights.within(1e-9);
    commands.within(1e-6);
}

/// Length of the episodes of a world \[s\], from which its observations are scaled.
fn episode_secs(world: &str) -> f32 {
    match world {
        "long" => 20.0,
        "room" => 10.0,
        other => panic!("unknown world {other}"),
    }
}

#[test]
fn observations_are_the_thesiss() {
    let mut worst = Worst::new("thesis, observations of recorded states");
    for case in json("pybullet/thesis/index.json")["cases"].as_array().unwrap() {
        let name = case["id"].as_str().unwrap();
        let layout = ReferenceLayout::of_episode(episode_secs(case["env"].as_str().unwrap()));
        let table = Table::read(&format!("pybullet/thesis/{name}.csv"));
        for row in &table.rows {
            let drone = placed(&table.motion(row, ""));
            let input = ObservationInput {
                state: &drone.motion,
                angular_velocity_in_world: drone.reported_angular_velocity,
                goal: &Vector3::zeros(),
                heading: [1.0, 0.0],
                integral: &Vector3::zeros(),
                history: &[],
                measurements: &[],
            };
            let recorded: [f64; REFERENCE_LEN] =
                core::array::from_fn(|index| table.get(row, [format!("vec{index}").as_str()])[0]);
            worst.add(name, largest(&layout.encode(&input), &recorded));
        }
    }
    // They were recorded in single precision.
    worst.within(1e-7);
}

#[test]
fn the_quick_check_of_the_fact_sheet_holds() {
    let airframe = model("cf2x");
    let speeds = command::rotor_speeds(&airframe, &ACTION);
    let fly = |physics: &str| {
        let bullet = Bullet::new(&airframe, mode(physics), Quirks::fork());
        let start = placed(&[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        (0..24 * SUBSTEPS).fold(start, |drone, _| bullet.step(&drone, &speeds, &[], STEP_SECS)).motion
    };
    let (bullet, explicit) = (fly("pyb"), fly("dyn"));
    // Given to eight decimals.
    assert!(largest(bullet.position.as_slice(), &[-0.002_084_93, 0.014_197_48, 1.000_625_26]) < 1e-8);
    assert!(largest(bullet.velocity.as_slice(), &[-0.015_688_3, 0.112_468_89, 0.000_876_54]) < 1e-8);
    assert!(largest(explicit.position.as_slice(), &[-0.002_014_21, 0.014_863_54, 1.000_616_36]) < 1e-8);
}
