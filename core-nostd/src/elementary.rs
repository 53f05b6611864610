//! Elementary functions of single precision for loops over lanes: polynomials, selects and one division or root.
//!
//! `libm`'s branch and look up, so that a loop that calls them runs lane by lane. These vectorise and, made of correctly
//! rounded operations in a fixed order, give the same bits on every target. The polynomials are minimax fits of the
//! relative error; beside the error of the fit stands what rounding makes of it, tested against `libm` in `f64`.
//! Results too small for a normal number may be zero.

use core::f32::consts::{FRAC_PI_2, LOG2_E, SQRT_2};

/// `FRAC_PI_2 + FRAC_PI_2_REST` is π/2 to 48 bits.
const FRAC_PI_2_REST: f32 = -4.371_139e-8;

/// `LN_2_HIGH + LN_2_LOW` is ln 2; products of the first with whole numbers up to 2⁹ are exact.
const LN_2_HIGH: f32 = 0.693_359_4;
const LN_2_LOW: f32 = -2.121_944_4e-4;

/// Bits of the fraction.
const FRACTION_BITS: u32 = f32::MANTISSA_DIGITS - 1;

/// Added to a small number, it leaves the nearest whole number in the lowest bits of the sum.
const ROUNDER: f32 = 1.5 * (1_u32 << FRACTION_BITS) as f32;

/// Square root, the same bits from either library; NaN below zero.
#[inline(always)]
pub(crate) fn sqrt(value: f32) -> f32 {
    #[cfg(feature = "std")]
    {
        value.sqrt()
    }
    #[cfg(not(feature = "std"))]
    {
        libm::sqrtf(value)
    }
}

/// Sine and cosine of an angle within ±π \[rad\], by those of its half (Abramowitz & Stegun 4.3.97 and 4.3.99), within
/// 1e-6: without double precision, which a microcontroller computes in software.
#[inline(always)]
pub(crate) fn sin_cos_of_half_turn(angle: f32) -> [f32; 2] {
    let half = 0.5 * angle;
    let square = half * half;
    let sine_over = ((((-2.39e-8 * square + 2.752_6e-6) * square - 1.984_09e-4) * square + 8.333_332e-3) * square
        - 0.166_666_67)
        * square
        + 1.0;
    let cosine =
        ((((-2.605e-7 * square + 2.476_09e-5) * square - 1.388_839_7e-3) * square + 0.041_666_64) * square - 0.5)
            * square
            + 1.0;
    let sine = half * sine_over;
    [2.0 * sine * cosine, cosine * cosine - sine * sine]
}

/// Angle \[rad\] of the point, in \[-π, π\], signs of zeros as in `libm`; NaN if both coordinates are infinite. Within
/// 3 units in the last place.
#[inline(always)]
pub(crate) fn atan2(ordinate: f32, abscissa: f32) -> f32 {
    let (height, width) = (ordinate.abs(), abscissa.abs());
    let steep = width < height;
    let (short, long) = if steep { (width, height) } else { (height, width) };
    let ratio = short / if long == 0.0 { 1.0 } else { long };
    let behind = abscissa.is_sign_negative();
    let quarters = if steep {
        1.0
    } else if behind {
        2.0
    } else {
        0.0
    };
    let acute = atan_of_share(ratio);
    let turn = if steep == behind { acute } else { -acute };
    let angle = quarters * FRAC_PI_2 + (turn + quarters * FRAC_PI_2_REST);
    angle.copysign(ordinate)
}

/// Arc tangent of a number from 0 to 1; the fit is within 1.7e-8.
#[inline(always)]
fn atan_of_share(x: f32) -> f32 {
    let coefficients = [
        -0.333_331_53,
        0.199_937_73,
        -0.142_110_55,
        0.106_660_03,
        -0.075_522_1,
        0.043_211_81,
        -0.016_367_893,
        0.002_920_683,
    ];
    let square = x * x;
    x + x * (square * polynomial(square, coefficients))
}

