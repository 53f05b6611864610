//! The simulator's side of PX4's lockstep (`SimulatorMavlink.cpp`), bytes in and bytes out. No socket and no clock.
//!
//! PX4's clock is set by `HIL_SENSOR`: one is sent, one `HIL_ACTUATOR_CONTROLS` is awaited, the plant steps, and so on.
//! PX4 needs some sensor messages before it answers its first; until then the bridge does not wait for it.

pub mod client;
pub mod producer;
pub mod server;

use std::io::{self, ErrorKind};

use kestrel_core::vehicle::State;
use kestrel_onboard::fields::{f32_at, u16_at, u64_at};
use mavlink::dialects::common::{
    HIL_GPS_DATA, HIL_SENSOR_DATA, HIL_STATE_QUATERNION_DATA, HilSensorUpdatedFlags, RC_CHANNELS_DATA,
};

use super::frames::ned_from_frd;
use super::radio::Radio;
use super::sensors::{GnssFix, Measurement};
use crate::frame::{Encoder, Frame, Payload, Receiver};
use crate::geodesy::{Geodetic, Home};
use crate::message::sent::surroundings::distance_sensors;
use crate::message::{frd_from_flu, ned_from_enu};

/// Whether a socket only has nothing to say yet.
fn is_pause(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

/// Simulated time of the first sensor message \[µs\]: PX4 takes zero for "never".
const START_MICROS: u64 = 1_000_000;

/// `HIL_ACTUATOR_CONTROLS` and the places of its fields in the payload.
const ACTUATORS_ID: u32 = 93;
const ACTUATORS_LEN: usize = 81;
const CONTROLS_AT: usize = 16;
const MODE_AT: usize = 80;

/// `MAV_MODE_FLAG_SAFETY_ARMED`.
const ARMED: u8 = 128;

/// `COMMAND_LONG`, `MAV_CMD_SET_MESSAGE_INTERVAL` and the message that PX4 wants with it.
const COMMAND_ID: u32 = 76;
const SET_MESSAGE_INTERVAL: u16 = 511;
const STATE_ID: f32 = 115.0;

/// Interval of `HIL_STATE_QUATERNION` unless another is asked for \[µs\].
const STATE_MICROS: u64 = 20_000;

/// An answer that is older than this has a clock of its own, and is none to an earlier message \[µs\].
const STALE_LIMIT_MICROS: u64 = 1_000_000;

/// Interval of `RC_CHANNELS` \[µs\].
const RADIO_MICROS: u64 = 100_000;

/// Fields of the accelerometer and the gyroscope.
const FAST_FIELDS: u32 = 0x7 | 0x38;

/// PX4 keeps specific forces \[m/s²\] and body rates \[rad/s\] in 16 bits, in these units; what does not fit would reach it
/// with the other sign.
const FORCE_UNIT: f32 = 9.80665 / 2048.0;
const RATE_UNIT: f32 = 2000.0 / 32768.0 * core::f32::consts::PI / 180.0;

/// Fields of the magnetometer and the barometer: PX4 takes a group only with all of its bits.
const SLOW_FIELDS: u32 = 0x1C0 | 0x1A00;

/// A fix in three dimensions (`GPS_FIX_TYPE_3D_FIX`).
const FIX_3D: u8 = 3;

/// Accuracies of a fix as PX4 reads them here \[cm\], horizontal and vertical; below, it would wait for better ones.
const ACCURACIES_CM: [u16; 2] = [30, 50];

/// Satellites of every fix: PX4 wants six.
const SATELLITES: u8 = 12;

/// Course over ground that is not known.
const COURSE_UNKNOWN: u16 = u16::MAX;

/// A simulator that PX4 talks to.
pub struct Px4Simulator {
    home: Home,
    radio: Option<Radio>,
    encoder: Encoder,
    receiver: Receiver,
    period_nanos: u64,
    step: u64,
    /// Step at which PX4 woke up: what is sent now and then counts from it.
    start: u64,
    state_interval_steps: Option<u64>,
    throttles: [f32; 4],
    phase: Phase,
    answered: bool,
    garbage: u64,
}

/// How far a PX4 has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// It has not answered yet: the bridge does not wait for it.
    Asleep,
    /// It has answered an older sensor message than the last one.
    Awake,
    /// It has answered the last one: both are in step.
    Engaged,
}

impl Px4Simulator {
    /// A simulator at home that sends so many sensor messages per simulated second.
    pub fn new(home: Home, rate_hz: u32, radio: Option<Radio>) -> Self {
        let period_nanos = 1_000_000_000 / u64::from(rate_hz.max(1));
        Self {
            home,
            radio,
            encoder: Encoder::new(1, 200),
            receiver: Receiver::new(),
            period_nanos,
            step: 0,
            start: 0,
            state_interval_steps: Some(steps(STATE_MICROS, period_nanos)),
            throttles: [0.0; 4],
            phase: Phase::Asleep,
            answered: false,
            garbage: 0,
        }
    }

