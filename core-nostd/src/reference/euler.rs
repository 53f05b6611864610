//! Roll, pitch and yaw as Bullet computes them, at the poles too.

use crate::attitude::Attitude;
use crate::real::Real;

/// Sine of the pitch beyond which Bullet counts an attitude as pointing straight up or down.
const POLE: f64 = 0.99999;

/// Angles of the z-y-x convention \[rad\]: the rotation is `Rz(yaw) Ry(pitch) Rx(roll)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EulerAngles<R> {
    /// About body x, in \[-π, π\]; zero at the poles.
    pub roll: R,
    /// About the turned y axis, in \[-π/2, π/2\].
    pub pitch: R,
    /// About world z, in \[-π, π\], at the poles in \[-2π, 2π\].
    pub yaw: R,
}

impl<R: Real> EulerAngles<R> {
    /// The angles of a unit quaternion (`getEulerFromQuaternion` of `PyBullet`).
    #[inline(always)]
    pub fn of(attitude: &Attitude<R>) -> Self {
        let Attitude { w, x, y, z } = *attitude;
        let two = R::from_f64(2.0);
        let half_turn = R::from_f64(core::f64::consts::PI);
        let pole = R::from_f64(POLE);
        let pitch_sine = -two * (x * z - w * y);
        let regular = |at_pole: R, elsewhere: R| pole.where_less(pitch_sine.abs(), at_pole, elsewhere);
        let up = pitch_sine.where_less(R::zero(), -R::one(), R::one());
        let roll = (two * (y * z + w * x)).atan2(w * w - x * x - y * y + z * z);
        let yaw = (two * (x * y + w * z)).atan2(w * w + x * x - y * y - z * z);
        Self {
            roll: regular(R::zero(), roll),
            pitch: regular(up * half_turn / two, pitch_sine.asin()),
            yaw: regular(two * (-up * x).atan2(up * y), yaw),
        }
    }

    /// The unit quaternion of the angles (`getQuaternionFromEuler` of `PyBullet`).
    pub fn attitude(&self) -> Attitude<R> {
        let half = R::from_f64(0.5);
        let (roll_sine, roll_cosine) = (self.roll * half).sin_cos();
        let (pitch_sine, pitch_cosine) = (self.pitch * half).sin_cos();
        let (yaw_sine, yaw_cosine) = (self.yaw * half).sin_cos();
        Attitude {
            w: roll_cosine * pitch_cosine * yaw_cosine + roll_sine * pitch_sine * yaw_sine,
            x: roll_sine * pitch_cosine * yaw_cosine - roll_cosine * pitch_sine * yaw_sine,
            y: roll_cosine * pitch_sine * yaw_cosine + roll_sine * pitch_cosine * yaw_sine,
            z: roll_cosine * pitch_cosine * yaw_sine - roll_sine * pitch_sine * yaw_cosine,
        }
        .normalized()
    }

    /// As `[roll, pitch, yaw]`.
    pub fn to_array(&self) -> [R; 3] {
        [self.roll, self.pitch, self.yaw]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn angles_survive_the_quaternion(roll in -3.1..3.1_f64, pitch in -1.5..1.5_f64, yaw in -3.1..3.1_f64) {
            let angles = EulerAngles { roll, pitch, yaw };
            let back = EulerAngles::of(&angles.attitude());
            for (a, b) in angles.to_array().into_iter().zip(back.to_array()) {
                prop_assert!((a - b).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn away_from_the_poles_they_are_the_attitudes_own() {
        let attitude = EulerAngles { roll: 0.4, pitch: -0.9, yaw: 2.2 }.attitude();
        for (a, b) in EulerAngles::of(&attitude).to_array().into_iter().zip(attitude.roll_pitch_yaw()) {
            assert!((a - b).abs() < 1e-12);
        }
    }
}
