//! Products of vectors for every number type (nalgebra's ask for more than [`Real`] promises).

use nalgebra::Vector3;

use crate::real::Real;

#[inline(always)]
pub(crate) fn dot<R: Real>(a: &Vector3<R>, b: &Vector3<R>) -> R {
    a.x * b.x + a.y * b.y + a.z * b.z
}

#[inline(always)]
pub(crate) fn cross<R: Real>(a: &Vector3<R>, b: &Vector3<R>) -> Vector3<R> {
    Vector3::new(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)
}

#[inline(always)]
pub(crate) fn square<R: Real>(vector: &Vector3<R>) -> R {
    dot(vector, vector)
}

#[inline(always)]
pub(crate) fn length<R: Real>(vector: &Vector3<R>) -> R {
    square(vector).sqrt()
}

#[inline(always)]
pub(crate) fn zero<R: Real>() -> Vector3<R> {
    Vector3::new(R::zero(), R::zero(), R::zero())
}

/// Every component within ±`limit`.
#[inline(always)]
pub(crate) fn limited<R: Real>(vector: &Vector3<R>, limit: f64) -> Vector3<R> {
    vector.map(|value| value.limited(R::from_f64(-limit), R::from_f64(limit)))
}
