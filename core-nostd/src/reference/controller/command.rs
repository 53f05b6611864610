//! The reference's actions: what its environments make of the numbers of a policy, all in \[-1, 1\].
//!
//! Nothing is clipped here, as nothing is there. Names in brackets are the reference's.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::Wrench;
use crate::airframe::{Airframe, RADIANS_PER_SECOND_PER_RPM};
use crate::real::Real;
use crate::reference::euler::EulerAngles;
use crate::reference::vector::{length, zero};
use crate::setpoint::Setpoint;
use crate::vehicle::State;

/// Share of the hover speed, or of a greatest torque, that a full action asks for.
const AUTHORITY: f64 = 0.05;

/// Distance of the next position from the drone for a full action \[m\].
const OFFSET: f64 = 0.1;

/// Greatest distance to the next position on the way to an absolute target \[m\].
const STRIDE: f64 = 1.0;

/// Speed for a full velocity action, as a share of the airframe's nominal speed.
const SPEED_SHARE: f64 = 0.03;

/// Where the reference computes an action in single precision. The differences, 1e-3 RPM, move a drone by micrometres
/// in seconds; comparisons with its recordings need them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Precision {
    /// Nowhere.
    #[default]
    Exact,
    /// Upstream, whose action spaces are `float32` and whose numpy keeps what is wider: the hover speed.
    Single,
    /// The fork, whose older numpy narrows the hover speed, too.
    AllSingle,
}

/// The hover speed of an airframe, ready for arithmetic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hover<R> {
    /// \[rad/s\].
    speed: R,
    /// \[RPM\], in single precision.
    rpm_in_single: R,
}

impl<R: Real> Hover<R> {
    /// The speed at which four rotors carry the weight.
    pub fn new(airframe: &Airframe) -> Self {
        let speed = airframe.hover_rotor_speed();
        Self { speed: R::from_f64(speed), rpm_in_single: R::from_f32((speed / RADIANS_PER_SECOND_PER_RPM) as f32) }
    }

    /// A rotor speed \[rad/s\] around hover.
    #[inline(always)]
    pub fn rotor_speed(&self, precision: Precision, action: R) -> R {
        match precision {
            Precision::Exact => self.speed * (R::one() + R::from_f64(AUTHORITY) * action),
            Precision::Single => self.speed * share_in_single(action),
            Precision::AllSingle => {
                let rpm = (self.rpm_in_single * share_in_single(action)).in_single();
                rpm * R::from_f64(RADIANS_PER_SECOND_PER_RPM)
            }
        }
    }
}

/// Share of the hover speed, with every operation in single precision.
#[inline(always)]
fn share_in_single<R: Real>(action: R) -> R {
    let change = (R::from_f32(AUTHORITY as f32) * action.in_single()).in_single();
    (R::one() + change).in_single()
}

/// Rotor speeds \[rad/s\] around hover, rotor by rotor (RPM).
pub fn rotor_speeds<R: Real>(airframe: &Airframe, action: &[R; 4]) -> [R; 4] {
    action.map(|value| Hover::new(airframe).rotor_speed(Precision::Exact, value))
}

/// As [`rotor_speeds`], with the factor of the hover speed rounded to single precision ([`Precision::Single`]).
pub fn rotor_speeds_in_single<R: Real>(airframe: &Airframe, action: &[R; 4]) -> [R; 4] {
    action.map(|value| Hover::new(airframe).rotor_speed(Precision::Single, value))
}

/// As [`rotor_speeds`], with every operation on RPM in single precision ([`Precision::AllSingle`]).
pub fn rotor_speeds_all_in_single<R: Real>(airframe: &Airframe, action: &[R; 4]) -> [R; 4] {
    action.map(|value| Hover::new(airframe).rotor_speed(Precision::AllSingle, value))
}

