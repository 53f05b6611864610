//! What the vehicle tells its peers: [`motion`], [`status`], its [`surroundings`], [`events`], and what it is ([`identity`]).

pub mod camera;
pub mod events;
pub mod identity;
pub mod motion;
pub mod status;
pub mod surroundings;

use mavlink::dialects::common::{MavSeverity, STATUSTEXT_DATA};

use crate::files::packet::PACKET_LEN;
use crate::frame::Payload;

/// `STATUSTEXT` of at most 50 bytes; longer text is cut.
pub fn status_text(severity: MavSeverity, text: &str) -> Payload {
    Payload::of(&STATUSTEXT_DATA { severity, text: text.into() })
}

/// `TIMESYNC`: the answer to a peer that asked with its time `ts1`, at a time since boot \[ns\].
pub fn timesync(ts1: i64, time_boot_ns: i64, [system, component]: [u8; 2]) -> Payload {
    let mut fields = [0; 18];
    let values = time_boot_ns.to_le_bytes().into_iter().chain(ts1.to_le_bytes()).chain([system, component]);
    fields.iter_mut().zip(values).for_each(|(field, value)| *field = value);
    Payload::new(111, 34, &fields)
}

/// `PING`: the answer to a peer's, with its time and number.
pub fn ping(time_usec: u64, seq: u32, [system, component]: [u8; 2]) -> Payload {
    let mut fields = [0; 14];
    let values = time_usec.to_le_bytes().into_iter().chain(seq.to_le_bytes()).chain([system, component]);
    fields.iter_mut().zip(values).for_each(|(field, value)| *field = value);
    Payload::new(4, 237, &fields)
}

/// `FILE_TRANSFER_PROTOCOL`: a packet to the system and component that asked.
pub fn file_transfer(packet: &[u8; PACKET_LEN], [system, component]: [u8; 2]) -> Payload {
    let mut fields = [0; 3 + PACKET_LEN];
    fields[1..3].copy_from_slice(&[system, component]);
    fields[3..].copy_from_slice(packet);
    Payload::new(110, 84, &fields)
}

#[cfg(test)]
mod tests;
