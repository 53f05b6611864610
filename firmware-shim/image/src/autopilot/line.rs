//! A ground station at the other end of a bad line.

use kestrel_onboard::dialect::checksum_seed;
use kestrel_onboard::frame::{Encoder, Frames, Payload};
use kestrel_onboard::signature::{SignatureTime, Signer, SigningKey};

use crate::input::Inputs;

/// MAVLink system of the vehicle.
pub(super) const VEHICLE: u8 = 1;

/// What signs the ground station's frames, and since when.
pub(super) const KEY: [u8; 32] = [9; 32];
pub(super) const START: SignatureTime = SignatureTime(4_000_000_000_000);

/// One of so many bytes of a frame is damaged, and before one of so many frames there is noise.
const DAMAGE: u32 = 300;
const NOISE: u32 = 8;

/// Control periods between two heartbeats, two set-points, and a command and its repetition.
const HEARTBEAT_PERIODS: u32 = 10;
const SET_POINT_PERIODS: u32 = 5;
const COMMAND_PERIODS: u32 = 4;

/// What is to be ignored of set-points: all but a position, all but a velocity; all rates.
const POSITION: u16 = 0b1101_1111_1000;
const VELOCITY: u16 = 0b1101_1100_0111;
const ATTITUDE: u8 = 0b0000_0111;

/// `MAV_FRAME_LOCAL_NED`.
const LOCAL_NED: u8 = 1;

/// `MAV_TYPE_GCS`.
const GROUND_STATION: u8 = 6;

/// The set-points that it sends.
#[derive(Clone, Copy)]
pub(super) enum SetPointStream {
    /// None.
    Nothing,
    /// A point: north, east, down \[m\].
    Position([f32; 3]),
    /// A velocity: north, east, down \[m/s\].
    Velocity([f32; 3]),
    /// The level attitude that faces north, with a share of the greatest thrust.
    Level { thrust: f32 },
}

/// Whether it says that it is there.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Presence {
    Present,
    Gone,
}

/// A command that waits for its acknowledgement.
#[derive(Clone, Copy)]
struct Pending {
    command: u16,
    parameters: [f32; 3],
}

/// The ground station and the line.
pub(super) struct Line {
    encoder: Encoder,
    inputs: Inputs,
    stream: SetPointStream,
    station: Presence,
    pending: Option<Pending>,
}

impl Line {
    pub(super) fn new() -> Self {
        Self {
            encoder: Encoder::new(255, 190).signed(Signer::new(SigningKey(KEY), 1, START)),
            inputs: Inputs::new(6),
            stream: SetPointStream::Nothing,
            station: Presence::Gone,
            pending: None,
        }
    }

    /// Sends a command until it is acknowledged.
    pub(super) fn command(&mut self, command: u16, parameters: [f32; 3]) {
        self.pending = Some(Pending { command, parameters });
    }

    /// Sends these set-points from now on.
    pub(super) fn stream(&mut self, stream: SetPointStream) {
        self.stream = stream;
    }

    /// Says that it is there, or no more.
    pub(super) fn set_presence(&mut self, station: Presence) {
        self.station = station;
    }

    /// Reads what the vehicle sent.
    pub(super) fn receive(&mut self, bytes: &[u8]) {
        for frame in Frames::new(bytes).flatten() {
            let acknowledged = u16::from_le_bytes(first(frame.fields()));
            self.pending = self.pending.filter(|pending| pending.command != acknowledged);
        }
    }

    /// What is due in a control period, as it arrives.
    pub(super) fn transmit(&mut self, tick: u32, arrive: &mut dyn FnMut(u8)) {
        if self.station == Presence::Present && tick.is_multiple_of(HEARTBEAT_PERIODS) {
            self.send(&heartbeat(), arrive);
        }
        if tick.is_multiple_of(SET_POINT_PERIODS)
            && let Some(payload) = set_point(self.stream)
        {
            self.send(&payload, arrive);
        }
        if tick.is_multiple_of(COMMAND_PERIODS)
            && let Some(pending) = self.pending
        {
            self.send(&command_long(&pending), arrive);
        }
    }

    fn send(&mut self, payload: &Payload, arrive: &mut dyn FnMut(u8)) {
        if self.inputs.bits().is_multiple_of(NOISE) {
            for _ in 0..self.inputs.bits() % 16 {
                arrive(self.inputs.bits() as u8);
            }
        }
        for byte in &self.encoder.encode(payload) {
            let damaged = self.inputs.bits().is_multiple_of(DAMAGE);
            arrive(if damaged { byte ^ 0x10 } else { *byte });
        }
    }
}

/// A command to terminate the flight from a sender without the key.
pub(super) fn intrude(arrive: &mut dyn FnMut(u8)) {
    let payload = command_long(&Pending { command: 185, parameters: [1.0, 0.0, 0.0] });
    for byte in &Encoder::new(254, 190).encode(&payload) {
        arrive(*byte);
    }
}

fn first([low, high, ..]: [u8; 10]) -> [u8; 2] {
    [low, high]
}

fn heartbeat() -> Payload {
    // Type, autopilot, base mode, system status and version stand behind the four bytes of the custom mode.
    payload::<9>(0, &[(4, &[GROUND_STATION, 8, 0, 4, 3])])
}

fn command_long(Pending { command, parameters }: &Pending) -> Payload {
    let open = [f32::NAN; 4].map(f32::to_le_bytes);
    payload::<33>(
        76,
        &[
            (0, parameters.map(f32::to_le_bytes).as_flattened()),
            (12, open.as_flattened()),
            (28, &command.to_le_bytes()),
            (30, &[VEHICLE, 1]),
        ],
    )
}

fn set_point(stream: SetPointStream) -> Option<Payload> {
    match stream {
        SetPointStream::Nothing => None,
        SetPointStream::Position(position) => Some(local_target(4, position, POSITION)),
        SetPointStream::Velocity(velocity) => Some(local_target(16, velocity, VELOCITY)),
        SetPointStream::Level { thrust } => Some(payload::<39>(
            82,
            &[(4, &1.0_f32.to_le_bytes()), (32, &thrust.to_le_bytes()), (36, &[VEHICLE, 1, ATTITUDE])],
        )),
    }
}

/// `SET_POSITION_TARGET_LOCAL_NED` of a vector that stands at an offset.
fn local_target(at: usize, vector: [f32; 3], ignored: u16) -> Payload {
    payload::<53>(
        84,
        &[
            (at, vector.map(f32::to_le_bytes).as_flattened()),
            (48, &ignored.to_le_bytes()),
            (50, &[VEHICLE, 1, LOCAL_NED]),
        ],
    )
}

/// A message of so many bytes, from parts that stand at their offsets.
fn payload<const LEN: usize>(message_id: u32, parts: &[(usize, &[u8])]) -> Payload {
    let mut fields = [0; LEN];
    for (at, bytes) in parts {
        for (field, byte) in fields.iter_mut().skip(*at).zip(*bytes) {
            *field = *byte;
        }
    }
    Payload::new(message_id, checksum_seed(message_id).unwrap_or_default(), &fields)
}