    /// Begins again with another PX4: motors stand still until it commands them. Time goes on.
    pub fn reconnect(&mut self) {
        self.receiver = Receiver::new();
        self.state_interval_steps = Some(steps(STATE_MICROS, self.period_nanos));
        self.throttles = [0.0; 4];
        self.phase = Phase::Asleep;
        self.answered = false;
    }

    /// Time of the next sensor message \[µs\], strictly increasing.
    fn time_micros(&self) -> u64 {
        START_MICROS + self.step * self.period_nanos / 1000
    }

    /// Time of the last sensor message \[µs\].
    fn last_micros(&self) -> u64 {
        START_MICROS + self.step.saturating_sub(1) * self.period_nanos / 1000
    }

    /// Sends what a drone measures, one frame after the other; the sensors last, for they set PX4's clock.
    pub fn send(&mut self, measurement: &Measurement, state: &State<f32>, send: &mut dyn FnMut(&[u8])) {
        let time_usec = self.time_micros();
        if let Some(fix) = &measurement.fix {
            self.send_payload(&hil_gps(fix, time_usec), send);
        }
        let flown = self.step - self.start;
        if self.state_interval_steps.is_some_and(|interval| flown.is_multiple_of(interval)) {
            let payload = hil_state(state, &self.home, measurement, time_usec);
            self.send_payload(&payload, send);
        }
        if let Some(radio) = self.radio
            && flown.is_multiple_of(steps(RADIO_MICROS, self.period_nanos))
        {
            self.send_payload(&rc_channels(&radio, time_usec), send);
        }
        if let Some(ranges) = &measurement.ranges {
            for payload in distance_sensors(ranges, (time_usec / 1000) as u32) {
                self.send_payload(&payload, send);
            }
        }
        self.send_payload(&hil_sensor(measurement, time_usec), send);
        self.step += 1;
        self.answered = false;
    }

    fn send_payload(&mut self, payload: &Payload, send: &mut dyn FnMut(&[u8])) {
        send(&self.encoder.encode(payload));
    }

    /// Reads bytes of the stream from PX4.
    pub fn receive(&mut self, bytes: &[u8]) {
        for byte in bytes {
            let Some(frame) = self.receiver.push(*byte) else { continue };
            match frame.map(|frame| Received::read(&frame)) {
                Ok(Some(Received::Actuators(actuators))) => self.handle(&actuators),
                Ok(Some(Received::StateInterval(micros))) => self.set_state_interval(micros),
                Ok(None) => {}
                Err(_) => self.garbage += 1,
            }
        }
    }

    fn handle(&mut self, actuators: &Actuators) {
        self.throttles = actuators.throttles;
        if self.is_stale(actuators.time_micros) {
            if self.phase == Phase::Asleep {
                self.phase = Phase::Awake;
            }
            return;
        }
        if self.phase != Phase::Engaged {
            self.start = self.step;
            self.phase = Phase::Engaged;
        }
        self.answered = true;
    }

    /// Whether an answer belongs to an earlier sensor message: those that PX4 had not read when it woke up.
    fn is_stale(&self, answer_micros: u64) -> bool {
        let last_micros = self.last_micros();
        answer_micros < last_micros && last_micros - answer_micros < STALE_LIMIT_MICROS
    }

    fn set_state_interval(&mut self, micros: f32) {
        self.state_interval_steps = if micros > 0.0 {
            Some(steps(micros as u64, self.period_nanos))
        } else if micros == 0.0 {
            Some(steps(STATE_MICROS, self.period_nanos))
        } else {
            None
        };
    }

    /// Whether PX4 has answered the last sensor message.
    pub fn answered(&self) -> bool {
        self.answered
    }

    /// Whether PX4 has ever answered, be it late.
    pub fn awake(&self) -> bool {
        self.phase != Phase::Asleep
    }

    /// Whether PX4 answers sensor messages one by one.
    pub fn engaged(&self) -> bool {
        self.phase == Phase::Engaged
    }

    /// The last command, as PX4 numbers its motors; zeros while it is disarmed. Not limited yet.
    pub fn throttles(&self) -> [f32; 4] {
        self.throttles
    }

    /// Bytes and frames that were none.
    pub fn garbage(&self) -> u64 {
        self.garbage
    }
}

/// What PX4 says that is listened to.
enum Received {
    Actuators(Actuators),
    /// Of `HIL_STATE_QUATERNION` \[µs\].
    StateInterval(f32),
}

/// `HIL_ACTUATOR_CONTROLS`.
struct Actuators {
    /// Time of the sensor message that it answers \[µs\]: PX4's clock.
    time_micros: u64,
    throttles: [f32; 4],
}

impl Received {
    fn read(frame: &Frame<'_>) -> Option<Self> {
        match frame.message_id {
            ACTUATORS_ID => Some(Self::Actuators(Actuators::read(&frame.fields()))),
            COMMAND_ID => state_interval(&frame.fields()).map(Self::StateInterval),
            _ => None,
        }
    }
}

impl Actuators {
    fn read(fields: &[u8; ACTUATORS_LEN]) -> Self {
        let armed = fields[MODE_AT] & ARMED != 0;
        let control = |motor: usize| if armed { f32_at(fields, CONTROLS_AT + 4 * motor) } else { 0.0 };
        Self { time_micros: u64_at(fields, 0), throttles: core::array::from_fn(control) }
    }
}

