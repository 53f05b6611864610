#![expect(deprecated, reason = "peers still send them")]

use kestrel_core::attitude::Attitude;
use mavlink::dialects::common::{
    COMMAND_INT_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MavCmd, MavFrame, MavType, PING_DATA,
    PositionTargetTypemask, SET_ATTITUDE_TARGET_DATA, SET_POSITION_TARGET_GLOBAL_INT_DATA,
    SET_POSITION_TARGET_LOCAL_NED_DATA, TIMESYNC_DATA,
};
use nalgebra::Vector3;
use proptest::prelude::*;

use super::set_point::TargetPosition;
use super::*;
use crate::autopilot::SetPoint;
use crate::frame::{Encoder, Frames, Payload};
use crate::geodesy::{Geodetic, Home};
use crate::goal::Facing;
use crate::steering::AttitudeSetPoint;

fn try_read<D: mavlink::MessageData>(message: &D) -> Option<(Address, Request)> {
    let bytes = Encoder::new(255, 190).encode(&Payload::of(message));
    request(&Frames::new(&bytes).next().unwrap().unwrap())
}

fn read<D: mavlink::MessageData>(message: &D) -> (Address, Request) {
    try_read(message).unwrap()
}

const TARGET: Address = Address { system: 8, component: 9 };

#[test]
fn a_command_is_read_as_the_mavlink_crate_writes_it() {
    let sent = COMMAND_LONG_DATA {
        param1: 1.0,
        param2: 2.0,
        param3: 3.0,
        param4: 4.0,
        param5: 5.0,
        param6: 6.0,
        param7: 7.0,
        command: MavCmd::MAV_CMD_NAV_TAKEOFF,
        target_system: 8,
        target_component: 9,
        confirmation: 10,
    };
    let expected = CommandRequest {
        command: 22,
        confirmation: 10,
        parameters: [1.0, 2.0, 3.0, 4.0],
        place: CommandLocation::Floats([5.0, 6.0, 7.0]),
    };
    assert_eq!(read(&sent), (TARGET, Request::Command(expected)));
}

#[test]
fn a_command_with_integers_is_read_as_the_mavlink_crate_writes_it() {
    let sent = COMMAND_INT_DATA {
        param1: 1.0,
        param4: 4.0,
        x: -5,
        y: 6,
        z: 7.0,
        frame: MavFrame::MAV_FRAME_GLOBAL_INT,
        command: MavCmd::MAV_CMD_DO_REPOSITION,
        target_system: 8,
        target_component: 9,
        ..COMMAND_INT_DATA::default()
    };
    let expected = CommandRequest {
        command: 192,
        confirmation: 0,
        parameters: [1.0, 0.0, 0.0, 4.0],
        place: CommandLocation::Integers { frame: 5, integers: [-5, 6], height: 7.0 },
    };
    assert_eq!(read(&sent), (TARGET, Request::Command(expected)));
}

#[test]
fn a_place_is_the_same_point_in_every_frame() {
    let home = Home::default();
    let point = Vector3::new(3.0, -2.0, 1.5);
    let Geodetic { latitude_deg, longitude_deg, altitude_m } = home.place_of(&point);
    let integers = home.place_of(&point).integers();
    let above_sea = altitude_m as f32;
    let places = [
        (CommandLocation::Integers { frame: 0, integers, height: above_sea }, 0.02),
        (CommandLocation::Integers { frame: 5, integers, height: above_sea }, 0.02),
        (CommandLocation::Integers { frame: 3, integers, height: 1.5 }, 0.02),
        (CommandLocation::Integers { frame: 6, integers, height: 1.5 }, 0.02),
        (CommandLocation::Integers { frame: 1, integers: [-20_000, 30_000], height: -1.5 }, 1e-6),
        // Single precision is good to 0.2 m and 0.1 m there.
        (CommandLocation::Floats([latitude_deg as f32, longitude_deg as f32, above_sea]), 0.5),
    ];
    for (place, tolerance_m) in places {
        let found = place.point(&home).unwrap();
        assert!((found - point).norm() < tolerance_m, "{place:?}: {found}");
    }
    for frame in [2, 4, 7, 8, 255] {
        assert_eq!(CommandLocation::Integers { frame, integers, height: 1.0 }.point(&home), None);
    }
    assert_eq!(CommandLocation::Floats([91.0, 0.0, 0.0]).point(&home), None);
    assert_eq!(CommandLocation::Floats([f32::NAN, 0.0, 0.0]).point(&home), None);
    let open = CommandLocation::Integers { frame: 6, integers, height: f32::NAN }.point(&home).unwrap();
    assert!((open.xy() - point.xy()).norm() < 0.02 && open.z.is_nan());
}

