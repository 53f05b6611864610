//! Processor in the loop: the protocol by which a policy backend on another processor is asked over a serial line.
//!
//! A frame is [`START`], the kind, the length of the payload in two bytes, the payload, and the CRC-32 of all but the start; numbers are
//! little-endian. The side that asks sends one frame and waits for its answer:
//!
//! | asked | payload | answered | payload |
//! |---|---|---|---|
//! | [`MessageKind::Policy`] | a policy file | [`MessageKind::Code`] | `i32`: zero, or [`PolicyError::code`] |
//! | [`MessageKind::Reset`] | | [`MessageKind::Code`] | zero, or [`NO_POLICY`] |
//! | [`MessageKind::Test`] | | [`MessageKind::Code`] | zero, [`NO_POLICY`], or [`PolicyError::code`] of the self-test |
//! | [`MessageKind::Tick`] | 13 `f32` of the state, 3 of the goal, the heading, then measurements | [`MessageKind::Targets`] | 4 `f32`, rad/s |
//!
//! Whatever is damaged, too long or asked at the wrong time is answered by a [`MessageKind::Code`] from 100 on, and nothing else happens.

use crate::attitude::Attitude;
use crate::crc32::Crc32;
use crate::observation::OBSERVATION_LIMIT;
use crate::pilot::{Pilot, StatePolicy};
use crate::setpoint::Setpoint;
use crate::vehicle::State;
use nalgebra::Vector3;

#[cfg(doc)]
use crate::policy_file::PolicyError;

/// The first byte of every frame.
pub const START: u8 = 0x4b;

/// There is no policy that could fly.
pub const NO_POLICY: i32 = 100;

/// The frame was damaged on its way, or is of no known kind.
pub const DAMAGED: i32 = 102;

/// The payload is longer than the room for it, or not as long as its kind asks for.
pub const LENGTH: i32 = 103;

/// Numbers of a state, a goal and a heading.
const STATE_LEN: usize = 17;

/// Most numbers of a tick.
const TICK_LIMIT: usize = STATE_LEN + OBSERVATION_LIMIT;

/// What a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum MessageKind {
    /// A policy to fly from now on.
    Policy = 1,
    /// An episode begins.
    Reset = 2,
    /// A control period.
    Tick = 3,
    /// How a request went.
    Code = 4,
    /// Rotor targets.
    Targets = 5,
    /// Whether the policy reproduces its golden vectors, at any time.
    Test = 6,
}

impl MessageKind {
    /// The kind of a number.
    pub const fn of(number: u8) -> Option<Self> {
        match number {
            1 => Some(Self::Policy),
            2 => Some(Self::Reset),
            3 => Some(Self::Tick),
            4 => Some(Self::Code),
            5 => Some(Self::Targets),
            6 => Some(Self::Test),
            _ => None,
        }
    }
}

/// One end of a serial line.
pub trait SerialPort {
    /// The next byte, whenever it comes; nothing when the line is gone.
    fn read(&mut self) -> Option<u8>;

    /// Sends a byte.
    fn write(&mut self, byte: u8);
}

/// Sends a frame whose payload has several parts, together at most 65,535 bytes.
pub fn send(port: &mut impl SerialPort, kind: MessageKind, payload: &[&[u8]]) {
    let len = payload.iter().map(|part| part.len()).sum::<usize>() as u16;
    let mut sum = Crc32::new();
    port.write(START);
    let head = [kind as u8, len.to_le_bytes()[0], len.to_le_bytes()[1]];
    for byte in head.iter().chain(payload.iter().copied().flatten()) {
        sum.add(*byte);
        port.write(*byte);
    }
    for byte in sum.value().to_le_bytes() {
        port.write(byte);
    }
}

/// The beginning of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageHeader {
    kind: u8,
    len: u16,
}

impl MessageHeader {
    /// Waits for the next frame; nothing when the line is gone.
    pub fn receive(port: &mut impl SerialPort) -> Option<Self> {
        while port.read()? != START {}
        let kind = port.read()?;
        Some(Self { kind, len: u16::from_le_bytes([port.read()?, port.read()?]) })
    }

    /// What the frame is, if it is known.
    pub const fn kind(self) -> Option<MessageKind> {
        MessageKind::of(self.kind)
    }

    /// Receives the payload into the front of `room`; nothing when the line is gone.
    pub fn receive_payload<'r>(
        self,
        port: &mut impl SerialPort,
        room: &'r mut [u8],
    ) -> Option<Result<&'r [u8], i32>> {
        let len = usize::from(self.len);
        let mut sum = Crc32::new();
        for byte in [self.kind].into_iter().chain(self.len.to_le_bytes()) {
            sum.add(byte);
        }
        for index in 0..len {
            let byte = port.read()?;
            sum.add(byte);
            if let Some(place) = room.get_mut(index) {
                *place = byte;
            }
        }
        let expected = [port.read()?, port.read()?, port.read()?, port.read()?];
        Some(match room.get(..len) {
            _ if sum.value().to_le_bytes() != expected => Err(DAMAGED),
            Some(payload) => Ok(payload),
            None => Err(LENGTH),
        })
    }
}

