//! The cascaded PID controller of the Crazyflies (`DSLPIDControl`).

use nalgebra::Vector3;

use super::{Command, PidGains, vector};
use crate::airframe::{Airframe, Layout, RADIANS_PER_SECOND_PER_RPM};
use crate::attitude::Attitude;
use crate::real::Real;
use crate::reference::euler::EulerAngles;
use crate::reference::vector::{cross, dot, length, limited, zero};
use crate::setpoint::Setpoint;
use crate::vehicle::State;

/// RPM per count of the motor command, and at zero counts (Landry 2015, as in `DSLPIDControl`).
const RPM_PER_COUNT: f64 = 0.2685;
const RPM_AT_ZERO: f64 = 4070.3;

/// Least and greatest motor command \[counts\].
const COUNTS: [f64; 2] = [20_000.0, 65_535.0];

/// Greatest torque command about each body axis \[counts\].
const TORQUE_LIMIT: f64 = 3200.0;

/// Limits of the integrated position error \[m s\]: everywhere, and more tightly along z.
const POSITION_INTEGRAL_LIMITS: [f64; 2] = [2.0, 0.15];

/// Limits of the integrated attitude error \[s\]: everywhere, and more tightly about x and y.
const ATTITUDE_INTEGRAL_LIMITS: [f64; 2] = [1500.0, 1.0];

/// The controller for one airframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DslPid<R> {
    /// Torques are in counts of the motor command.
    pub gains: PidGains<R>,
    /// Counts per torque count about x, y, z for each rotor.
    pub mixer: [[R; 3]; 4],
    /// \[N\].
    pub weight: R,
    /// Thrust of one rotor per squared speed \[N s²/rad²\].
    pub thrust_coefficient: R,
}

/// What a [`DslPid`] remembers from call to call.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DslPidMemory<R> {
    /// \[m s\], world.
    pub position_integral: Vector3<R>,
    /// \[s\], body.
    pub attitude_integral: Vector3<R>,
    /// Roll, pitch and yaw of the last call \[rad\]. They start at zero, so that the first call sees a jump, and yaw
    /// is not unwrapped at ±π: both as in the reference.
    pub last_angles: Vector3<R>,
}

impl<R: Real> DslPidMemory<R> {
    /// Nothing, as at the start of an episode.
    pub fn new() -> Self {
        Self { position_integral: zero(), attitude_integral: zero(), last_angles: zero() }
    }
}

impl<R: Real> Default for DslPidMemory<R> {
    fn default() -> Self {
        Self::new()
    }
}

/// What the position loop asks of the attitude loop.
struct Wanted<R> {
    /// Motor command of the thrust \[counts\].
    thrust_counts: R,
    /// Body axes, world.
    axes: [Vector3<R>; 3],
}

impl<R: Real> DslPid<R> {
    /// The reference's controller; it knows `cf2x` and `cf2p`, and its learning environments give the former to
    /// both.
    pub fn new(airframe: &Airframe) -> Self {
        Self {
            gains: PidGains {
                position_proportional: vector([0.4, 0.4, 1.25]),
                position_integral: vector([0.05, 0.05, 0.05]),
                position_derivative: vector([0.2, 0.2, 0.5]),
                attitude_proportional: vector([70_000.0, 70_000.0, 60_000.0]),
                attitude_integral: vector([0.0, 0.0, 500.0]),
                attitude_derivative: vector([20_000.0, 20_000.0, 12_000.0]),
            },
            mixer: mixer(airframe).map(|row| row.map(R::from_f64)),
            weight: R::from_f64(airframe.weight()),
            thrust_coefficient: R::from_f64(airframe.thrust_coefficient),
        }
    }

    /// Rotor speeds towards the set point, `secs` after the last call. It reads pose and velocity, not body rates.
    pub fn command(
        &self,
        memory: &mut DslPidMemory<R>,
        state: &State<R>,
        setpoint: &Setpoint<R>,
        secs: R,
    ) -> Command<R> {
        let position_error = setpoint.position - state.position;
        let wanted = self.position_loop(memory, state, setpoint, secs);
        let torque = self.attitude_loop(memory, &state.world_from_body, &wanted, setpoint, secs);
        // The wanted yaw is the third of the intrinsic x-y-z angles, the drone's the one of the z-y-x convention.
        let [forward, left, _] = wanted.axes;
        Command {
            rotor_speeds: self.mixed(wanted.thrust_counts, &torque),
            position_error,
            yaw_error: (-left.x).atan2(forward.x) - memory.last_angles.z,
        }
    }

