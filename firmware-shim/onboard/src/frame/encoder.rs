//! Messages to bytes.

use super::{CHECKSUM_LEN, FRAME_LIMIT, HEADER_V2, PAYLOAD_LIMIT, SIGNED, START_V2};
use crate::checksum::Checksum;
use crate::signature::{SIGNATURE_LEN, Signer};

/// A message ready to be framed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Payload {
    message_id: u32,
    seed: u8,
    bytes: heapless::Vec<u8, PAYLOAD_LIMIT>,
}

impl Payload {
    /// Of a message's identifier, the seed of its checksum and at most 255 bytes of fields, whose trailing zeros are cut
    /// off as MAVLink 2 wants it.
    pub fn new(message_id: u32, seed: u8, fields: &[u8]) -> Self {
        let mut bytes = heapless::Vec::new();
        // There is room: the rest is not looked at.
        let _ = bytes.extend_from_slice(fields.get(..PAYLOAD_LIMIT).unwrap_or(fields));
        while bytes.len() > 1 && bytes.last() == Some(&0) {
            bytes.pop();
        }
        Self { message_id, seed, bytes }
    }

    /// Of a message that the `mavlink` crate writes.
    #[cfg(any(test, feature = "mavlink"))]
    pub fn of<D: mavlink::MessageData>(message: &D) -> Self {
        let mut bytes = [0; PAYLOAD_LIMIT];
        let len = message.ser(mavlink::MavlinkVersion::V2, &mut bytes);
        Self::new(D::ID, D::EXTRA_CRC, bytes.get(..len).unwrap_or_default())
    }

    /// What it is.
    pub const fn message_id(&self) -> u32 {
        self.message_id
    }
}

/// Writes the frames of one component, numbering them.
#[derive(Clone, Debug)]
pub struct Encoder {
    system: u8,
    component: u8,
    pub(super) sequence: u8,
    signer: Option<Signer>,
}

impl Encoder {
    /// Frames sent as this system and component, unsigned.
    pub const fn new(system: u8, component: u8) -> Self {
        Self { system, component, sequence: 0, signer: None }
    }

    /// Frames that are signed.
    #[must_use]
    pub fn signed(self, signer: Signer) -> Self {
        Self { signer: Some(signer), ..self }
    }

    /// What signs, if anything does.
    pub const fn signer(&self) -> Option<&Signer> {
        self.signer.as_ref()
    }

    /// The same, to tell it the time.
    pub fn signer_mut(&mut self) -> Option<&mut Signer> {
        self.signer.as_mut()
    }

    /// The bytes of one MAVLink 2 frame to somebody whose frames have numbers of their own: this one's is `sequence`, which
    /// then is the next one's.
    pub fn encode_numbered(&mut self, payload: &Payload, sequence: &mut u8) -> heapless::Vec<u8, FRAME_LIMIT> {
        core::mem::swap(&mut self.sequence, sequence);
        let frame = self.encode(payload);
        core::mem::swap(&mut self.sequence, sequence);
        frame
    }

    /// The bytes of one MAVLink 2 frame.
    pub fn encode(&mut self, payload: &Payload) -> heapless::Vec<u8, FRAME_LIMIT> {
        const { assert!(HEADER_V2 + PAYLOAD_LIMIT + CHECKSUM_LEN + SIGNATURE_LEN <= FRAME_LIMIT) };
        let [low, middle, high, _] = payload.message_id.to_le_bytes();
        let flags = if self.signer.is_some() { SIGNED } else { 0 };
        let len = payload.bytes.len() as u8;
        let header = [START_V2, len, flags, 0, self.sequence, self.system, self.component, low, middle, high];
        let mut frame = heapless::Vec::<u8, FRAME_LIMIT>::new();
        // There is room for all of it.
        let _ = frame.extend_from_slice(&header);
        let _ = frame.extend_from_slice(&payload.bytes);
        let checksum = Checksum::new().with(frame.get(1..).unwrap_or_default()).with(&[payload.seed]);
        let _ = frame.extend_from_slice(&checksum.to_bytes());
        if let Some(signer) = &mut self.signer {
            let signature = signer.sign(&frame);
            let _ = frame.extend_from_slice(&signature);
        }
        self.sequence = self.sequence.wrapping_add(1);
        frame
    }
}