fn state_interval(fields: &[u8; 33]) -> Option<f32> {
    (u16_at(fields, 28) == SET_MESSAGE_INTERVAL && f32_at(fields, 0) == STATE_ID).then(|| f32_at(fields, 4))
}

/// Whole steps in an interval \[µs\], at least one.
fn steps(micros: u64, period_nanos: u64) -> u64 {
    ((micros.saturating_mul(1000) + period_nanos / 2) / period_nanos).max(1)
}

fn hil_sensor(measurement: &Measurement, time_usec: u64) -> Payload {
    let [xacc, yacc, zacc] = measurement.specific_force_frd.map(|force| saturated(force, FORCE_UNIT));
    let [xgyro, ygyro, zgyro] = measurement.body_rates_frd.map(|rate| saturated(rate, RATE_UNIT));
    let mut message =
        HIL_SENSOR_DATA { time_usec, xacc, yacc, zacc, xgyro, ygyro, zgyro, ..HIL_SENSOR_DATA::default() };
    let mut fields = FAST_FIELDS;
    if let Some(ambient) = &measurement.ambient {
        [message.xmag, message.ymag, message.zmag] = ambient.magnetic_field_frd_gauss;
        message.abs_pressure = 0.01 * ambient.pressure_pa;
        message.pressure_alt = ambient.pressure_altitude_m;
        message.temperature = ambient.temperature_celsius;
        fields |= SLOW_FIELDS;
    }
    message.fields_updated = HilSensorUpdatedFlags::from_bits_truncate(fields);
    Payload::of(&message)
}

/// Limited to what 16 bits hold of this unit.
fn saturated(value: f32, unit: f32) -> f32 {
    let limit = f32::from(i16::MAX) * unit;
    value.clamp(-limit, limit)
}

fn hil_gps(fix: &GnssFix, time_usec: u64) -> Payload {
    let [lat, lon, alt] = global(&fix.position);
    let [vn, ve, vd] = fix.velocity_ned.map(|speed| (100.0 * speed) as i16);
    let [eph, epv] = ACCURACIES_CM;
    let vel = (100.0 * libm::hypotf(fix.velocity_ned[0], fix.velocity_ned[1])) as u16;
    Payload::of(&HIL_GPS_DATA {
        time_usec,
        lat,
        lon,
        alt,
        eph,
        epv,
        vel,
        vn,
        ve,
        vd,
        cog: COURSE_UNKNOWN,
        fix_type: FIX_3D,
        satellites_visible: SATELLITES,
    })
}

fn hil_state(state: &State<f32>, home: &Home, measurement: &Measurement, time_usec: u64) -> Payload {
    let [lat, lon, alt] = global(&home.place_of(&state.position));
    let [rollspeed, pitchspeed, yawspeed] = frd_from_flu(&state.body_rates);
    let [vx, vy, vz] = ned_from_enu(&state.velocity).map(|speed| (100.0 * speed) as i16);
    let attitude = ned_from_frd(&state.world_from_body);
    let [xacc, yacc, zacc] = measurement.specific_force_frd.map(|force| (force * (1000.0 / 9.80665)) as i16);
    Payload::of(&HIL_STATE_QUATERNION_DATA {
        time_usec,
        attitude_quaternion: [attitude.w, attitude.x, attitude.y, attitude.z].map(|value| value as f32),
        rollspeed,
        pitchspeed,
        yawspeed,
        lat,
        lon,
        alt,
        vx,
        vy,
        vz,
        ind_airspeed: 0,
        true_airspeed: (100.0 * state.velocity.norm()) as u16,
        xacc,
        yacc,
        zacc,
    })
}

/// Latitude and longitude \[1e-7 deg\] and altitude \[mm\].
fn global(position: &Geodetic) -> [i32; 3] {
    [1e7 * position.latitude_deg, 1e7 * position.longitude_deg, 1e3 * position.altitude_m]
        .map(|value| libm::round(value) as i32)
}

fn rc_channels(radio: &Radio, time_usec: u64) -> Payload {
    let channel = |number: usize| radio.pulse_us(number).unwrap_or(u16::MAX);
    Payload::of(&RC_CHANNELS_DATA {
        time_boot_ms: (time_usec / 1000) as u32,
        chan1_raw: channel(1),
        chan2_raw: channel(2),
        chan3_raw: channel(3),
        chan4_raw: channel(4),
        chan5_raw: channel(5),
        chan6_raw: channel(6),
        chan7_raw: channel(7),
        chan8_raw: channel(8),
        chan9_raw: channel(9),
        chan10_raw: channel(10),
        chan11_raw: channel(11),
        chan12_raw: channel(12),
        chan13_raw: channel(13),
        chan14_raw: channel(14),
        chan15_raw: channel(15),
        chan16_raw: channel(16),
        chan17_raw: u16::MAX,
        chan18_raw: u16::MAX,
        chancount: radio.len(),
        rssi: u8::MAX,
    })
}

#[cfg(test)]
mod tests;
