//! A process of an operating system.

extern crate std;

use std::process::ExitCode;

use super::Verdict;

/// Prints `text`.
pub(super) fn print(text: &str) {
    std::print!("{text}");
}

/// The status that `main` returns.
pub fn end(verdict: Verdict) -> ExitCode {
    match verdict {
        Verdict::Passed => ExitCode::SUCCESS,
        Verdict::Failed => ExitCode::FAILURE,
    }
}
