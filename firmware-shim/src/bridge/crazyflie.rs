//! The simulator's side of CrazySim's interface, behind which Bitcraze's firmware runs on a host (`socketlink.c`,
//! `sensors_sitl.c` and `power_distribution_sitl.c` there, April 2024), packets of CRTP in and out; the loop around it is
//! [`server`].
//!
//! The firmware's stabiliser makes one step for every sample of accelerometer and gyroscope, and answers with the ratios of
//! its motors, thrust as a share of the greatest, at most once in a tick of its own clock. Where it is, a motion-capture
//! system tells it 100 times a second, as its users have it. Whatever else it says is for a client, and what a client says
//! is for it.

pub mod server;

use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use super::noise::{Noise, Purpose};
use super::sensors::Measurement;
use crate::crtp::packet::{PACKET_LIMIT, Packet, Port};
use crate::message::frd_from_flu;

/// What a firmware sends until it is answered with the same, before anything else.
pub const HELLO: u8 = 0xF3;

/// Steps of the firmware's stabiliser in a second.
pub const RATE_HZ: u32 = 1000;

/// Steps from one pose of the motion capture to the next.
const STEPS_PER_POSE: u64 = 10;

/// Samples and motors have the number that newer firmwares give to their supervisor (`CRTP_PORT_SETPOINT_SIM`).
const SIMULATION: Port = Port::Supervisor;

/// First byte of a sample of accelerometer and gyroscope.
const INERTIAL: u8 = 0;

/// Channel of poses at the port of localization, and their type there (`EXT_POSE`).
const GENERIC_CHANNEL: u8 = 1;
const POSE: u8 = 8;

/// Resolution of the samples \[°/s, g\]: ±2000 °/s and ±16 g in 16 bits.
const DEGREES_PER_SECOND: f32 = 4000.0 / 65536.0;
const EARTH_GRAVITIES: f32 = 32.0 / 65536.0;

/// As the firmware has it \[m/s²\].
const STANDARD_GRAVITY: f32 = 9.81;

/// Noise of the motion capture along each axis \[m\] and about it \[rad\].
const POSITION_DEVIATION: f32 = 1e-3;
const ATTITUDE_DEVIATION: f32 = 2e-3;

/// Motor outputs: a header and four ratios of 16 bits.
const MOTORS_LEN: usize = 9;

/// A packet as it is sent.
pub type PacketBytes = heapless::Vec<u8, PACKET_LIMIT>;

/// What a datagram of the firmware is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Said {
    /// It has started, and waits for the same.
    Hello,
    /// Motor outputs, kept.
    Motors,
    /// A packet for a client.
    ForClient,
    /// None of these.
    Garbage,
}

/// A simulator that a firmware talks to.
#[derive(Clone, Debug)]
pub struct CrazyflieSimulator {
    noise: Noise,
    steps: u64,
    throttles: [f32; 4],
    engaged: bool,
    /// Samples since the last motor outputs.
    waiting: u32,
    garbage: u64,
}

impl CrazyflieSimulator {
    /// A simulator whose motion capture errs as `noise` says.
    pub const fn new(noise: Noise) -> Self {
        Self { noise, steps: 0, throttles: [0.0; 4], engaged: false, waiting: 0, garbage: 0 }
    }

    /// The sample of a step, which is to be answered.
    pub fn sample(&mut self, measurement: &Measurement) -> PacketBytes {
        self.waiting += 1;
        // Forward, right and down from forward, left and up is the same as back.
        let force = frd_from_flu(&Vector3::from(measurement.specific_force_frd));
        let rates = frd_from_flu(&Vector3::from(measurement.body_rates_frd));
        let counts = force
            .map(|force| count(force / STANDARD_GRAVITY / EARTH_GRAVITIES))
            .into_iter()
            .chain(rates.map(|rate| count(rate.to_degrees() / DEGREES_PER_SECOND)));
        counts
            .fold(Packet::new(SIMULATION, 0).with(&[INERTIAL]), |packet, count| packet.with(&count.to_le_bytes()))
            .encode()
    }

    /// Where the drone is, with the steps in which the motion capture says so. Counts the steps.
    pub fn pose(&mut self, state: &State<f32>) -> Option<PacketBytes> {
        let step = self.steps;
        self.steps += 1;
        step.is_multiple_of(STEPS_PER_POSE).then(|| {
            let off = |purpose, deviation| Vector3::from(self.noise.normals(purpose, step)) * deviation;
            let position = state.position + off(Purpose::MotionCapturePosition, POSITION_DEVIATION);
            let turn = off(Purpose::MotionCaptureAttitude, ATTITUDE_DEVIATION);
            let error = Attitude { w: 1.0, x: 0.5 * turn.x, y: 0.5 * turn.y, z: 0.5 * turn.z };
            let Attitude { w, x, y, z } = error.after(&state.world_from_body).normalized();
            let numbers = [position.x, position.y, position.z, x, y, z, w];
            let head = Packet::new(Port::Localization, GENERIC_CHANNEL).with(&[POSE]);
            numbers.into_iter().fold(head, |packet, number| packet.with(&number.to_le_bytes())).encode()
        })
    }

    /// Reads a datagram of the firmware.
    pub fn receive(&mut self, datagram: &[u8]) -> Said {
        if datagram == [HELLO] {
            return Said::Hello;
        }
        match (Packet::parse(datagram), ratios(datagram)) {
            (Some(packet), Some(ratios)) if packet.port == SIMULATION => {
                self.throttles = ratios.map(|ratio| f32::from(ratio) / f32::from(u16::MAX));
                self.engaged = true;
                self.waiting = 0;
                Said::Motors
            }
            // The firmware answers samples with a byte once its gyroscope is calibrated: no client asked for it.
            (Some(packet), _) if packet.port == SIMULATION => Said::Garbage,
            (Some(_), _) => Said::ForClient,
            (None, _) => {
                self.garbage += 1;
                Said::Garbage
            }
        }
    }

    /// Motors stand still until a firmware commands them again, which counts its steps from zero.
    pub const fn restart(&mut self) {
        *self = Self { garbage: self.garbage, ..Self::new(self.noise) };
    }

    /// Samples that have not been answered yet.
    pub const fn waiting(&self) -> u32 {
        self.waiting
    }

    /// Whether any ever was.
    pub const fn engaged(&self) -> bool {
        self.engaged
    }

    /// The last motor outputs, 0 to 1, clockwise from the front right.
    pub const fn throttles(&self) -> [f32; 4] {
        self.throttles
    }

    /// Datagrams that were no packets.
    pub const fn garbage(&self) -> u64 {
        self.garbage
    }
}

/// The nearest number of 16 bits.
fn count(value: f32) -> i16 {
    value.round() as i16
}

fn ratios(datagram: &[u8]) -> Option<[u16; 4]> {
    let bytes: &[u8; MOTORS_LEN] = datagram.try_into().ok()?;
    Some(core::array::from_fn(|motor| u16::from_le_bytes([bytes[1 + 2 * motor], bytes[2 + 2 * motor]])))
}

#[cfg(test)]
mod tests;
