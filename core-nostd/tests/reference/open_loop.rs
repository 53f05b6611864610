//! Runs with recorded rotor speeds, up to their first contact.

use std::collections::BTreeMap;

use kestrel_core::reference::bullet::{Bullet, BulletState, Quirks};
use nalgebra::Vector3;
use serde_json::Value;

use crate::recording::{STEP_SECS, Table, Worst, cases, deviation, placed, rotor_speeds, settings};

/// The recorded motion of each drone, by physics step.
type Record = BTreeMap<usize, Vec<[f64; 13]>>;

fn record(table: &Table) -> Record {
    let mut record = Record::new();
    for row in &table.rows {
        record.entry(row[0] as usize).or_default().push(table.motion(row, ""));
    }
    record
}

/// Steps that can be compared: all, or those before the control step in which the first contact was seen.
fn comparable_steps(case: &Value) -> usize {
    let steps = case["phys_steps"].as_u64().unwrap() as usize;
    let substeps = 240 / case["ctrl_freq"].as_u64().unwrap() as usize;
    case["first_contact_step"].as_u64().map_or(steps, |contact| (contact as usize).saturating_sub(substeps))
}

/// One physics step of the whole swarm.
fn advance(bullet: &Bullet<f64>, drones: &mut [BulletState<f64>], speeds: &[[f64; 4]]) {
    let swarm: Vec<Vector3<f64>> = drones.iter().map(|drone| drone.motion.position).collect();
    for (drone, speeds) in drones.iter_mut().zip(speeds) {
        *drone = bullet.step(drone, speeds, &swarm, STEP_SECS);
    }
}

fn worst_step(case: &Value) -> f64 {
    let (airframe, mode) = settings(case);
    let bullet = Bullet::new(&airframe, mode, Quirks::upstream());
    let path = format!("pybullet/open_loop/{}", case["id"].as_str().unwrap());
    let record = record(&Table::read(&format!("{path}.state.csv")));
    let commands = Table::read(&format!("{path}.rpm.csv"));
    let substeps = 240 / case["ctrl_freq"].as_u64().unwrap() as usize;
    let mut drones: Vec<_> = record[&0].iter().map(placed).collect();
    let mut speeds = vec![[0.0; 4]; drones.len()];
    let mut commands = commands.rows.iter().peekable();
    let mut error = 0.0_f64;
    for step in 0..comparable_steps(case) {
        while let Some(row) = commands.next_if(|row| row[0] as usize * substeps <= step) {
            speeds[row[1] as usize] = rotor_speeds([row[2], row[3], row[4], row[5]]);
        }
        advance(&bullet, &mut drones, &speeds);
        for (drone, logged) in drones.iter().zip(record.get(&(step + 1)).into_iter().flatten()) {
            error = error.max(deviation(drone, logged));
        }
    }
    error
}

#[test]
fn flights_are_reproduced_up_to_the_first_contact() {
    let mut worst = Worst::new("open_loop");
    for case in cases("open_loop") {
        worst.add(case["id"].as_str().unwrap(), worst_step(&case));
    }
    worst.within(1e-9);
}
