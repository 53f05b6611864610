//! Numbers as tables and packets carry them: eight types, two codes for each, little-endian bytes.

use kestrel_core::attitude::Attitude;

/// Type of a log variable or a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Number {
    /// Unsigned, 8 bits.
    U8,
    /// Unsigned, 16 bits.
    U16,
    /// Unsigned, 32 bits.
    U32,
    /// Signed, 8 bits.
    I8,
    /// Signed, 16 bits.
    I16,
    /// Signed, 32 bits.
    I32,
    /// IEEE 754, 16 bits.
    Half,
    /// IEEE 754, 32 bits.
    Float,
}

/// Bytes of a number.
pub type Bytes = heapless::Vec<u8, 4>;

impl Number {
    /// All of them.
    pub const ALL: [Self; 8] =
        [Self::U8, Self::U16, Self::U32, Self::I8, Self::I16, Self::I32, Self::Half, Self::Float];

    /// Code in the table of log variables.
    pub const fn log_code(self) -> u8 {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::U32 => 3,
            Self::I8 => 4,
            Self::I16 => 5,
            Self::I32 => 6,
            Self::Float => 7,
            Self::Half => 8,
        }
    }

    /// The type of a code of log variables.
    pub fn of_log_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|number| number.log_code() == code)
    }

    /// Code in the table of parameters.
    pub const fn parameter_code(self) -> u8 {
        match self {
            Self::I8 => 0,
            Self::I16 => 1,
            Self::I32 => 2,
            Self::Half => 5,
            Self::Float => 6,
            Self::U8 => 8,
            Self::U16 => 9,
            Self::U32 => 10,
        }
    }

    /// Number of its bytes.
    pub const fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 | Self::Half => 2,
            Self::U32 | Self::I32 | Self::Float => 4,
        }
    }

    /// The bytes of a value; integers drop the fraction and what their width does not hold, as the firmware's do.
    pub fn write(self, value: f64) -> Bytes {
        let mut bytes = Bytes::new();
        match self {
            Self::Float => bytes.extend((value as f32).to_le_bytes()),
            Self::Half => bytes.extend(half_bits(value as f32).to_le_bytes()),
            Self::U8 | Self::U16 | Self::U32 | Self::I8 | Self::I16 | Self::I32 => {
                bytes.extend((value as i64).to_le_bytes().into_iter().take(self.size()));
            }
        }
        bytes
    }

    /// The value at the beginning of `bytes`; nothing if there are too few, if it is not finite, or of a half, which
    /// no parameter is.
    pub fn read(self, bytes: &[u8]) -> Option<f64> {
        let value = match self {
            Self::U8 => (*bytes.first()?).into(),
            Self::I8 => (*bytes.first()? as i8).into(),
            Self::U16 => u16::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::I16 => i16::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::U32 => u32::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::I32 => i32::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::Float => f32::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::Half => return None,
        };
        f64::is_finite(value).then_some(value)
    }
}

/// Greatest half.
const HALF_LIMIT: f32 = 65504.0;

/// Smallest half with a full significand, 2⁻¹⁴.
const HALF_NORMAL: f32 = 1.0 / 16384.0;

/// The nearest half, ties to even; beyond the greatest one the greatest.
fn half_bits(value: f32) -> u16 {
    let sign = if value.is_sign_negative() { 0x8000 } else { 0 };
    let magnitude = value.abs().min(HALF_LIMIT);
    if magnitude < HALF_NORMAL {
        return sign | libm::rintf(magnitude * 16_777_216.0) as u16;
    }
    let exponent = (magnitude.to_bits() >> 23) as u16 - (127 - 15);
    let significand = f32::from_bits(magnitude.to_bits() & 0x007F_FFFF | 0x3F80_0000);
    // A significand that rounds up to 2 carries into the exponent, as it should.
    sign | ((exponent << 10) + libm::rintf((significand - 1.0) * 1024.0) as u16)
}

