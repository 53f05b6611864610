//! The trajectory controller of Mellinger and Kumar 2011 with the Crazyflie's gains.

use nalgebra::Vector3;

use super::{Mix, STABILISER_SECS};
use crate::airframe::GRAVITY;
use crate::real::Real;
use crate::setpoint::Setpoint;
use crate::vehicle::State;

/// Force \[N\] per distance \[m\], speed \[m/s\] and integral of the distance \[m s\], world x, y, z.
const STIFFNESS: [f32; 3] = [0.4, 0.4, 1.25];
const DAMPING: [f32; 3] = [0.2, 0.2, 0.4];
const INTEGRAL: f32 = 0.05;
/// Bounds of the integral \[m s\].
const INTEGRAL_LIMITS: [f32; 3] = [2.0, 2.0, 0.4];

/// Counts per newton of all motors, per turn (twice its sine), per body rate \[rad/s\], per change of the rates about x
/// and y \[rad/s²\], and per integral of the turn about z \[s\] with its bound.
const COUNTS_PER_NEWTON: f32 = 132_000.0;
const TURN_GAINS: [f32; 3] = [70_000.0, 70_000.0, 60_000.0];
const RATE_GAINS: [f32; 3] = [20_000.0, 20_000.0, 12_000.0];
const CHANGE_GAIN: f32 = 200.0;
const HEADING_INTEGRAL: f32 = 500.0;
const HEADING_INTEGRAL_LIMIT: f32 = 1500.0;
/// Greatest counts of a turn.
const TURNING_LIMIT: f32 = 32_000.0;

/// A force for position, velocity and acceleration, and a turn towards it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mellinger<R> {
    mass: R,
    integral: Vector3<R>,
    heading_integral: R,
    /// \[rad/s\], body.
    rates_before: Option<Vector3<R>>,
}

/// Where the thrust shall point, and how strong it is along body z now.
struct Push<R> {
    thrust: R,
    /// From the attitude to the wanted one: axis times twice the sine of the angle, body.
    turn: Vector3<R>,
}

impl<R: Real> Mellinger<R> {
    /// For a drone of this mass \[kg\].
    pub fn new(mass_kg: f64) -> Self {
        let nothing = Vector3::new(R::zero(), R::zero(), R::zero());
        Self { mass: R::from_f64(mass_kg), integral: nothing, heading_integral: R::zero(), rates_before: None }
    }

    /// What the motors are told, [`STABILISER_SECS`] after the last time; `acceleration` \[m/s², world\] is that of the
    /// set-point.
    pub fn mix(&mut self, state: &State<R>, setpoint: &Setpoint<R>, acceleration: &Vector3<R>) -> Mix<R> {
        let (real, secs) = (R::from_f32, R::from_f64(STABILISER_SECS));
        let Push { thrust, turn } = self.push(state, setpoint, acceleration, secs);
        let rates = state.body_rates;
        let change = (rates - self.rates_before.replace(rates).unwrap_or(rates)) / secs;
        let limit = real(HEADING_INTEGRAL_LIMIT);
        self.heading_integral = (self.heading_integral + turn.z * secs).limited(-limit, limit);
        let extra = [
            -change.x * real(CHANGE_GAIN),
            -change.y * real(CHANGE_GAIN),
            self.heading_integral * real(HEADING_INTEGRAL),
        ];
        let turning = core::array::from_fn(|axis| {
            let rate_error = setpoint.euler_rates[axis] - rates[axis];
            let counts = real(TURN_GAINS[axis]) * turn[axis] + real(RATE_GAINS[axis]) * rate_error + extra[axis];
            counts.limited(-real(TURNING_LIMIT), real(TURNING_LIMIT))
        });
        Mix { thrust: thrust * real(COUNTS_PER_NEWTON), turning }
    }

    fn push(&mut self, state: &State<R>, setpoint: &Setpoint<R>, acceleration: &Vector3<R>, secs: R) -> Push<R> {
        let real = R::from_f32;
        let (error, drift) = (setpoint.position - state.position, setpoint.velocity - state.velocity);
        let mut force = acceleration * self.mass;
        force.z += self.mass * R::from_f64(GRAVITY);
        for axis in 0..3 {
            let limit = real(INTEGRAL_LIMITS[axis]);
            self.integral[axis] = (self.integral[axis] + error[axis] * secs).limited(-limit, limit);
            force[axis] += real(STIFFNESS[axis]) * error[axis]
                + real(DAMPING[axis]) * drift[axis]
                + real(INTEGRAL) * self.integral[axis];
        }
        let thrust = dot(&force, &state.world_from_body.body_z());
        let (sine, cosine) = setpoint.yaw.sin_cos();
        let up = unit(&force);
        let left = unit(&cross(&up, &Vector3::new(cosine, sine, R::zero())));
        let ahead = cross(&left, &up);
        let [ahead, left, up] = [ahead, left, up].map(|axis| state.world_from_body.rotate_inverse(axis));
        Push { thrust, turn: Vector3::new(left.z - up.y, up.x - ahead.z, ahead.y - left.x) }
    }
}

fn dot<R: Real>(a: &Vector3<R>, b: &Vector3<R>) -> R {
    (a.x * b.x + a.y * b.y) + a.z * b.z
}

fn cross<R: Real>(a: &Vector3<R>, b: &Vector3<R>) -> Vector3<R> {
    Vector3::new(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)
}

/// Of length one; nothing stays nothing.
fn unit<R: Real>(vector: &Vector3<R>) -> Vector3<R> {
    let length = dot(vector, vector).sqrt().at_least(R::from_f64(1e-9));
    Vector3::new(vector.x / length, vector.y / length, vector.z / length)
}
