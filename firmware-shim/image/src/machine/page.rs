//! A web page, or Node: the host brings a function that prints.

#![expect(unsafe_code, reason = "functions of the host are foreign")]

use super::Verdict;

#[link(wasm_import_module = "host")]
unsafe extern "C" {
    /// Prints `len` bytes at `text`.
    fn print_bytes(text: *const u8, len: usize);
}

/// Prints `text`.
pub(super) fn print(text: &str) {
    // SAFETY: the host reads as many bytes as the slice has.
    unsafe { print_bytes(text.as_ptr(), text.len()) }
}

/// The status that a program returns to its host.
pub fn end(verdict: Verdict) -> i32 {
    i32::from(verdict == Verdict::Failed)
}
