//! What the images need of a machine: a way to print, a way to end, and on a microcontroller what becomes of a panic.

#[cfg(any(all(target_arch = "arm", target_os = "none"), all(target_arch = "riscv32", target_os = "none")))]
#[path = "machine/semihosting.rs"]
mod host;
#[cfg(target_arch = "wasm32")]
#[path = "machine/page.rs"]
mod host;
#[cfg(not(any(
    all(target_arch = "arm", target_os = "none"),
    all(target_arch = "riscv32", target_os = "none"),
    target_arch = "wasm32"
)))]
#[path = "machine/process.rs"]
mod host;
#[cfg(any(target_os = "none", target_arch = "wasm32"))]
mod panic;
#[cfg(all(target_arch = "arm", target_os = "none"))]
mod usart;

pub use host::end;
#[cfg(all(target_arch = "arm", target_os = "none"))]
pub use usart::Usart;

/// How a program ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// As it should.
    Passed,
    /// Something was refused or differs.
    Failed,
}

impl Verdict {
    /// Passed if both are.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        match self {
            Self::Passed => other,
            Self::Failed => self,
        }
    }
}

/// Prints the parts one after the other.
pub fn print(parts: &[&str]) {
    for part in parts {
        host::print(part);
    }
}

/// The sixteen digits of a number.
pub fn hexadecimal(value: u64) -> [u8; 16] {
    core::array::from_fn(|index| {
        let digit = (value >> (60 - 4 * index)) as u8 & 15;
        if digit < 10 { b'0' + digit } else { b'a' + digit - 10 }
    })
}

/// The ten decimal digits of a number, with leading zeros.
pub fn decimal(value: u32) -> [u8; 10] {
    let mut rest = value;
    let mut digits = [b'0'; 10];
    for digit in digits.iter_mut().rev() {
        *digit += (rest % 10) as u8;
        rest /= 10;
    }
    digits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_all_their_digits() {
        assert_eq!(&hexadecimal(0x0123_4567_89ab_cdef), b"0123456789abcdef");
        assert_eq!(&decimal(4_294_967_295), b"4294967295");
        assert_eq!(&decimal(70), b"0000000070");
    }

    #[test]
    fn one_failure_is_enough() {
        assert_eq!(Verdict::Passed.and(Verdict::Failed).and(Verdict::Passed), Verdict::Failed);
    }
}
