//! Policies as source code, for firmwares without a file system: a Rust module for those that link `kestrel-core`, C for
//! all others. The same policy file gives the same bytes.

mod betaflight;
mod c;
mod crazyflie;
mod rust;

use std::fmt::Write;

use kestrel_core::policy_file::PolicyError;
use thiserror::Error;

pub use betaflight::betaflight_controller;
pub use c::{CSource, c_source};
pub use crazyflie::crazyflie_app;
pub use rust::rust_module;

/// `kestrel_guard.h`: when a policy in C goes on flying, when it is held, and when another controller takes over.
pub const GUARD: &str = include_str!("../../../firmware-shim/crazyflie/include/kestrel_guard.h");

/// Why there is no source of a policy.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SourceError {
    /// The bytes are no policy, or its golden vectors fail.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// C is written in fixed point only.
    #[error("found a policy in float32, expected one in fixed16: only that can be written in C")]
    Float,
    /// The reference's controllers need more stack than the stabilizer's task has.
    #[error(
        "found a policy with the reference's actions, expected rotor speeds, thrust and body rates, or velocities"
    )]
    Published,
    /// An app shows a policy the Crazyflie's own motion and where it should be, and nothing else.
    #[error(
        "found a policy that sees `{found}`, expected one trained with `pilot`: an app shows it the drone's motion and the goal alone"
    )]
    Observation {
        /// What it sees.
        found: &'static str,
    },
}

/// `values` in rows of `per_row`, each followed by a comma.
fn rows(values: impl Iterator<Item = String>, per_row: usize) -> String {
    let mut text = String::new();
    for (index, value) in values.enumerate() {
        let gap = if index % per_row == 0 { "\n    " } else { " " };
        let _infallible = write!(text, "{gap}{value},");
    }
    text
}

/// Text that ends no comment and no line.
fn comment(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() || "*/\\".contains(letter) { '_' } else { letter }).collect()
}

#[cfg(test)]
mod tests;
