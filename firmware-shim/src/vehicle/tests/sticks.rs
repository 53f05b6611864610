//! Flown by a joystick.

use super::*;

/// `MANUAL_CONTROL`: forward, right, throttle, clockwise, in thousandths.
fn sticks(axes: [i16; 4]) -> Vec<u8> {
    let mut fields = [0; 11];
    for (place, axis) in fields.chunks_exact_mut(2).zip(axes) {
        place.copy_from_slice(&axis.to_le_bytes());
    }
    fields[10] = 1;
    Encoder::new(255, 190).encode(&Payload::new(69, 243, &fields)).to_vec()
}

/// `RC_CHANNELS_OVERRIDE`: roll, pitch, throttle, yaw \[µs\].
fn channels(pulses: [u16; 4]) -> Vec<u8> {
    let mut fields = [0; 18];
    for (place, pulse) in fields.chunks_exact_mut(2).zip(pulses) {
        place.copy_from_slice(&pulse.to_le_bytes());
    }
    fields[16] = 1;
    Encoder::new(255, 190).encode(&Payload::new(70, 124, &fields)).to_vec()
}

const TO_POSITION: [f32; 7] = [129.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0];

fn by_sticks() -> Rig {
    let mut rig = Rig::flying();
    rig.accepted(MavCmd::MAV_CMD_DO_SET_MODE, TO_POSITION);
    rig
}

fn stream(rig: &mut Rig, frame: &[u8], secs: f32) {
    for _ in 0..(secs / 0.1).round() as u32 {
        rig.receive(frame);
        rig.fly(0.1);
    }
}

#[test]
fn sticks_wait_for_their_mode() {
    let mut rig = Rig::flying();
    rig.heard.clear();
    stream(&mut rig, &sticks([1000, 0, 500, 0]), 0.5);
    assert_eq!(texts(&rig.heard), ["sticks wait for the Position mode"]);
    assert_eq!(rig.vehicle.mode(), Mode::Holding);
}

/// The nose points to the east, along the world's x axis.
#[test]
fn a_stick_forward_flies_where_the_nose_points_and_in_the_middle_it_holds() {
    let mut rig = by_sticks();
    stream(&mut rig, &sticks([500, 0, 500, 0]), 4.0);
    let velocity = rig.plant.state().velocity;
    assert!((velocity - nalgebra::Vector3::new(0.25, 0.0, 0.0)).norm() < 0.05, "{velocity}");
    assert_eq!(rig.heartbeat().custom_mode, FlightMode::Position.custom_mode());
    stream(&mut rig, &channels([1750, 1500, 1500, 1500]), 4.0);
    let velocity = rig.plant.state().velocity;
    assert!((velocity - nalgebra::Vector3::new(0.0, -0.25, 0.0)).norm() < 0.05, "{velocity}");
    stream(&mut rig, &sticks([0, 0, 520, i16::MAX]), 4.0);
    assert!(rig.plant.state().velocity.norm() < 0.02);
}

#[test]
fn sticks_that_fall_silent_hold_and_go_on_when_they_come_back() {
    let mut rig = by_sticks();
    stream(&mut rig, &sticks([0, 0, 1000, 0]), 1.0);
    rig.fly(3.0);
    assert_eq!(rig.vehicle.mode(), Mode::Holding);
    assert!(rig.plant.state().velocity.norm() < 0.05);
    assert_eq!(rig.heartbeat().custom_mode, FlightMode::Position.custom_mode());
    stream(&mut rig, &sticks([0, 0, 750, 0]), 4.0);
    assert_eq!(rig.vehicle.mode(), Mode::Offboard);
    assert!(rig.plant.state().velocity.z > 0.2);
}

#[test]
fn another_command_takes_the_sticks_away() {
    let mut rig = by_sticks();
    stream(&mut rig, &sticks([1000, 0, 500, 0]), 1.0);
    rig.accepted(MavCmd::MAV_CMD_NAV_LAND, LEFT_OPEN);
    stream(&mut rig, &sticks([1000, 0, 500, 0]), 1.0);
    assert_eq!(rig.vehicle.mode(), Mode::Landing);
}

#[test]
fn a_drone_takes_off_by_the_throttle_alone() {
    let mut rig = Rig::new();
    rig.accepted(MavCmd::MAV_CMD_DO_SET_MODE, TO_POSITION);
    rig.accepted(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    stream(&mut rig, &sticks([1000, 0, 500, 0]), 0.5);
    assert_eq!(rig.vehicle.mode(), Mode::Armed, "the throttle is in the middle");
    stream(&mut rig, &sticks([0, 0, 1000, 0]), 3.0);
    assert_eq!(rig.vehicle.mode(), Mode::Offboard);
    assert!(rig.plant.state().position.z > 0.8);
    // Channels that are given back are no sticks.
    stream(&mut rig, &channels([0, u16::MAX, 0, 0]), 2.0);
    assert_eq!(rig.vehicle.mode(), Mode::Holding);
}
