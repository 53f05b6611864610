//! What clients of other autopilots see and may say.

use mavlink::dialects::common::MavAutopilot;

use super::*;

fn flying_as(personality: Personality) -> Rig {
    let mut rig = Rig::flying();
    rig.vehicle.profile.personality = personality;
    rig
}

/// A velocity to the north.
fn velocity() -> SET_POSITION_TARGET_LOCAL_NED_DATA {
    SET_POSITION_TARGET_LOCAL_NED_DATA {
        vx: 0.3,
        type_mask: PositionTargetTypemask::from_bits_truncate(2503),
        ..set_point([0.0; 3])
    }
}

/// `mode RTL` of pymavlink and MAVProxy to a copter of `ArduPilot` is PX4's number of the offboard mode.
#[test]
fn six_returns_an_arducopter_and_is_the_offboard_mode_of_px4() {
    for (personality, mode) in [
        (Personality::Px4, Mode::Offboard),
        (Personality::Generic, Mode::Offboard),
        (Personality::Ardupilot, Mode::Returning),
    ] {
        let mut rig = flying_as(personality);
        rig.answers(&datagram(&set_point([0.0, 0.0, -1.0])));
        rig.accepted(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(rig.vehicle.mode(), mode, "{personality:?}");
    }
}

#[test]
fn heartbeats_have_the_numbers_of_the_autopilot_that_it_says_it_is() {
    let seen = |personality| {
        let heartbeat = flying_as(personality).heartbeat();
        (heartbeat.autopilot, heartbeat.custom_mode)
    };
    let hold = FlightMode::Hold.custom_mode();
    assert_eq!(seen(Personality::Px4), (MavAutopilot::MAV_AUTOPILOT_PX4, hold));
    assert_eq!(seen(Personality::Ardupilot), (MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA, 4));
    let policy = FlightMode::Policy.custom_mode();
    assert_eq!(seen(Personality::Generic), (MavAutopilot::MAV_AUTOPILOT_GENERIC, policy));
}

#[test]
fn in_guided_an_arducopter_follows_velocities_at_once() {
    let mut rig = flying_as(Personality::Ardupilot);
    for _ in 0..30 {
        rig.receive(&datagram(&velocity()));
        rig.fly(0.1);
    }
    assert_eq!(rig.vehicle.mode(), Mode::Offboard);
    assert!((rig.plant.state().velocity.y - 0.3).abs() < 0.05);
    assert_eq!(rig.heartbeat().custom_mode, 4, "still guided");
    let mut px4 = flying_as(Personality::Px4);
    px4.receive(&datagram(&velocity()));
    assert_eq!(px4.vehicle.mode(), Mode::Holding);
}

#[test]
fn the_main_modes_of_px4_are_understood_alone() {
    let mut rig = flying_as(Personality::Px4);
    let mut choose = |main: f32| command(&mut rig, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, main, 0.0]);
    assert_eq!(choose(3.0), MavResult::MAV_RESULT_ACCEPTED, "POSCTL");
    assert_eq!(choose(4.0), MavResult::MAV_RESULT_TEMPORARILY_REJECTED, "AUTO: there is no mission");
    assert_eq!(choose(1.0), MavResult::MAV_RESULT_DENIED, "MANUAL");
}
