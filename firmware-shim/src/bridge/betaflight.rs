//! The simulator's side of Betaflight's simulation target (`SIMULATOR/sitl.c`), datagrams in and datagrams out; the loop
//! around it is [`server`].
//!
//! State and sticks go out, motor outputs come in, once per state. Betaflight also sends the outputs as shares (port
//! 9002), but in an order that changed between its releases of 2025 and 2026; the pulses on port 9001 always were in
//! Betaflight's own order, and are what is obeyed here.

pub mod server;

use core::f64::consts::FRAC_1_SQRT_2;

use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::State;

use super::motors::throttle_of_pulse;
use super::radio::Radio;
use super::sensors::{Ambient, Measurement};
use crate::geodesy::{Geodetic, Home};

/// Bytes of a state: eighteen doubles.
pub const STATE_LEN: usize = 144;

/// Bytes of the sticks: a double and sixteen channels.
pub const RADIO_LEN: usize = 40;

/// Bytes of the motor outputs: their number in four bytes, and sixteen floats.
const PULSES_LEN: usize = 68;

/// A quarter turn about up.
const NWU_FROM_ENU: Attitude<f64> = Attitude { w: FRAC_1_SQRT_2, x: 0.0, y: 0.0, z: -FRAC_1_SQRT_2 };

/// Half a turn about up.
const WSU_FROM_ENU: Attitude<f64> = Attitude { w: 0.0, x: 0.0, y: 0.0, z: 1.0 };

/// Pulse of a channel that the radio does not have, and of the sticks' middle \[µs\].
const MIDDLE_US: u16 = 1500;

/// The simulators that a Betaflight may be built for (`ENABLE_GAZEBO_BRIDGE`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BetaflightBuild {
    /// Gazebo, the default: it undoes the frames of that simulator's plug-in.
    Gazebo,
    /// X-Plane and RealFlight: plain NED, FRD and positions.
    Legacy,
}

/// A simulator that Betaflight talks to.
#[derive(Clone, Debug)]
pub struct BetaflightSimulator {
    home: Home,
    build: BetaflightBuild,
    radio: Option<Radio>,
    pressure_pa: f32,
    throttles: [f32; 4],
    engaged: bool,
    answered: bool,
    garbage: u64,
}

impl BetaflightSimulator {
    /// A simulator at home for one kind of build.
    pub fn new(home: Home, build: BetaflightBuild, radio: Option<Radio>) -> Self {
        Self {
            home,
            build,
            radio,
            pressure_pa: 0.0,
            throttles: [0.0; 4],
            engaged: false,
            answered: false,
            garbage: 0,
        }
    }

    /// The state at a time since the start \[s\], as Betaflight reads it.
    pub fn send(&mut self, measurement: &Measurement, state: &State<f32>, secs: f64) -> [u8; STATE_LEN] {
        if let Some(Ambient { pressure_pa, .. }) = measurement.ambient {
            self.pressure_pa = pressure_pa;
        }
        self.answered = false;
        let [roll, pitch, yaw] = self.body_rates(measurement);
        let [forward, right, down] = measurement.specific_force_frd.map(f64::from);
        let Attitude { w, x, y, z } = self.attitude(state);
        let velocity = state.velocity.map(f64::from);
        let Geodetic { latitude_deg, longitude_deg, altitude_m } = self.position(state);
        let numbers: [f64; STATE_LEN / 8] = [
            secs,
            roll,
            pitch,
            yaw,
            // Betaflight negates all three, and takes what becomes of them for forward, left and up.
            -forward,
            right,
            down,
            w,
            x,
            y,
            z,
            velocity.x,
            velocity.y,
            velocity.z,
            longitude_deg,
            latitude_deg,
            altitude_m,
            f64::from(self.pressure_pa),
        ];
        let mut bytes = [0; STATE_LEN];
        for (place, number) in bytes.chunks_exact_mut(8).zip(numbers) {
            place.copy_from_slice(&number.to_le_bytes());
        }
        bytes
    }

