//! Where the vehicle is and how it moves; times are since boot.

use kestrel_core::vehicle::State;
use mavlink::dialects::common::{
    ALTITUDE_DATA, ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, ATTITUDE_TARGET_DATA, AttitudeTargetTypemask,
    ESC_STATUS_DATA, ESTIMATOR_STATUS_DATA, EstimatorStatusFlags, GLOBAL_POSITION_INT_DATA, GPS_RAW_INT_DATA,
    GpsFixType, HIGHRES_IMU_DATA, HOME_POSITION_DATA, HighresImuUpdatedFlags, LOCAL_POSITION_NED_COV_DATA,
    LOCAL_POSITION_NED_DATA, MavEstimatorType, MavFrame, ODOMETRY_DATA, POSITION_TARGET_LOCAL_NED_DATA,
    PositionTargetTypemask, SERVO_OUTPUT_RAW_DATA, VFR_HUD_DATA,
};
use nalgebra::Vector3;

use crate::frame::Payload;
use crate::geodesy::Home;
use crate::goal::MovingGoal;
use crate::message::{frd_from_flu, ned_from_enu, ned_from_frd, ned_roll_pitch_yaw};
use crate::steering::AttitudeSetPoint;

/// The whole of a turn \[rad\].
const TURN: f64 = core::f64::consts::TAU;

/// `ATTITUDE`.
pub fn attitude(state: &State<f32>, time_boot_ms: u32) -> Payload {
    let [roll, pitch, yaw] = ned_roll_pitch_yaw(&state.world_from_body).map(|angle| angle as f32);
    let [rollspeed, pitchspeed, yawspeed] = frd_from_flu(&state.body_rates);
    Payload::of(&ATTITUDE_DATA { time_boot_ms, roll, pitch, yaw, rollspeed, pitchspeed, yawspeed })
}

/// `ATTITUDE_QUATERNION`.
pub fn attitude_quaternion(state: &State<f32>, time_boot_ms: u32) -> Payload {
    let [q1, q2, q3, q4] = ned_from_frd(&state.world_from_body);
    let [rollspeed, pitchspeed, yawspeed] = frd_from_flu(&state.body_rates);
    Payload::of(&ATTITUDE_QUATERNION_DATA { time_boot_ms, q1, q2, q3, q4, rollspeed, pitchspeed, yawspeed })
}

/// `LOCAL_POSITION_NED`; the origin is the world's.
pub fn local_position_ned(state: &State<f32>, time_boot_ms: u32) -> Payload {
    let [x, y, z] = ned_from_enu(&state.position);
    let [vx, vy, vz] = ned_from_enu(&state.velocity);
    Payload::of(&LOCAL_POSITION_NED_DATA { time_boot_ms, x, y, z, vx, vy, vz })
}

/// `LOCAL_POSITION_NED_COV`, with the acceleration of the last control period \[m/s², world\]; the covariances are not
/// known.
pub fn local_position_ned_cov(state: &State<f32>, acceleration: &Vector3<f32>, time_usec: u64) -> Payload {
    let [x, y, z] = ned_from_enu(&state.position);
    let [vx, vy, vz] = ned_from_enu(&state.velocity);
    let [ax, ay, az] = ned_from_enu(acceleration);
    let mut covariance = [0.0; 45];
    covariance[0] = f32::NAN;
    Payload::of(&LOCAL_POSITION_NED_COV_DATA {
        time_usec,
        x,
        y,
        z,
        vx,
        vy,
        vz,
        ax,
        ay,
        az,
        covariance,
        estimator_type: MavEstimatorType::MAV_ESTIMATOR_TYPE_NAIVE,
    })
}

/// `ATTITUDE_TARGET`: what a peer steers by, if one steers by attitude or body rates; nothing of it is meant if none does.
pub fn attitude_target(set_point: Option<&AttitudeSetPoint>, time_boot_ms: u32) -> Payload {
    const NO_RATES: u8 = 0b0000_0111;
    const NO_THRUST: u8 = 0b0100_0000;
    const NO_ATTITUDE: u8 = 0b1000_0000;
    let unknown = [f32::NAN; 4];
    let (ignored, q, rates, thrust) = match set_point {
        Some(AttitudeSetPoint::Attitude { world_from_body, thrust }) => {
            (NO_RATES, ned_from_frd(world_from_body), [0.0; 3], *thrust)
        }
        Some(AttitudeSetPoint::BodyRates { body_rates, thrust }) => {
            (NO_ATTITUDE, unknown, frd_from_flu(body_rates), *thrust)
        }
        None => (NO_RATES | NO_THRUST | NO_ATTITUDE, unknown, [0.0; 3], 0.0),
    };
    let [body_roll_rate, body_pitch_rate, body_yaw_rate] = rates;
    Payload::of(&ATTITUDE_TARGET_DATA {
        time_boot_ms,
        q,
        body_roll_rate,
        body_pitch_rate,
        body_yaw_rate,
        thrust,
        type_mask: AttitudeTargetTypemask::from_bits_truncate(ignored),
    })
}

