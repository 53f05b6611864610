//! Bitcraze's cascade of PID loops: position, velocity, attitude, body rates.

use nalgebra::Vector3;

use super::pid::{Gains, Pid};
use super::{DEGREES, FULL_COUNTS, Mix, degrees_of, wrapped};
use crate::real::Real;
use crate::setpoint::Setpoint;
use crate::vehicle::State;

/// Integral limit of loops that state none.
const LOOSE: f32 = 5000.0;

const fn gains(proportional: f32, integral: f32, integral_limit: f32, output_limit: f32) -> Gains {
    Gains { proportional, integral, derivative: 0.0, integral_limit, output_limit }
}

/// Speed \[m/s\] per distance, along the heading, across it, and up.
const POSITION: [Gains; 3] =
    [gains(2.0, 0.0, LOOSE, 1.1), gains(2.0, 0.0, LOOSE, 1.1), gains(2.0, 0.5, LOOSE, 1.1)];

/// Tilt \[°\] per speed, along and across the heading, and thousands of counts per vertical speed.
const VELOCITY: [Gains; 3] =
    [gains(25.0, 1.0, LOOSE, 22.0), gains(25.0, 1.0, LOOSE, 22.0), gains(25.0, 15.0, LOOSE, 32.767)];

/// Body rate \[°/s\] per angle, about body x, y, z.
const ATTITUDE: [Gains; 3] = [
    gains(6.0, 3.0, 20.0, 0.0),
    gains(6.0, 3.0, 20.0, 0.0),
    Gains { derivative: 0.35, ..gains(6.0, 1.0, 360.0, 0.0) },
];

/// Counts per body rate \[°/s\], about body x, y, z.
const RATES: [Gains; 3] = [
    Gains { derivative: 2.5, ..gains(250.0, 500.0, 33.3, 32767.0) },
    Gains { derivative: 2.5, ..gains(250.0, 500.0, 33.3, 32767.0) },
    gains(120.0, 16.7, 166.7, 32767.0),
];

/// Greatest roll and pitch \[°\].
const TILT_LIMIT: f32 = 20.0;

/// Counts that about hold the drone up, and the fewest in flight.
const HOVER_COUNTS: f32 = 36000.0;
const FEWEST_COUNTS: f32 = 20000.0;

/// Calls of [`Cascade::mix`] from one run of the position loops to the next: they run at 100 Hz, the others at 500.
const STEPS_PER_STEERING: u32 = 5;

/// Position, velocity, attitude and body-rate loops; it is led by position and heading alone, so that it follows a point
/// at a steady speed by half a second late.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cascade<R> {
    position: [Pid<R>; 3],
    velocity: [Pid<R>; 3],
    attitude: [Pid<R>; 3],
    rates: [Pid<R>; 3],
    /// Counts of each motor, and roll and pitch \[°\], that the position loops ask for.
    thrust: R,
    tilt: [R; 2],
    steps: u32,
}

impl<R: Real> Cascade<R> {
    /// Takes over in a state.
    pub fn begun(state: &State<R>) -> Self {
        let nothing = Pid::begun(R::zero());
        let [roll, pitch, yaw] = degrees_of(&state.world_from_body);
        Self {
            position: along_heading(&state.position, yaw).map(Pid::begun),
            velocity: [nothing; 3],
            attitude: [roll, pitch, yaw].map(Pid::begun),
            rates: [nothing; 3],
            thrust: R::zero(),
            tilt: [roll, pitch],
            steps: 0,
        }
    }

    /// What the motors are told, [`STABILISER_SECS`](super::STABILISER_SECS) after the last time.
    pub fn mix(&mut self, state: &State<R>, setpoint: &Setpoint<R>) -> Mix<R> {
        let secs = R::from_f64(super::STABILISER_SECS);
        let angles = degrees_of(&state.world_from_body);
        if self.steps.is_multiple_of(STEPS_PER_STEERING) {
            self.steer(state, setpoint, angles[2], secs * R::from_f64(f64::from(STEPS_PER_STEERING)));
        }
        self.steps = self.steps.wrapping_add(1);
        let wanted = self.turn(angles, setpoint, secs);
        let measured: [R; 3] = (state.body_rates * R::from_f64(DEGREES)).into();
        let turning = core::array::from_fn(|axis| {
            self.rates[axis].output(&RATES[axis], wanted[axis] - measured[axis], measured[axis], secs)
        });
        Mix { thrust: self.thrust, turning }
    }

    /// The position and velocity loops.
    fn steer(&mut self, state: &State<R>, setpoint: &Setpoint<R>, yaw: R, secs: R) {
        let real = R::from_f32;
        let position = along_heading(&state.position, yaw);
        let goal = along_heading(&setpoint.position, yaw);
        let velocity = along_heading(&state.velocity, yaw);
        let [ahead, aside, up]: [R; 3] = core::array::from_fn(|axis| {
            let error = goal[axis] - position[axis];
            let wanted = self.position[axis].output(&POSITION[axis], error, position[axis], secs);
            self.velocity[axis].output(&VELOCITY[axis], wanted - velocity[axis], velocity[axis], secs)
        });
        let limit = real(TILT_LIMIT);
        self.tilt = [-aside, ahead].map(|tilt| tilt.limited(-limit, limit));
        let counts = up * real(1000.0) + real(HOVER_COUNTS);
        self.thrust = counts.limited(real(FEWEST_COUNTS), R::from_f64(FULL_COUNTS));
    }

    /// The attitude loops: body rates \[°/s\].
    fn turn(&mut self, [roll, pitch, yaw]: [R; 3], setpoint: &Setpoint<R>, secs: R) -> [R; 3] {
        let [wanted_roll, wanted_pitch] = self.tilt;
        let wanted_yaw = setpoint.yaw * R::from_f64(DEGREES);
        // Yaw goes on beyond a half turn, so that its derivative does not jump.
        let before = self.attitude[2].measured();
        let turns = [roll, pitch, before + wrapped(wrapped(yaw) - wrapped(before))];
        let errors = [wanted_roll - roll, wanted_pitch - pitch, wrapped(wanted_yaw - yaw)];
        core::array::from_fn(|axis| self.attitude[axis].output(&ATTITUDE[axis], errors[axis], turns[axis], secs))
    }
}

/// The part of a world vector along the heading \[°\], that to its left, and that upwards.
fn along_heading<R: Real>(vector: &Vector3<R>, yaw: R) -> [R; 3] {
    let (sine, cosine) = (yaw / R::from_f64(DEGREES)).sin_cos();
    [vector.x * cosine + vector.y * sine, vector.y * cosine - vector.x * sine, vector.z]
}
