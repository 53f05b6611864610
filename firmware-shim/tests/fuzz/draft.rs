//! Frames to the letter, and beside it: what no encoder writes.

use kestrel_onboard::checksum::Checksum;
use kestrel_onboard::dialect::checksum_seed;
use kestrel_onboard::signature::{SIGNATURE_LEN, SignatureTime, Signer, SigningKey};
use kestrel_shim::frame::{FrameVersion, START_V1, START_V2};

/// Incompatibility flag of a signed frame.
pub(crate) const SIGNED: u8 = 0x01;

/// What a frame shall be.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameDraft<'a> {
    pub(crate) version: FrameVersion,
    /// Incompatibility flags of MAVLink 2; signed ones are followed by 13 bytes.
    pub(crate) flags: u8,
    pub(crate) sequence: u8,
    pub(crate) sender: [u8; 2],
    pub(crate) message_id: u32,
    /// At most 255 bytes.
    pub(crate) payload: &'a [u8],
}

/// What comes behind the checksum of a signed frame.
#[derive(Clone, Debug)]
pub(crate) enum Seal {
    /// These bytes.
    Bytes([u8; SIGNATURE_LEN]),
    /// A signature with this key, on a link, at a time.
    Of(SigningKey, u8, SignatureTime),
}

impl FrameDraft<'_> {
    /// Appends the frame, its checksum altered by `damage`: right if that is zero. A message that is unknown has the seed zero.
    pub(crate) fn write(&self, damage: u16, seal: &Seal, bytes: &mut Vec<u8>) {
        let start = bytes.len();
        let len = self.payload.len() as u8;
        let [system, component] = self.sender;
        let [low, middle, high, _] = self.message_id.to_le_bytes();
        match self.version {
            FrameVersion::V1 => bytes.extend([START_V1, len, self.sequence, system, component, low]),
            FrameVersion::V2 => {
                bytes.extend([START_V2, len, self.flags, 0, self.sequence, system, component, low, middle, high]);
            }
        }
        bytes.extend(self.payload);
        let seed = checksum_seed(self.message_id).unwrap_or_default();
        let checksum = Checksum::new().with(&bytes[start + 1..]).with(&[seed]);
        bytes.extend((u16::from_le_bytes(checksum.to_bytes()) ^ damage).to_le_bytes());
        if self.version == FrameVersion::V2 && self.flags & SIGNED != 0 {
            let signature = seal.signature(&bytes[start..]);
            bytes.extend(signature);
        }
    }
}

impl Seal {
    fn signature(&self, frame: &[u8]) -> [u8; SIGNATURE_LEN] {
        match self {
            Self::Bytes(bytes) => *bytes,
            // A signer takes the time after the last.
            Self::Of(key, link, time) => Signer::new(key.clone(), *link, SignatureTime(time.0 - 1)).sign(frame),
        }
    }
}
