//! The plain PID controller of the Hummingbird (`SimplePIDControl`).

use nalgebra::Vector3;

use super::{Allocation, Command, PidGains, Wrench, vector};
use crate::airframe::Airframe;
use crate::attitude::Attitude;
use crate::real::Real;
use crate::reference::euler::EulerAngles;
use crate::reference::vector::{length, zero};
use crate::setpoint::Setpoint;
use crate::vehicle::State;

/// Greatest roll and pitch that the position loop asks for \[rad\].
const TILT_LIMIT: f64 = core::f64::consts::FRAC_PI_6;

/// The controller for one airframe; it always wants a yaw of zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimplePid<R> {
    /// Torques are in N m.
    pub gains: PidGains<R>,
    /// \[N\].
    pub weight: R,
    /// From thrust and torque to rotor speeds.
    pub allocation: Allocation<R>,
}

/// What a [`SimplePid`] remembers from call to call; nothing bounds the integrals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimplePidMemory<R> {
    /// \[m s\], world.
    pub position_integral: Vector3<R>,
    /// \[m\], world.
    pub last_position_error: Vector3<R>,
    /// Of roll, pitch and yaw \[rad s\].
    pub attitude_integral: Vector3<R>,
    /// Of roll, pitch and yaw \[rad\].
    pub last_attitude_error: Vector3<R>,
}

impl<R: Real> SimplePidMemory<R> {
    /// Nothing, as at the start of an episode.
    pub fn new() -> Self {
        Self {
            position_integral: zero(),
            last_position_error: zero(),
            attitude_integral: zero(),
            last_attitude_error: zero(),
        }
    }
}

impl<R: Real> Default for SimplePidMemory<R> {
    fn default() -> Self {
        Self::new()
    }
}

impl<R: Real> SimplePid<R> {
    /// The reference's controller, tuned for the Hummingbird.
    pub fn new(airframe: &Airframe) -> Self {
        Self {
            gains: PidGains {
                position_proportional: vector([0.1, 0.1, 0.2]),
                position_integral: vector([1e-4; 3]),
                position_derivative: vector([0.3, 0.3, 0.4]),
                attitude_proportional: vector([0.3, 0.3, 0.05]),
                attitude_integral: vector([1e-4; 3]),
                attitude_derivative: vector([0.3, 0.3, 0.5]),
            },
            weight: R::from_f64(airframe.weight()),
            allocation: Allocation::new(airframe),
        }
    }

    /// Rotor speeds towards the position of the set point, `secs` after the last call. It reads nothing of the state
    /// but the pose, and nothing of the set point but the position.
    pub fn command(
        &self,
        memory: &mut SimplePidMemory<R>,
        state: &State<R>,
        setpoint: &Setpoint<R>,
        secs: R,
    ) -> Command<R> {
        let position_error = setpoint.position - state.position;
        let force = self.force(memory, position_error, secs);
        let attitude_error = attitude_error(&tilt(&force), &state.world_from_body);
        let wrench = Wrench {
            thrust: state.world_from_body.rotate(force).z,
            torque: self.torque(memory, attitude_error, secs),
        };
        let rotor_speeds = self.allocation.rotor_speeds(&wrench);
        let yaw_error = -EulerAngles::of(&state.world_from_body).yaw;
        Command { rotor_speeds, position_error, yaw_error }
    }

    /// Wanted force \[N\], world.
    fn force(&self, memory: &mut SimplePidMemory<R>, error: Vector3<R>, secs: R) -> Vector3<R> {
        let rate = (error - memory.last_position_error) / secs;
        memory.last_position_error = error;
        memory.position_integral += error * secs;
        error.component_mul(&self.gains.position_proportional)
            + memory.position_integral.component_mul(&self.gains.position_integral)
            + rate.component_mul(&self.gains.position_derivative)
            + Vector3::new(R::zero(), R::zero(), self.weight)
    }

    /// Wanted torque \[N m\], body.
    fn torque(&self, memory: &mut SimplePidMemory<R>, error: Vector3<R>, secs: R) -> Vector3<R> {
        let rate = (error - memory.last_attitude_error) / secs;
        memory.last_attitude_error = error;
        memory.attitude_integral += error * secs;
        error.component_mul(&self.gains.attitude_proportional)
            + memory.attitude_integral.component_mul(&self.gains.attitude_integral)
            + rate.component_mul(&self.gains.attitude_derivative)
    }
}

/// Wanted roll and pitch \[rad\] that point the thrust along a force, facing +x.
fn tilt<R: Real>(force: &Vector3<R>) -> Vector3<R> {
    let limit = R::from_f64(TILT_LIMIT);
    let side = force.z.where_less(R::zero(), -R::one(), R::one());
    let roll = (-side * force.y / length(force)).asin();
    let pitch = (side * force.x).atan2(side * force.z);
    Vector3::new(roll.limited(-limit, limit), pitch.limited(-limit, limit), R::zero())
}

/// From the drone's angles to the wanted ones \[rad\], yaw wrapped once.
fn attitude_error<R: Real>(wanted: &Vector3<R>, attitude: &Attitude<R>) -> Vector3<R> {
    let half_turn = R::from_f64(core::f64::consts::PI);
    let turn = half_turn + half_turn;
    let error = *wanted - Vector3::from(EulerAngles::of(attitude).to_array());
    let yaw = half_turn.where_less(error.z, error.z - turn, error.z);
    Vector3::new(error.x, error.y, yaw.where_less(-half_turn, yaw + turn, yaw))
}
