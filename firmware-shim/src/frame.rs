//! MAVLink frames: the bytes of a datagram to checked frames, and messages to bytes.
//!
//! A datagram is a whole number of frames. A frame whose checksum fails is skipped as a whole, so that nothing
//! hidden in its payload is ever read as a frame of its own; at the first byte that begins no frame the rest of the
//! datagram is dropped.

use mavlink::consts::MAX_PAYLOAD_LEN;
use mavlink::dialects::common::MavMessage;
use mavlink::utils::remove_trailing_zeroes;
use mavlink::{MAV_STX, MAV_STX_V2, MavlinkVersion, Message, MessageData, calculate_crc};

/// Header, payload and checksum around the payload length of MAVLink 1.
const V1_OVERHEAD: usize = 8;

/// The same for MAVLink 2.
const V2_OVERHEAD: usize = 12;

/// The longest frame that is sent.
pub const FRAME_LIMIT: usize = V2_OVERHEAD + MAX_PAYLOAD_LEN;

/// Bytes of a MAVLink 2 signature.
const SIGNATURE_LEN: usize = 13;

/// Incompatibility flag of a signed frame, the only one understood. The signature is not verified: no key is held.
const SIGNED: u8 = 0x01;

/// `COMPONENT_INFORMATION`, the one message whose checksum seed really is zero; zero otherwise means unknown.
const ZERO_SEED_ID: u32 = 395;

/// A frame whose checksum is right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// System that sent it.
    pub system: u8,
    /// Component of that system.
    pub component: u8,
    /// What it is.
    pub message_id: u32,
    /// Its payload, trailing zeros possibly cut off.
    pub payload: &'a [u8],
}

/// What stands in a datagram instead of a good frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// No frame begins here.
    #[error("expected a frame to begin with 0xfd or 0xfe, found {0:#04x}")]
    Start(u8),
    /// The frame ends after the datagram.
    #[error("the datagram ends inside a frame")]
    Truncated,
    /// Flags that change the meaning of the frame in unknown ways.
    #[error("unknown incompatibility flags {0:#04x}")]
    Flags(u8),
    /// A message that the common dialect lacks, whose checksum cannot be known.
    #[error("unknown message {0}")]
    Message(u32),
    /// Transmission error.
    #[error("checksum mismatch in message {0}")]
    Checksum(u32),
}

impl Frame<'_> {
    /// The payload in the length of the message's definition: zeros where it was cut, extensions dropped.
    pub fn fields<const LEN: usize>(&self) -> [u8; LEN] {
        let mut fields = [0; LEN];
        let len = self.payload.len().min(LEN);
        fields[..len].copy_from_slice(&self.payload[..len]);
        fields
    }
}

/// The frames of one datagram, in order.
#[derive(Clone, Debug)]
pub struct Frames<'a> {
    rest: &'a [u8],
}

impl<'a> Frames<'a> {
    /// Of this datagram.
    pub fn new(datagram: &'a [u8]) -> Self {
        Self { rest: datagram }
    }
}

impl<'a> Iterator for Frames<'a> {
    type Item = Result<Frame<'a>, FrameError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let Ok((bytes, rest)) = split(self.rest) else {
            return split(core::mem::take(&mut self.rest)).err().map(Err);
        };
        self.rest = rest;
        Some(check(bytes))
    }
}

/// The bytes of the first frame, and what follows it.
fn split(datagram: &[u8]) -> Result<(&[u8], &[u8]), FrameError> {
    let len = match *datagram {
        [MAV_STX, payload_len, ..] => V1_OVERHEAD + payload_len as usize,
        [MAV_STX_V2, payload_len, flags, ..] if flags & SIGNED != 0 => {
            V2_OVERHEAD + payload_len as usize + SIGNATURE_LEN
        }
        [MAV_STX_V2, payload_len, ..] => V2_OVERHEAD + payload_len as usize,
        [MAV_STX] | [] => return Err(FrameError::Truncated),
        [start, ..] => {
            return Err(if start == MAV_STX_V2 { FrameError::Truncated } else { FrameError::Start(start) });
        }
    };
    datagram.split_at_checked(len).ok_or(FrameError::Truncated)
}