/// `ODOMETRY`: position in the world, velocity in the body; the covariances are not known.
pub fn odometry(state: &State<f32>, time_usec: u64) -> Payload {
    let [x, y, z] = ned_from_enu(&state.position);
    let [vx, vy, vz] = frd_from_flu(&state.world_from_body.rotate_inverse(state.velocity));
    let [rollspeed, pitchspeed, yawspeed] = frd_from_flu(&state.body_rates);
    let mut unknown = [0.0; 21];
    unknown[0] = f32::NAN;
    Payload::of(&ODOMETRY_DATA {
        time_usec,
        x,
        y,
        z,
        q: ned_from_frd(&state.world_from_body),
        vx,
        vy,
        vz,
        rollspeed,
        pitchspeed,
        yawspeed,
        pose_covariance: unknown,
        velocity_covariance: unknown,
        frame_id: MavFrame::MAV_FRAME_LOCAL_NED,
        child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
    })
}

/// `HIGHRES_IMU` without noise: specific force of the last control period \[m/s², FLU\] and body rates.
pub fn highres_imu(state: &State<f32>, specific_force: &Vector3<f32>, time_usec: u64) -> Payload {
    let [xacc, yacc, zacc] = frd_from_flu(specific_force);
    let [xgyro, ygyro, zgyro] = frd_from_flu(&state.body_rates);
    let fields_updated = HighresImuUpdatedFlags::from_bits_truncate(0b11_1111);
    Payload::of(&HIGHRES_IMU_DATA {
        time_usec,
        xacc,
        yacc,
        zacc,
        xgyro,
        ygyro,
        zgyro,
        fields_updated,
        ..HIGHRES_IMU_DATA::default()
    })
}

/// `ESC_STATUS` of the four rotors, in turns per minute; nothing else is known of them.
pub fn esc_status(rotor_speeds: &[f32; 4], time_usec: u64) -> Payload {
    let rpm = rotor_speeds.map(|speed| libm::roundf(speed * 60.0 / core::f32::consts::TAU) as i32);
    let unknown = [f32::NAN; 4];
    Payload::of(&ESC_STATUS_DATA { time_usec, rpm, voltage: unknown, current: unknown, index: 0 })
}

/// `ESTIMATOR_STATUS`: attitude, velocity and position are known, and no measurement was refused.
pub fn estimator_status(time_usec: u64) -> Payload {
    let flags = EstimatorStatusFlags::ESTIMATOR_ATTITUDE
        | EstimatorStatusFlags::ESTIMATOR_VELOCITY_HORIZ
        | EstimatorStatusFlags::ESTIMATOR_VELOCITY_VERT
        | EstimatorStatusFlags::ESTIMATOR_POS_HORIZ_REL
        | EstimatorStatusFlags::ESTIMATOR_POS_HORIZ_ABS
        | EstimatorStatusFlags::ESTIMATOR_POS_VERT_ABS;
    Payload::of(&ESTIMATOR_STATUS_DATA { time_usec, flags, ..ESTIMATOR_STATUS_DATA::default() })
}

/// `GLOBAL_POSITION_INT`, for a world whose origin is at `origin`.
pub fn global_position_int(state: &State<f32>, origin: &Home, time_boot_ms: u32) -> Payload {
    let place = origin.place_of(&state.position);
    let [lat, lon] = place.integers();
    let [vx, vy, vz] = ned_from_enu(&state.velocity).map(centi);
    Payload::of(&GLOBAL_POSITION_INT_DATA {
        time_boot_ms,
        lat,
        lon,
        alt: millimetres(place.altitude_m),
        relative_alt: millimetres(f64::from(state.position.z)),
        vx,
        vy,
        vz,
        hdg: (heading(state) / TURN * 36_000.0) as u16,
    })
}

