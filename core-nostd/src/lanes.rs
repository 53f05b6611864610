//! Several drones side by side in one number.

use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

use crate::real::Real;

/// `N` independent `f32` values that take part in every operation together.
///
/// Plain arrays with plain loops: inside a function compiled for AVX2, AVX-512 or NEON the compiler turns them
/// into vector registers, elsewhere they stay scalar, and the bits are the same.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub struct Lanes<const N: usize>(pub [f32; N]);

impl<const N: usize> Lanes<N> {
    /// The same value in every lane.
    #[inline(always)]
    pub fn splat(value: f32) -> Self {
        Self([value; N])
    }

    /// Reads `N` consecutive values from the start of `column`.
    ///
    /// # Panics
    /// When `column` is shorter than `N`.
    #[inline(always)]
    pub fn load(column: &[f32]) -> Self {
        let mut lanes = [0.0; N];
        lanes.copy_from_slice(&column[..N]);
        Self(lanes)
    }

    /// Writes the lanes to the start of `column`.
    ///
    /// # Panics
    /// When `column` is shorter than `N`.
    #[inline(always)]
    pub fn store(self, column: &mut [f32]) {
        column[..N].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn map(self, f: impl Fn(f32) -> f32) -> Self {
        let mut result = self.0;
        for value in &mut result {
            *value = f(*value);
        }
        Self(result)
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut result = self.0;
        for (value, other) in result.iter_mut().zip(other.0) {
            *value = f(*value, other);
        }
        Self(result)
    }
}

macro_rules! lanewise_operator {
    ($trait:ident, $method:ident, $assign_trait:ident, $assign_method:ident, $operator:tt) => {
        impl<const N: usize> $trait for Lanes<N> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(other, |a, b| a $operator b)
            }
        }

        impl<const N: usize> $assign_trait for Lanes<N> {
            #[inline(always)]
            fn $assign_method(&mut self, other: Self) {
                *self = *self $operator other;
            }
        }
    };
}

lanewise_operator!(Add, add, AddAssign, add_assign, +);
lanewise_operator!(Sub, sub, SubAssign, sub_assign, -);
lanewise_operator!(Mul, mul, MulAssign, mul_assign, *);
lanewise_operator!(Div, div, DivAssign, div_assign, /);

impl<const N: usize> Neg for Lanes<N> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|a| -a)
    }
}

impl<const N: usize> Real for Lanes<N> {
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        Self::splat(value as f32)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(Real::sqrt)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        self.map(f32::abs)
    }

    #[inline(always)]
    fn where_less(self, bound: Self, then: Self, otherwise: Self) -> Self {
        let mut result = otherwise.0;
        for (lane, result) in result.iter_mut().enumerate() {
            if self.0[lane] < bound.0[lane] {
                *result = then.0[lane];
            }
        }
        Self(result)
    }
}
