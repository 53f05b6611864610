//! Who is there: the handshake, versions, echoes, and memories, of which there are none.

use super::packet::{DATA_LIMIT, Packet, Port};
use super::status;

/// Version of the protocol (`CRTP_PROTOCOL_VERSION`): yaw rates in the firmware's sense, arming by the supervisor.
const PROTOCOL_VERSION: i32 = 12;

/// By this clients know a drone.
const SOURCE: &[u8] = b"Bitcraze Crazyflie";

/// Name of the firmware, at most 29 bytes.
pub const FIRMWARE: &str = concat!("Kestrel ", env!("CARGO_PKG_VERSION"));

/// Name of the platform: Crazyflie 2.1.
const DEVICE: &[u8] = b"CF21";

/// Channels of the link port.
const ECHO_CHANNEL: u8 = 0;
const SOURCE_CHANNEL: u8 = 1;

/// Channel of versions, at the platform's port.
const VERSION_CHANNEL: u8 = 1;

/// What a client says first: a question for the magic word.
pub fn handshake() -> Packet {
    Packet::new(Port::Link, SOURCE_CHANNEL)
}

/// Whether a packet is what a client says first.
pub fn is_handshake(packet: &Packet) -> bool {
    packet.port == Port::Link && packet.channel == SOURCE_CHANNEL
}

/// Answers a packet at the link port: echoes, the magic word of the handshake; a sink answers nothing.
pub fn answer_link(packet: &Packet) -> Option<Packet> {
    match packet.channel {
        ECHO_CHANNEL => Some(packet.clone()),
        SOURCE_CHANNEL => Some(packet.reply().with(SOURCE).with(&[0; DATA_LIMIT])),
        _ => None,
    }
}

/// Answers a question for a version, at the platform's port.
pub fn answer_version(packet: &Packet) -> Option<Packet> {
    let question = packet.fields().byte()?;
    let reply = packet.reply().with(&[question]);
    match (packet.channel, question) {
        (VERSION_CHANNEL, 0) => Some(reply.with(&PROTOCOL_VERSION.to_le_bytes())),
        (VERSION_CHANNEL, 1) => Some(reply.with(FIRMWARE.as_bytes())),
        (VERSION_CHANNEL, 2) => Some(reply.with(DEVICE)),
        _ => None,
    }
}

/// Answers a packet at the memory port: there is none to describe, read or write.
pub fn answer_memory(packet: &Packet) -> Option<Packet> {
    let mut fields = packet.fields();
    let first = fields.byte()?;
    let reply = packet.reply();
    match (packet.channel, first) {
        (0, 1) => Some(reply.with(&[1, 0])),
        (0, 2) => Some(reply.with(&[2, fields.byte()?])),
        (1 | 2, _) if packet.data().len() > 4 => Some(reply.with(&packet.data()[..5]).with(&[status::NO_DEVICE])),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(answer: fn(&Packet) -> Option<Packet>, port: Port, channel: u8, data: &[u8]) -> Option<Vec<u8>> {
        answer(&Packet::new(port, channel).with(data)).map(|reply| reply.data().to_vec())
    }

    #[test]
    fn echoes_are_what_was_sent_and_sinks_are_silent() {
        assert_eq!(ask(answer_link, Port::Link, 0, &[1, 2, 3]), Some(vec![1, 2, 3]));
        assert_eq!(ask(answer_link, Port::Link, 2, &[1, 2, 3]), None);
    }

    #[test]
    fn the_handshake_is_answered_with_the_magic_word() {
        let source = ask(answer_link, Port::Link, 1, &[0]).unwrap();
        assert_eq!(source.len(), DATA_LIMIT);
        assert!(source.starts_with(SOURCE) && source[SOURCE.len()..].iter().all(|byte| *byte == 0));
        assert!(is_handshake(&handshake()) && !is_handshake(&Packet::new(Port::Platform, 1)));
    }

    #[test]
    fn versions_are_told() {
        assert_eq!(ask(answer_version, Port::Platform, 1, &[0]), Some(vec![0, 12, 0, 0, 0]));
        assert_eq!(ask(answer_version, Port::Platform, 1, &[2]), Some(b"\x02CF21".to_vec()));
        let firmware = ask(answer_version, Port::Platform, 1, &[1]).unwrap();
        assert_eq!(&firmware[1..], FIRMWARE.as_bytes());
        for (channel, data) in [(1, &[3][..]), (1, &[]), (2, &[0])] {
            assert_eq!(ask(answer_version, Port::Platform, channel, data), None);
        }
    }

    #[test]
    fn there_is_no_memory() {
        assert_eq!(ask(answer_memory, Port::Memory, 0, &[1]), Some(vec![1, 0]));
        assert_eq!(ask(answer_memory, Port::Memory, 0, &[2, 7]), Some(vec![2, 7]));
        assert_eq!(ask(answer_memory, Port::Memory, 1, &[7, 1, 2, 3, 4, 24]), Some(vec![7, 1, 2, 3, 4, 5]));
        assert_eq!(ask(answer_memory, Port::Memory, 2, &[7, 1, 2, 3, 4, 24]), Some(vec![7, 1, 2, 3, 4, 5]));
        for data in [&[][..], &[7, 1, 2]] {
            assert_eq!(ask(answer_memory, Port::Memory, 1, data), None, "{data:?}");
        }
    }
}
