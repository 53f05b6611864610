//! What can be logged: the names, types and units of Bitcraze's firmware, read from the true state.
//!
//! Only what a simulated drone truly has is listed. Its battery is always full, its estimator always right, and its
//! rangers are ideal.

use kestrel_core::airframe::CF2X;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use super::contents::Listed;
use super::number::{Number, compressed};
use crate::plant::Ranges;

/// What the variables are read from.
#[derive(Clone, Copy, Debug)]
pub struct LogSource<'a> {
    /// True state.
    pub state: &'a State<f32>,
    /// Where the drone is to be \[m, world\].
    pub goal: Vector3<f32>,
    /// Bits of `supervisor.info`.
    pub supervision: u16,
    /// What rangers measure, if the drone has some.
    pub ranges: Option<Ranges>,
}

/// One variable of the table.
#[derive(Clone, Copy, Debug)]
pub struct Variable {
    group: &'static str,
    name: &'static str,
    /// As which it is stored.
    pub number: Number,
    read: fn(&LogSource) -> f64,
}

impl Variable {
    const fn new(group: &'static str, name: &'static str, number: Number, read: fn(&LogSource) -> f64) -> Self {
        Self { group, name, number, read }
    }

    /// Its value now, in the unit of the firmware.
    pub fn value(&self, source: &LogSource) -> f64 {
        (self.read)(source)
    }
}

impl Listed for Variable {
    fn group(&self) -> &'static str {
        self.group
    }

    fn name(&self) -> &'static str {
        self.name
    }

    fn code(&self) -> u8 {
        self.number.log_code()
    }
}

/// Voltage of a full battery \[V\].
const FULL_BATTERY: f64 = 4.2;

/// Bits of [`LogSource::supervision`] that have variables of their own.
pub mod supervision {
    /// A take-off would be obeyed.
    pub const CAN_FLY: u16 = 1 << 3;
    /// Motors turn.
    pub const FLYING: u16 = 1 << 4;
    /// Tilted beyond recovery.
    pub const TUMBLED: u16 = 1 << 5;
}

use Number::{Float, I8, I16, U8, U16, U32};

