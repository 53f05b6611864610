//! The air that one drone pushes onto another below it.

use nalgebra::Vector3;

use crate::airframe::{Airframe, GRAVITY};
use crate::real::Real;

/// Force \[N, world\] on a drone at `offset` \[m, world\] from the drone above that makes the wind; zero beside or
/// above it.
///
/// gym-pybullet-drones' jet, a Gaussian across whose strength falls with the square of the depth, without its two
/// singularities: it never pushes harder than the weight that it carries (the momentum of the air is no more), and it
/// is never narrower than the drone (the reference's width passes through zero 0.69 m down).
#[inline(always)]
pub fn downwash_force<R: Real>(airframe: &Airframe, offset: &Vector3<R>) -> Vector3<R> {
    let jet = &airframe.downwash;
    let depth = (-offset.z).at_least(R::from_f64(1e-6));
    let spread = R::from_f64(0.25 * airframe.propeller_radius) / depth;
    let strength = (R::from_f64(jet.strength) * spread * spread).at_most(R::from_f64(airframe.mass * GRAVITY));
    let width = (R::from_f64(jet.width_slope) * depth + R::from_f64(jet.width_offset)).abs();
    let width = width.at_least(R::from_f64(airframe.collision_radius));
    let across = (offset.x * offset.x + offset.y * offset.y) / (width * width);
    let push = strength * exp_of_minus(R::from_f64(0.5) * across);
    let zero = R::zero();
    Vector3::new(zero, zero, offset.z.where_less(zero, -push, zero))
}

/// `exp(-x)` for x ≥ 0 to within 1e-4 of one: the cubic of x/1024, squared ten times.
#[inline(always)]
fn exp_of_minus<R: Real>(x: R) -> R {
    // Beyond 50 the result is below 2e-22.
    let small = x.at_most(R::from_f64(50.0)) * R::from_f64(1.0 / 1024.0);
    let (half, sixth) = (R::from_f64(0.5), R::from_f64(1.0 / 6.0));
    let mut power = R::one() - small * (R::one() - small * (half - small * sixth));
    for _ in 0..10 {
        power = power * power;
    }
    power
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airframe::CF2X;

    fn push(x: f64, z: f64) -> f64 {
        -downwash_force(&CF2X, &Vector3::new(x, 0.0, z)).z
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

    #[test]
    fn the_exponential_is_close_enough() {
        for x in [0.0, 0.1, 1.0, 3.0, 10.0, 100.0] {
            assert!((exp_of_minus(x) - libm::exp(-x)).abs() < 1e-6);
            assert!((f64::from(exp_of_minus(x as f32)) - libm::exp(-x)).abs() < 1e-4);
        }
    }
}
