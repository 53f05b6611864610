//! Every term against numbers made by hand, the reference's both as published and corrected.

mod component;
mod list;
mod term;

use nalgebra::Vector3;

use super::trial::{PITCH, ROLL, Trial, YAW, assert_all_near, assert_near, turn};

#[test]
fn a_turn_is_a_unit_quaternion() {
    let up = turn(ROLL, 0.3).rotate(Vector3::z());
    assert_near(up.y, -(0.3_f64.sin()));
    assert_near(up.z, 0.3_f64.cos());
}
