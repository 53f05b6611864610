//! The autopilot's side of PX4's lockstep: what a PX4-compatible simulator sends to a state, rotor targets to
//! `HIL_ACTUATOR_CONTROLS`. Bytes in and bytes out, no socket and no clock.
//!
//! The state is the simulator's own (`HIL_STATE_QUATERNION`), which is coarse (11 mm, 1 cm/s) and rarer than the sensor
//! messages; between two of them the inertial sensors carry it on. Nothing is estimated without it: the Crazyflie's
//! policies fly where a motion-capture system sees them.

use kestrel_core::airframe::GRAVITY;
use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::State;
use kestrel_onboard::fields::{f32_at, i32_at, u16_at, u64_at};
use mavlink::dialects::common::{
    COMMAND_LONG_DATA, HEARTBEAT_DATA, HIL_ACTUATOR_CONTROLS_DATA, HilActuatorControlsFlags, MavAutopilot, MavCmd,
    MavModeFlag,
};
use nalgebra::Vector3;

use crate::bridge::frames::enu_from_flu;
use crate::bridge::motors::Motors;
use crate::frame::{Encoder, Frame, Payload, Receiver};
use crate::geodesy::{Geodetic, Home};
use crate::message::enu_from_ned;

const SENSOR_ID: u32 = 107;
const STATE_ID: u32 = 115;

/// Interval of `HIL_STATE_QUATERNION` that is asked for \[µs\], as PX4 does.
const STATE_MICROS: f32 = 5000.0;

/// Sensor messages farther apart are a leap, not a step \[s\].
const STEP_LIMIT_SECS: f32 = 0.1;

/// Share of the difference to the simulator's position and velocity that each of its messages corrects: its rounding
/// errors must not shake the drone.
const CORRECTION: f32 = 0.2;

/// A state that the simulator has not confirmed for so long is none \[µs\].
const UNCONFIRMED_LIMIT_MICROS: u64 = 1_000_000;

/// A larger difference is a leap, not an error \[m\].
const LEAP_M: f32 = 0.5;

/// Greater rates \[rad/s\] and forces \[m/s²\] are none that a drone survives, and would overflow the state.
const SENSED_LIMIT: f32 = 1e4;

/// A lower sum of the squares of a quaternion is no attitude.
const ATTITUDE_SQUARE_LIMIT: f32 = 0.5;

/// The autopilot that a PX4-compatible simulator talks to.
#[derive(Debug)]
pub struct Producer {
    motors: Motors,
    encoder: Encoder,
    receiver: Receiver,
    throttles: [f32; 4],
    time_micros: Option<u64>,
    confirmed_micros: u64,
    origin: Option<Home>,
    state: Option<State<f32>>,
    garbage: u64,
}

/// A sensor message that waits for its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SensorReadings {
    /// Simulated time \[µs\].
    pub time_micros: u64,
}

impl Producer {
    /// An autopilot with these motors, disarmed.
    pub fn new(motors: Motors) -> Self {
        Self {
            motors,
            encoder: Encoder::new(1, 1),
            receiver: Receiver::new(),
            throttles: [0.0; 4],
            time_micros: None,
            confirmed_micros: 0,
            origin: None,
            state: None,
            garbage: 0,
        }
    }

