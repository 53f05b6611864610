//! The checksum of MAVLink frames: CRC-16/MCRF4XX.

/// Before the first byte.
const INITIAL: u16 = 0xffff;

/// A sum over the bytes that it was told so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Checksum(u16);

impl Checksum {
    /// Of no bytes.
    pub const fn new() -> Self {
        Self(INITIAL)
    }

    /// Of these bytes as well.
    #[must_use]
    pub fn with(self, bytes: &[u8]) -> Self {
        bytes.iter().fold(self, |sum, &byte| sum.with_byte(byte))
    }

    /// The polynomial x¹⁶ + x¹² + x⁵ + 1, reflected, eight bits at once.
    fn with_byte(self, byte: u8) -> Self {
        let low = byte ^ (self.0 as u8);
        let mixed = u16::from(low ^ (low << 4));
        Self((self.0 >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4))
    }

    /// As it is sent, low byte first.
    pub const fn to_bytes(self) -> [u8; 2] {
        self.0.to_le_bytes()
    }
}

impl Default for Checksum {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The check value of the catalogue of parametrised CRC algorithms.
    #[test]
    fn the_catalogue_agrees() {
        assert_eq!(Checksum::new().with(b"123456789").to_bytes(), 0x6f91_u16.to_le_bytes());
    }
}
