//! The axes of MAVLink and those of the core, and the only place where NED and FRD become ENU and FLU.
//!
//! The core's world is ENU: x east, y north, z up; a level drone that faces +x heads east, which MAVLink calls a
//! yaw of +90°. Body axes are FLU in the core (forward, left, up) and FRD in MAVLink (forward, right, down).

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;

/// World vector in MAVLink's north, east, down.
pub fn ned_from_enu(vector: &Vector3<f32>) -> [f32; 3] {
    [vector.y, vector.x, -vector.z]
}

/// World vector in the core's east, north, up.
pub fn enu_from_ned([north, east, down]: [f32; 3]) -> Vector3<f32> {
    Vector3::new(east, north, -down)
}

/// Body vector in MAVLink's forward, right, down.
pub fn frd_from_flu(vector: &Vector3<f32>) -> [f32; 3] {
    [vector.x, -vector.y, -vector.z]
}

/// Body vector in the core's forward, left, up.
pub fn flu_from_frd([forward, right, down]: [f32; 3]) -> Vector3<f32> {
    Vector3::new(forward, -right, -down)
}

/// Attitude of the FRD body in the NED world: w, x, y, z.
pub fn ned_from_frd(enu_from_flu: &Attitude<f32>) -> [f32; 4] {
    let Attitude { w, x, y, z } = turned(&enu_from_flu.map(f64::from)).map(|value| value as f32);
    [w, x, y, z]
}

/// Attitude of the FLU body in the ENU world, from w, x, y, z of the FRD body in the NED world.
pub fn enu_from_flu([w, x, y, z]: [f32; 4]) -> Attitude<f32> {
    turned(&Attitude { w, x, y, z }.map(f64::from)).map(|value| value as f32)
}

/// Roll, pitch and yaw \[rad\] of the FRD body in the NED world.
pub fn ned_roll_pitch_yaw(enu_from_flu: &Attitude<f32>) -> [f64; 3] {
    turned(&enu_from_flu.map(f64::from)).roll_pitch_yaw()
}

/// The same attitude between the other pair of axes: the turns that exchange them are their own inverses.
fn turned(attitude: &Attitude<f64>) -> Attitude<f64> {
    let half_root = core::f64::consts::FRAC_1_SQRT_2;
    let worlds = Attitude { w: 0.0, x: half_root, y: half_root, z: 0.0 };
    let bodies = Attitude { w: 0.0, x: 1.0, y: 0.0, z: 0.0 };
    worlds.after(attitude).after(&bodies)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{FRAC_PI_2, PI};

    use proptest::prelude::*;

    use super::*;

    fn tilted(axis: Vector3<f64>, angle_rad: f64) -> Attitude<f32> {
        Attitude::from_axis_angle(axis, angle_rad).map(|value| value as f32)
    }

    fn close(found: [f64; 3], expected: [f64; 3]) {
        for (found, expected) in found.iter().zip(expected) {
            let difference = libm::remainder(found - expected, 2.0 * PI);
            assert!(difference.abs() < 1e-6, "{found} instead of {expected}");
        }
    }

    #[test]
    fn east_north_and_up_have_their_places() {
        assert_eq!(ned_from_enu(&Vector3::new(1.0, 2.0, 3.0)), [2.0, 1.0, -3.0]);
        assert_eq!(enu_from_ned([2.0, 1.0, -3.0]), Vector3::new(1.0, 2.0, 3.0));
        assert_eq!(frd_from_flu(&Vector3::new(1.0, 2.0, 3.0)), [1.0, -2.0, -3.0]);
    }

    #[test]
    fn a_level_drone_that_faces_east_has_a_yaw_of_ninety_degrees() {
        close(ned_roll_pitch_yaw(&Attitude::level()), [0.0, 0.0, FRAC_PI_2]);
    }

    #[test]
    fn turning_left_from_east_faces_north() {
        close(ned_roll_pitch_yaw(&tilted(Vector3::z(), FRAC_PI_2)), [0.0, 0.0, 0.0]);
    }

    #[test]
    fn the_left_side_up_is_a_positive_roll() {
        // FLU: a positive turn about forward lifts the left side, which is a roll to the right.
        close(ned_roll_pitch_yaw(&tilted(Vector3::x(), 0.3)), [0.3, 0.0, FRAC_PI_2]);
    }

    #[test]
    fn the_nose_down_is_a_negative_pitch() {
        // FLU: a positive turn about left pushes the nose down; MAVLink counts the nose up.
        close(ned_roll_pitch_yaw(&tilted(Vector3::y(), 0.3)), [0.0, -0.3, FRAC_PI_2]);
    }

    #[test]
    fn an_attitude_goes_there_and_back() {
        for axis in [Vector3::x(), Vector3::y(), Vector3::new(0.6, 0.0, 0.8)] {
            let before = tilted(axis, 0.7);
            let after = enu_from_flu(ned_from_frd(&before));
            // A quaternion and its negative are the same turn.
            let product = before.w * after.w + before.x * after.x + before.y * after.y + before.z * after.z;
            assert!((product.abs() - 1.0).abs() < 1e-6);
        }
        assert_eq!(flu_from_frd(frd_from_flu(&Vector3::new(1.0, 2.0, 3.0))), Vector3::new(1.0, 2.0, 3.0));
    }

    proptest! {
        #[test]
        fn there_and_back_is_exact(x in -1e3_f32..1e3, y in -1e3_f32..1e3, z in -1e3_f32..1e3) {
            let vector = Vector3::new(x, y, z);
            prop_assert_eq!(enu_from_ned(ned_from_enu(&vector)), vector);
        }

        #[test]
        fn heading_counts_from_north_to_the_right(yaw in -3.0_f64..3.0) {
            close(ned_roll_pitch_yaw(&tilted(Vector3::z(), yaw)), [0.0, 0.0, FRAC_PI_2 - yaw]);
        }
    }
}