/// The same rotor speed \[rad/s\] for all (`ONE_D_RPM`).
pub fn common_rotor_speed<R: Real>(airframe: &Airframe, action: R) -> [R; 4] {
    rotor_speeds(airframe, &[action; 4])
}

/// Thrust from nothing to twice the weight, and torques (DYN of the fork).
pub fn wrench<R: Real>(airframe: &Airframe, action: &[R; 4]) -> Wrench<R> {
    let [thrust, roll, pitch, yaw] = *action;
    let tilting = R::from_f64(AUTHORITY * airframe.tilting_torque_limit());
    let turning = R::from_f64(AUTHORITY * airframe.turning_torque_limit());
    Wrench {
        thrust: R::from_f64(airframe.weight()) * (thrust + R::one()),
        torque: Vector3::new(tilting * roll, tilting * pitch, turning * yaw),
    }
}

/// Thrust around the weight, no torque (`ONE_D_DYN` of the fork).
pub fn thrust<R: Real>(airframe: &Airframe, action: R) -> Wrench<R> {
    let thrust = R::from_f64(airframe.weight()) * (R::one() + R::from_f64(AUTHORITY) * action);
    Wrench { thrust, torque: zero() }
}

/// A position near the drone, offset by the action in world axes, facing +x (PID of the fork).
pub fn offset<R: Real>(state: &State<R>, action: &[R; 3]) -> Setpoint<R> {
    Setpoint::at(state.position + Vector3::from(*action) * R::from_f64(OFFSET))
}

/// As [`offset`], with the offset in single precision, as it is in the fork, whose actions are `float32`.
pub fn offset_in_single<R: Real>(state: &State<R>, action: &[R; 3]) -> Setpoint<R> {
    let per_action = R::from_f32(OFFSET as f32);
    let offset = action.map(|value| (per_action * value.in_single()).in_single());
    Setpoint::at(state.position + Vector3::from(offset))
}

/// A position above or below the drone, facing +x (`ONE_D_PID`).
pub fn vertical_offset<R: Real>(state: &State<R>, action: R) -> Setpoint<R> {
    offset(state, &[R::zero(), R::zero(), action])
}

/// A position on the way to `target` \[m, world\], at most a stride away, facing +x (PID of upstream).
pub fn waypoint<R: Real>(state: &State<R>, target: Vector3<R>) -> Setpoint<R> {
    let way = target - state.position;
    let distance = length(&way);
    let stride = R::from_f64(STRIDE);
    let step = way * (stride / distance);
    let choose = |far: R, near: R| stride.where_less(distance, far, near);
    Setpoint::at(Vector3::new(
        choose(state.position.x + step.x, target.x),
        choose(state.position.y + step.y, target.y),
        choose(state.position.z + step.z, target.z),
    ))
}

/// A velocity along the first three numbers, whose magnitude does not matter, with the fourth's magnitude as share
/// of the speed limit; position and yaw stay the drone's own (VEL).
pub fn velocity<R: Real>(airframe: &Airframe, state: &State<R>, action: &[R; 4]) -> Setpoint<R> {
    let [x, y, z, speed] = *action;
    let along = Vector3::new(x, y, z);
    let norm = length(&along);
    let speed = R::from_f64(SPEED_SHARE * airframe.nominal_speed) * speed.abs();
    let velocity = (along / norm * speed).map(|value| R::zero().where_less(norm, value, R::zero()));
    Setpoint { velocity, ..staying(state) }
}

/// The position and the yaw of the drone.
fn staying<R: Real>(state: &State<R>) -> Setpoint<R> {
    Setpoint { yaw: EulerAngles::of(&state.world_from_body).yaw, ..Setpoint::at(state.position) }
}

