//! SHA-256 (FIPS 180-4) over pieces of a message: the blocks are the `sha2` crate's, what stands around them is here, because
//! that crate's own buffer may panic as far as a linker can tell.

use sha2::digest::generic_array::GenericArray;

/// Bytes of a block.
const BLOCK: usize = 64;

/// Bytes at the end of the last block that hold the length of the message.
const LENGTH: usize = 8;

/// The first 32 bits of the fractional parts of the square roots of the first eight primes.
const START: [u32; 8] =
    [0x6a09_e667, 0xbb67_ae85, 0x3c6e_f372, 0xa54f_f53a, 0x510e_527f, 0x9b05_688c, 0x1f83_d9ab, 0x5be0_cd19];

/// A digest of the bytes so far.
#[derive(Clone, Debug)]
pub struct Sha256 {
    state: [u32; 8],
    block: [u8; BLOCK],
    /// Bytes in the block.
    filled: usize,
    /// Bytes in all.
    len: u64,
}

impl Sha256 {
    /// Of nothing.
    pub const fn new() -> Self {
        Self { state: START, block: [0; BLOCK], filled: 0, len: 0 }
    }

    /// Of these bytes as well.
    #[must_use]
    pub fn with(mut self, bytes: &[u8]) -> Self {
        for byte in bytes {
            self.push(*byte);
            self.len += 1;
        }
        self
    }

    /// The digest.
    pub fn finish(mut self) -> [u8; 32] {
        self.push(0x80);
        while self.filled != BLOCK - LENGTH {
            self.push(0);
        }
        for byte in (8 * self.len).to_be_bytes() {
            self.push(byte);
        }
        let mut digest = [0; 32];
        let bytes = self.state.iter().flat_map(|word| word.to_be_bytes());
        digest.iter_mut().zip(bytes).for_each(|(to, from)| *to = from);
        digest
    }

    fn push(&mut self, byte: u8) {
        if let Some(place) = self.block.get_mut(self.filled) {
            *place = byte;
        }
        self.filled += 1;
        if self.filled == BLOCK {
            sha2::compress256(&mut self.state, &[GenericArray::from(self.block)]);
            self.filled = 0;
        }
    }
}

impl Default for Sha256 {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use sha2::Digest;

    use super::*;

    #[test]
    fn it_is_that_of_the_crate_for_every_length() {
        let message: std::vec::Vec<u8> = (0..300_u16).map(|value| value as u8).collect();
        for len in 0..message.len() {
            let (first, second) = message[..len].split_at(len / 3);
            let theirs: [u8; 32] = sha2::Sha256::digest(&message[..len]).into();
            assert_eq!(Sha256::new().with(first).with(second).finish(), theirs, "{len} bytes");
        }
    }
}