#[test]
fn a_place_may_be_left_open() {
    for place in [
        CommandLocation::Floats([f32::NAN, 0.0, 3.0]),
        CommandLocation::Integers { frame: 6, integers: [0, i32::MAX], height: 3.0 },
    ] {
        assert!(place.is_here());
        assert_eq!(place.height(), 3.0);
    }
    assert!(!CommandLocation::Floats([47.0, f32::NAN, 3.0]).is_here());
}

/// A drone whose nose points north, a quarter of a turn from the world's x axis.
const HERE: Whereabouts = Whereabouts {
    position: Vector3::new(5.0, 6.0, 2.0),
    heading: core::f32::consts::FRAC_PI_2,
    goal: Vector3::new(5.0, 6.0, 1.0),
};

#[test]
fn a_set_point_is_read_as_the_mavlink_crate_writes_it() {
    let sent = SET_POSITION_TARGET_LOCAL_NED_DATA {
        x: 1.0,
        y: 2.0,
        z: -3.0,
        vx: 0.1,
        vy: 0.2,
        vz: -0.3,
        yaw: 0.5,
        yaw_rate: 0.25,
        type_mask: PositionTargetTypemask::from_bits_truncate(0b1101_1111_1000),
        target_system: 8,
        target_component: 9,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
        ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
    };
    let expected = PositionTarget {
        frame: 1,
        type_mask: 0b1101_1111_1000,
        position: TargetPosition::Local([1.0, 2.0, -3.0]),
        velocity: [0.1, 0.2, -0.3],
        yaw: [0.5, 0.25],
    };
    assert_eq!(read(&sent), (TARGET, Request::PositionTarget(expected)));
    assert_eq!(expected.facing(&HERE), Facing::Kept, "both are to be ignored");
    let facing = |type_mask| PositionTarget { type_mask, ..expected }.facing(&HERE);
    // Half a radian to the right of north, where the world's x axis is east.
    assert_eq!(facing(0b1001_1111_1000), Facing::Toward(core::f32::consts::FRAC_PI_2 - 0.5));
    assert_eq!(facing(0b0101_1111_1000), Facing::Turning(-0.25));
    let unknown = PositionTarget { type_mask: 0b1001_1111_1000, yaw: [f32::NAN, 0.0], ..expected };
    assert_eq!(unknown.facing(&HERE), Facing::Kept);
    assert_eq!(expected.set_point(&Home::default(), &HERE), Ok(SetPoint::Position(Vector3::new(2.0, 1.0, 3.0))));
    let velocity = PositionTarget { type_mask: 2503, ..expected };
    let flown = SetPoint::Velocity(Vector3::new(0.2, 0.1, 0.3));
    assert_eq!(velocity.set_point(&Home::default(), &HERE), Ok(flown), "MAVSDK's velocity and yaw");
}

#[test]
fn a_global_set_point_is_read_as_the_mavlink_crate_writes_it() {
    let home = Home::default();
    let point = Vector3::new(10.0, 20.0, 3.0);
    let [lat_int, lon_int] = home.place_of(&point).integers();
    let sent = SET_POSITION_TARGET_GLOBAL_INT_DATA {
        lat_int,
        lon_int,
        alt: 3.0,
        type_mask: PositionTargetTypemask::from_bits_truncate(0b1101_1111_1000),
        coordinate_frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        ..SET_POSITION_TARGET_GLOBAL_INT_DATA::default()
    };
    let (_, Request::PositionTarget(target)) = read(&sent) else { panic!() };
    let Ok(SetPoint::Position(found)) = target.set_point(&home, &HERE) else { panic!() };
    assert!((found - point).norm() < 0.02, "{found}");
}

