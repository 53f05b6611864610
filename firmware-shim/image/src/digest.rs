//! A number that stands for a stream of results: FNV-1a, 64 bits (draft-eastlake-fnv).

const OFFSET_BASIS: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;

/// The digest of the numbers so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digest(u64);

impl Digest {
    /// Of nothing.
    pub const fn new() -> Self {
        Self(OFFSET_BASIS)
    }

    /// Adds `values`, bit for bit, lowest byte first.
    pub fn add(&mut self, values: &[f32]) {
        for value in values {
            self.add_bytes(&value.to_le_bytes());
        }
    }

    /// Adds bytes.
    pub fn add_bytes(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(PRIME);
        }
    }

    /// The number.
    pub const fn value(self) -> u64 {
        self.0
    }
}

impl Default for Digest {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The published test vector of "foobar" has six bytes; four of them and a float of the others would not do, so the
    /// empty one and the one of four bytes, "chon", computed by the reference implementation's loop.
    #[test]
    fn it_is_fnv_1a() {
        assert_eq!(Digest::new().value(), 0xcbf2_9ce4_8422_2325);
        let mut digest = Digest::new();
        digest.add(&[f32::from_le_bytes(*b"foob")]);
        let expected = b"foob".iter().fold(OFFSET_BASIS, |sum, byte| (sum ^ u64::from(*byte)).wrapping_mul(PRIME));
        assert_eq!(digest.value(), expected);
    }
}
