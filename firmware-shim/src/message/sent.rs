//! What the vehicle tells its peers.

use kestrel_core::vehicle::State;
use mavlink::dialects::common::{
    ATTITUDE_DATA, AUTOPILOT_VERSION_DATA, EXTENDED_SYS_STATE_DATA, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA,
    MavAutopilot, MavLandedState, MavModeFlag, MavProtocolCapability, MavResult, MavSeverity, MavState,
    MavSysStatusSensor, MavType, STATUSTEXT_DATA, SYS_STATUS_DATA,
};

use crate::autopilot::Mode;
use crate::frame::Payload;
use crate::message::{frd_from_flu, ned_from_enu, ned_roll_pitch_yaw};

/// Identifier of `AUTOPILOT_VERSION`.
pub const AUTOPILOT_VERSION_ID: u32 = 148;

/// `HEARTBEAT`: a quadrotor of no known make, whose mode is in `custom_mode` (see [`mode_number`]).
pub fn heartbeat(mode: Mode) -> Payload {
    let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
    base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, mode.armed());
    base_mode.set(MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED, mode.flies());
    base_mode.set(MavModeFlag::MAV_MODE_FLAG_GUIDED_ENABLED, mode == Mode::Guided);
    Payload::of(&HEARTBEAT_DATA {
        custom_mode: mode_number(mode),
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC,
        base_mode,
        system_status: if mode.armed() { MavState::MAV_STATE_ACTIVE } else { MavState::MAV_STATE_STANDBY },
        mavlink_version: 3,
    })
}

/// `custom_mode` of a mode.
pub const fn mode_number(mode: Mode) -> u32 {
    match mode {
        Mode::Disarmed => 0,
        Mode::Armed => 1,
        Mode::TakingOff => 2,
        Mode::Holding => 3,
        Mode::Guided => 4,
        Mode::Landing => 5,
        Mode::Landed => 6,
        Mode::Offboard => 7,
        Mode::Returning => 8,
    }
}

/// `SYS_STATUS`: the controllers that a policy stands for, its self-test as the pre-arm check, and how many
/// datagrams were garbage. There is no battery.
pub fn sys_status(healthy: bool, garbage: u16) -> Payload {
    let check = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK;
    let present = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_GYRO
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_ACCEL
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_ANGULAR_RATE_CONTROL
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
        | check;
    Payload::of(&SYS_STATUS_DATA {
        onboard_control_sensors_present: present,
        onboard_control_sensors_enabled: present,
        onboard_control_sensors_health: if healthy { present } else { present - check },
        voltage_battery: u16::MAX,
        current_battery: -1,
        battery_remaining: -1,
        errors_comm: garbage,
        ..SYS_STATUS_DATA::default()
    })
}

/// `EXTENDED_SYS_STATE`: on the ground or not.
pub fn extended_sys_state(mode: Mode) -> Payload {
    let landed_state = match mode {
        Mode::Disarmed | Mode::Armed | Mode::Landed => MavLandedState::MAV_LANDED_STATE_ON_GROUND,
        Mode::TakingOff => MavLandedState::MAV_LANDED_STATE_TAKEOFF,
        Mode::Holding | Mode::Guided | Mode::Offboard | Mode::Returning => MavLandedState::MAV_LANDED_STATE_IN_AIR,
        Mode::Landing => MavLandedState::MAV_LANDED_STATE_LANDING,
    };
    Payload::of(&EXTENDED_SYS_STATE_DATA { landed_state, ..EXTENDED_SYS_STATE_DATA::default() })
}

/// `ATTITUDE` at a time since boot \[ms\].
pub fn attitude(state: &State<f32>, time_boot_ms: u32) -> Payload {
    let [roll, pitch, yaw] = ned_roll_pitch_yaw(&state.world_from_body).map(|angle| angle as f32);
    let [rollspeed, pitchspeed, yawspeed] = frd_from_flu(&state.body_rates);
    Payload::of(&ATTITUDE_DATA { time_boot_ms, roll, pitch, yaw, rollspeed, pitchspeed, yawspeed })
}

