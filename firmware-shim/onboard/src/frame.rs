//! MAVLink frames: bytes to checked frames, and messages to bytes.
//!
//! A datagram is a whole number of frames; a stream is cut by a [`Receiver`]. Either way a frame whose checksum fails is
//! skipped as a whole, so that nothing hidden in its payload is ever read as a frame of its own.

mod encoder;
mod receiver;

pub use encoder::{Encoder, Payload};
pub use receiver::Receiver;

use crate::checksum::Checksum;
use crate::dialect::checksum_seed;
use crate::signature::{SIGNATURE_LEN, Signature};

/// First byte of a frame of MAVLink 1.
pub const START_V1: u8 = 0xfe;

/// First byte of a frame of MAVLink 2.
pub const START_V2: u8 = 0xfd;

/// Bytes of the longest payload.
pub const PAYLOAD_LIMIT: usize = 255;

const HEADER_V1: usize = 6;
const HEADER_V2: usize = 10;
const CHECKSUM_LEN: usize = 2;

/// Bytes of the longest frame, its signature included.
pub const FRAME_LIMIT: usize = HEADER_V2 + PAYLOAD_LIMIT + CHECKSUM_LEN + SIGNATURE_LEN;

/// Incompatibility flag of a signed frame, the only one understood.
const SIGNED: u8 = 0x01;

/// The protocol's versions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameVersion {
    /// MAVLink 1, which knows no signatures.
    V1,
    /// MAVLink 2.
    V2,
}

/// A frame whose checksum is right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Of the protocol.
    pub version: FrameVersion,
    /// Which one of its sender's frames it is, modulo 256.
    pub sequence: u8,
    /// System that sent it.
    pub system: u8,
    /// Component of that system.
    pub component: u8,
    /// What it is.
    pub message_id: u32,
    /// Its payload, trailing zeros possibly cut off.
    pub payload: &'a [u8],
    /// All of it, from the first byte to the last of its signature.
    pub bytes: &'a [u8],
}

/// What stands in the place of a good frame.
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
    /// A message that the dialect lacks, whose checksum cannot be known.
    #[error("unknown message {0}")]
    Message(u32),
    /// Transmission error.
    #[error("checksum mismatch in message {0}")]
    Checksum(u32),
}

impl<'a> Frame<'a> {
    /// Reads one whole frame, of the length that [`frame_len`] tells.
    fn read(bytes: &'a [u8]) -> Result<Self, FrameError> {
        let frame = match *bytes {
            [START_V1, len, sequence, system, component, id, ..] => Self {
                version: FrameVersion::V1,
                sequence,
                system,
                component,
                message_id: u32::from(id),
                payload: part(bytes, HEADER_V1, len)?,
                bytes,
            },
            [START_V2, len, flags, _, sequence, system, component, low, middle, high, ..] => {
                if flags & !SIGNED != 0 {
                    return Err(FrameError::Flags(flags));
                }
                let message_id = u32::from_le_bytes([low, middle, high, 0]);
                let payload = part(bytes, HEADER_V2, len)?;
                Self { version: FrameVersion::V2, sequence, system, component, message_id, payload, bytes }
            }
            _ => return Err(FrameError::Truncated),
        };
        frame.check()
    }

    fn check(self) -> Result<Self, FrameError> {
        let seed = checksum_seed(self.message_id).ok_or(FrameError::Message(self.message_id))?;
        let (covered, rest) = self.bytes.split_at_checked(self.covered_len()).ok_or(FrameError::Truncated)?;
        let expected = Checksum::new().with(covered.get(1..).unwrap_or_default()).with(&[seed]);
        if rest.starts_with(&expected.to_bytes()) { Ok(self) } else { Err(FrameError::Checksum(self.message_id)) }
    }

    /// Bytes before the checksum.
    fn covered_len(&self) -> usize {
        let header = match self.version {
            FrameVersion::V1 => HEADER_V1,
            FrameVersion::V2 => HEADER_V2,
        };
        header + self.payload.len()
    }

    /// Its signature, not verified yet.
    pub fn signature(&self) -> Option<Signature<'a>> {
        let end = self.covered_len() + CHECKSUM_LEN;
        let (signed, signature) = self.bytes.split_at_checked(end)?;
        Signature::read(signed, signature)
    }

    /// The payload in the length of the message's definition: zeros where it was cut, extensions dropped.
    pub fn fields<const LEN: usize>(&self) -> [u8; LEN] {
        let mut fields = [0; LEN];
        for (field, byte) in fields.iter_mut().zip(self.payload) {
            *field = *byte;
        }
        fields
    }
}

fn part(bytes: &[u8], header: usize, len: u8) -> Result<&[u8], FrameError> {
    bytes.get(header..header + usize::from(len)).ok_or(FrameError::Truncated)
}

/// Bytes of the frame that begins here, as soon as its first bytes tell.
fn frame_len(bytes: &[u8]) -> Result<Option<usize>, FrameError> {
    match *bytes {
        [START_V1, len, ..] => Ok(Some(HEADER_V1 + usize::from(len) + CHECKSUM_LEN)),
        [START_V2, len, flags, ..] => {
            let signature = if flags & SIGNED == 0 { 0 } else { SIGNATURE_LEN };
            Ok(Some(HEADER_V2 + usize::from(len) + CHECKSUM_LEN + signature))
        }
        [] | [START_V1 | START_V2, ..] => Ok(None),
        [start, ..] => Err(FrameError::Start(start)),
    }
}

/// The frames of one datagram, in order; at the first byte that begins no frame the rest is dropped.
#[derive(Clone, Debug)]
pub struct Frames<'a> {
    rest: &'a [u8],
}

impl<'a> Frames<'a> {
    /// Of this datagram.
    pub fn new(datagram: &'a [u8]) -> Self {
        Self { rest: datagram }
    }

    /// The bytes of the first frame, and what follows it.
    fn split(datagram: &[u8]) -> Result<(&[u8], &[u8]), FrameError> {
        let len = frame_len(datagram)?.ok_or(FrameError::Truncated)?;
        datagram.split_at_checked(len).ok_or(FrameError::Truncated)
    }
}

impl<'a> Iterator for Frames<'a> {
    type Item = Result<Frame<'a>, FrameError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        match Self::split(self.rest) {
            Ok((bytes, rest)) => {
                self.rest = rest;
                Some(Frame::read(bytes))
            }
            Err(error) => {
                self.rest = &[];
                Some(Err(error))
            }
        }
    }
}

#[cfg(test)]
mod tests;