/// Reads one frame of [`split`].
fn check(bytes: &[u8]) -> Result<Frame<'_>, FrameError> {
    let payload_len = bytes[1] as usize;
    let (header_len, frame) = if bytes[0] == MAV_STX {
        let message_id = u32::from(bytes[5]);
        (6, Frame { system: bytes[3], component: bytes[4], message_id, payload: &bytes[6..6 + payload_len] })
    } else {
        if bytes[2] & !SIGNED != 0 {
            return Err(FrameError::Flags(bytes[2]));
        }
        let message_id = u32::from_le_bytes([bytes[7], bytes[8], bytes[9], 0]);
        (10, Frame { system: bytes[5], component: bytes[6], message_id, payload: &bytes[10..10 + payload_len] })
    };
    let seed = MavMessage::extra_crc(frame.message_id);
    if seed == 0 && frame.message_id != ZERO_SEED_ID {
        return Err(FrameError::Message(frame.message_id));
    }
    let covered = header_len + payload_len;
    let found = u16::from_le_bytes([bytes[covered], bytes[covered + 1]]);
    if found == calculate_crc(&bytes[1..covered], seed) {
        Ok(frame)
    } else {
        Err(FrameError::Checksum(frame.message_id))
    }
}

/// A message ready to be framed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Payload {
    message_id: u32,
    seed: u8,
    bytes: heapless::Vec<u8, MAX_PAYLOAD_LEN>,
}

impl Payload {
    /// Of a message that the `mavlink` crate writes.
    pub fn of<D: MessageData>(message: &D) -> Self {
        let mut bytes = [0; MAX_PAYLOAD_LEN];
        let len = message.ser(MavlinkVersion::V2, &mut bytes);
        Self::new(D::ID, D::EXTRA_CRC, &bytes[..len])
    }

    /// Of a message written by hand: its identifier, the seed of its checksum and at most 255 bytes of fields.
    pub fn new(message_id: u32, seed: u8, fields: &[u8]) -> Self {
        let len = remove_trailing_zeroes(&fields[..fields.len().min(MAX_PAYLOAD_LEN)]);
        Self { message_id, seed, bytes: fields[..len].iter().copied().collect() }
    }
}

/// Writes the frames of one component, numbering them.
#[derive(Clone, Debug)]
pub struct Encoder {
    system: u8,
    component: u8,
    sequence: u8,
}

impl Encoder {
    /// Frames sent as this system and component.
    pub fn new(system: u8, component: u8) -> Self {
        Self { system, component, sequence: 0 }
    }

    /// The bytes of one MAVLink 2 frame.
    pub fn encode(&mut self, payload: &Payload) -> heapless::Vec<u8, FRAME_LIMIT> {
        let [low, middle, high, _] = payload.message_id.to_le_bytes();
        let len = payload.bytes.len() as u8;
        let header = [MAV_STX_V2, len, 0, 0, self.sequence, self.system, self.component, low, middle, high];
        let mut frame: heapless::Vec<u8, FRAME_LIMIT> = header.iter().chain(&payload.bytes).copied().collect();
        let checksum = calculate_crc(&frame[1..], payload.seed);
        frame.extend(checksum.to_le_bytes());
        self.sequence = self.sequence.wrapping_add(1);
        frame
    }
}

#[cfg(test)]
mod tests {
    use mavlink::dialects::common::HEARTBEAT_DATA;
    use mavlink::{MAVLinkV1MessageRaw, MAVLinkV2MessageRaw, MavHeader};
    use proptest::prelude::*;

    use super::*;

    fn heartbeat() -> Vec<u8> {
        Encoder::new(255, 190).encode(&Payload::of(&HEARTBEAT_DATA::default())).to_vec()
    }

