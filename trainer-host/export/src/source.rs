//! Policies as source code, for firmwares without a file system: a Rust module for those that link `kestrel-core`, C for
//! all others. The same policy file gives the same bytes.

mod betaflight;
mod c;
mod crazyflie;
mod rust;
mod sensing;

use std::fmt::Write;

use kestrel_core::action::ActionSpace;
use kestrel_core::observation::ObservationLayout;
use kestrel_core::policy_file::{Activation, PolicyError, PolicyFile, PolicyMetadata, RecurrentPolicy};
use thiserror::Error;

use crate::policy::Policy;

pub use betaflight::betaflight_controller;
pub use c::{CSource, c_source};
pub use crazyflie::{crazyflie_app, crazyflie_map_bytes};
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
    /// Nothing trains such a one.
    #[error("found a policy with a memory and rectifiers, expected one of them: C has no such policy")]
    RectifiedMemory,
    /// The library that Betaflight's forks link has no place for a memory.
    #[error(
        "found a policy with a memory, expected one without: `--target c`, `--target rust` and `--target crazyflie` take it"
    )]
    Memory,
    /// The reference's controllers need more stack than the stabilizer's task has.
    #[error(
        "found a policy with the reference's actions, expected rotor speeds, thrust and body rates, or velocities"
    )]
    Published,
    /// The library of the app leaves out what is for PX4.
    #[error("found a policy with {found}, expected one without: the app leaves out what is for PX4")]
    Px4 {
        /// What of it.
        found: &'static str,
    },
    /// Its rotors are not where a Crazyflie's motors are.
    #[error(
        "found a policy for rotors in another order, expected the Crazyflie's: clockwise from the front right, which turns counter-clockwise"
    )]
    Rotors,
    /// A firmware shows a policy the drone's own motion and where it should be, and nothing else.
    #[error(
        "found a policy that sees `{found}`, expected one trained with `pilot`, or with `body` and no sensors: it is shown the drone's motion and the goal alone"
    )]
    Observation {
        /// What it sees.
        found: &'static str,
    },
    /// Which sensors the policy sees is not in its file.
    #[error(
        "found a policy file alone of a policy that sees sensors, expected its run or a pilot that comes with the program: they say which sensors"
    )]
    UnknownSensors,
    /// A Crazyflie does not measure what the policy sees.
    #[error(
        "found a policy that sees {found}, expected rangers, and a scan of the same few rooms in which nothing moves: an app shows it nothing else"
    )]
    Sensors {
        /// What it sees.
        found: String,
    },
}

/// The network of a policy that sees no images, and its memory if it has one.
fn network_of<'p, 'a>(
    policy: &'p Policy<'a>,
) -> Result<(&'p PolicyFile<'a>, Option<&'p RecurrentPolicy<'a>>), SourceError> {
    match policy {
        Policy::Blind(policy) => Ok((policy, None)),
        Policy::Recurrent(policy) => Ok((policy.network(), Some(policy))),
        Policy::Seeing(_) => Err(PolicyError::Vision.into()),
    }
}

/// What of the policy only a `kestrel-core` with the feature `px4` reads.
fn for_px4(policy: &PolicyFile<'_>) -> Option<&'static str> {
    let PolicyMetadata { observation, action, .. } = policy.metadata();
    match (policy.activation(), observation, action) {
        (Activation::Relu, _, _) => Some("rectifiers (`training.activation: relu`)"),
        (_, ObservationLayout::Px4Neural(_), _) => Some("the observation `px4_neural`"),
        (_, _, ActionSpace::RotorThrusts(_)) => Some("the action `rotor_thrusts`"),
        (Activation::Tanh, _, _) => None,
    }
}

/// Whether the policy's rotors are the Crazyflie's motors 1 to 4, as far as it says.
fn for_crazyflie(policy: &PolicyFile<'_>) -> bool {
    policy
        .metadata()
        .airframe
        .is_none_or(|airframe| airframe.corners() == Some([0, 1, 2, 3]) && airframe.turn_as_usual([0, 1, 2, 3]))
}

/// `values` in rows of `per_row`, each followed by a comma.
pub(crate) fn rows(values: impl Iterator<Item = String>, per_row: usize) -> String {
    let mut text = String::new();
    for (index, value) in values.enumerate() {
        let gap = if index % per_row == 0 { "\n    " } else { " " };
        let _infallible = write!(text, "{gap}{value},");
    }
    text
}

/// Text that ends no comment and no line.
pub(crate) fn comment(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() || "*/\\".contains(letter) { '_' } else { letter }).collect()
}

#[cfg(test)]
mod tests;
