//! Randomness that is a function of a counter and a key, without state: the same for any order of calls.

/// One Philox4x32-10 block (Salmon et al. 2011): four random words of a counter under a key.
#[inline(always)]
pub fn philox(counter: [u32; 4], key: [u32; 2]) -> [u32; 4] {
    let mut words = counter;
    let mut key = key;
    for _ in 0..10 {
        let low = u64::from(words[0]) * 0xD251_1F53;
        let high = u64::from(words[2]) * 0xCD9E_8D57;
        words = [
            (high >> 32) as u32 ^ words[1] ^ key[0],
            high as u32,
            (low >> 32) as u32 ^ words[3] ^ key[1],
            low as u32,
        ];
        key = [key[0].wrapping_add(0x9E37_79B9), key[1].wrapping_add(0xBB67_AE85)];
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_vectors_agree() {
        // Random123, kat_vectors: philox4x32 10.
        assert_eq!(philox([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(philox([u32::MAX; 4], [u32::MAX; 2]), [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
    }
}