/// `GPS_RAW_INT`: the true position, as good as receivers get.
pub fn gps_raw_int(state: &State<f32>, origin: &Home, time_usec: u64) -> Payload {
    let place = origin.place_of(&state.position);
    let [lat, lon] = place.integers();
    let ground_speed = state.velocity.xy().norm();
    Payload::of(&GPS_RAW_INT_DATA {
        time_usec,
        lat,
        lon,
        alt: millimetres(place.altitude_m),
        eph: 50,
        epv: 80,
        vel: (ground_speed * 100.0) as u16,
        cog: u16::MAX,
        fix_type: GpsFixType::GPS_FIX_TYPE_3D_FIX,
        satellites_visible: 12,
    })
}

/// `HOME_POSITION`: where it returns to \[m, world\].
pub fn home_position(home: &Vector3<f32>, origin: &Home) -> Payload {
    let place = origin.place_of(home);
    let [latitude, longitude] = place.integers();
    let [x, y, z] = ned_from_enu(home);
    Payload::of(&HOME_POSITION_DATA {
        latitude,
        longitude,
        altitude: millimetres(place.altitude_m),
        x,
        y,
        z,
        q: [1.0, 0.0, 0.0, 0.0],
        ..HOME_POSITION_DATA::default()
    })
}

/// `ALTITUDE`, over a floor at the world's z = 0.
pub fn altitude(state: &State<f32>, origin: &Home, time_usec: u64) -> Payload {
    let height_m = state.position.z;
    let above_sea_m = (origin.altitude_m + f64::from(height_m)) as f32;
    Payload::of(&ALTITUDE_DATA {
        time_usec,
        altitude_monotonic: above_sea_m,
        altitude_amsl: above_sea_m,
        altitude_local: height_m,
        altitude_relative: height_m,
        altitude_terrain: height_m,
        bottom_clearance: height_m,
    })
}

/// `VFR_HUD`, with the share of the greatest rotor speed as throttle.
pub fn vfr_hud(state: &State<f32>, origin: &Home, throttle: f32) -> Payload {
    let groundspeed = state.velocity.xy().norm();
    Payload::of(&VFR_HUD_DATA {
        airspeed: state.velocity.norm(),
        groundspeed,
        alt: (origin.altitude_m + f64::from(state.position.z)) as f32,
        climb: state.velocity.z,
        heading: heading(state).to_degrees() as i16,
        throttle: (throttle * 100.0) as u16,
    })
}

/// `POSITION_TARGET_LOCAL_NED`: the point that the pilot sees.
pub fn position_target(goal: &MovingGoal, time_boot_ms: u32) -> Payload {
    let [x, y, z] = ned_from_enu(&goal.position());
    let [vx, vy, vz] = ned_from_enu(&goal.velocity());
    Payload::of(&POSITION_TARGET_LOCAL_NED_DATA {
        time_boot_ms,
        x,
        y,
        z,
        vx,
        vy,
        vz,
        afx: 0.0,
        afy: 0.0,
        afz: 0.0,
        yaw: 0.0,
        yaw_rate: 0.0,
        // Accelerations, yaw and its rate are not meant.
        type_mask: PositionTargetTypemask::from_bits_truncate(0b1101_1100_0000),
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
    })
}

/// `SERVO_OUTPUT_RAW`: rotor targets as shares of the greatest speed, as 1000 µs to 2000 µs.
pub fn servo_output_raw(shares: [f32; 4], time_usec: u32) -> Payload {
    let [servo1_raw, servo2_raw, servo3_raw, servo4_raw] = shares.map(|share| (1000.0 + share * 1000.0) as u16);
    Payload::of(&SERVO_OUTPUT_RAW_DATA {
        time_usec,
        servo1_raw,
        servo2_raw,
        servo3_raw,
        servo4_raw,
        ..SERVO_OUTPUT_RAW_DATA::default()
    })
}

/// From north to the right, in \[0, 2π) \[rad\].
fn heading(state: &State<f32>) -> f64 {
    let [_, _, yaw] = ned_roll_pitch_yaw(&state.world_from_body);
    if yaw < 0.0 { yaw + TURN } else { yaw }
}

fn centi(value: f32) -> i16 {
    (value * 100.0) as i16
}

fn millimetres(metres: f64) -> i32 {
    (metres * 1000.0) as i32
}