/// As [`velocity`], with the velocity in single precision, as it is in both references (see [`Precision`]); only the
/// sum of squares is wider, because `OpenBLAS` adds the products of a short `float32` vector in double.
pub fn velocity_in_single<R: Real>(airframe: &Airframe, state: &State<R>, action: &[R; 4]) -> Setpoint<R> {
    let [x, y, z, share] = action.map(R::in_single);
    let [xx, yy, zz] = [x, y, z].map(|value| value.squared().in_single());
    let norm = ((xx + yy) + zz).in_single().sqrt().in_single();
    let speed = (R::from_f32((SPEED_SHARE * airframe.nominal_speed) as f32) * share.abs()).in_single();
    let along = |value: R| {
        let velocity = ((value / norm).in_single() * speed).in_single();
        R::zero().where_less(norm, velocity, R::zero())
    };
    Setpoint { velocity: Vector3::new(along(x), along(y), along(z)), ..staying(state) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airframe::CF2X;
    use crate::attitude::Attitude;

    fn level() -> State<f64> {
        State {
            position: Vector3::new(1.0, 2.0, 3.0),
            world_from_body: Attitude::from_axis_angle(Vector3::z(), 0.7),
            velocity: Vector3::zeros(),
            body_rates: Vector3::zeros(),
            rotor_speeds: [0.0; 4],
        }
    }

    #[test]
    fn zero_actions_hover() {
        let hover = CF2X.hover_rotor_speed();
        assert_eq!(rotor_speeds(&CF2X, &[0.0; 4]), [hover; 4]);
        assert_eq!(common_rotor_speed(&CF2X, 1.0), rotor_speeds(&CF2X, &[1.0; 4]));
        assert_eq!(wrench(&CF2X, &[0.0; 4]), thrust(&CF2X, 0.0));
        assert_eq!(offset(&level(), &[0.0; 3]), vertical_offset(&level(), 0.0));
    }

    /// What the recordings cannot tell: that the generic functions round wherever single precision does.
    #[test]
    fn in_single_precision_double_numbers_become_what_single_ones_do() {
        let hover = CF2X.hover_rotor_speed();
        for action in [-1.0_f32, -0.731, 1e-9, 0.1, 0.999] {
            let wide = [f64::from(action); 4];
            let share = f64::from(1.0 + 0.05_f32 * action);
            assert_eq!(rotor_speeds_in_single(&CF2X, &wide), [hover * share; 4]);
            let position = offset_in_single(&level(), &[wide[0]; 3]).position;
            assert_eq!(position, level().position + Vector3::repeat(f64::from(0.1_f32 * action)));
            let along = [action, 0.3, -0.2];
            let norm = along.map(|value| f64::from(value * value)).iter().sum::<f64>() as f32;
            let velocity = along.map(|value| f64::from(value / norm.sqrt() * (0.25_f32 * 0.8)));
            let wide = [wide[0], f64::from(0.3_f32), f64::from(-0.2_f32), f64::from(-0.8_f32)];
            assert_eq!(velocity_in_single(&CF2X, &level(), &wide).velocity, Vector3::from(velocity));
        }
    }

    #[test]
    fn a_waypoint_is_a_stride_away_or_the_target() {
        let near = level().position + Vector3::new(0.3, 0.0, -0.4);
        assert_eq!(waypoint(&level(), near).position, near);
        assert_eq!(waypoint(&level(), level().position).position, level().position);
        let far = level().position + Vector3::new(3.0, 0.0, -4.0);
        assert!((waypoint(&level(), far).position - Vector3::new(1.6, 2.0, 2.2)).norm() < 1e-12);
    }

    #[test]
    fn a_velocity_has_the_direction_of_its_action_and_keeps_the_heading() {
        let setpoint = velocity(&CF2X, &level(), &[0.0, -0.5, 0.0, -0.4]);
        assert!((setpoint.velocity - Vector3::new(0.0, -0.1, 0.0)).norm() < 1e-12);
        assert!((setpoint.yaw - 0.7).abs() < 1e-12 && setpoint.position == level().position);
        assert_eq!(velocity(&CF2X, &level(), &[0.0, 0.0, 0.0, 1.0]).velocity, Vector3::zeros());
    }
}
