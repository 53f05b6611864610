//! Velocities as actions: for policies that shall find their way, not learn to fly.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{ACTION_LEN, ThrustBodyRates};
use crate::airframe::GRAVITY;
use crate::real::Real;
use crate::vehicle::State;

/// Greatest acceleration that a velocity error asks for \[m/s²\]: a tilt of 31 degrees, and a fall at 0.4 g.
const ACCELERATION_LIMIT: f32 = 6.0;

/// Velocity in the world and yaw rate, tracked by a geometric controller (after Lee, Leok and McClamroch 2010) in front of
/// a [`ThrustBodyRates`].
///
/// The wanted velocity is `action[0..3] · speed_limit` along the world's axes, the wanted yaw rate `action[3]` times
/// its limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Velocities {
    /// What turns thrust and body rates into rotor speeds.
    pub rates: ThrustBodyRates,
    /// Velocity along each axis that a full action asks for \[m/s\].
    pub speed_limit: f32,
    /// Acceleration per velocity error \[1/s\].
    pub velocity_gain: f32,
    /// Body rate per sine of the angle between the thrust and where it should point \[1/s\].
    pub attitude_gain: f32,
}

impl Velocities {
    /// Rotor targets \[rad/s\], within zero and the greatest rotor speed, whatever the action (limited to
    /// \[-1, 1\], NaN to -1) and the state.
    #[inline(always)]
    pub fn rotor_targets<R: Real>(&self, action: &[R; ACTION_LEN], state: &State<R>) -> [R; 4] {
        let real = R::from_f32;
        let [x, y, z, yaw] = action.map(|value| value.limited(-R::one(), R::one()));
        let limit = real(self.speed_limit);
        let gravity = R::from_f64(GRAVITY);
        let mut push = self.acceleration(&Vector3::new(x * limit, y * limit, z * limit), &state.velocity);
        push.z += gravity;
        let length = ((push.x * push.x + push.y * push.y) + push.z * push.z).sqrt();
        let in_body = state.world_from_body.rotate_inverse(push);
        let gain = real(self.attitude_gain) / length;
        let of_limit = |axis: usize, rate: R| rate / real(self.rates.body_rates_limit[axis]);
        let thrust = (in_body.z / gravity - R::one()) / real(self.rates.thrust_fraction);
        let action = [thrust, of_limit(0, -(in_body.y * gain)), of_limit(1, in_body.x * gain), yaw];
        self.rates.rotor_targets(&action, &state.body_rates)
    }

    /// Towards a velocity \[m/s²\], shortened to its limit.
    #[inline(always)]
    fn acceleration<R: Real>(&self, wanted: &Vector3<R>, velocity: &Vector3<R>) -> Vector3<R> {
        let gain = R::from_f32(self.velocity_gain);
        let [x, y, z] = core::array::from_fn(|axis| (wanted[axis] - velocity[axis]) * gain);
        let limit = R::from_f32(ACCELERATION_LIMIT);
        let scale = limit / ((x * x + y * y) + z * z).sqrt().at_least(limit);
        Vector3::new(x * scale, y * scale, z * scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airframe::CF2X;
    use crate::attitude::Attitude;
    use crate::dynamics::Integrator;
    use crate::vehicle::{Air, Vehicle};

    fn space() -> Velocities {
        Velocities {
            rates: ThrustBodyRates::new(&CF2X, 1.0, [8.0, 8.0, 3.0], [16.0, 16.0, 6.0]),
            speed_limit: 2.0,
            velocity_gain: 3.0,
            attitude_gain: 5.0,
        }
    }

    fn still(world_from_body: Attitude<f64>) -> State<f64> {
        State {
            position: Vector3::zeros(),
            world_from_body,
            velocity: Vector3::zeros(),
            body_rates: Vector3::zeros(),
            rotor_speeds: [CF2X.hover_rotor_speed(); 4],
        }
    }

    #[test]
    fn a_zero_action_hovers() {
        for target in space().rotor_targets(&[0.0; 4], &still(Attitude::level())) {
            assert!((target / CF2X.hover_rotor_speed() - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn whatever_the_heading_the_wanted_velocity_is_reached() {
        let vehicle = Vehicle::<f64>::new(&CF2X);
        for heading in [0.0, 1.0, 2.5, -2.0] {
            let tilted = Attitude::from_axis_angle(Vector3::x(), 0.5);
            let mut state = still(Attitude::from_axis_angle(Vector3::z(), heading).after(&tilted));
            for _ in 0..100 {
                let targets = space().rotor_targets(&[0.5, -0.25, 0.1, 0.0], &state);
                for _ in 0..4 {
                    state =
                        Integrator::SemiImplicitEuler.advance(&vehicle, &state, &targets, &Air::still(), 0.005);
                }
            }
            let missed = (state.velocity - Vector3::new(1.0, -0.5, 0.2)).norm();
            assert!(missed < 0.1, "{missed} m/s at heading {heading}");
        }
    }
}