/// Announces itself ([`NO_POLICY`]: what comes before that is lost on a line that is not open yet), then flies policies
/// for whoever asks, until the line is gone. `room`, on a four-byte boundary of memory, is for policy files.
pub fn serve(port: &mut impl SerialPort, room: &mut [u8]) {
    let mut asked = answer(port, NO_POLICY);
    while let Some(head) = asked {
        asked = match head.kind() {
            Some(MessageKind::Policy) => match head.receive_payload(port, room) {
                None => return,
                Some(Err(code)) => answer(port, code),
                Some(Ok(file)) => fly(port, file),
            },
            Some(
                MessageKind::Reset
                | MessageKind::Tick
                | MessageKind::Test
                | MessageKind::Code
                | MessageKind::Targets,
            )
            | None => match head.receive_payload(port, &mut [0; 4 * TICK_LIMIT]) {
                None => return,
                Some(Err(code)) => answer(port, code),
                Some(Ok(_)) => answer(port, NO_POLICY),
            },
        };
    }
}

/// Reports how a request went, and waits for the next.
fn answer(port: &mut impl SerialPort, code: i32) -> Option<MessageHeader> {
    send(port, MessageKind::Code, &[&code.to_le_bytes()]);
    MessageHeader::receive(port)
}

/// Flies a policy until another one is sent, whose head it returns.
fn fly(port: &mut impl SerialPort, file: &[u8]) -> Option<MessageHeader> {
    let policy = match StatePolicy::parse(file) {
        Ok(policy) => policy,
        Err(error) => return answer(port, i32::from(error.code())),
    };
    let mut pilot = Pilot::with_runner(policy);
    if let Err(error) = pilot.self_test() {
        return answer(port, i32::from(error.code()));
    }
    let mut asked = answer(port, 0)?;
    let mut room = [0; 4 * TICK_LIMIT];
    loop {
        let kind = asked.kind();
        if kind == Some(MessageKind::Policy) {
            return Some(asked);
        }
        let payload = asked.receive_payload(port, &mut room)?;
        asked = match (kind, payload) {
            (_, Err(code)) => answer(port, code)?,
            (Some(MessageKind::Reset), Ok(_)) => {
                pilot.reset();
                answer(port, 0)?
            }
            (Some(MessageKind::Test), Ok(_)) => {
                let code = pilot.self_test().map_or_else(|error| i32::from(error.code()), |()| 0);
                answer(port, code)?
            }
            (Some(MessageKind::Tick), Ok(payload)) => match tick(&mut pilot, payload) {
                Some(targets) => {
                    send(
                        port,
                        MessageKind::Targets,
                        &targets.map(f32::to_le_bytes).each_ref().map(|bytes| &bytes[..]),
                    );
                    MessageHeader::receive(port)?
                }
                None => answer(port, LENGTH)?,
            },
            (Some(MessageKind::Policy | MessageKind::Code | MessageKind::Targets) | None, Ok(_)) => {
                answer(port, DAMAGED)?
            }
        };
    }
}

/// Rotor targets for the numbers of a tick, if they are as many as the policy needs.
fn tick<'a>(pilot: &mut Pilot<'a, StatePolicy<'a>>, payload: &[u8]) -> Option<[f32; 4]> {
    let (numbers, []) = payload.as_chunks::<4>() else { return None };
    let (first, measured) = numbers.split_first_chunk::<STATE_LEN>()?;
    let mut measurements = [0.0; OBSERVATION_LIMIT];
    let measurements = measurements.get_mut(..measured.len())?;
    if measurements.len() != pilot.metadata().observation.measured_len() {
        return None;
    }
    for (value, bytes) in measurements.iter_mut().zip(measured) {
        *value = f32::from_le_bytes(*bytes);
    }
    let [px, py, pz, w, x, y, z, vx, vy, vz, p, q, r, gx, gy, gz, yaw] = first.map(f32::from_le_bytes);
    let state = State {
        position: Vector3::new(px, py, pz),
        world_from_body: Attitude { w, x, y, z },
        velocity: Vector3::new(vx, vy, vz),
        body_rates: Vector3::new(p, q, r),
        rotor_speeds: [0.0; 4],
    };
    let setpoint = Setpoint { yaw, ..Setpoint::at(Vector3::new(gx, gy, gz)) };
    Some(pilot.tick_towards(measurements, &state, &setpoint))
}

/// The payload of a tick, but for its measurements.
pub fn tick_payload(state: &State<f32>, setpoint: &Setpoint<f32>) -> [[u8; 4]; STATE_LEN] {
    let State { position: p, world_from_body: q, velocity: v, body_rates: w, .. } = state;
    let Setpoint { position: goal, yaw, .. } = setpoint;
    let values = [p.x, p.y, p.z, q.w, q.x, q.y, q.z, v.x, v.y, v.z, w.x, w.y, w.z, goal.x, goal.y, goal.z, *yaw];
    values.map(f32::to_le_bytes)
}

#[cfg(test)]
mod tests;
