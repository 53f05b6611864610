//! Arithmetic over the lanes of a block.

use kestrel_core::real::Real;
use nalgebra::Vector3;

use crate::swarm::{Column, Swarm, vector};
use crate::world::Cuboid;

/// Writes the value of each lane.
#[inline(always)]
pub(crate) fn each<const LANES: usize, R>(values: &mut Column<LANES, R>, value: impl Fn(usize) -> R) {
    for (lane, slot) in values.iter_mut().enumerate() {
        *slot = value(lane);
    }
}

/// Writes `worth` times the sum of squares of some numbers of each lane. Number by number: a sum within a lane, over as many
/// numbers as are known at run time only, does not vectorise.
#[inline(always)]
pub(crate) fn sum_squares<const LANES: usize, R: Real>(
    values: &mut Column<LANES, R>,
    worth: R,
    numbers: impl Iterator<Item = impl Fn(usize) -> R>,
) {
    *values = [R::zero(); LANES];
    for number in numbers {
        for (lane, sum) in values.iter_mut().enumerate() {
            let value = number(lane);
            *sum += value * value;
        }
    }
    for sum in values {
        *sum = worth * *sum;
    }
}

/// Writes `code` where the lane is not `fine`; comparisons with NaN are false, so NaN is never fine.
#[inline(always)]
pub(crate) fn mark<const LANES: usize>(codes: &mut Column<LANES>, code: f32, fine: impl Fn(usize) -> bool) {
    for (lane, slot) in codes.iter_mut().enumerate() {
        *slot = if fine(lane) { *slot } else { code };
    }
}

/// Whether a column remembers nothing yet.
#[inline(always)]
pub(crate) fn is_unset<R: Real>(value: R) -> bool {
    value.to_f64().is_nan()
}

#[inline(always)]
pub(crate) fn squared_length<const LANES: usize, R: Real>(columns: &[Column<LANES, R>], lane: usize) -> R {
    columns.iter().fold(R::zero(), |sum, column| sum + column[lane] * column[lane])
}

#[inline(always)]
pub(crate) fn length<R: Real>(vector: &Vector3<R>) -> R {
    ((vector.x * vector.x + vector.y * vector.y) + vector.z * vector.z).sqrt()
}

#[inline(always)]
pub(crate) fn planar_length<R: Real>(vector: &Vector3<R>) -> R {
    (vector.x * vector.x + vector.y * vector.y).sqrt()
}

/// Distance of the drone in a lane from a point \[m\].
#[inline(always)]
pub(crate) fn distance<const LANES: usize, R: Real>(
    swarm: &Swarm<LANES, R>,
    target: &Vector3<f64>,
    lane: usize,
) -> R {
    length(&(vector(&swarm.position, lane) - target.map(R::from_f64)))
}

/// As [`distance`], in x and y only.
#[inline(always)]
pub(crate) fn planar_distance<const LANES: usize, R: Real>(
    swarm: &Swarm<LANES, R>,
    target: &Vector3<f64>,
    lane: usize,
) -> R {
    planar_length(&(vector(&swarm.position, lane) - target.map(R::from_f64)))
}

/// Inside a box, its surface excluded.
#[inline(always)]
pub(crate) fn contains<const LANES: usize, R: Real>(
    cuboid: &Cuboid,
    swarm: &Swarm<LANES, R>,
    lane: usize,
) -> bool {
    let [x, y, z] = [swarm.position[0][lane], swarm.position[1][lane], swarm.position[2][lane]];
    let (low, high) = (cuboid.low.map(R::from_f32), cuboid.high.map(R::from_f32));
    (low.x < x) & (x < high.x) & (low.y < y) & (y < high.y) & (low.z < z) & (z < high.z)
}

/// Within a box, its surface included: the reference's bounds end what is beyond them.
#[inline(always)]
pub(crate) fn stays_in<const LANES: usize, R: Real>(
    cuboid: &Cuboid,
    swarm: &Swarm<LANES, R>,
    lane: usize,
) -> bool {
    let [x, y, z] = [swarm.position[0][lane], swarm.position[1][lane], swarm.position[2][lane]];
    let (low, high) = (cuboid.low.map(R::from_f32), cuboid.high.map(R::from_f32));
    (low.x <= x) & (x <= high.x) & (low.y <= y) & (y <= high.y) & (low.z <= z) & (z <= high.z)
}