    fn errors(datagram: &[u8]) -> Vec<FrameError> {
        Frames::new(datagram).filter_map(Result::err).collect()
    }

    #[test]
    fn an_encoded_frame_is_read_back() {
        let bytes = heartbeat();
        let frames: Vec<_> = Frames::new(&bytes).collect::<Result<_, _>>().unwrap();
        assert_eq!(frames.len(), 1);
        assert_eq!((frames[0].system, frames[0].component, frames[0].message_id), (255, 190, 0));
        assert_eq!(frames[0].fields::<9>()[8], 3, "mavlink_version");
    }

    #[test]
    fn mavlink_1_is_understood() {
        let mut raw = MAVLinkV1MessageRaw::new();
        let header = MavHeader { system_id: 7, component_id: 8, sequence: 9 };
        raw.serialize_message(header, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
        let frame = Frames::new(raw.raw_bytes()).next().unwrap().unwrap();
        assert_eq!((frame.system, frame.component, frame.message_id), (7, 8, 0));
    }

    #[test]
    fn frames_are_those_of_the_mavlink_crate() {
        let mut raw = MAVLinkV2MessageRaw::new();
        let header = MavHeader { system_id: 255, component_id: 190, sequence: 0 };
        raw.serialize_message_data(header, &HEARTBEAT_DATA::default());
        assert_eq!(heartbeat(), raw.raw_bytes());
    }

    #[test]
    fn frames_follow_each_other_in_one_datagram() {
        let both = [heartbeat(), heartbeat()].concat();
        assert_eq!(Frames::new(&both).flatten().count(), 2);
    }

    #[test]
    fn a_frame_inside_a_broken_frame_is_never_read() {
        let inner = heartbeat();
        let mut outer = vec![MAV_STX_V2, inner.len() as u8, 0, 0, 0, 1, 1, 0, 0, 0];
        outer.extend(&inner);
        outer.extend([0, 0]);
        assert_eq!(errors(&outer), [FrameError::Checksum(0)]);
        assert_eq!(Frames::new(&outer).flatten().count(), 0);
    }

    #[test]
    fn what_is_wrong_is_told_apart() {
        assert_eq!(errors(b"hello"), [FrameError::Start(b'h')]);
        assert_eq!(errors(&heartbeat()[..15]), [FrameError::Truncated]);
        assert_eq!(errors(&[MAV_STX]), [FrameError::Truncated]);
        assert_eq!(errors(&[MAV_STX_V2]), [FrameError::Truncated]);
        let mut flagged = heartbeat();
        flagged[2] = 0x02;
        assert_eq!(errors(&flagged), [FrameError::Flags(0x02)]);
        let mut unknown = heartbeat();
        unknown[9] = 0xff;
        assert!(matches!(errors(&unknown)[..], [FrameError::Message(_)]));
        let mut flipped = heartbeat();
        flipped[12] ^= 1;
        assert_eq!(errors(&flipped), [FrameError::Checksum(0)]);
    }

    proptest! {
        #[test]
        fn no_datagram_panics_or_loops(datagram in proptest::collection::vec(any::<u8>(), 0..600)) {
            prop_assert!(Frames::new(&datagram).count() <= datagram.len());
        }

        #[test]
        fn no_damaged_frame_passes(position in 1_usize..19, bit in 0_u32..8) {
            let mut bytes = heartbeat();
            let position = position % bytes.len();
            bytes[position] ^= 1 << bit;
            prop_assert!(Frames::new(&bytes).all(|frame| frame.is_err()));
        }

        #[test]
        fn frames_that_begin_well_never_panic(
            flags in 0_u8..2, rest in proptest::collection::vec(any::<u8>(), 0..300)
        ) {
            let bytes = [&[MAV_STX_V2, 9, flags][..], &rest].concat();
            prop_assert!(Frames::new(&bytes).count() <= bytes.len());
        }
    }
}
