//! Where a vehicle may fly.

use nalgebra::Vector3;

/// A cylinder around home.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fence {
    /// Its middle, on the ground \[m, world\].
    pub center: Vector3<f32>,
    /// Greatest horizontal distance \[m\], infinite without a fence.
    pub radius_m: f32,
    /// Greatest height \[m\], infinite without a fence.
    pub height_m: f32,
}

impl Fence {
    /// None.
    pub fn open() -> Self {
        Self { center: Vector3::zeros(), radius_m: f32::INFINITY, height_m: f32::INFINITY }
    }

    /// Distance from a point within to the fence, negative outside \[m\].
    pub fn margin_m(&self, point: &Vector3<f32>) -> f32 {
        let way = point - self.center;
        (self.radius_m - way.xy().norm()).min(self.height_m - way.z)
    }
}
