//! A flight to look at: from behind, around or on board a drone, with the plan from above and what its camera sees.
//!
//! [`Controls`] are what keys and the mouse have set, [`Desk`] makes the picture of that. With the feature `viewer` a
//! window shows it; without a display it is written to a file ([`Desk::film`]), by the same code.

mod controls;
mod desk;
mod layout;
#[cfg(test)]
mod tests;
#[cfg(feature = "viewer")]
pub mod window;

pub use controls::{Action, CameraMode, Controls, Extent, Flow, action};
pub use desk::Desk;

/// Least columns and rows of a picture \[px\].
pub const LEAST_SIZE: [usize; 2] = [320, 240];