/// Every variable; its index is its number on the wire.
pub const TABLE: [Variable; 65] = [
    Variable::new("stateEstimate", "x", Float, |source| source.state.position.x.into()),
    Variable::new("stateEstimate", "y", Float, |source| source.state.position.y.into()),
    Variable::new("stateEstimate", "z", Float, |source| source.state.position.z.into()),
    Variable::new("stateEstimate", "vx", Float, |source| source.state.velocity.x.into()),
    Variable::new("stateEstimate", "vy", Float, |source| source.state.velocity.y.into()),
    Variable::new("stateEstimate", "vz", Float, |source| source.state.velocity.z.into()),
    Variable::new("stateEstimate", "roll", Float, roll_deg),
    Variable::new("stateEstimate", "pitch", Float, pitch_deg),
    Variable::new("stateEstimate", "yaw", Float, yaw_deg),
    Variable::new("stateEstimate", "qx", Float, |source| source.state.world_from_body.x.into()),
    Variable::new("stateEstimate", "qy", Float, |source| source.state.world_from_body.y.into()),
    Variable::new("stateEstimate", "qz", Float, |source| source.state.world_from_body.z.into()),
    Variable::new("stateEstimate", "qw", Float, |source| source.state.world_from_body.w.into()),
    Variable::new("stateEstimateZ", "x", I16, |source| thousandths(source.state.position.x)),
    Variable::new("stateEstimateZ", "y", I16, |source| thousandths(source.state.position.y)),
    Variable::new("stateEstimateZ", "z", I16, |source| thousandths(source.state.position.z)),
    Variable::new("stateEstimateZ", "vx", I16, |source| thousandths(source.state.velocity.x)),
    Variable::new("stateEstimateZ", "vy", I16, |source| thousandths(source.state.velocity.y)),
    Variable::new("stateEstimateZ", "vz", I16, |source| thousandths(source.state.velocity.z)),
    Variable::new("stateEstimateZ", "quat", U32, |source| compressed(&source.state.world_from_body).into()),
    Variable::new("stateEstimateZ", "rateRoll", I16, |source| thousandths(source.state.body_rates.x)),
    Variable::new("stateEstimateZ", "ratePitch", I16, |source| thousandths(-source.state.body_rates.y)),
    Variable::new("stateEstimateZ", "rateYaw", I16, |source| thousandths(source.state.body_rates.z)),
    Variable::new("stabilizer", "roll", Float, roll_deg),
    Variable::new("stabilizer", "pitch", Float, pitch_deg),
    Variable::new("stabilizer", "yaw", Float, yaw_deg),
    Variable::new("stabilizer", "thrust", Float, |source| {
        (0..4).map(|motor| ratio(source, motor)).sum::<f64>() / 4.0
    }),
    Variable::new("gyro", "x", Float, |source| degrees(source.state.body_rates.x)),
    Variable::new("gyro", "y", Float, |source| degrees(source.state.body_rates.y)),
    Variable::new("gyro", "z", Float, |source| degrees(source.state.body_rates.z)),
    Variable::new("kalman", "stateX", Float, |source| source.state.position.x.into()),
    Variable::new("kalman", "stateY", Float, |source| source.state.position.y.into()),
    Variable::new("kalman", "stateZ", Float, |source| source.state.position.z.into()),
    Variable::new("kalman", "varX", Float, exact),
    Variable::new("kalman", "varY", Float, exact),
    Variable::new("kalman", "varZ", Float, exact),
    Variable::new("kalman", "varPX", Float, exact),
    Variable::new("kalman", "varPY", Float, exact),
    Variable::new("kalman", "varPZ", Float, exact),
    Variable::new("ctrltarget", "x", Float, |source| source.goal.x.into()),
    Variable::new("ctrltarget", "y", Float, |source| source.goal.y.into()),
    Variable::new("ctrltarget", "z", Float, |source| source.goal.z.into()),
    Variable::new("motor", "m1", U16, |source| ratio(source, 0)),
    Variable::new("motor", "m2", U16, |source| ratio(source, 1)),
    Variable::new("motor", "m3", U16, |source| ratio(source, 2)),
    Variable::new("motor", "m4", U16, |source| ratio(source, 3)),
    Variable::new("motor", "m1_rpm", U16, |source| revolutions_per_minute(source, 0)),
    Variable::new("motor", "m2_rpm", U16, |source| revolutions_per_minute(source, 1)),
    Variable::new("motor", "m3_rpm", U16, |source| revolutions_per_minute(source, 2)),
    Variable::new("motor", "m4_rpm", U16, |source| revolutions_per_minute(source, 3)),
    Variable::new("pm", "vbat", Float, |_| FULL_BATTERY),
    Variable::new("pm", "vbatMV", U16, |_| FULL_BATTERY * 1e3),
    Variable::new("pm", "batteryLevel", U8, |_| 100.0),
    Variable::new("pm", "state", I8, |_| 0.0),
    Variable::new("supervisor", "info", U16, |source| source.supervision.into()),
    Variable::new("sys", "canfly", U8, |source| bit(source, supervision::CAN_FLY)),
    Variable::new("sys", "isFlying", U8, |source| bit(source, supervision::FLYING)),
    Variable::new("sys", "isTumbled", U8, |source| bit(source, supervision::TUMBLED)),
    Variable::new("kalman", "inFlight", U8, |source| bit(source, supervision::FLYING)),
    Variable::new("range", "front", U16, |source| millimetres(source.ranges.and_then(|ranges| ranges.front))),
    Variable::new("range", "back", U16, |source| millimetres(source.ranges.and_then(|ranges| ranges.back))),
    Variable::new("range", "left", U16, |source| millimetres(source.ranges.and_then(|ranges| ranges.left))),
    Variable::new("range", "right", U16, |source| millimetres(source.ranges.and_then(|ranges| ranges.right))),
    Variable::new("range", "up", U16, |source| millimetres(source.ranges.and_then(|ranges| ranges.up))),
    Variable::new("range", "zrange", U16, |source| millimetres(source.ranges.and_then(|ranges| ranges.down))),
];

/// What the firmware's rangers say of nothing.
const NOTHING_NEAR: f64 = 32767.0;

/// Variance of what is known exactly.
fn exact(_: &LogSource) -> f64 {
    0.0
}

fn angles_deg(source: &LogSource) -> [f64; 3] {
    source.state.world_from_body.map(f64::from).roll_pitch_yaw().map(f64::to_degrees)
}

fn roll_deg(source: &LogSource) -> f64 {
    angles_deg(source)[0]
}

/// The firmware counts a raised nose as positive, against the axes of its body frame.
fn pitch_deg(source: &LogSource) -> f64 {
    -angles_deg(source)[1]
}

fn yaw_deg(source: &LogSource) -> f64 {
    angles_deg(source)[2]
}

fn degrees(angle_rad: f32) -> f64 {
    f64::from(angle_rad).to_degrees()
}

/// For the compressed state, which ends at ±32 m, m/s or rad/s.
fn thousandths(value: f32) -> f64 {
    (f64::from(value) * 1e3).clamp(i16::MIN.into(), i16::MAX.into())
}