#[test]
fn only_whole_finite_reachable_positions_are_followed() {
    let position = TargetPosition::Local([0.0, 0.0, -1.0]);
    let good =
        PositionTarget { frame: 1, type_mask: 0b1101_1111_1000, position, velocity: [0.0; 3], yaw: [0.0; 2] };
    let home = Home::default();
    let at = |ned| PositionTarget { position: TargetPosition::Local(ned), ..good }.set_point(&home, &HERE);
    let masked = |type_mask| PositionTarget { type_mask, ..good }.set_point(&home, &HERE);
    assert!(good.set_point(&home, &HERE).is_ok());
    assert!(masked(2552).is_ok(), "MAVSDK's position and yaw");
    assert!(masked(0).is_ok(), "an acceleration beside it is a hint");
    assert_eq!(PositionTarget { frame: 20, ..good }.set_point(&home, &HERE), Err(SetPointError::Frame));
    assert_eq!(masked(0b1101_1111_1110), Err(SetPointError::Partial));
    assert_eq!(masked(0b1101_1111_1111), Err(SetPointError::Motion), "nothing is asked for");
    assert_eq!(masked(0b1100_0011_1111), Err(SetPointError::Motion), "an acceleration alone");
    assert_eq!(at([f32::NAN, 0.0, -1.0]), Err(SetPointError::NotFinite));
    assert_eq!(at([0.0, f32::INFINITY, -1.0]), Err(SetPointError::NotFinite));
    assert_eq!(at([0.0, 0.0, 1.0]), Err(SetPointError::Outside));
    assert_eq!(at([1e6, 0.0, -1.0]), Err(SetPointError::Outside));
}

fn followed(target: &PositionTarget) -> Result<Vector3<f32>, SetPointError> {
    let set_point = target.set_point(&Home::default(), &HERE)?;
    let (SetPoint::Position(vector) | SetPoint::Velocity(vector)) = set_point else { panic!() };
    Ok(vector.map(|number| (number * 1e3).round() / 1e3))
}

#[test]
fn places_and_velocities_may_count_from_the_drone() {
    let position = TargetPosition::Local([1.0, 2.0, -0.5]);
    let target = |frame, type_mask| PositionTarget {
        frame,
        type_mask,
        position,
        velocity: [0.1, 0.2, -0.3],
        yaw: [0.5, 0.0],
    };
    let (place, velocity) = (0b1101_1111_1000, 0b1101_1100_0111);
    // East is the world's x axis, north its y axis; the nose points north.
    assert_eq!(followed(&target(7, place)), Ok(Vector3::new(7.0, 7.0, 2.5)), "2 m east, 1 m north");
    for frame in [8, 9, 12] {
        assert_eq!(followed(&target(frame, place)), Ok(Vector3::new(7.0, 7.0, 2.5)), "1 m ahead, 2 m right");
        assert_eq!(followed(&target(frame, velocity)), Ok(Vector3::new(0.2, 0.1, 0.3)));
    }
    let east = Whereabouts { heading: 0.0, ..HERE };
    let ahead = target(12, velocity).set_point(&Home::default(), &east);
    assert_eq!(ahead, Ok(SetPoint::Velocity(Vector3::new(0.1, -0.2, 0.3))));
    assert_eq!(target(12, 0b1001_1111_1000).facing(&east), Facing::Toward(-0.5), "to the right of the nose");
    assert_eq!(followed(&target(8, 0b1101_1100_0111 | 0b1_0000)), Err(SetPointError::Partial));
}