    /// What PX4 says first: who it is, and that it wants the true state.
    pub fn introduce(&mut self, send: &mut dyn FnMut(&[u8])) {
        let heartbeat = HEARTBEAT_DATA { autopilot: MavAutopilot::MAV_AUTOPILOT_PX4, ..HEARTBEAT_DATA::default() };
        send(&self.encoder.encode(&Payload::of(&heartbeat)));
        let wanted = COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            param1: STATE_ID as f32,
            param2: STATE_MICROS,
            ..COMMAND_LONG_DATA::default()
        };
        send(&self.encoder.encode(&Payload::of(&wanted)));
    }

    /// Reads one byte of the stream from the simulator; it may complete a sensor message, which wants an answer.
    pub fn receive(&mut self, byte: u8) -> Option<SensorReadings> {
        let Ok(frame) = self.receiver.push(byte)? else {
            self.garbage += 1;
            return None;
        };
        let message = Received::read(&frame)?;
        match message {
            Received::Sensor(sensor) => {
                self.advance(&sensor);
                Some(SensorReadings { time_micros: sensor.time_micros })
            }
            Received::Truth(truth) => {
                self.correct(&truth);
                None
            }
        }
    }

    /// From now on answers with these rotor targets \[rad/s\], in the airframe's order.
    pub fn command(&mut self, rotor_targets: &[f32; 4]) {
        self.throttles = self.motors.throttles(rotor_targets);
    }

    /// Answers a sensor message.
    pub fn answer(&mut self, sensed: SensorReadings, send: &mut dyn FnMut(&[u8])) {
        let mut controls = [0.0; 16];
        controls[..4].copy_from_slice(&self.throttles);
        let turning = self.throttles.iter().any(|throttle| *throttle > 0.0);
        let armed = if turning { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
        let message = HIL_ACTUATOR_CONTROLS_DATA {
            time_usec: sensed.time_micros,
            flags: HilActuatorControlsFlags::HIL_ACTUATOR_CONTROLS_FLAGS_LOCKSTEP,
            controls,
            mode: MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | armed,
        };
        send(&self.encoder.encode(&Payload::of(&message)));
    }

    /// The state, in a world whose origin is where the simulator first said that the drone is; none before.
    pub fn state(&self) -> Option<&State<f32>> {
        self.state.as_ref()
    }

    /// Bytes and frames that were none.
    pub fn garbage(&self) -> u64 {
        self.garbage
    }

    /// Carries the state on with the inertial sensors.
    fn advance(&mut self, sensor: &Sensor) {
        let before = self.time_micros.replace(sensor.time_micros);
        let micros = before.and_then(|before| sensor.time_micros.checked_sub(before)).unwrap_or(0);
        let secs = micros as f32 * 1e-6;
        if sensor.time_micros.saturating_sub(self.confirmed_micros) > UNCONFIRMED_LIMIT_MICROS {
            self.state = None;
        }
        let Some(state) = &mut self.state else { return };
        if !(0.0..STEP_LIMIT_SECS).contains(&secs) {
            return;
        }
        state.body_rates = sensor.body_rates;
        let turning = state.world_from_body.derivative(sensor.body_rates);
        state.world_from_body = state.world_from_body.advanced(&turning, secs).normalized();
        let felt = state.world_from_body.rotate(sensor.specific_force);
        let acceleration = felt - Vector3::z() * GRAVITY as f32;
        state.velocity += acceleration * secs;
        state.position += state.velocity * secs;
    }

    /// Draws the state to the true one.
    fn correct(&mut self, truth: &Truth) {
        self.confirmed_micros = truth.time_micros;
        let origin = *self.origin.get_or_insert(Home {
            latitude_deg: truth.position.latitude_deg,
            longitude_deg: truth.position.longitude_deg,
            altitude_m: truth.position.altitude_m,
        });
        let position = origin.point_at(&truth.position);
        let told = State {
            position,
            world_from_body: truth.world_from_body,
            velocity: truth.velocity,
            body_rates: truth.body_rates,
            rotor_speeds: [0.0; 4],
        };
        self.state = Some(match &self.state {
            Some(state) if (state.position - position).norm() < LEAP_M => State {
                position: state.position + (position - state.position) * CORRECTION,
                velocity: state.velocity + (truth.velocity - state.velocity) * CORRECTION,
                ..told
            },
            Some(_) | None => told,
        });
    }
}

/// What a simulator says that is listened to; every number is finite and of the size that such numbers have.
enum Received {
    Sensor(Sensor),
    Truth(Truth),
}

/// `HIL_SENSOR`, in body axes FLU.
struct Sensor {
    time_micros: u64,
    specific_force: Vector3<f32>,
    body_rates: Vector3<f32>,
}

/// `HIL_STATE_QUATERNION`, in the world's frame.
struct Truth {
    time_micros: u64,
    position: Geodetic,
    world_from_body: Attitude<f32>,
    velocity: Vector3<f32>,
    body_rates: Vector3<f32>,
}

impl Received {
    fn read(frame: &Frame<'_>) -> Option<Self> {
        match frame.message_id {
            SENSOR_ID => Sensor::read(&frame.fields()).map(Self::Sensor),
            STATE_ID => Truth::read(&frame.fields()).map(Self::Truth),
            _ => None,
        }
    }
}

impl Sensor {
    fn read(fields: &[u8; 64]) -> Option<Self> {
        let time_micros = u64_at(fields, 0);
        Some(Self { time_micros, specific_force: flu_at(fields, 8)?, body_rates: flu_at(fields, 20)? })
    }
}

impl Truth {
    fn read(fields: &[u8; 64]) -> Option<Self> {
        let [w, x, y, z] = core::array::from_fn(|index| f32_at(fields, 8 + 4 * index));
        let square = w * w + x * x + y * y + z * z;
        if !square.is_finite() || square < ATTITUDE_SQUARE_LIMIT {
            return None;
        }
        let whole = |at: usize| i32_at(fields, at);
        let speed = |at: usize| f32::from(u16_at(fields, at) as i16) * 0.01;
        Some(Self {
            time_micros: u64_at(fields, 0),
            position: Geodetic {
                latitude_deg: f64::from(whole(36)) * 1e-7,
                longitude_deg: f64::from(whole(40)) * 1e-7,
                altitude_m: f64::from(whole(44)) * 1e-3,
            },
            world_from_body: enu_from_flu(&Attitude { w, x, y, z }.normalized()),
            velocity: enu_from_ned([speed(48), speed(50), speed(52)]),
            body_rates: flu_at(fields, 24)?,
        })
    }
}

/// A vector in FRD, turned into FLU, if it is one that can be sensed.
fn flu_at(fields: &[u8; 64], at: usize) -> Option<Vector3<f32>> {
    let [forward, right, down] = core::array::from_fn(|axis| f32_at(fields, at + 4 * axis));
    let vector = Vector3::new(forward, -right, -down);
    vector.iter().all(|value| value.abs() <= SENSED_LIMIT).then_some(vector)
}

#[cfg(test)]
mod tests;