/// Arc sine \[rad\]; NaN beyond ±1. Within 3 units in the last place.
#[inline(always)]
pub(crate) fn asin(sine: f32) -> f32 {
    // Beyond 30° from the half angle, whose sine is the root of (1 − x) / 2. The fit is within 5e-9.
    let coefficients = [0.166_667_54, 0.074_952_416, 0.045_477_11, 0.024_147_562, 0.042_218_62];
    let magnitude = sine.abs();
    let flat = magnitude < 0.5;
    let square = if flat { magnitude * magnitude } else { 0.5 * (1.0 - magnitude) };
    let base = if flat { magnitude } else { sqrt(square) };
    let angle = base + base * (square * polynomial(square, coefficients));
    let angle = if flat { angle } else { FRAC_PI_2 - (2.0 * angle - FRAC_PI_2_REST) };
    angle.copysign(sine)
}

/// Natural exponential; zero below −87.3, infinite above 88.3. Within 2 units in the last place.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    // 2ⁿ eʳ with |r| ≤ ln 2 / 2; the fit is within 3.2e-9.
    let coefficients = [0.5, 0.166_665_2, 0.041_666_206, 0.008_368_889, 0.001_395_047_6];
    let shifted = x * LOG2_E + ROUNDER;
    let whole = shifted - ROUNDER;
    let rest = (x - whole * LN_2_HIGH) - whole * LN_2_LOW;
    let growth = 1.0 + (rest + rest * rest * polynomial(rest, coefficients));
    let bits = shifted.to_bits().wrapping_add(f32::MAX_EXP as u32 - 1) << FRACTION_BITS;
    let power = growth * f32::from_bits(bits);
    let power = if x < -87.3 { 0.0 } else { power };
    if 88.3 < x { f32::INFINITY } else { power }
}

/// Natural logarithm; −∞ of zero and subnormal numbers, NaN below. Within 2 units in the last place.
#[inline(always)]
pub(crate) fn ln(x: f32) -> f32 {
    // n ln 2 + ln (1 + f) with √½ ≤ 1 + f < √2; the fit is within 5.9e-9.
    let coefficients = [
        0.333_333_3,
        -0.250_008_2,
        0.200_012_26,
        -0.166_233_58,
        0.142_017_87,
        -0.131_602_05,
        0.127_613_86,
        -0.076_341_95,
    ];
    let root_bits = (0.5 * SQRT_2).to_bits();
    let above = x.to_bits().wrapping_sub(root_bits);
    let whole = ((above as i32) >> FRACTION_BITS) as f32;
    let fraction = f32::from_bits((above & ((1 << FRACTION_BITS) - 1)) + root_bits) - 1.0;
    let square = fraction * fraction;
    let tail = whole * LN_2_LOW + (fraction * square * polynomial(fraction, coefficients) - 0.5 * square);
    let log = whole * LN_2_HIGH + (fraction + tail);
    let log = if x < f32::MIN_POSITIVE { f32::NEG_INFINITY } else { log };
    // Also NaN where the argument is.
    let log = if 0.0 <= x { log } else { f32::NAN };
    if x == f32::INFINITY { x } else { log }
}

