#![cfg_attr(not(test), no_std)]
//! Bare-metal images that check and measure the core's policies where they are to fly.
//!
//! Four [`policy`]s of `assets/pilots` are in the image. The program `conformance` feeds them the same [`input`]s on every
//! machine and prints [`digest`]s, which must be equal: see [`conformance`]. It knows nothing of the [`machine`].
//! On microcontrollers the program `budget` runs each part of a control period in a window that a counter of instructions
//! sees.
//!
//! On a machine without an operating system a panic refers to a symbol that does not exist, so that an image in which
//! one could be reached does not link.

pub mod autopilot;
#[cfg(target_os = "none")]
pub mod budget;
pub mod conformance;
pub mod digest;
pub mod input;
pub mod learning;
pub mod link;
pub mod machine;
pub mod policy;
#[cfg(target_os = "none")]
pub mod probe;
#[cfg(feature = "encoder")]
pub mod sight;