/// Share of its greatest thrust that a rotor has, in 1/65535.
fn ratio(source: &LogSource, motor: usize) -> f64 {
    let share = f64::from(source.state.rotor_speeds[motor]) / CF2X.rotor_speed_limit;
    (share * share).min(1.0) * f64::from(u16::MAX)
}

fn millimetres(distance_m: Option<f32>) -> f64 {
    distance_m.map_or(NOTHING_NEAR, |metres| (f64::from(metres) * 1e3).round())
}

fn revolutions_per_minute(source: &LogSource, motor: usize) -> f64 {
    f64::from(source.state.rotor_speeds[motor]) * 30.0 / core::f64::consts::PI
}

fn bit(source: &LogSource, mask: u16) -> f64 {
    if source.supervision & mask == 0 { 0.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use kestrel_core::attitude::Attitude;

    use super::*;
    use crate::crtp::contents;

    fn state() -> State<f32> {
        State {
            position: Vector3::new(1.0, -2.0, 0.5),
            world_from_body: Attitude::level(),
            velocity: Vector3::new(0.1, 0.2, -40.0),
            body_rates: Vector3::new(core::f32::consts::PI, 0.0, 0.0),
            rotor_speeds: [CF2X.rotor_speed_limit as f32, 0.0, 0.0, 0.0],
        }
    }

    fn value(group: &str, name: &str, source: &LogSource) -> f64 {
        let is_it = |variable: &&Variable| contents::is_called(*variable, group.as_bytes(), name.as_bytes());
        TABLE.iter().find(is_it).unwrap().value(source)
    }

    #[test]
    fn rangers_tell_millimetres_as_the_firmware_does() {
        let [front, back, left, right, up, down] = [Some(1.2345), None, Some(4.0), Some(0.0), None, Some(0.5)];
        let ranges = Some(Ranges { front, back, left, right, up, down });
        let source = LogSource { state: &state(), goal: Vector3::zeros(), supervision: 0, ranges };
        let found = ["front", "back", "left", "right", "up", "zrange"].map(|name| value("range", name, &source));
        assert_eq!(found, [1235.0, 32767.0, 4000.0, 0.0, 32767.0, 500.0]);
        assert_eq!(value("range", "front", &LogSource { ranges: None, ..source }), 32767.0);
    }

    #[test]
    fn the_table_fits_its_packets_and_names_nothing_twice() {
        contents::check(&TABLE);
    }

    /// Clients keep the table under this number. It may change only together with the table.
    #[test]
    fn the_checksum_of_the_table_is_stable() {
        assert_eq!(contents::checksum(&TABLE), 0x82E5_CED7);
    }

    #[test]
    fn values_are_in_the_firmware_s_units() {
        let source =
            LogSource { state: &state(), goal: Vector3::new(0.0, 0.0, 9.0), supervision: 0x0018, ranges: None };
        let expected = [
            ("stateEstimate", "y", -2.0),
            ("stateEstimateZ", "x", 1000.0),
            ("stateEstimateZ", "vz", -32768.0),
            ("gyro", "x", 180.0),
            ("ctrltarget", "z", 9.0),
            ("motor", "m1", 65535.0),
            ("motor", "m2", 0.0),
            ("stabilizer", "thrust", 65535.0 / 4.0),
            ("supervisor", "info", 24.0),
            ("sys", "canfly", 1.0),
            ("sys", "isFlying", 1.0),
            ("sys", "isTumbled", 0.0),
        ];
        for (group, name, expected) in expected {
            let found = value(group, name, &source);
            assert!((found - expected).abs() < 1e-2, "{group}.{name} is {found} instead of {expected}");
        }
        assert!((value("motor", "m1_rpm", &source) - 21_702.6).abs() < 0.1);
    }

    #[test]
    fn a_raised_nose_is_positive_and_a_left_turn_too() {
        // About +y the nose goes down.
        let turned = |axis: Vector3<f64>, angle_deg: f64| {
            let attitude = Attitude::from_axis_angle(axis, angle_deg.to_radians()).map(|part| part as f32);
            State { world_from_body: attitude, ..state() }
        };
        let angle = |name, axis, angle_deg| {
            let state = turned(axis, angle_deg);
            value(
                "stabilizer",
                name,
                &LogSource { state: &state, goal: Vector3::zeros(), supervision: 0, ranges: None },
            )
        };
        assert!((angle("pitch", Vector3::y(), -20.0) - 20.0).abs() < 1e-4);
        assert!((angle("roll", Vector3::x(), 30.0) - 30.0).abs() < 1e-4);
        assert!((angle("yaw", Vector3::z(), 100.0) - 100.0).abs() < 1e-4);
    }
}
