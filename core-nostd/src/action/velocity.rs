//! Velocities as actions: for policies that shall find their way, not learn to fly.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{ACTION_LEN, ThrustBodyRates};
use crate::airframe::GRAVITY;
use crate::real::Real;
use crate::vehicle::State;

/// Greatest acceleration that a velocity error asks for \[m/s²\]: a tilt of 31 degrees, and a fall at 0.4 g.
const ACCELERATION_LIMIT: f32 = 6.0;

/// Greatest velocity error along an axis that an integral takes in \[m/s\], so that it does not wind up while the drone is on its
/// way to another velocity.
const INTEGRATED_LIMIT: f32 = 0.5;

/// Greatest acceleration along an axis that an integral makes up for \[m/s²\]: 40 % of the weight.
const INTEGRAL_LIMIT: f32 = 4.0;

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

/// [`Velocities`] with an integral of the velocity error, which makes up for what the controller is not told of: mass, thrust,
/// drag, wind. So do the velocity controllers of Bitcraze's firmware and of PX4.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct IntegralVelocities {
    /// The controller that it helps.
    pub velocities: Velocities,
    /// Acceleration per integrated velocity error \[1/s²\].
    pub integral_gain: f32,
}

impl IntegralVelocities {
    /// Rotor targets as of [`Velocities::rotor_targets`] after `secs` more; `integral` is the acceleration that it makes up for so
    /// far \[m/s², world\], zero at the start of an episode.
    #[inline(always)]
    pub fn rotor_targets<R: Real>(
        &self,
        action: &[R; ACTION_LEN],
        state: &State<R>,
        integral: &mut Vector3<R>,
        secs: R,
    ) -> [R; 4] {
        let wanted = self.velocities.wanted(action);
        let gain = R::from_f32(self.integral_gain) * secs;
        let (taken, limit) = (R::from_f32(INTEGRATED_LIMIT), R::from_f32(INTEGRAL_LIMIT));
        let next = |integral: R, wanted: R, velocity: R| {
            (integral + (wanted - velocity).limited(-taken, taken) * gain).limited(-limit, limit)
        };
        integral.x = next(integral.x, wanted.x, state.velocity.x);
        integral.y = next(integral.y, wanted.y, state.velocity.y);
        integral.z = next(integral.z, wanted.z, state.velocity.z);
        let push = self.velocities.acceleration(&wanted, &state.velocity);
        let push = Vector3::new(push.x + integral.x, push.y + integral.y, push.z + integral.z);
        self.velocities.pushed(action, state, push)
    }
}

impl Velocities {
    /// Rotor targets \[rad/s\], within zero and the greatest rotor speed, whatever the action (limited to
    /// \[-1, 1\], NaN to -1) and the state.
    #[inline(always)]
    pub fn rotor_targets<R: Real>(&self, action: &[R; ACTION_LEN], state: &State<R>) -> [R; 4] {
        self.pushed(action, state, self.acceleration(&self.wanted(action), &state.velocity))
    }

    /// The velocity that an action asks for \[m/s, world\].
    #[inline(always)]
    fn wanted<R: Real>(&self, action: &[R; ACTION_LEN]) -> Vector3<R> {
        let [x, y, z, _] = action.map(|value| value.limited(-R::one(), R::one()));
        let limit = R::from_f32(self.speed_limit);
        Vector3::new(x * limit, y * limit, z * limit)
    }

    /// Rotor targets that accelerate the drone by `push` \[m/s²\] against gravity.
    #[inline(always)]
    fn pushed<R: Real>(&self, action: &[R; ACTION_LEN], state: &State<R>, mut push: Vector3<R>) -> [R; 4] {
        let real = R::from_f32;
        let [_, _, _, yaw] = action.map(|value| value.limited(-R::one(), R::one()));
        let gravity = R::from_f64(GRAVITY);
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
    use crate::airframe::{Airframe, CF2X};
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
    fn an_integral_makes_up_for_a_heavier_drone_in_wind() {
        let vehicle = Vehicle::<f64>::new(&Airframe { mass: 1.15 * CF2X.mass, ..CF2X });
        let air = Air { wind: Vector3::new(0.0, 1.0, 0.0), ..Air::still() };
        let missed = |integral_gain| {
            let space = IntegralVelocities { velocities: space(), integral_gain };
            let (mut state, mut integral) = (still(Attitude::level()), Vector3::zeros());
            for _ in 0..200 {
                let targets = space.rotor_targets(&[0.5, -0.25, 0.1, 0.0], &state, &mut integral, 0.02);
                for _ in 0..4 {
                    state = Integrator::SemiImplicitEuler.advance(&vehicle, &state, &targets, &air, 0.005);
                }
            }
            (state.velocity - Vector3::new(1.0, -0.5, 0.2)).norm()
        };
        assert!(missed(0.0) > 0.3, "{}", missed(0.0));
        assert!(missed(3.0) < 0.02, "{}", missed(3.0));
    }

    #[test]
    fn without_a_gain_an_integral_changes_nothing() {
        let space = IntegralVelocities { velocities: space(), integral_gain: 0.0 };
        let (state, mut integral) = (still(Attitude::from_axis_angle(Vector3::x(), 0.5)), Vector3::zeros());
        let action = [0.5, -0.25, 0.1, 0.3];
        let targets = space.rotor_targets(&action, &state, &mut integral, 0.02);
        assert_eq!((targets, integral), (space.velocities.rotor_targets(&action, &state), Vector3::zeros()));
    }

    #[test]
    fn whatever_the_state_an_integral_keeps_its_limits() {
        let space = IntegralVelocities { velocities: space(), integral_gain: 3.0 };
        let mut integral = Vector3::zeros();
        for velocity in [f64::NAN, f64::INFINITY, -1e30, 1e30, 0.0] {
            let state = State { velocity: Vector3::repeat(velocity), ..still(Attitude::level()) };
            for _ in 0..500 {
                space.rotor_targets(&[f64::NAN, 2.0, -2.0, 0.0], &state, &mut integral, 0.02);
                assert!(integral.iter().all(|value| value.abs() <= 4.0), "{integral}");
            }
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