    /// Roll, pitch and yaw \[rad/s\] that become rates about forward, left and up: Betaflight negates pitch, and yaw only
    /// if it is not built for Gazebo. Its comments have yaw clockwise there, but its mixer and estimator do not.
    fn body_rates(&self, measurement: &Measurement) -> [f64; 3] {
        let [roll, pitch, yaw] = measurement.body_rates_frd.map(f64::from);
        match self.build {
            BetaflightBuild::Gazebo => [roll, pitch, -yaw],
            BetaflightBuild::Legacy => [roll, pitch, yaw],
        }
    }

    /// North, west and up from forward, left and up is what Betaflight flies by. For Gazebo, what becomes it: Betaflight
    /// negates y and z, and turns west and south to north and west.
    fn attitude(&self, state: &State<f32>) -> Attitude<f64> {
        let enu_from_flu = state.world_from_body.map(f64::from);
        match self.build {
            BetaflightBuild::Gazebo => {
                let wsu_from_flu = WSU_FROM_ENU.after(&enu_from_flu);
                Attitude { y: -wsu_from_flu.y, z: -wsu_from_flu.z, ..wsu_from_flu }
            }
            BetaflightBuild::Legacy => NWU_FROM_ENU.after(&enu_from_flu),
        }
    }

    /// Where the drone is; for Gazebo mirrored at home, as Betaflight mirrors it back.
    fn position(&self, state: &State<f32>) -> Geodetic {
        let global = self.home.place_of(&state.position);
        match self.build {
            BetaflightBuild::Gazebo => Geodetic {
                latitude_deg: 2.0 * self.home.latitude_deg - global.latitude_deg,
                longitude_deg: 2.0 * self.home.longitude_deg - global.longitude_deg,
                ..global
            },
            BetaflightBuild::Legacy => global,
        }
    }

    /// The sticks at a time since the start \[s\], if there is a radio.
    pub fn sticks(&self, secs: f64) -> Option<[u8; RADIO_LEN]> {
        let radio = self.radio?;
        let mut bytes = [0; RADIO_LEN];
        let (time, channels) = bytes.split_at_mut(8);
        time.copy_from_slice(&secs.to_le_bytes());
        for (index, place) in channels.chunks_exact_mut(2).enumerate() {
            place.copy_from_slice(&radio.pulse_us(index + 1).unwrap_or(MIDDLE_US).to_le_bytes());
        }
        Some(bytes)
    }

    /// Reads a datagram of motor outputs.
    pub fn receive(&mut self, datagram: &[u8]) {
        match throttles(datagram) {
            Some(throttles) => {
                self.throttles = throttles;
                self.engaged = true;
                self.answered = true;
            }
            None => self.garbage += 1,
        }
    }

    /// Motors stand still until a Betaflight commands them again.
    pub fn disengage(&mut self) {
        self.throttles = [0.0; 4];
        self.engaged = false;
    }

    /// Whether motor outputs have come since the last state.
    pub fn answered(&self) -> bool {
        self.answered
    }

    /// Whether any have ever come.
    pub fn engaged(&self) -> bool {
        self.engaged
    }

    /// The last motor outputs, 0 to 1, in Betaflight's order.
    pub fn throttles(&self) -> [f32; 4] {
        self.throttles
    }

    /// Datagrams that were none.
    pub fn garbage(&self) -> u64 {
        self.garbage
    }
}

/// Throttles of a datagram of motor outputs for at least four motors; none if it is none.
fn throttles(datagram: &[u8]) -> Option<[f32; 4]> {
    let bytes: &[u8; PULSES_LEN] = datagram.try_into().ok()?;
    let motors = u16::from_le_bytes([bytes[0], bytes[1]]);
    (4..=16).contains(&motors).then_some(())?;
    Some(core::array::from_fn(|motor| {
        let at = 4 + 4 * motor;
        throttle_of_pulse(f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]))
    }))
}

#[cfg(test)]
mod tests;
