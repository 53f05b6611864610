//! A flight to look at: from behind, around or on board a drone, with the plan from above and what its camera sees.
//!
//! [`Controls`] are what keys and the mouse have set, [`Viewport`] makes the picture of that, [`LiveViewport`] while the flight
//! goes on. With the feature `viewer` a window shows it; without a display it is written to a file ([`Viewport::video`]), by
//! the same code.

mod controls;
mod layout;
mod live;
#[cfg(test)]
mod tests;
mod viewport;
#[cfg(feature = "viewer")]
pub mod window;

pub use controls::{Action, CameraMode, Controls, Extent, Flow, action};
pub use live::{Glimpse, LiveViewport};
pub use viewport::Viewport;

use crate::picture::Picture;
use crate::video::VideoError;

/// Least columns and rows of a picture \[px\].
pub const LEAST_SIZE: [usize; 2] = [320, 240];

/// What a window shows.
pub trait Spectacle {
    /// How much there is to see.
    fn extent(&self) -> Extent;

    /// Makes pictures of another size \[px\], at least [`LEAST_SIZE`].
    fn resize(&mut self, size: [usize; 2]);

    /// What there is to see now.
    ///
    /// # Errors
    /// When the renderer fails.
    fn picture(&self, controls: &Controls) -> Result<Picture, VideoError>;

    /// Takes in what has happened meanwhile; whether there is more to come.
    ///
    /// # Errors
    /// When it cannot be shown.
    fn follow(&mut self, controls: &mut Controls) -> Result<Flow, VideoError>;
}
