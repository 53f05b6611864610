//! The CRC-32 of Ethernet, zlib and PNG.

/// Reflected generator polynomial (IEEE 802.3).
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// Remainders of the sixteen half bytes: 64 bytes of flash instead of 1024, at two steps per byte.
const REMAINDERS: [u32; 16] = remainders();

/// Checksum of `bytes`: initial value and final exclusive-or all ones, reflected.
///
/// Finds every burst of errors up to 32 bits long and every pair of flipped bits; any other damage slips through
/// with probability 2⁻³².
pub fn crc32(bytes: &[u8]) -> u32 {
    let mut sum = Crc32::new();
    for byte in bytes {
        sum.add(*byte);
    }
    sum.value()
}

/// The checksum of bytes that come one by one.
#[derive(Clone, Copy, Debug)]
pub struct Crc32(u32);

impl Crc32 {
    /// Of nothing.
    pub const fn new() -> Self {
        Self(u32::MAX)
    }

    /// Adds a byte.
    #[inline]
    pub fn add(&mut self, byte: u8) {
        self.0 = half_step(half_step(self.0 ^ u32::from(byte)));
    }

    /// Of all bytes so far.
    pub const fn value(self) -> u32 {
        !self.0
    }
}

impl Default for Crc32 {
    fn default() -> Self {
        Self::new()
    }
}

#[inline]
fn half_step(state: u32) -> u32 {
    (state >> 4) ^ REMAINDERS[(state & 15) as usize]
}

const fn remainders() -> [u32; 16] {
    let mut table = [0; 16];
    let mut nibble = 0;
    while nibble < 16 {
        let mut remainder = nibble as u32;
        let mut bit = 0;
        while bit < 4 {
            remainder = (remainder >> 1) ^ (POLYNOMIAL & (remainder & 1).wrapping_neg());
            bit += 1;
        }
        table[nibble] = remainder;
        nibble += 1;
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The check value that every catalogue of CRCs prints for this one.
    #[test]
    fn the_check_value_is_the_published_one() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
        assert_eq!(crc32(b""), 0);
    }

    #[test]
    fn every_flipped_bit_changes_the_checksum() {
        let mut bytes = *b"a policy, in flight";
        let intact = crc32(&bytes);
        for bit in 0..bytes.len() * 8 {
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert_ne!(crc32(&bytes), intact, "bit {bit}");
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    }
}
