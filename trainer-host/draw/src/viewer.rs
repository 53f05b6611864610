//! A flight to look at: from behind, around or on board a drone, with the plan from above and what its camera sees.
//!
//! [`Controls`] are what keys and the mouse have set, [`Viewport`] makes the picture of that. With the feature `viewer` a
//! window shows it; without a display it is written to a file ([`Viewport::video`]), by the same code.

mod controls;
mod layout;
#[cfg(test)]
mod tests;
mod viewport;
#[cfg(feature = "viewer")]
pub mod window;

pub use controls::{Action, CameraMode, Controls, Extent, Flow, action};
pub use viewport::Viewport;

/// Least columns and rows of a picture \[px\].
pub const LEAST_SIZE: [usize; 2] = [320, 240];