/// A unit quaternion in 32 bits: which component is the greatest, then sign and nine bits of each of the others, in
/// the order x, y, z, w (`quatcompress.h` of the firmware).
pub fn compressed(attitude: &Attitude<f32>) -> u32 {
    let parts = [attitude.x, attitude.y, attitude.z, attitude.w];
    let mut greatest = 0;
    for index in 1..4 {
        if parts[index].abs() > parts[greatest].abs() {
            greatest = index;
        }
    }
    let others = (0..4).filter(|index| *index != greatest);
    others.fold(greatest as u32, |bits, index| {
        let negative = (parts[index] < 0.0) != (parts[greatest] < 0.0);
        let magnitude = (511.0 * core::f32::consts::SQRT_2 * parts[index].abs() + 0.5) as u32;
        bits << 10 | u32::from(negative) << 9 | magnitude.min(511)
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn codes_are_those_of_the_protocol_and_differ() {
        for number in Number::ALL {
            assert_eq!(Number::of_log_code(number.log_code()), Some(number));
            let size = match number.parameter_code() & 3 {
                0 => 1,
                1 => 2,
                _ => 4,
            };
            assert_eq!(number.size(), size, "the lowest two bits of {number:?} are its size");
        }
        assert_eq!(Number::of_log_code(0), None);
        assert_eq!(Number::of_log_code(9), None);
    }

    #[test]
    fn integers_drop_what_does_not_fit() {
        assert_eq!(Number::U8.write(258.9), [2]);
        assert_eq!(Number::I16.write(-1.5), [0xFF, 0xFF]);
        assert_eq!(Number::U32.write(f64::from(u32::MAX)), [0xFF; 4]);
    }

    #[test]
    fn halves_are_the_nearest_ones() {
        // Binary interchange format: sign, five bits of exponent biased by 15, ten bits of fraction.
        let table = [
            (0.0, 0x0000),
            (-0.0, 0x8000),
            (1.0, 0x3C00),
            (-2.0, 0xC000),
            (1.0 / 3.0, 0x3555),
            (1.0 + 1.0 / 2048.0, 0x3C00),
            (1.0 + 3.0 / 2048.0, 0x3C02),
            (2047.9, 0x6800),
            (65504.0, 0x7BFF),
            (1e9, 0x7BFF),
            (5.960_464_5e-8, 0x0001),
            (6.097_555e-5, 0x03FF),
            (6.103_515_6e-5, 0x0400),
        ];
        for (value, bits) in table {
            assert_eq!(half_bits(value), bits, "{value}");
        }
    }

    #[test]
    fn numbers_that_are_not_finite_are_not_read() {
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(Number::Float.read(&value.to_le_bytes()), None);
        }
        assert_eq!(Number::U32.read(&[1, 2, 3]), None);
    }

    /// The attitude in 32 bits, by the definition in the firmware's header.
    fn decompressed(mut bits: u32) -> [f32; 4] {
        let greatest = (bits >> 30) as usize;
        let mut parts = [0.0_f32; 4];
        let mut squares = 0.0;
        for index in (0..4).rev().filter(|index| *index != greatest) {
            let magnitude = (bits & 511) as f32 / 511.0 / core::f32::consts::SQRT_2;
            parts[index] = if bits & 512 == 0 { magnitude } else { -magnitude };
            squares += magnitude * magnitude;
            bits >>= 10;
        }
        parts[greatest] = (1.0 - squares).sqrt();
        parts
    }

    proptest! {
        #[test]
        fn values_survive_the_wire(value in any::<u32>()) {
            let value = f64::from(value);
            prop_assert_eq!(Number::U32.read(&Number::U32.write(value)), Some(value));
            prop_assert_eq!(Number::I16.read(&Number::I16.write(value % 32768.0)), Some(value % 32768.0));
            let small = f64::from(value as f32 * 1e-3);
            prop_assert_eq!(Number::Float.read(&Number::Float.write(small)), Some(small));
        }

        #[test]
        fn a_compressed_attitude_turns_alike(parts in [-1.0_f32..1.0, -1.0_f32..1.0, -1.0_f32..1.0, -1.0_f32..1.0]) {
            let [w, x, y, z] = parts;
            prop_assume!(parts.iter().map(|part| part * part).sum::<f32>() > 0.01);
            let attitude = Attitude { w, x, y, z }.normalized();
            let parts = decompressed(compressed(&attitude));
            let cosine = parts[0] * attitude.x + parts[1] * attitude.y + parts[2] * attitude.z + parts[3] * attitude.w;
            prop_assert!(cosine.abs() > 0.999_99, "{cosine}");
        }
    }
}
