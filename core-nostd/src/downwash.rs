//! The air that one drone pushes onto another below it.

use nalgebra::Vector3;

use crate::airframe::{Airframe, GRAVITY};
use crate::real::Real;

/// The air that an airframe pushes down, ready for arithmetic.
///
/// gym-pybullet-drones' jet, a Gaussian across whose strength falls with the square of the depth, without its two
/// singularities: it never pushes harder than the weight that it carries (the momentum of the air is no more), and it
/// is never narrower than the drone (the reference's width passes through zero 0.69 m down).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jet<R> {
    /// Strength times squared quarter radius of a propeller \[N m²\].
    strength: R,
    /// Weight of the drone that makes it \[N\].
    weight: R,
    /// Growth of the width with depth \[m/m\].
    width_slope: R,
    /// Width at depth zero \[m\].
    width_offset: R,
    /// \[m\].
    least_width: R,
}

impl<R: Real> Jet<R> {
    /// The jet below a drone of the airframe.
    pub fn new(airframe: &Airframe) -> Self {
        let quarter_radius = 0.25 * airframe.propeller_radius;
        Self {
            strength: R::from_f64(airframe.downwash.strength * quarter_radius * quarter_radius),
            weight: R::from_f64(airframe.mass * GRAVITY),
            width_slope: R::from_f64(airframe.downwash.width_slope),
            width_offset: R::from_f64(airframe.downwash.width_offset),
            least_width: R::from_f64(airframe.collision_radius),
        }
    }

    /// Downward force \[N, world\] on a drone at `offset` \[m, world\] from the one that makes the wind; zero beside or
    /// above it.
    #[inline(always)]
    pub fn push(&self, offset: &Vector3<R>) -> R {
        let depth = (-offset.z).at_least(R::from_f64(1e-6));
        let width = (self.width_slope * depth + self.width_offset).abs().at_least(self.least_width);
        let across = (offset.x * offset.x + offset.y * offset.y) / (width * width);
        let strength = (self.strength / (depth * depth)).at_most(self.weight);
        let push = strength * (R::from_f64(-0.5) * across).exp();
        offset.z.where_less(R::zero(), push, R::zero())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airframe::CF2X;

    fn push(x: f64, z: f64) -> f64 {
        Jet::new(&CF2X).push(&Vector3::new(x, 0.0, z))
    }

    #[test]
    fn below_it_is_the_reference_where_that_is_sound() {
        // 2267.18 (R / 4 dz)² at 1.5 m, straight below and at one width to the side.
        let below = 2267.18 * (2.31348e-2 / 6.0) * (2.31348e-2 / 6.0);
        assert!((push(0.0, -1.5) - below).abs() < 1e-6);
        assert!((push(0.13, -1.5) - below * libm::exp(-0.5)).abs() < 1e-4 * below);
    }

    #[test]
    fn it_never_exceeds_the_weight_of_the_drone_above() {
        for depth in [1e-9, 0.01, 0.1, 0.3, 0.5, 0.6875] {
            assert!(push(0.0, -depth) <= CF2X.mass * GRAVITY);
        }
    }

    #[test]
    fn beside_and_above_there_is_none() {
        assert_eq!(push(0.0, 0.5), 0.0);
        assert_eq!(push(0.0, 0.0), 0.0);
        assert!(push(2.0, -0.5) < 1e-9);
    }
}
