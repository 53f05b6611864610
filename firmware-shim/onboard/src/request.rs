//! What peers ask for.
//!
//! The messages that carry requests are read here field by field, not through the `mavlink` crate's enums: those
//! reject a frame with an unknown command number, which must be answered "unsupported".

mod command;
mod set_point;

pub use command::{CommandLocation, CommandRequest};
pub use set_point::{AttitudeTarget, PositionTarget, SetPointError, Whereabouts};

use crate::fields::{u32_at, u64_at};
use crate::frame::Frame;

/// `MAV_TYPE_GCS`: who sends such heartbeats is a ground station.
const GROUND_STATION: u8 = 6;

/// A request to this or another system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Request {
    /// `HEARTBEAT` of a ground station, to everybody.
    GroundStation,
    /// `PING`, of this time and number, that wants an answer.
    Ping {
        /// Time of the sender \[µs\].
        time_usec: u64,
        /// Its number.
        seq: u32,
    },
    /// `SET_MODE`, with the `custom_mode`.
    SetMode(u32),
    /// `COMMAND_LONG` or `COMMAND_INT`.
    Command(CommandRequest),
    /// `SET_POSITION_TARGET_LOCAL_NED` or `SET_POSITION_TARGET_GLOBAL_INT`.
    PositionTarget(PositionTarget),
    /// `SET_ATTITUDE_TARGET`.
    AttitudeTarget(AttitudeTarget),
    /// `TIMESYNC` that asks, with the sender's time \[ns\].
    TimeSync(i64),
    /// `FILE_TRANSFER_PROTOCOL`: who has files reads its payload in the frame.
    Files,
}

/// To whom a request is addressed; zero means everybody.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address {
    /// System, 0 for all.
    pub system: u8,
    /// Component, 0 for all.
    pub component: u8,
}

impl Address {
    /// Of messages that bear no address.
    const EVERYBODY: Self = Self { system: 0, component: 0 };

    /// Whether `system` and `component` shall listen.
    pub fn reaches(self, system: u8, component: u8) -> bool {
        [0, system].contains(&self.system) && [0, component].contains(&self.component)
    }
}

/// The request in a frame and its addressee; none if the message is no request that is known here.
pub fn request(frame: &Frame) -> Option<(Address, Request)> {
    match frame.message_id {
        0 => heartbeat(&frame.fields()),
        4 => ping(&frame.fields()),
        11 => Some(set_mode(&frame.fields())),
        75 => Some(command::of_integers(&frame.fields())),
        76 => Some(command::of_floats(&frame.fields())),
        82 => Some(set_point::attitude_target(&frame.fields())),
        84 => Some(set_point::local_target(&frame.fields())),
        86 => Some(set_point::global_target(&frame.fields())),
        110 => Some(files(&frame.fields())),
        111 => time_sync(&frame.fields()),
        _ => None,
    }
}

fn heartbeat(fields: &[u8; 9]) -> Option<(Address, Request)> {
    (fields[4] == GROUND_STATION).then_some((Address::EVERYBODY, Request::GroundStation))
}

/// One without an addressee is a question; one with an addressee is an answer.
fn ping(fields: &[u8; 14]) -> Option<(Address, Request)> {
    let [system, component] = [fields[12], fields[13]];
    let request = Request::Ping { time_usec: u64_at(fields, 0), seq: u32_at(fields, 8) };
    (system == 0 && component == 0).then_some((Address::EVERYBODY, request))
}

fn set_mode(fields: &[u8; 6]) -> (Address, Request) {
    (Address { system: fields[4], component: 0 }, Request::SetMode(u32_at(fields, 0)))
}

fn files(fields: &[u8; 3]) -> (Address, Request) {
    (Address { system: fields[1], component: fields[2] }, Request::Files)
}

/// Zero as the answerer's time is a question. The address is an extension: zero, to everybody, where it is missing.
fn time_sync(fields: &[u8; 18]) -> Option<(Address, Request)> {
    let address = Address { system: fields[16], component: fields[17] };
    (u64_at(fields, 0) == 0).then_some((address, Request::TimeSync(u64_at(fields, 8) as i64)))
}

#[cfg(test)]
mod tests;
