//! Boxes and points, as far as checks need them.

use nalgebra::Vector3;

use crate::scenario::Cuboid;

/// Whether `point` is inside, not on the surface, as the simulation tests it.
pub(crate) fn contains(cuboid: &Cuboid, point: &Vector3<f32>) -> bool {
    (0..3).all(|axis| cuboid.low[axis] < point[axis] && point[axis] < cuboid.high[axis])
}

/// Whether all of `inner` is inside.
pub(crate) fn surrounds(cuboid: &Cuboid, inner: &Cuboid) -> bool {
    contains(cuboid, &inner.low) && contains(cuboid, &inner.high)
}

/// Distance between two boxes \[m\], zero where they overlap.
pub(crate) fn gap(one: &Cuboid, other: &Cuboid) -> f32 {
    (one.low - other.high).sup(&(other.low - one.high)).sup(&Vector3::zeros()).norm()
}
