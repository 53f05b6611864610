//! Single controller calls, and the angles that they read.

use kestrel_core::action::Setpoint;
use kestrel_core::airframe::{CF2X, HUMMINGBIRD, RADIANS_PER_SECOND_PER_RPM, RotorOrder};
use kestrel_core::attitude::Attitude;
use kestrel_core::reference::controller::{DslPid, DslPidMemory, SimplePid, SimplePidMemory};
use kestrel_core::reference::euler::EulerAngles;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;
use serde_json::Value;

use crate::recording::{Table, Worst, airframe, json, largest, numbers};

/// A drone somewhere, of which controllers read no more than this; the quaternion is x, y, z, w.
fn state(position: [f64; 3], [x, y, z, w]: [f64; 4], velocity: [f64; 3]) -> State<f64> {
    State {
        position: Vector3::from(position),
        world_from_body: Attitude { w, x, y, z },
        velocity: Vector3::from(velocity),
        body_rates: Vector3::zeros(),
        rotor_speeds: [0.0; 4],
    }
}

fn rpm(rotor_speeds: [f64; 4]) -> [f64; 4] {
    rotor_speeds.map(|speed| speed / RADIANS_PER_SECOND_PER_RPM)
}

#[test]
fn angles_are_bullets_at_the_poles_too() {
    let table = Table::read("pybullet/unit/attitude.csv");
    let mut worst = Worst::new("unit/attitude");
    for (index, row) in table.rows.iter().enumerate() {
        let [x, y, z, w] = table.get(row, ["qx", "qy", "qz", "qw"]);
        let attitude = Attitude { w, x, y, z };
        let [roll, pitch, yaw] = table.get(row, ["roll", "pitch", "yaw"]);
        let made = EulerAngles { roll, pitch, yaw }.attitude();
        let back = EulerAngles::of(&attitude).to_array();
        let matrix = ["r00", "r01", "r02", "r10", "r11", "r12", "r20", "r21", "r22"];
        let error = largest(&[made.x, made.y, made.z, made.w], &[x, y, z, w])
            .max(largest(&back, &table.get(row, ["eroll", "epitch", "eyaw"])))
            .max(largest(attitude.rows().as_flattened(), &table.get(row, matrix)));
        worst.add(&format!("row {index}"), error);
    }
    worst.within(1e-9);
}

#[test]
fn dsl_pid_calls_are_reproduced() {
    let table = Table::read("pybullet/unit/dslpid_calls.csv");
    let mut worst = Worst::new("unit/dslpid_calls");
    let mut memory = DslPidMemory::<f64>::new();
    for row in &table.rows {
        let [model, group, call, secs] = table.get(row, ["model", "group", "call", "dt"]);
        if call == 0.0 {
            memory = DslPidMemory::new();
        }
        let controller = DslPid::new(&airframe(if model == 0.0 { "cf2x" } else { "cf2p" }));
        let state = state(
            table.get(row, ["px", "py", "pz"]),
            table.get(row, ["qx", "qy", "qz", "qw"]),
            table.get(row, ["vx", "vy", "vz"]),
        );
        let setpoint = Setpoint {
            position: table.get(row, ["tx", "ty", "tz"]).into(),
            velocity: table.get(row, ["tvx", "tvy", "tvz"]).into(),
            yaw: table.get(row, ["tyaw"])[0],
            euler_rates: table.get(row, ["trr", "tpr", "tyr"]).into(),
        };
        let command = controller.command(&mut memory, &state, &setpoint, secs);
        let error = largest(&rpm(command.rotor_speeds), &table.get(row, ["m0", "m1", "m2", "m3"]))
            .max(largest(command.position_error.as_slice(), &table.get(row, ["pex", "pey", "pez"])))
            .max(largest(&[command.yaw_error], &table.get(row, ["yaw_e"])))
            .max(largest(memory.position_integral.as_slice(), &table.get(row, ["ip0", "ip1", "ip2"])))
            .max(largest(memory.attitude_integral.as_slice(), &table.get(row, ["ir0", "ir1", "ir2"])))
            .max(largest(memory.last_angles.as_slice(), &table.get(row, ["lr0", "lr1", "lr2"])));
        worst.add(&format!("model {model}, group {group}, call {call}"), error);
    }
    worst.within(1e-9);
}

/// The recorded calls of one controller of the fork.
fn calls(name: &str) -> Vec<Value> {
    json("fork/physics_golden.json")[name].as_array().unwrap().clone()
}

#[test]
fn the_forks_dsl_pid_calls_are_reproduced() {
    let mut worst = Worst::new("fork/dslpid_calls");
    let controller = DslPid::new(&CF2X.numbered(RotorOrder::CounterClockwise));
    let mut memory = DslPidMemory::new();
    for (index, call) in calls("dslpid_sequence_calls_one_controller").iter().enumerate() {
        let state = state(numbers(&call["pos"]), numbers(&call["quat"]), numbers(&call["vel"]));
        let setpoint = Setpoint {
            velocity: numbers(&call["target_vel"]).into(),
            yaw: call["target_yaw"].as_f64().unwrap(),
            ..Setpoint::at(numbers(&call["target"]).into())
        };
        let command = controller.command(&mut memory, &state, &setpoint, call["dt"].as_f64().unwrap());
        let error = largest(&rpm(command.rotor_speeds), &numbers::<4>(&call["rpm"]))
            .max(largest(&[command.yaw_error], &[call["yaw_err"].as_f64().unwrap()]));
        worst.add(&format!("call {index}"), error);
    }
    worst.within(1e-9);
}

#[test]
fn the_forks_simple_pid_calls_are_reproduced() {
    let mut worst = Worst::new("fork/simplepid_calls");
    let controller = SimplePid::new(&HUMMINGBIRD);
    let mut memory = SimplePidMemory::new();
    for (index, call) in calls("simplepid_sequence_calls_one_controller_hb").iter().enumerate() {
        let state = state(numbers(&call["pos"]), numbers(&call["quat"]), [0.0; 3]);
        let setpoint = Setpoint::at(numbers(&call["target"]).into());
        let command = controller.command(&mut memory, &state, &setpoint, call["dt"].as_f64().unwrap());
        worst.add(&format!("call {index}"), largest(&rpm(command.rotor_speeds), &numbers::<4>(&call["rpm"])));
    }
    worst.within(1e-9);
}