/// `c₀ + c₁ x + c₂ x² + …`
#[inline(always)]
fn polynomial<const N: usize>(x: f32, coefficients: [f32; N]) -> f32 {
    let mut sum = coefficients[N - 1];
    for coefficient in coefficients[..N - 1].iter().rev() {
        sum = sum * x + coefficient;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Distance in units in the last place of the exact value, which is normal or zero.
    fn error(found: f32, exact: f64) -> f64 {
        if f64::from(found) == exact {
            return 0.0;
        }
        let exponent = libm::ilogb(exact).max(-126) - FRACTION_BITS as i32;
        (f64::from(found) - exact).abs() / libm::ldexp(1.0, exponent)
    }

    fn any_angle_of(points: impl Iterator<Item = (f32, f32)>) -> f64 {
        let errors = points.map(|(y, x)| error(atan2(y, x), libm::atan2(f64::from(y), f64::from(x))));
        errors.fold(0.0, f64::max)
    }

    /// Numbers spread over `[low, high]`.
    fn spread(low: f32, high: f32) -> impl Iterator<Item = f32> {
        let count = 200_000;
        (0..=count).map(move |index| low + (high - low) * (index as f32 / count as f32))
    }

    #[test]
    fn they_are_libms_to_a_few_units_in_the_last_place() {
        let worst = |errors: &mut dyn Iterator<Item = f64>| errors.fold(0.0, f64::max);
        let angle = any_angle_of(spread(-4.0, 4.0).flat_map(|t| [(t, 1.0), (t, -1.0), (1.0, t), (-1.0, t)]));
        let arc = worst(&mut spread(-1.0, 1.0).map(|x| error(asin(x), libm::asin(f64::from(x)))));
        let power = worst(&mut spread(-87.0, 88.0).map(|x| error(exp(x), libm::exp(f64::from(x)))));
        let small = worst(&mut spread(-0.5, 0.5).map(|x| error(exp(x), libm::exp(f64::from(x)))));
        let log = worst(&mut spread(1e-3, 4.0).map(|x| error(ln(x), libm::log(f64::from(x)))));
        assert!(angle < 3.0 && arc < 3.0, "{angle} {arc}");
        assert!(power.max(small) < 2.0 && log < 2.0, "{power} {small} {log}");
    }

    #[test]
    fn sine_and_cosine_of_a_heading_are_libms() {
        assert_eq!(sin_cos_of_half_turn(0.0), [0.0, 1.0]);
        for angle in spread(-core::f32::consts::PI, core::f32::consts::PI) {
            let [sine, cosine] = sin_cos_of_half_turn(angle).map(f64::from);
            let expected = libm::sincos(f64::from(angle));
            assert!((sine - expected.0).abs() < 1e-6 && (cosine - expected.1).abs() < 1e-6, "{angle}");
        }
    }

    #[test]
    fn angles_on_the_axes_are_exact() {
        for y in [0.0, -0.0, 1.0, -1.0, f32::MIN_POSITIVE, f32::MAX, f32::INFINITY] {
            for x in [0.0, -0.0, 1.0, -1.0, f32::MAX] {
                let exact = libm::atan2(f64::from(y), f64::from(x)) as f32;
                assert_eq!(atan2(y, x).to_bits(), exact.to_bits(), "{y} {x}");
            }
        }
        assert_eq!([asin(0.0), asin(1.0), asin(-1.0)], [0.0, FRAC_PI_2, -FRAC_PI_2]);
        assert!(asin(-0.0).is_sign_negative());
    }

    #[test]
    fn limits_are_what_they_should_be() {
        assert_eq!([exp(0.0), exp(-1e9), exp(f32::NEG_INFINITY)], [1.0, 0.0, 0.0]);
        assert_eq!([exp(100.0), exp(f32::INFINITY), ln(f32::INFINITY)], [f32::INFINITY; 3]);
        assert_eq!([ln(1.0), ln(0.0)], [0.0, f32::NEG_INFINITY]);
        assert!(ln(-1.0).is_nan() && asin(1.000_001).is_nan() && asin(-2.0).is_nan());
        let nan = f32::NAN;
        for value in [exp(nan), ln(nan), asin(nan), atan2(nan, 1.0), atan2(1.0, nan), atan2(nan, 0.0)] {
            assert!(value.is_nan());
        }
    }

    proptest! {
        #[test]
        fn any_point_has_its_angle(y in -1e30_f32..1e30, x in -1e30_f32..1e30, scale in 1e-6_f32..1.0) {
            let points = [(y, x), (y * scale, x), (y, x * scale)];
            prop_assert!(any_angle_of(points.into_iter()) < 3.0);
        }

        #[test]
        fn any_positive_number_has_its_logarithm(bits in f32::MIN_POSITIVE.to_bits()..f32::MAX.to_bits()) {
            let x = f32::from_bits(bits);
            prop_assert!(error(ln(x), libm::log(f64::from(x))) < 2.0);
        }
    }
}
