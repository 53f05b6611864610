use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::State;
use mavlink::dialects::common::{MavMessage, MavModeFlag, MavSysStatusSensor};
use mavlink::{MavlinkVersion, Message};
use nalgebra::Vector3;

use super::*;
use crate::autopilot::Mode;
use crate::battery::Battery;
use crate::controller::Controller;
use crate::flight_mode::FlightMode;
use crate::frame::{Encoder, Frames};
use crate::personality::Personality;

fn sent(payload: &Payload) -> MavMessage {
    let bytes = Encoder::new(1, 1).encode(payload);
    let frame = Frames::new(&bytes).next().unwrap().unwrap();
    MavMessage::parse(MavlinkVersion::V2, frame.message_id, frame.payload).unwrap()
}

fn moving() -> State<f32> {
    State {
        position: Vector3::new(1.0, 2.0, 3.0),
        world_from_body: Attitude::level(),
        velocity: Vector3::new(4.0, 5.0, 6.0),
        body_rates: Vector3::new(0.1, 0.2, 0.3),
        rotor_speeds: [0.0; 4],
    }
}

fn well() -> status::VehicleHealth {
    status::VehicleHealth { policy: true, inside_fence: true, battery: Battery::full(), garbage: 0, refused: 0 }
}

#[test]
fn positions_and_velocities_are_north_east_down() {
    let MavMessage::LOCAL_POSITION_NED(message) = sent(&motion::local_position_ned(&moving(), 7)) else {
        panic!()
    };
    assert_eq!([message.x, message.y, message.z], [2.0, 1.0, -3.0]);
    assert_eq!([message.vx, message.vy, message.vz], [5.0, 4.0, -6.0]);
    assert_eq!(message.time_boot_ms, 7);
}

#[test]
fn rates_are_forward_right_down() {
    let MavMessage::ATTITUDE(message) = sent(&motion::attitude(&moving(), 7)) else { panic!() };
    assert_eq!([message.rollspeed, message.pitchspeed, message.yawspeed], [0.1, -0.2, -0.3]);
}

#[test]
fn a_heartbeat_says_whether_motors_may_turn() {
    for mode in [Mode::Disarmed, Mode::Armed, Mode::Guided, Mode::Landed] {
        let flight_mode = FlightMode::of(mode, Controller::Policy);
        let heartbeat = status::heartbeat(mode, flight_mode, Personality::Generic);
        let MavMessage::HEARTBEAT(message) = sent(&heartbeat) else { panic!() };
        let armed = message.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
        assert_eq!(armed, mode.armed());
        assert_eq!(message.custom_mode, flight_mode.custom_mode());
    }
}

#[test]
fn a_failed_self_test_fails_the_pre_arm_check() {
    for healthy in [true, false] {
        let health = status::VehicleHealth { policy: healthy, ..well() };
        let MavMessage::SYS_STATUS(message) = sent(&status::sys_status(&health)) else { panic!() };
        let check = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK;
        assert_eq!(message.onboard_control_sensors_health.contains(check), healthy);
    }
}

#[test]
fn counts_of_errors_end_at_the_greatest_number_of_the_message() {
    let health = status::VehicleHealth { garbage: 3, refused: 70_000, ..well() };
    let MavMessage::SYS_STATUS(message) = sent(&status::sys_status(&health)) else { panic!() };
    assert_eq!([message.errors_comm, message.errors_count1], [3, u16::MAX]);
}

#[test]
fn long_text_is_cut() {
    let MavMessage::STATUSTEXT(message) = sent(&status_text(MavSeverity::MAV_SEVERITY_INFO, &"x".repeat(80)))
    else {
        panic!()
    };
    assert_eq!(message.text.to_str().unwrap().len(), 50);
}