    fn position_loop(
        &self,
        memory: &mut DslPidMemory<R>,
        state: &State<R>,
        setpoint: &Setpoint<R>,
        secs: R,
    ) -> Wanted<R> {
        let error = setpoint.position - state.position;
        let [everywhere, vertical] = POSITION_INTEGRAL_LIMITS;
        let integral = limited(&(memory.position_integral + error * secs), everywhere);
        let tight = limited(&integral, vertical);
        memory.position_integral = Vector3::new(integral.x, integral.y, tight.z);
        let force = error.component_mul(&self.gains.position_proportional)
            + memory.position_integral.component_mul(&self.gains.position_integral)
            + (setpoint.velocity - state.velocity).component_mul(&self.gains.position_derivative)
            + Vector3::new(R::zero(), R::zero(), self.weight);
        let thrust = dot(&force, &state.world_from_body.body_z()).at_least(R::zero());
        Wanted { thrust_counts: self.thrust_counts(thrust), axes: axes(&force, setpoint.yaw) }
    }

    /// Motor command for a thrust \[N\] of all four rotors.
    fn thrust_counts(&self, thrust: R) -> R {
        let speed = (thrust / (R::from_f64(4.0) * self.thrust_coefficient)).sqrt();
        let rpm = speed / R::from_f64(RADIANS_PER_SECOND_PER_RPM);
        (rpm - R::from_f64(RPM_AT_ZERO)) / R::from_f64(RPM_PER_COUNT)
    }

    /// Torque command \[counts\], body.
    fn attitude_loop(
        &self,
        memory: &mut DslPidMemory<R>,
        attitude: &Attitude<R>,
        wanted: &Wanted<R>,
        setpoint: &Setpoint<R>,
        secs: R,
    ) -> Vector3<R> {
        let error = attitude_error(attitude, &wanted.axes);
        let angles = Vector3::from(EulerAngles::of(attitude).to_array());
        let rate_error = setpoint.euler_rates - (angles - memory.last_angles) / secs;
        memory.last_angles = angles;
        let [everywhere, tilting] = ATTITUDE_INTEGRAL_LIMITS;
        let integral = limited(&(memory.attitude_integral - error * secs), everywhere);
        let tight = limited(&integral, tilting);
        memory.attitude_integral = Vector3::new(tight.x, tight.y, integral.z);
        let torque = rate_error.component_mul(&self.gains.attitude_derivative)
            - error.component_mul(&self.gains.attitude_proportional)
            + memory.attitude_integral.component_mul(&self.gains.attitude_integral);
        limited(&torque, TORQUE_LIMIT)
    }

    fn mixed(&self, thrust_counts: R, torque: &Vector3<R>) -> [R; 4] {
        let [least, greatest] = COUNTS.map(R::from_f64);
        self.mixer.map(|[x, y, z]| {
            let counts = thrust_counts + (x * torque.x + y * torque.y + z * torque.z);
            let rpm = R::from_f64(RPM_PER_COUNT) * counts.limited(least, greatest) + R::from_f64(RPM_AT_ZERO);
            rpm * R::from_f64(RADIANS_PER_SECOND_PER_RPM)
        })
    }
}

/// Half a count per torque count where four rotors tilt the drone, one where two do; one for every rotor in yaw.
fn mixer(airframe: &Airframe) -> [[f64; 3]; 4] {
    let share = match airframe.layout {
        Layout::Cross { .. } => 0.5,
        Layout::Plus { .. } => 1.0,
    };
    let sign = |lever: f64| if lever == 0.0 { 0.0 } else { share * lever.signum() };
    let positions = airframe.rotor_positions();
    core::array::from_fn(|i| [sign(positions[i][1]), sign(-positions[i][0]), Layout::TORQUE_SIGNS[i]])
}

/// Body axes with z along a force and the nose towards `yaw` \[rad\].
fn axes<R: Real>(force: &Vector3<R>, yaw: R) -> [Vector3<R>; 3] {
    let up = *force / length(force);
    let (sine, cosine) = yaw.sin_cos();
    let across = cross(&up, &Vector3::new(cosine, sine, R::zero()));
    let left = across / length(&across);
    [cross(&left, &up), left, up]
}

/// Twice the sine of the rotation from the wanted axes to the drone's, body.
fn attitude_error<R: Real>(attitude: &Attitude<R>, wanted: &[Vector3<R>; 3]) -> Vector3<R> {
    let rows = attitude.rows();
    let [x, y, z] = core::array::from_fn(|column| Vector3::from(rows.map(|row| row[column])));
    let [wanted_x, wanted_y, wanted_z] = wanted;
    Vector3::new(
        dot(wanted_z, &y) - dot(&z, wanted_y),
        dot(wanted_x, &z) - dot(&x, wanted_z),
        dot(wanted_y, &x) - dot(&y, wanted_x),
    )
}
