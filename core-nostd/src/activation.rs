//! The activation functions of every network, the same bits wherever they run.

use serde::{Deserialize, Serialize};

use crate::real::Real;

/// What follows the sums of a hidden layer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Activation {
    /// Hyperbolic tangent, [`tanh`].
    #[default]
    Tanh,
    /// Rectifier, [`relu`].
    Relu,
}

impl Activation {
    /// As written in configurations.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tanh => "tanh",
            Self::Relu => "relu",
        }
    }
}

/// Where the approximation is cut off: `tanh` is within 4e-7 of one there.
const SATURATION: f64 = 7.8;

/// Odd numerator and even denominator of a rational approximation, lowest power first: the minimax fit of the
/// relative error on \[0, 7.8\] by Lawson's reweighted least squares, 1.2e-7 before rounding. Both have nearly the
/// same length, so that they are evaluated side by side.
const NUMERATOR: [f64; 4] = [0.999_999_882_9, 0.129_431_222_2, 0.002_969_895_57, 1.163_578_485e-5];
const DENOMINATOR: [f64; 5] = [1.0, 0.462_763_592_3, 0.023_892_425_04, 2.413_555_045e-4, 2.526_256_449e-7];

/// Hyperbolic tangent to within 1e-6, odd, never beyond ±1; NaN becomes -1.
///
/// Plain multiplications, additions and one division: vectorises on hosts and needs no `f64` on a microcontroller.
#[inline(always)]
pub fn tanh<R: Real>(x: R) -> R {
    let limit = R::from_f64(SATURATION);
    let x = x.limited(-limit, limit);
    let square = x * x;
    let numerator = x * polynomial(&NUMERATOR, square);
    (numerator / polynomial(&DENOMINATOR, square)).limited(-R::one(), R::one())
}

/// Logistic function, `0.5 + 0.5 tanh(x / 2)`, to within 1e-6 and never outside \[0, 1\]; NaN counts as -∞.
#[inline(always)]
pub fn sigmoid<R: Real>(x: R) -> R {
    let half = R::from_f64(0.5);
    half + half * tanh(half * x)
}

/// `x` where it is positive, zero elsewhere and for NaN.
#[inline(always)]
pub fn relu<R: Real>(x: R) -> R {
    if x > R::zero() { x } else { R::zero() }
}

#[inline(always)]
fn polynomial<R: Real, const N: usize>(coefficients: &[f64; N], x: R) -> R {
    let mut value = R::from_f64(coefficients[N - 1]);
    for coefficient in coefficients[..N - 1].iter().rev() {
        value = value * x + R::from_f64(*coefficient);
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn tanh_saturates_and_is_odd() {
        assert_eq!(tanh(0.0_f32), 0.0);
        assert_eq!(tanh(f32::NAN), tanh(f32::NEG_INFINITY));
        for x in [0.1_f32, 1.0, 5.0, 100.0, f32::INFINITY] {
            assert_eq!(tanh(-x), -tanh(x));
            assert!(tanh(x) <= 1.0);
        }
        assert!(tanh(50.0_f32) > 0.999_999);
    }

    #[test]
    fn sigmoid_is_the_logistic_function() {
        for x in [-30.0_f32, -2.0, 0.0, 0.5, 30.0] {
            let exact = 1.0 / (1.0 + libm::exp(-f64::from(x)));
            assert!((f64::from(sigmoid(x)) - exact).abs() < 1e-6, "{x}");
        }
        assert_eq!(sigmoid(f32::NAN), sigmoid(f32::NEG_INFINITY));
    }

    #[test]
    fn relu_keeps_what_is_positive() {
        for (x, expected) in [(-1.0_f32, 0.0), (-0.0, 0.0), (0.0, 0.0), (2.5, 2.5), (f32::NAN, 0.0)] {
            assert_eq!(relu(x).to_bits(), f32::to_bits(expected));
        }
    }

    proptest! {
        #[test]
        fn tanh_is_within_a_millionth(x in -20.0_f32..20.0) {
            prop_assert!((f64::from(tanh(x)) - libm::tanh(f64::from(x))).abs() < 1e-6);
        }
    }
}
