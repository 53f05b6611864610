//! One physics step from a fresh state.

use kestrel_core::airframe::{CF2X, RotorOrder};
use kestrel_core::reference::bullet::{Bullet, Quirks};
use nalgebra::Vector3;

use crate::recording::{STEP_SECS, Table, Worst, cases, deviation, largest, mode, placed, rotor_speeds, settings};

/// Worst deviation over the rows of a table.
fn worst_row(table: &Table, bullet: &Bullet<f64>) -> f64 {
    let errors = table.rows.iter().map(|row| {
        let mut drone = placed(&table.motion(row, "0"));
        if table.has("l0") {
            drone.motion.rotor_speeds = rotor_speeds(table.get(row, ["l0", "l1", "l2", "l3"]));
        }
        let body_rates = ["bx0", "by0", "bz0"];
        let euler_rates = ["rr0_0", "rr1_0", "rr2_0"];
        for names in [body_rates, euler_rates] {
            if table.has(names[0]) {
                drone.motion.body_rates = Vector3::from(table.get(row, names));
            }
        }
        let swarm: Vec<_> =
            table.has("ox").then(|| Vector3::from(table.get(row, ["ox", "oy", "oz"]))).into_iter().collect();
        let speeds = rotor_speeds(table.get(row, ["m0", "m1", "m2", "m3"]));
        let after = bullet.step(&drone, &speeds, &swarm, STEP_SECS);
        let mut error = deviation(&after, &table.motion(row, "1"));
        for names in [["bx1", "by1", "bz1"], ["rr0_1", "rr1_1", "rr2_1"]] {
            if table.has(names[0]) {
                error = error.max(largest(after.motion.body_rates.as_slice(), &table.get(row, names)));
            }
        }
        error
    });
    errors.fold(0.0, f64::max)
}

#[test]
fn upstream_steps_are_reproduced() {
    let mut worst = Worst::new("one_step");
    for case in cases("one_step") {
        let (airframe, mode) = settings(&case);
        let name = format!("{}_{}", case["model"].as_str().unwrap(), case["physics"].as_str().unwrap());
        let table = Table::read(&format!("pybullet/one_step/{name}.csv"));
        worst.add(&name, worst_row(&table, &Bullet::new(&airframe, mode, Quirks::upstream())));
    }
    worst.within(1e-9);
}

#[test]
fn steps_of_the_fork_are_reproduced() {
    let mut worst = Worst::new("thesis/one_step");
    for physics in ["pyb", "dyn"] {
        let table = Table::read(&format!("pybullet/thesis/one_step_cf2x_{physics}.csv"));
        let airframe = CF2X.numbered(RotorOrder::CounterClockwise);
        worst.add(physics, worst_row(&table, &Bullet::new(&airframe, mode(physics), Quirks::fork())));
    }
    worst.within(1e-9);
}
