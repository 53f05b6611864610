//! What a camera sees of a world of convex bodies: colour, metric depth and what each pixel shows, in one pass.
//!
//! A pixel looks along `d = forward + u · right + v · down`, whose part along the optical axis is one: the parameter of
//! its ray is the planar depth. The ray meets a plane `n · x = c` at the inverse depth `n · d / (c − n · eye)`, which is
//! affine in `u` and `v`. A convex body is what lies behind all of its planes, so that a ray is inside between the last
//! plane that it enters (the least inverse depth of those that face the eye) and the first that it leaves (the greatest
//! of the others). A plane costs a pixel two additions, two multiplications and a comparison; only what is seen in the
//! end is divided and coloured. Cylinders are exact: a root per pixel.

mod backend;
mod kernel;
mod onboard;
mod optics;
mod plot;
mod render;
mod renderer;
mod scene;
#[cfg(test)]
mod tests;
pub mod words;

use nalgebra::Vector3;

pub use backend::{Backend, RenderError, UnknownBackend};
pub use kernel::Canvas;
pub use onboard::{Channel, Mount, OnboardCamera};
pub(crate) use optics::Calibration;
pub use optics::Optics;
pub use renderer::{Cpu, Renderer, Shot};
pub use scene::{Mover, Scene};

use crate::world::Pose;

/// Label of a pixel that shows nothing.
pub const NOTHING: u16 = 0;

/// Label of a pixel that shows the floor.
pub const FLOOR: u16 = 1;

/// Label of a pixel that shows the first solid of the world; those of the others follow, then those of its movables, then
/// those of the scene's drones, one each.
pub const FIRST_SOLID: u16 = 2;

/// A pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Pixels of a row.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// Tangents of half the angles of view, across and up.
    pub tangents: [f64; 2],
    /// Where in a pixel its ray goes, from its left and upper edges; half and half is the middle.
    pub sample: [f64; 2],
    /// Least depth that is seen \[m\].
    pub near_m: f64,
    /// Greatest depth that is seen \[m\].
    pub far_m: f64,
}

/// Where a camera is and where it looks: an orthonormal frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// \[m\], world.
    pub eye: Vector3<f64>,
    /// Towards the right of the image.
    pub right: Vector3<f64>,
    /// Towards its bottom.
    pub down: Vector3<f64>,
    /// The optical axis.
    pub forward: Vector3<f64>,
}

/// What a camera saw; rows from the top, each from the left.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image {
    /// Pixels of a row.
    pub columns: usize,
    /// Along the optical axis \[m\]; the camera's greatest where nothing is.
    pub depths: Vec<f32>,
    /// [`NOTHING`], [`FLOOR`], or [`FIRST_SOLID`] plus the index of a solid of the world, movables behind, drones behind those.
    pub labels: Vec<u16>,
    /// Red, green, blue.
    pub colours: Vec<[u8; 3]>,
}

impl Camera {
    /// The reference's: 64×48 pixels, 60° both across and up (pixels are not square), from an arm's length to 1 km.
    /// `TinyRenderer` samples a pixel at its left lower corner.
    pub const REFERENCE: Self = Self {
        columns: 64,
        rows: 48,
        tangents: [0.577_350_269_189_625_8; 2],
        sample: [0.0, 1.0],
        near_m: 0.0397,
        far_m: 1000.0,
    };
}

impl View {
    /// From a point towards another, the image's top towards `up`.
    ///
    /// # Panics
    /// When the camera looks along `up`, or from a point to itself.
    pub fn towards(eye: Vector3<f64>, target: Vector3<f64>, up: Vector3<f64>) -> Self {
        let forward = (target - eye).normalize();
        let right = forward.cross(&up);
        assert!(right.norm() > 1e-9, "a camera does not look along its own top");
        let right = right.normalize();
        Self { eye, right, down: forward.cross(&right), forward }
    }

    /// As the reference mounts it: an arm's length above the drone's centre in the world, along the drone's x axis, never
    /// tilted sideways.
    pub fn paper(drone: &Pose, arm_m: f64) -> Self {
        let eye = drone.position + arm_m * Vector3::z();
        let ahead = drone.world_from_body.rotate(Vector3::x());
        Self::towards(eye, drone.position + 1000.0 * ahead, Vector3::z())
    }
}
