//! Flights under a controller, whole and in two halves: the controller on recorded states, the physics on recorded
//! rotor speeds.

use kestrel_core::action::Setpoint;
use kestrel_core::airframe::{Airframe, RADIANS_PER_SECOND_PER_RPM};
use kestrel_core::reference::bullet::{Bullet, BulletState, Quirks};
use kestrel_core::reference::controller::{DslPid, DslPidMemory, command};
use kestrel_core::vehicle::State;
use serde_json::Value;

use crate::recording::{
    STEP_SECS, Table, Worst, airframe, cases, deviation, largest, placed, rotor_speeds, settings,
};

/// Columns of the commanded rotor speeds.
const RPM: [&str; 4] = ["m0", "m1", "m2", "m3"];

/// A recorded flight and who flew it.
struct Flight {
    name: String,
    table: Table,
    airframe: Airframe,
    bullet: Bullet<f64>,
    controller: DslPid<f64>,
    substeps: u64,
}

impl Flight {
    fn new(case: &Value) -> Self {
        let (drone, mode) = settings(case);
        let name = case["id"].as_str().unwrap().to_owned();
        Self {
            table: Table::read(&format!("pybullet/closed_loop/{name}.csv")),
            name,
            airframe: drone,
            bullet: Bullet::new(&drone, mode, Quirks::upstream()),
            controller: DslPid::new(&airframe(case["controller_model"].as_str().unwrap())),
            substeps: 240 / case["ctrl_freq"].as_u64().unwrap(),
        }
    }

    fn start(&self) -> BulletState<f64> {
        placed(&self.table.motion(&self.table.rows[0], ""))
    }

    /// The recorded rows up to a tilt of 60°, beyond which the drone is lost and soon on the floor.
    fn upright_rows(&self) -> impl Iterator<Item = (&Vec<f64>, [f64; 13])> {
        let rows = self.table.rows.iter().map(|row| (row, self.table.motion(row, "")));
        rows.take_while(|(_, logged)| placed(logged).motion.world_from_body.up_cosine() > 0.5)
    }

    /// Rotor speeds \[rad/s\] that the controller commands for what the recording asked of it in a row.
    fn command(&self, memory: &mut DslPidMemory<f64>, row: &[f64], state: &State<f64>) -> [f64; 4] {
        let table = &self.table;
        let setpoint = if table.has("a0") {
            command::velocity(&self.airframe, state, &table.get(row, ["a0", "a1", "a2", "a3"]))
        } else {
            Setpoint {
                velocity: table.get(row, ["tvx", "tvy", "tvz"]).into(),
                yaw: table.get(row, ["tyaw"])[0],
                ..Setpoint::at(table.get(row, ["tx", "ty", "tz"]).into())
            }
        };
        let control_secs = self.substeps as f64 * STEP_SECS;
        self.controller.command(memory, state, &setpoint, control_secs).rotor_speeds
    }

    fn advance(&self, drone: BulletState<f64>, speeds: &[f64; 4]) -> BulletState<f64> {
        (0..self.substeps).fold(drone, |drone, _| self.bullet.step(&drone, speeds, &[], STEP_SECS))
    }
}

/// Every flight that was recorded.
fn flights() -> Vec<Flight> {
    cases("closed_loop").iter().map(Flight::new).collect()
}

#[test]
fn the_controller_commands_what_it_commanded_in_the_recorded_states() {
    let mut worst = Worst::new("closed_loop, rotor speeds [RPM] in recorded states");
    for flight in flights() {
        let mut memory = DslPidMemory::new();
        for (index, row) in flight.table.rows.iter().enumerate() {
            let state = placed(&flight.table.motion(row, "")).motion;
            let speeds = flight.command(&mut memory, row, &state);
            let rpm = speeds.map(|speed| speed / RADIANS_PER_SECOND_PER_RPM);
            worst.add(&format!("{} row {index}", flight.name), largest(&rpm, &flight.table.get(row, RPM)));
        }
    }
    worst.within(1e-6);
}

#[test]
fn recorded_commands_fly_the_recorded_way() {
    let mut worst = Worst::new("closed_loop, states under recorded rotor speeds");
    for flight in flights() {
        let mut drone = flight.start();
        for (row, logged) in flight.upright_rows() {
            worst.add(&flight.name, deviation(&drone, &logged));
            drone = flight.advance(drone, &rotor_speeds(flight.table.get(row, RPM)));
        }
    }
    worst.within(1e-9);
}

/// The controller saturates in a limit cycle and doubles any difference, rounding included, every other step. A twin
/// that starts a picometre per second faster shows how far the flight is determined: until their body rates are
/// 1e-8 rad/s apart.
#[test]
fn controlled_flights_are_reproduced_as_long_as_they_are_determined() {
    let mut worst = Worst::new("closed_loop, free flight");
    for flight in flights() {
        let mut drones = [flight.start(); 2];
        drones[1].motion.velocity.x += 1e-12;
        let mut memories = [DslPidMemory::new(); 2];
        let mut steps = 0;
        let mut error = 0.0_f64;
        for (row, logged) in flight.upright_rows() {
            let apart = drones[0].motion.body_rates - drones[1].motion.body_rates;
            if apart.norm() > 1e-8 {
                break;
            }
            error = error.max(deviation(&drones[0], &logged));
            steps += 1;
            for (drone, memory) in drones.iter_mut().zip(&mut memories) {
                let speeds = flight.command(memory, row, &drone.motion);
                *drone = flight.advance(*drone, &speeds);
            }
        }
        println!("{}: {steps} control steps of {} determined", flight.name, flight.table.rows.len());
        assert!(steps >= 5, "{}: the first {steps} control steps only", flight.name);
        worst.add(&flight.name, error);
    }
    worst.within(1e-6);
}
