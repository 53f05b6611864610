//! The one number trait of the physics.

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

use nalgebra::Scalar;

use crate::elementary;

/// A real number on which the vehicle's equations are written once: `f32` flies, `f64` is the oracle.
///
/// Every operation is correctly rounded IEEE arithmetic in source order, nothing fused, and every choice is a select.
/// The transcendental functions of `f64` and `sin_cos` are `libm`'s everywhere; those of `f32` are polynomials that
/// differ from them by three units in the last place at most. A plain loop over columns of `f32` therefore becomes
/// SIMD lanes inside functions compiled for AVX2, AVX-512 or NEON, and a lane, a scalar and a microcontroller compute
/// the same bits. (A number type that holds an array of lanes was tried: the compiler unrolls it into scalars and runs
/// at a third of the loop's speed.)
pub trait Real:
    Scalar
    + PartialOrd
    + Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
{
    /// The nearest representable value.
    fn from_f64(value: f64) -> Self;

    /// The same value.
    fn from_f32(value: f32) -> Self;

    /// The same value, or the nearest, in double precision.
    fn to_f64(self) -> f64;

    /// The same value, or the nearest, in single precision.
    fn to_f32(self) -> f32;

    /// Square root; NaN below zero.
    #[must_use]
    fn sqrt(self) -> Self;

    /// Magnitude.
    #[must_use]
    fn abs(self) -> Self;

    /// Sine and cosine of an angle \[rad\].
    #[must_use]
    fn sin_cos(self) -> (Self, Self);

    /// Arc sine \[rad\]; NaN beyond ±1.
    #[must_use]
    fn asin(self) -> Self;

    /// Angle \[rad\] of the point with ordinate `self` and the given abscissa, in \[-π, π\].
    #[must_use]
    fn atan2(self, abscissa: Self) -> Self;

    /// Natural exponential.
    #[must_use]
    fn exp(self) -> Self;

    /// Natural logarithm; NaN below zero.
    #[must_use]
    fn ln(self) -> Self;

    /// The greatest whole number that is not greater.
    #[must_use]
    fn floor(self) -> Self;

    /// The nearest single-precision number.
    #[must_use]
    fn in_single(self) -> Self;

    /// `then` where `self < bound`, `otherwise` elsewhere (also where either is NaN).
    #[must_use]
    fn where_less(self, bound: Self, then: Self, otherwise: Self) -> Self;

    /// Zero.
    #[inline(always)]
    #[must_use]
    fn zero() -> Self {
        Self::from_f64(0.0)
    }

    /// One.
    #[inline(always)]
    #[must_use]
    fn one() -> Self {
        Self::from_f64(1.0)
    }

    /// The smaller of both; `other` where `self` is NaN.
    #[inline(always)]
    #[must_use]
    fn at_most(self, other: Self) -> Self {
        self.where_less(other, self, other)
    }

    /// The larger of both; `other` where `self` is NaN.
    #[inline(always)]
    #[must_use]
    fn at_least(self, other: Self) -> Self {
        other.where_less(self, self, other)
    }

    /// Limited to `[low, high]`; NaN becomes `low`.
    #[inline(always)]
    #[must_use]
    fn limited(self, low: Self, high: Self) -> Self {
        self.at_least(low).at_most(high)
    }

    /// Sine of an angle \[rad\].
    #[inline(always)]
    #[must_use]
    fn sin(self) -> Self {
        self.sin_cos().0
    }

    /// Cosine of an angle \[rad\].
    #[inline(always)]
    #[must_use]
    fn cos(self) -> Self {
        self.sin_cos().1
    }

    /// Square.
    #[inline(always)]
    #[must_use]
    fn squared(self) -> Self {
        self * self
    }
}

macro_rules! real_for_float {
    (
        $float:ty,
        [$sqrt:path, $floor:path],
        [$sin_cos:path, $asin:path, $atan2:path, $exp:path, $ln:path]
    ) => {
        impl Real for $float {
            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                value as $float
            }

            #[inline(always)]
            fn from_f32(value: f32) -> Self {
                <$float>::from(value)
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                $sqrt(self)
            }

            #[inline(always)]
            fn abs(self) -> Self {
                <$float>::abs(self)
            }

            #[inline]
            fn sin_cos(self) -> (Self, Self) {
                $sin_cos(self)
            }

            #[inline(always)]
            fn asin(self) -> Self {
                $asin(self)
            }

            #[inline(always)]
            fn atan2(self, abscissa: Self) -> Self {
                $atan2(self, abscissa)
            }

            #[inline(always)]
            fn exp(self) -> Self {
                $exp(self)
            }

            #[inline(always)]
            fn ln(self) -> Self {
                $ln(self)
            }

            #[inline(always)]
            fn floor(self) -> Self {
                $floor(self)
            }

            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }

            #[inline(always)]
            fn to_f32(self) -> f32 {
                self as f32
            }

            #[inline(always)]
            fn in_single(self) -> Self {
                <$float>::from(self as f32)
            }

            #[inline(always)]
            fn where_less(self, bound: Self, then: Self, otherwise: Self) -> Self {
                if self < bound { then } else { otherwise }
            }
        }
    };
}

#[cfg(feature = "std")]
real_for_float!(
    f32,
    [f32::sqrt, f32::floor],
    [libm::sincosf, elementary::asin, elementary::atan2, elementary::exp, elementary::ln]
);
#[cfg(feature = "std")]
real_for_float!(f64, [f64::sqrt, f64::floor], [libm::sincos, libm::asin, libm::atan2, libm::exp, libm::log]);
#[cfg(not(feature = "std"))]
real_for_float!(
    f32,
    [libm::sqrtf, libm::floorf],
    [libm::sincosf, elementary::asin, elementary::atan2, elementary::exp, elementary::ln]
);
#[cfg(not(feature = "std"))]
real_for_float!(f64, [libm::sqrt, libm::floor], [libm::sincos, libm::asin, libm::atan2, libm::exp, libm::log]);
