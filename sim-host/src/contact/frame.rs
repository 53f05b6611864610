//! Poses, composed in `f64`, and their way into parry's `f32`.

use kestrel_core::attitude::Attitude;
use nalgebra::{Matrix3, Vector3};
use rapier3d::math as small;

use crate::world::Pose;

/// The turn back.
pub(super) fn inverse(turn: &Attitude<f64>) -> Attitude<f64> {
    Attitude { w: turn.w, x: -turn.x, y: -turn.y, z: -turn.z }
}

/// `inner`, given relative to `outer`, in the frame that `outer` is given in.
pub(super) fn compose(outer: &Pose, inner: &Pose) -> Pose {
    Pose {
        position: outer.position + outer.world_from_body.rotate(inner.position),
        world_from_body: outer.world_from_body.after(&inner.world_from_body),
    }
}

/// `pose` as seen from `origin`; both in the world.
pub(super) fn relative(origin: &Pose, pose: &Pose) -> Pose {
    Pose {
        position: origin.world_from_body.rotate_inverse(pose.position - origin.position),
        world_from_body: inverse(&origin.world_from_body).after(&pose.world_from_body),
    }
}

pub(super) fn to_vector(vector: &Vector3<f64>) -> small::Vector {
    small::Vector::new(vector.x as f32, vector.y as f32, vector.z as f32)
}

pub(super) fn from_vector(vector: small::Vector) -> Vector3<f64> {
    Vector3::new(f64::from(vector.x), f64::from(vector.y), f64::from(vector.z))
}

pub(super) fn to_rotation(turn: &Attitude<f64>) -> small::Rotation {
    small::Rotation::from_xyzw(turn.x as f32, turn.y as f32, turn.z as f32, turn.w as f32)
}

pub(super) fn from_rotation(turn: small::Rotation) -> Attitude<f64> {
    let [x, y, z, w] = turn.to_array().map(f64::from);
    Attitude { w, x, y, z }
}

pub(super) fn to_matrix(matrix: &Matrix3<f64>) -> small::Matrix {
    small::Matrix::from_cols_array(&core::array::from_fn(|index| matrix[index] as f32))
}

pub(super) fn to_pose(pose: &Pose) -> small::Pose {
    small::Pose::from_parts(to_vector(&pose.position), to_rotation(&pose.world_from_body))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_seen_from_a_pose_is_put_back_by_it() {
        let turned = |x, angle| Pose {
            position: Vector3::new(x, -0.5, 2.0),
            world_from_body: Attitude::from_axis_angle(Vector3::new(0.6, 0.0, 0.8), angle),
        };
        let (origin, pose) = (turned(40.0, 0.7), turned(41.0, -1.9));
        let back = compose(&origin, &relative(&origin, &pose));
        assert!((back.position - pose.position).norm() < 1e-12);
        assert!((back.world_from_body.matrix() - pose.world_from_body.matrix()).norm() < 1e-12);
    }
}
