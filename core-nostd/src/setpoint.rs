//! Where a drone should be and how it should move there.

use nalgebra::Vector3;

use crate::real::Real;

/// What a controller follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setpoint<R> {
    /// \[m\], world.
    pub position: Vector3<R>,
    /// \[m/s\], world.
    pub velocity: Vector3<R>,
    /// Heading \[rad\].
    pub yaw: R,
    /// Rates of roll, pitch and yaw \[rad/s\].
    pub euler_rates: Vector3<R>,
}

impl<R: Real> Setpoint<R> {
    /// At rest at a position \[m, world\], facing +x.
    pub fn at(position: Vector3<R>) -> Self {
        let still = Vector3::new(R::zero(), R::zero(), R::zero());
        Self { position, velocity: still, yaw: R::zero(), euler_rates: still }
    }
}
