//! The shape of a firmware with `cortex-m-rt`: policy in flash, pilot in RAM, one call per control period.
//!
//! On a microcontroller `#![no_std]` and `#![no_main]` stand above, `#[cortex_m_rt::entry]` stands before `main` and the
//! loop has no end (`firmware-shim/image` is such a program). Here it runs on the host, with a board that stands still.

use kestrel_core::attitude::Attitude;
use kestrel_core::nalgebra::Vector3;
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{Aligned, PolicyFile};
use kestrel_core::vehicle::State;

/// The policy stays where the linker puts it: nothing is copied to RAM.
static POLICY: Aligned<{ include_bytes!("../../assets/pilots/hover.kestrel").len() }> =
    Aligned(*include_bytes!("../../assets/pilots/hover.kestrel"));

/// What your board offers: a timer, a state estimate, four motors.
#[derive(Default)]
struct Board {
    rotor_targets: [f32; 4],
    periods: u32,
    position: Vector3<f32>,
}

impl Board {
    fn wait_for_control_period(&mut self) {
        self.periods += 1;
    }

    fn estimated_state(&self) -> State<f32> {
        State {
            position: self.position,
            world_from_body: Attitude::level(),
            velocity: Vector3::zeros(),
            body_rates: Vector3::zeros(),
            rotor_speeds: [0.0; 4],
        }
    }

    fn drive_motors(&mut self, rotor_targets: [f32; 4]) {
        self.rotor_targets = rotor_targets;
    }
}

fn main() {
    let mut board = Board { position: Vector3::new(0.0, 0.0, 0.9), ..Board::default() };
    // A policy that does not compute here what it did where it was exported does not fly.
    let Ok(policy) = PolicyFile::parse(&POLICY.0) else { return };
    let mut pilot = Pilot::new(policy);
    if pilot.self_test().is_err() {
        return;
    }
    let goal = Vector3::new(0.0, 0.0, 1.0);
    for _ in 0..100 {
        board.wait_for_control_period();
        board.drive_motors(pilot.tick(&board.estimated_state(), &goal));
    }
    println!("rotor targets {:.0?} rad/s", board.rotor_targets);
    assert!(board.rotor_targets.iter().all(|target| *target > 0.0), "the drone is below its goal");
}