#[test]
fn a_velocity_along_the_floor_goes_with_a_height_and_the_other_way_round() {
    let target = |type_mask, down| PositionTarget {
        frame: 1,
        type_mask,
        position: TargetPosition::Local([6.1, 5.2, down]),
        velocity: [0.1, 0.2, -0.3],
        yaw: [0.0; 2],
    };
    // PX4's and ArduPilot's "velocity and height": x and y of the position and z of the velocity are ignored.
    assert_eq!(
        followed(&target(0b1101_1110_0011, -1.2)),
        Ok(Vector3::new(0.2, 0.1, 0.4)),
        "0.2 m in half a second"
    );
    assert_eq!(followed(&target(0b1101_1110_0011, -9.0)), Ok(Vector3::new(0.2, 0.1, 1.0)), "no faster");
    assert_eq!(followed(&target(0b1101_1110_0011, f32::NAN)), Err(SetPointError::NotFinite));
    assert_eq!(followed(&target(0b1101_1101_1100, -1.2)), Ok(Vector3::new(0.4, 0.2, 0.3)));
}

#[test]
fn an_attitude_is_read_as_the_mavlink_crate_writes_it() {
    // North in MAVLink's frames is a left turn from the core's x axis.
    let sent = SET_ATTITUDE_TARGET_DATA {
        q: [1.0, 0.0, 0.0, 0.0],
        body_roll_rate: 0.1,
        body_pitch_rate: 0.2,
        body_yaw_rate: 0.3,
        thrust: 0.4,
        target_system: 8,
        target_component: 9,
        ..SET_ATTITUDE_TARGET_DATA::default()
    };
    let (address, Request::AttitudeTarget(target)) = read(&sent) else { panic!() };
    assert_eq!(address, TARGET);
    let Ok(SetPoint::Attitude(AttitudeSetPoint::Attitude { world_from_body, thrust })) = target.set_point() else {
        panic!()
    };
    let north = Attitude::from_axis_angle(Vector3::z(), core::f64::consts::FRAC_PI_2);
    let same = f64::from(world_from_body.w) * north.w + f64::from(world_from_body.z) * north.z;
    assert!((same.abs() - 1.0).abs() < 1e-6 && thrust == 0.4);
    let rates = AttitudeTarget { type_mask: 0b1000_0000, ..target }.set_point();
    let expected = AttitudeSetPoint::BodyRates { body_rates: Vector3::new(0.1, -0.2, -0.3), thrust: 0.4 };
    assert_eq!(rates, Ok(SetPoint::Attitude(expected)));
    for (type_mask, error) in [(0b0100_0000, SetPointError::Partial), (0b1000_0001, SetPointError::Partial)] {
        assert_eq!(AttitudeTarget { type_mask, ..target }.set_point(), Err(error));
    }
    for wrong in [
        AttitudeTarget { thrust: f32::NAN, ..target },
        AttitudeTarget { thrust: 1.5, ..target },
        AttitudeTarget { quaternion: [f32::NAN; 4], ..target },
        AttitudeTarget { quaternion: [0.0; 4], ..target },
    ] {
        assert_eq!(wrong.set_point(), Err(SetPointError::NotFinite));
    }
}

#[test]
fn questions_are_told_from_answers() {
    let ground_station = HEARTBEAT_DATA { mavtype: MavType::MAV_TYPE_GCS, ..HEARTBEAT_DATA::default() };
    assert_eq!(try_read(&ground_station), Some((Address::EVERYBODY, Request::GroundStation)));
    assert_eq!(try_read(&HEARTBEAT_DATA::default()), None, "another vehicle");
    let question = PING_DATA { time_usec: 5, seq: 6, ..PING_DATA::default() };
    assert_eq!(try_read(&question), Some((Address::EVERYBODY, Request::Ping { time_usec: 5, seq: 6 })));
    assert_eq!(try_read(&PING_DATA { target_system: 1, ..question }), None);
    let asked = TIMESYNC_DATA { tc1: 0, ts1: -7 };
    assert_eq!(try_read(&asked), Some((Address::EVERYBODY, Request::TimeSync(-7))));
    assert_eq!(try_read(&TIMESYNC_DATA { tc1: 3, ..asked }), None);
}

#[test]
fn zero_addresses_everybody() {
    let reaches = |system, component| Address { system, component }.reaches(1, 1);
    assert!(reaches(0, 0) && reaches(1, 0) && reaches(0, 1) && reaches(1, 1));
    assert!(!reaches(2, 0) && !reaches(2, 1) && !reaches(1, 2));
}

