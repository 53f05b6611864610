//! The simulator's side of ArduPilot's JSON interface (`SIM_JSON.cpp`), datagrams in and datagrams out; the loop around
//! it is [`server`].
//!
//! ArduPilot sends a frame of servo pulses and waits for one line of JSON. Its reader is no JSON parser: it looks for
//! names as text, and a space behind a colon makes it fail, so the line is written without any. ArduPilot takes its time
//! from that line: whatever rate it asks for, a step is one control period of the plant.

pub mod server;

use core::fmt::{self, Write};

use kestrel_core::vehicle::State;

use super::frames::ned_from_frd;
use super::motors::throttle_of_pulse;
use super::sensors::Measurement;
use crate::message::ned_from_enu;
use crate::plant::Ranges;

/// First word of a frame of 16 and of 32 servos, and their lengths \[bytes\].
const FORMATS: [(u16, usize); 2] = [(18_458, 40), (29_569, 72)];

/// Where the pulses of the servos begin.
const PULSES_AT: usize = 8;

/// Longest line \[bytes\].
pub const LINE_LIMIT: usize = 640;

/// What a ranger that sees nothing is told to measure \[m\]: more than `RNGFNDx_MAX`.
const NOTHING_NEAR_M: f64 = 10.0;

/// A larger number is none that a simulation of a drone has; it keeps lines within their limit.
const NUMBER_LIMIT: f64 = 1e7;

/// One line for ArduPilot.
pub type JsonLine = heapless::String<LINE_LIMIT>;

/// A frame of servo pulses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Servos {
    /// Counts from zero; the same number again means that the answer was lost.
    pub count: u32,
    /// Throttles of the first four servos, 0 to 1.
    pub throttles: [f32; 4],
}

/// What a datagram asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ServoRequest {
    /// The next step, with these throttles.
    Step([f32; 4]),
    /// The last line again.
    Repeat,
}

/// A simulator that ArduPilot talks to.
#[derive(Clone, Debug, Default)]
pub struct ArdupilotSimulator {
    last_count: Option<u32>,
    steps: u64,
    restarts: u64,
    garbage: u64,
    line: JsonLine,
}

impl Servos {
    /// Reads a datagram; none if it is no frame of servos.
    pub fn read(datagram: &[u8]) -> Option<Self> {
        // Between the first word and the count stands the rate that it asks for.
        let [low, high, _, _, rest @ ..] = datagram else { return None };
        let first_word = u16::from_le_bytes([*low, *high]);
        FORMATS.contains(&(first_word, datagram.len())).then_some(())?;
        let count = rest.first_chunk::<4>()?;
        let pulse = |servo: usize| {
            let at = PULSES_AT + 2 * servo;
            throttle_of_pulse(f32::from(u16::from_le_bytes([datagram[at], datagram[at + 1]])))
        };
        Some(Self { count: u32::from_le_bytes(*count), throttles: core::array::from_fn(pulse) })
    }
}

impl ArdupilotSimulator {
    /// A simulator before the first request.
    pub fn new() -> Self {
        Self::default()
    }

    /// What a datagram asks for; nothing if it is no frame of servos, or an old one that arrives late.
    pub fn receive(&mut self, datagram: &[u8]) -> Option<ServoRequest> {
        let Some(servos) = Servos::read(datagram) else {
            self.garbage += 1;
            return None;
        };
        let last = self.last_count.replace(servos.count);
        match last {
            Some(last) if servos.count == last && !self.line.is_empty() => return Some(ServoRequest::Repeat),
            Some(last) if servos.count < last => self.restart(),
            None => self.restart(),
            Some(_) => {}
        }
        self.steps += 1;
        Some(ServoRequest::Step(servos.throttles))
    }

    /// ArduPilot counts from the beginning, and so does the time that it is told.
    fn restart(&mut self) {
        self.steps = 0;
        self.restarts += 1;
    }

    /// The line that answers a step, of `period_secs`: what a drone measures, and where it truly is.
    pub fn answer(&mut self, measurement: &Measurement, state: &State<f32>, period_secs: f64) -> &str {
        let secs = self.steps as f64 * period_secs;
        self.line.clear();
        if write_line(&mut self.line, secs, measurement, state).is_err() {
            // Longer than any line of finite numbers: none is sent, and ArduPilot asks again.
            self.line.clear();
        }
        &self.line
    }

    /// The last line.
    pub fn last_answer(&self) -> &str {
        &self.line
    }

    /// How often an ArduPilot began to count.
    pub fn restarts(&self) -> u64 {
        self.restarts
    }

    /// Datagrams that were no frames.
    pub fn garbage(&self) -> u64 {
        self.garbage
    }
}

fn write_line(line: &mut JsonLine, secs: f64, measurement: &Measurement, state: &State<f32>) -> fmt::Result {
    let attitude = ned_from_frd(&state.world_from_body);
    write!(line, "\n{{\"timestamp\":{:.6},\"imu\":{{\"gyro\":", finite(secs))?;
    write_numbers(line, &measurement.body_rates_frd.map(f64::from))?;
    line.write_str(",\"accel_body\":")?;
    write_numbers(line, &measurement.specific_force_frd.map(f64::from))?;
    line.write_str("},\"position\":")?;
    write_numbers(line, &ned_from_enu(&state.position).map(f64::from))?;
    line.write_str(",\"quaternion\":")?;
    write_numbers(line, &[attitude.w, attitude.x, attitude.y, attitude.z])?;
    line.write_str(",\"velocity\":")?;
    write_numbers(line, &ned_from_enu(&state.velocity).map(f64::from))?;
    if let Some(Ranges { front, back, left, right, up, down }) = measurement.ranges {
        for (number, distance_m) in (1..).zip([front, back, left, right, up, down]) {
            write!(line, ",\"rng_{number}\":{:.3}", finite(distance_m.map_or(NOTHING_NEAR_M, f64::from)))?;
        }
    }
    line.write_str("}\n")
}

fn write_numbers(line: &mut JsonLine, numbers: &[f64]) -> fmt::Result {
    for (index, number) in numbers.iter().enumerate() {
        let separator = if index == 0 { '[' } else { ',' };
        write!(line, "{separator}{:.6}", finite(*number))?;
    }
    line.write_char(']')
}

/// A number as it is written: finite, to the sixth digit, and zero without a sign.
fn finite(number: f64) -> f64 {
    let number = if number.is_finite() { number.clamp(-NUMBER_LIMIT, NUMBER_LIMIT) } else { 0.0 };
    libm::round(number * 1e6) / 1e6 + 0.0
}

#[cfg(test)]
mod tests;
