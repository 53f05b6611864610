//! Attitudes in the frames of autopilots: forward, right, down in north, east, down.

use kestrel_core::attitude::Attitude;

const HALF_ROOT: f64 = core::f64::consts::FRAC_1_SQRT_2;

/// Half a turn about the axis between north and east; it is its own inverse.
const NED_FROM_ENU: Attitude<f64> = Attitude { w: 0.0, x: HALF_ROOT, y: HALF_ROOT, z: 0.0 };

/// Half a turn about forward; it is its own inverse.
const FLU_FROM_FRD: Attitude<f64> = Attitude { w: 0.0, x: 1.0, y: 0.0, z: 0.0 };

/// Attitude of the FRD body in the NED world, scalar part not negative.
pub(super) fn ned_from_frd(enu_from_flu: &Attitude<f32>) -> Attitude<f64> {
    let attitude = NED_FROM_ENU.after(&enu_from_flu.map(f64::from)).after(&FLU_FROM_FRD);
    if attitude.w < 0.0 { attitude.map(core::ops::Neg::neg) } else { attitude }
}

/// The inverse of [`ned_from_frd`], which is the same exchange of both frames.
pub(super) fn enu_from_flu(ned_from_frd: &Attitude<f32>) -> Attitude<f32> {
    self::ned_from_frd(ned_from_frd).map(|value| value as f32)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::FRAC_PI_2;

    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;
    use crate::message::{frd_from_flu, ned_from_enu};

    #[test]
    fn a_level_drone_that_faces_north_is_not_turned() {
        let north = Attitude::from_axis_angle(Vector3::z(), FRAC_PI_2).map(|value| value as f32);
        let Attitude { w, x, y, z } = ned_from_frd(&north);
        assert!((w - 1.0).abs() < 1e-6 && x.abs() + y.abs() + z.abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn vectors_turn_alike_in_both_frames(
            axis in proptest::array::uniform3(-1.0_f64..1.0), angle in -3.0_f64..3.0,
            vector in proptest::array::uniform3(-1.0_f32..1.0)
        ) {
            let axis = Vector3::from(axis);
            prop_assume!(axis.norm() > 0.1);
            let attitude = Attitude::from_axis_angle(axis.normalize(), angle).map(|value| value as f32);
            let in_body = Vector3::from(vector);
            let expected = ned_from_enu(&attitude.rotate(in_body));
            let found = ned_from_frd(&attitude).rotate(Vector3::from(frd_from_flu(&in_body).map(f64::from)));
            for axis in 0..3 {
                prop_assert!((found[axis] - f64::from(expected[axis])).abs() < 1e-5);
            }
            let back = enu_from_flu(&ned_from_frd(&attitude).map(|value| value as f32));
            prop_assert!((back.rotate(in_body) - attitude.rotate(in_body)).norm() < 1e-5);
        }
    }
}
