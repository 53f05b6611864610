//! DYN: the reference's own explicit model, for which Bullet only keeps the pose.

use nalgebra::Vector3;

use super::{Bullet, BulletState, DynAttitude, DynReport};
use crate::airframe::GRAVITY;
use crate::attitude::Attitude;
use crate::real::Real;
use crate::reference::euler::EulerAngles;
use crate::reference::vector::length;
use crate::vehicle::State;

/// Rotation slower than this \[rad/s\] does not turn the drone (`numpy.isclose` to zero).
const STANDSTILL: f64 = 1e-8;

impl<R: Real> Bullet<R> {
    pub(super) fn explicit_step(&self, drone: &BulletState<R>, rotor_speeds: &[R; 4], secs: R) -> BulletState<R> {
        let State { position, world_from_body, velocity, body_rates, .. } = drone.motion;
        let (thrust, torque) = self.rotor_wrench(rotor_speeds);
        let gravity = Vector3::new(R::zero(), R::zero(), R::from_f64(GRAVITY));
        let velocity = velocity + (world_from_body.body_z() * (thrust / self.mass) - gravity) * secs;
        let body_rates = body_rates + self.angular_acceleration(&torque, &body_rates) * secs;
        let turned = match self.quirks.dyn_attitude {
            DynAttitude::Quaternion => spun(&world_from_body, &body_rates, secs),
            DynAttitude::EulerAngles => grown(&world_from_body, &body_rates, secs),
        };
        BulletState {
            motion: State {
                position: position + velocity * secs,
                world_from_body: turned,
                velocity,
                body_rates,
                rotor_speeds: *rotor_speeds,
            },
            link_attitude: world_from_body,
            reported_angular_velocity: self.report(&world_from_body, &turned, body_rates),
        }
    }

    /// Thrust \[N\] along body z and torque \[N m\], body.
    fn rotor_wrench(&self, rotor_speeds: &[R; 4]) -> (R, Vector3<R>) {
        let (thrusts, reaction) = self.loads(rotor_speeds);
        let lever = self.lever(&thrusts);
        (thrusts[0] + thrusts[1] + thrusts[2] + thrusts[3], Vector3::new(lever.y, -lever.x, reaction))
    }

    fn report(&self, before: &Attitude<R>, after: &Attitude<R>, body_rates: Vector3<R>) -> Vector3<R> {
        match self.quirks.dyn_report {
            DynReport::PreviousAttitude => before.rotate(body_rates),
            DynReport::MinusOne => Vector3::new(-R::one(), -R::one(), -R::one()),
            DynReport::Current => after.rotate(body_rates),
        }
    }
}

/// Constant body rates for `secs`, exactly.
fn spun<R: Real>(attitude: &Attitude<R>, body_rates: &Vector3<R>, secs: R) -> Attitude<R> {
    let speed = length(body_rates);
    let (sine, cosine) = (speed * secs * R::from_f64(0.5)).sin_cos();
    let axis = *body_rates * (sine / speed);
    let turned = attitude.after(&Attitude { w: cosine, x: axis.x, y: axis.y, z: axis.z });
    let chosen = |still: R, turned: R| speed.where_less(R::from_f64(STANDSTILL), still, turned);
    Attitude {
        w: chosen(attitude.w, turned.w),
        x: chosen(attitude.x, turned.x),
        y: chosen(attitude.y, turned.y),
        z: chosen(attitude.z, turned.z),
    }
}

/// Roll, pitch and yaw advanced by the body rates.
fn grown<R: Real>(attitude: &Attitude<R>, body_rates: &Vector3<R>, secs: R) -> Attitude<R> {
    let EulerAngles { roll, pitch, yaw } = EulerAngles::of(attitude);
    EulerAngles {
        roll: roll + body_rates.x * secs,
        pitch: pitch + body_rates.y * secs,
        yaw: yaw + body_rates.z * secs,
    }
    .attitude()
}
