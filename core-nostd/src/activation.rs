//! The activation function of every network, the same bits wherever it runs.

use crate::real::Real;

/// Beyond this magnitude `tanh` rounds to one in `f32`.
const SATURATION: f64 = 7.905_311;

/// Odd numerator and even denominator of the rational approximation, lowest power first: the minimax fit that
/// Eigen and XLA use for `f32`.
const NUMERATOR: [f64; 7] = [
    4.893_524_558_917_86e-3,
    6.372_619_288_754_36e-4,
    1.485_722_357_179_79e-5,
    5.122_297_090_371_14e-8,
    -8.604_671_522_137_35e-11,
    2.000_187_904_824_77e-13,
    -2.760_768_477_423_55e-16,
];
const DENOMINATOR: [f64; 4] =
    [4.893_525_185_543_85e-3, 2.268_434_632_439_00e-3, 1.185_347_056_866_54e-4, 1.198_258_394_667_02e-6];

/// Hyperbolic tangent to within 1e-6, odd, never beyond ±1; NaN becomes -1.
///
/// Plain multiplications, additions and one division: vectorises on hosts and needs no `f64` on a microcontroller.
#[inline(always)]
pub fn tanh<R: Real>(x: R) -> R {
    let limit = R::from_f64(SATURATION);
    let x = x.limited(-limit, limit);
    let square = x * x;
    let mut numerator = R::from_f64(NUMERATOR[6]);
    for coefficient in NUMERATOR[..6].iter().rev() {
        numerator = numerator * square + R::from_f64(*coefficient);
    }
    let mut denominator = R::from_f64(DENOMINATOR[3]);
    for coefficient in DENOMINATOR[..3].iter().rev() {
        denominator = denominator * square + R::from_f64(*coefficient);
    }
    (x * numerator / denominator).limited(-R::one(), R::one())
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

    proptest! {
        #[test]
        fn tanh_is_within_a_millionth(x in -20.0_f32..20.0) {
            prop_assert!((f64::from(tanh(x)) - libm::tanh(f64::from(x))).abs() < 1e-6);
        }
    }
}
