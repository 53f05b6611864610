//! What an instrument makes of the truth: a bias that wanders, white noise, and limits.
//!
//! Simulated sensors of policies and those that a simulator lends to another autopilot share it.

use nalgebra::Vector3;

use crate::airframe::GRAVITY;
use crate::real::Real;
use crate::vehicle::State;

/// A bias that takes a random walk and is pulled back to zero (a Gauss-Markov process, as RotorS has it: Furrer et al.
/// 2016, `gazebo_imu_plugin`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BiasWalk<R> {
    /// Growth of its deviation \[unit/√s\].
    pub density: R,
    /// Time in which it is pulled back \[s\]; infinite if it is not.
    pub correlation_secs: R,
}

impl<R: Real> BiasWalk<R> {
    /// The bias `secs` later, moved by a standard normal number.
    #[must_use]
    pub fn step(&self, bias: R, normal: R, secs: R) -> R {
        bias + (self.density * secs.sqrt() * normal - bias * secs / self.correlation_secs)
    }
}

/// What is measured of a true value: with its bias and its noise, and within the least and the greatest value that the
/// instrument delivers.
pub fn measured<R: Real>(truth: R, bias: R, noise: R, [least, greatest]: [R; 2]) -> R {
    let value = truth + (bias + noise);
    if value < least {
        least
    } else if value > greatest {
        greatest
    } else {
        value
    }
}

/// What an accelerometer at the centre of mass feels on average while the velocity \[m/s, world\] changes from `before`
/// to that of `after`, in `secs` \[s\], whatever did it: rotors, air, or something hit. In the body frame of `after`
/// \[m/s²\].
pub fn specific_force<R: Real>(before: &Vector3<R>, after: &State<R>, secs: R) -> Vector3<R> {
    let gravity = Vector3::new(R::zero(), R::zero(), R::from_f64(GRAVITY));
    after.world_from_body.rotate_inverse((after.velocity - before) / secs + gravity)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airframe::CF2X;
    use crate::attitude::Attitude;

    #[test]
    fn a_bias_without_a_pull_is_a_random_walk_and_with_one_it_decays() {
        let free = BiasWalk { density: 0.2_f64, correlation_secs: f64::INFINITY };
        assert_eq!(free.step(1.0, 0.5, 4.0), 1.0 + 0.2 * 2.0 * 0.5);
        assert_eq!(free.step(1.0, 0.0, 4.0), 1.0);
        let pulled = BiasWalk { density: 0.2_f64, correlation_secs: 10.0 };
        assert!((pulled.step(1.0, 0.0, 1.0) - 0.9).abs() < 1e-15);
        let normals = [1.0, -0.5].iter().cycle().take(100_000);
        let end = normals.fold(0.0, |bias, normal| pulled.step(bias, *normal, 0.1));
        // The mean of the normals, 0.25, against the pull.
        assert!((end / (0.2 * 0.25 * 10.0 / 0.1_f64.sqrt()) - 1.0).abs() < 0.05, "{end}");
    }

    #[test]
    fn an_instrument_delivers_nothing_beyond_its_limits() {
        let limits = [-1.0_f32, 2.0];
        assert_eq!(measured(0.5, 0.25, -0.5, limits), 0.25);
        assert_eq!(measured(3.0, 0.0, 0.0, limits), 2.0);
        assert_eq!(measured(f32::INFINITY, 0.0, 0.0, limits), 2.0);
        assert_eq!(measured(-3.0, 0.0, 0.0, limits), -1.0);
    }

    #[test]
    fn an_accelerometer_feels_the_floor_but_no_fall() {
        let still = State::<f64> {
            position: Vector3::zeros(),
            world_from_body: Attitude::from_axis_angle(Vector3::x(), core::f64::consts::FRAC_PI_2),
            velocity: Vector3::zeros(),
            body_rates: Vector3::zeros(),
            rotor_speeds: [CF2X.hover_rotor_speed(); 4],
        };
        let felt = specific_force(&Vector3::zeros(), &still, 0.01);
        assert!((felt - Vector3::new(0.0, GRAVITY, 0.0)).norm() < 1e-12, "on its side: {felt}");
        let falling = State { velocity: Vector3::new(0.0, 0.0, -0.01 * GRAVITY), ..still };
        assert!(specific_force(&Vector3::zeros(), &falling, 0.01).norm() < 1e-12);
    }
}