/// The first bytes of a payload as the mavlink crate reads them, if it knows the numbers in them.
fn theirs<D: mavlink::MessageData>(payload: &[u8]) -> Option<D> {
    D::deser(mavlink::MavlinkVersion::V2, payload).ok()
}

fn ours(message_id: u32, payload: &[u8]) -> Option<(Address, Request)> {
    let seed = crate::dialect::checksum_seed(message_id)?;
    let bytes = Encoder::new(255, 190).encode(&Payload::new(message_id, seed, payload));
    request(&Frames::new(&bytes).next()?.ok()?)
}

fn bits<const LEN: usize>(values: [f32; LEN]) -> [u32; LEN] {
    values.map(f32::to_bits)
}

proptest! {
    #[test]
    fn any_command_is_read_as_the_mavlink_crate_reads_it(
        mut payload in proptest::collection::vec(any::<u8>(), 33),
        command in proptest::sample::select(vec![16_u16, 17, 20, 21, 22, 176, 178, 185, 192, 193, 300, 400, 511, 512])
    ) {
        payload[28..30].copy_from_slice(&command.to_le_bytes());
        let sent: COMMAND_LONG_DATA = theirs(&payload).unwrap();
        let (address, Request::Command(read)) = ours(76, &payload).unwrap() else { panic!() };
        let CommandLocation::Floats(place) = read.place else { panic!() };
        prop_assert_eq!(address, Address { system: sent.target_system, component: sent.target_component });
        prop_assert_eq!((read.command, read.confirmation), (sent.command as u16, sent.confirmation));
        prop_assert_eq!(bits(read.parameters), bits([sent.param1, sent.param2, sent.param3, sent.param4]));
        prop_assert_eq!(bits(place), bits([sent.param5, sent.param6, sent.param7]));
    }

    #[test]
    fn any_local_set_point_is_read_as_the_mavlink_crate_reads_it(
        mut payload in proptest::collection::vec(any::<u8>(), 53), frame in 0_u8..12
    ) {
        payload[52] = frame;
        let Some(sent) = theirs::<SET_POSITION_TARGET_LOCAL_NED_DATA>(&payload) else { return Ok(()) };
        let (address, Request::PositionTarget(read)) = ours(84, &payload).unwrap() else { panic!() };
        let TargetPosition::Local(position) = read.position else { panic!() };
        prop_assert_eq!(address, Address { system: sent.target_system, component: sent.target_component });
        prop_assert_eq!((read.frame, read.type_mask & 0x0fff), (frame, sent.type_mask.bits() & 0x0fff));
        prop_assert_eq!(bits(position), bits([sent.x, sent.y, sent.z]));
        prop_assert_eq!(bits(read.velocity), bits([sent.vx, sent.vy, sent.vz]));
    }

    #[test]
    fn any_attitude_is_read_as_the_mavlink_crate_reads_it(payload in proptest::collection::vec(any::<u8>(), 39)) {
        let Some(sent) = theirs::<SET_ATTITUDE_TARGET_DATA>(&payload) else { return Ok(()) };
        let (address, Request::AttitudeTarget(read)) = ours(82, &payload).unwrap() else { panic!() };
        prop_assert_eq!(address, Address { system: sent.target_system, component: sent.target_component });
        prop_assert_eq!(bits(read.quaternion), bits(sent.q));
        let rates = [sent.body_roll_rate, sent.body_pitch_rate, sent.body_yaw_rate];
        prop_assert_eq!(bits(read.body_rates_frd), bits(rates));
        prop_assert_eq!(read.thrust.to_bits(), sent.thrust.to_bits());
    }

    #[test]
    fn any_heartbeat_is_read_as_the_mavlink_crate_reads_it(
        mut payload in proptest::collection::vec(any::<u8>(), 9), kind in 0_u8..12
    ) {
        payload[4] = kind;
        let Some(sent) = theirs::<HEARTBEAT_DATA>(&payload) else { return Ok(()) };
        let speaks = sent.mavtype == MavType::MAV_TYPE_GCS;
        prop_assert_eq!(ours(0, &payload).is_some(), speaks);
    }
}
