//! What the vehicle is doing, and how well it is.

use mavlink::dialects::common::{
    BATTERY_STATUS_DATA, CURRENT_MODE_DATA, EXTENDED_SYS_STATE_DATA, HEARTBEAT_DATA, MESSAGE_INTERVAL_DATA,
    MavBatteryFunction, MavBatteryType, MavLandedState, MavModeFlag, MavState, MavSysStatusSensor, MavType,
    NAMED_VALUE_FLOAT_DATA, NAMED_VALUE_INT_DATA, SYS_STATUS_DATA,
};

use super::identity::standard_mode;
use crate::autopilot::Mode;
use crate::battery::Battery;
use crate::flight_mode::FlightMode;
use crate::frame::Payload;
use crate::personality::Personality;

/// How well a vehicle is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleHealth {
    /// Whether the policy passes its self-test.
    pub policy: bool,
    /// Whether it is within its fence.
    pub inside_fence: bool,
    /// What is left.
    pub battery: Battery,
    /// Datagrams that were none.
    pub garbage: u64,
    /// Frames that were not signed as they must be.
    pub refused: u64,
}

/// `HEARTBEAT` of a quadrotor.
pub fn heartbeat(mode: Mode, flight_mode: FlightMode, personality: Personality) -> Payload {
    let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
    base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, mode.armed());
    base_mode.set(MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED, mode.flies());
    base_mode.set(MavModeFlag::MAV_MODE_FLAG_GUIDED_ENABLED, [Mode::Guided, Mode::Offboard].contains(&mode));
    base_mode.set(MavModeFlag::MAV_MODE_FLAG_MANUAL_INPUT_ENABLED, flight_mode == FlightMode::Position);
    base_mode.set(MavModeFlag::MAV_MODE_FLAG_AUTO_ENABLED, flight_mode == FlightMode::Mission);
    Payload::of(&HEARTBEAT_DATA {
        custom_mode: personality.custom_mode(flight_mode),
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: personality.autopilot(),
        base_mode,
        system_status: if mode.armed() { MavState::MAV_STATE_ACTIVE } else { MavState::MAV_STATE_STANDBY },
        mavlink_version: 3,
    })
}

/// `SYS_STATUS`: sensors and controllers are the simulator's and the pilot's, hence well. The first of the autopilot's own
/// counts of errors is that of refused frames; counts end at the greatest number that the message holds.
pub fn sys_status(health: &VehicleHealth) -> Payload {
    let check = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK;
    let fence = MavSysStatusSensor::MAV_SYS_STATUS_GEOFENCE;
    let present = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_GYRO
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_ACCEL
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_MAG
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_GPS
        | MavSysStatusSensor::MAV_SYS_STATUS_AHRS
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_ANGULAR_RATE_CONTROL
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_YAW_POSITION
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
        | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_BATTERY
        | fence
        | check;
    let mut well = present;
    well.set(check, health.policy);
    well.set(fence, health.inside_fence);
    Payload::of(&SYS_STATUS_DATA {
        onboard_control_sensors_present: present,
        onboard_control_sensors_enabled: present,
        onboard_control_sensors_health: well,
        voltage_battery: millivolts(&health.battery),
        current_battery: -1,
        battery_remaining: percent(&health.battery),
        errors_comm: counted(health.garbage),
        errors_count1: counted(health.refused),
        ..SYS_STATUS_DATA::default()
    })
}

/// `BATTERY_STATUS` of its one cell.
pub fn battery_status(battery: &Battery) -> Payload {
    let mut voltages = [u16::MAX; 10];
    voltages[0] = millivolts(battery);
    Payload::of(&BATTERY_STATUS_DATA {
        current_consumed: -1,
        energy_consumed: -1,
        temperature: i16::MAX,
        voltages,
        current_battery: -1,
        id: 0,
        battery_function: MavBatteryFunction::MAV_BATTERY_FUNCTION_ALL,
        mavtype: MavBatteryType::MAV_BATTERY_TYPE_LIPO,
        battery_remaining: percent(battery),
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

/// `CURRENT_MODE`.
pub fn current_mode(flight_mode: FlightMode, personality: Personality) -> Payload {
    let custom_mode = personality.custom_mode(flight_mode);
    Payload::of(&CURRENT_MODE_DATA {
        custom_mode,
        intended_custom_mode: custom_mode,
        standard_mode: standard_mode(flight_mode),
    })
}

/// `MESSAGE_INTERVAL` of a message \[µs\]: -1 if it is switched off, 0 if it is never sent.
pub fn message_interval(message_id: u16, interval_us: i32) -> Payload {
    Payload::of(&MESSAGE_INTERVAL_DATA { interval_us, message_id })
}

/// `NAMED_VALUE_FLOAT`; a name has at most ten bytes.
pub fn named_float(name: &str, value: f32, time_boot_ms: u32) -> Payload {
    Payload::of(&NAMED_VALUE_FLOAT_DATA { time_boot_ms, value, name: name.into() })
}

/// `NAMED_VALUE_INT`; a name has at most ten bytes.
pub fn named_integer(name: &str, value: i32, time_boot_ms: u32) -> Payload {
    Payload::of(&NAMED_VALUE_INT_DATA { time_boot_ms, value, name: name.into() })
}

/// Who has the control of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ControlStatus {
    /// MAVLink system, 0 for none.
    pub system_in_control: u8,
    /// Whether another one gets it who asks for it.
    pub takeover_allowed: bool,
}

/// `CONTROL_STATUS`; the vehicle hands out the control by itself.
pub fn control_status(status: ControlStatus) -> Payload {
    const SYSTEM_MANAGER: u8 = 1;
    const TAKEOVER_ALLOWED: u8 = 2;
    let (message_id, seed) = (512, 184);
    let takeover = if status.takeover_allowed { TAKEOVER_ALLOWED } else { 0 };
    Payload::new(message_id, seed, &[status.system_in_control, SYSTEM_MANAGER | takeover])
}

/// `MAV_CMD_REQUEST_OPERATOR_CONTROL` to who has the control (`holder`): another system asks for it.
pub fn request_for_control([_, action, takeover, secs]: [f32; 4], system: u8, holder: u8) -> Payload {
    let (message_id, seed) = (76, 152);
    let mut fields = [0; 33];
    for (place, number) in fields.chunks_exact_mut(4).zip([f32::from(system), action, takeover, secs]) {
        place.copy_from_slice(&number.to_le_bytes());
    }
    fields[28..30].copy_from_slice(&32_100_u16.to_le_bytes());
    fields[30] = holder;
    Payload::new(message_id, seed, &fields)
}

fn counted(count: u64) -> u16 {
    count.min(u16::MAX.into()) as u16
}

fn millivolts(battery: &Battery) -> u16 {
    (battery.voltage() * 1000.0) as u16
}

fn percent(battery: &Battery) -> i8 {
    libm::roundf(battery.remaining() * 100.0) as i8
}
