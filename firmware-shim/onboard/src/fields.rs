//! Numbers in the fields of a message, which are little-endian; zero beyond the end.

/// A number.
pub fn f32_at(fields: &[u8], at: usize) -> f32 {
    f32::from_bits(u32_at(fields, at))
}

/// Four bytes without a sign.
pub fn u32_at(fields: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes_at(fields, at))
}

/// Four bytes with a sign.
pub fn i32_at(fields: &[u8], at: usize) -> i32 {
    i32::from_le_bytes(bytes_at(fields, at))
}

/// Eight bytes without a sign.
pub fn u64_at(fields: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes_at(fields, at))
}

/// Two bytes without a sign.
pub fn u16_at(fields: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(bytes_at(fields, at))
}

/// Two bytes with a sign.
pub fn i16_at(fields: &[u8], at: usize) -> i16 {
    i16::from_le_bytes(bytes_at(fields, at))
}

fn bytes_at<const LEN: usize>(fields: &[u8], at: usize) -> [u8; LEN] {
    fields.get(at..).and_then(<[u8]>::first_chunk).copied().unwrap_or([0; LEN])
}