/// `LOCAL_POSITION_NED` at a time since boot \[ms\]; the origin is the world's.
pub fn local_position_ned(state: &State<f32>, time_boot_ms: u32) -> Payload {
    let [x, y, z] = ned_from_enu(&state.position);
    let [vx, vy, vz] = ned_from_enu(&state.velocity);
    Payload::of(&LOCAL_POSITION_NED_DATA { time_boot_ms, x, y, z, vx, vy, vz })
}

/// `AUTOPILOT_VERSION` of this package.
pub fn autopilot_version() -> Payload {
    let number = |text: &str| text.parse::<u8>().unwrap_or(0);
    let version = [
        number(env!("CARGO_PKG_VERSION_MAJOR")),
        number(env!("CARGO_PKG_VERSION_MINOR")),
        number(env!("CARGO_PKG_VERSION_PATCH")),
        0, // FIRMWARE_VERSION_TYPE_DEV
    ];
    Payload::of(&AUTOPILOT_VERSION_DATA {
        capabilities: MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MAVLINK2
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED,
        flight_sw_version: u32::from_be_bytes(version),
        ..AUTOPILOT_VERSION_DATA::default()
    })
}

/// `COMMAND_ACK` to a system and component, for any command number, whether the dialect knows it or not.
pub fn command_ack(command: u16, result: MavResult, [system, component]: [u8; 2]) -> Payload {
    let [low, high] = command.to_le_bytes();
    // The four bytes of the second result and the progress before them are not used.
    Payload::new(77, 143, &[low, high, result as u8, 0, 0, 0, 0, 0, system, component])
}

/// `STATUSTEXT` of at most 50 bytes; longer text is cut.
pub fn status_text(severity: MavSeverity, text: &str) -> Payload {
    Payload::of(&STATUSTEXT_DATA { severity, text: text.into() })
}

#[cfg(test)]
mod tests {
    use kestrel_core::attitude::Attitude;
    use mavlink::dialects::common::{COMMAND_ACK_DATA, MavCmd, MavMessage};
    use mavlink::{MavlinkVersion, Message};
    use nalgebra::Vector3;

    use super::*;
    use crate::frame::{Encoder, Frames};

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

    #[test]
    fn an_acknowledgement_is_read_by_the_mavlink_crate() {
        let expected = COMMAND_ACK_DATA {
            command: MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            result: MavResult::MAV_RESULT_DENIED,
        };
        let ack = command_ack(400, MavResult::MAV_RESULT_DENIED, [255, 190]);
        assert_eq!(sent(&ack), MavMessage::COMMAND_ACK(expected));
    }

    #[test]
    fn positions_and_velocities_are_north_east_down() {
        let MavMessage::LOCAL_POSITION_NED(message) = sent(&local_position_ned(&moving(), 7)) else { panic!() };
        assert_eq!([message.x, message.y, message.z], [2.0, 1.0, -3.0]);
        assert_eq!([message.vx, message.vy, message.vz], [5.0, 4.0, -6.0]);
        assert_eq!(message.time_boot_ms, 7);
    }

    #[test]
    fn rates_are_forward_right_down() {
        let MavMessage::ATTITUDE(message) = sent(&attitude(&moving(), 7)) else { panic!() };
        assert_eq!([message.rollspeed, message.pitchspeed, message.yawspeed], [0.1, -0.2, -0.3]);
    }

    #[test]
    fn a_heartbeat_says_whether_motors_may_turn() {
        for mode in [Mode::Disarmed, Mode::Armed, Mode::Guided, Mode::Landed] {
            let MavMessage::HEARTBEAT(message) = sent(&heartbeat(mode)) else { panic!() };
            let armed = message.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
            assert_eq!(armed, mode.armed());
            assert_eq!(message.custom_mode, mode_number(mode));
        }
    }

    #[test]
    fn a_failed_self_test_fails_the_pre_arm_check() {
        for healthy in [true, false] {
            let MavMessage::SYS_STATUS(message) = sent(&sys_status(healthy, 3)) else { panic!() };
            let check = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK;
            assert_eq!(message.onboard_control_sensors_health.contains(check), healthy);
            assert_eq!(message.errors_comm, 3);
        }
    }

    #[test]
    fn long_text_is_cut() {
        let MavMessage::STATUSTEXT(message) = sent(&status_text(MavSeverity::MAV_SEVERITY_INFO, &"x".repeat(80)))
        else {
            panic!()
        };
        assert_eq!(message.text.to_str().unwrap().len(), 50);
    }
}
