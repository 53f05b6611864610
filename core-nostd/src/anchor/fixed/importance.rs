//! Importances as logarithms: a byte spans 32 octaves in steps of an eighth.

use super::{FRACTION_BITS, Fraction};

const STEPS_PER_OCTAVE: u8 = 8;

/// 2^(j / 8) in 2⁻²⁴, rounded.
const STEPS: [u32; STEPS_PER_OCTAVE as usize] =
    [16_777_216, 18_295_684, 19_951_585, 21_757_357, 23_726_566, 25_874_004, 28_215_802, 30_769_550];

/// Logarithm to base 2 of the least importance.
const LEAST_OCTAVE: i32 = -16;

/// Bits that the least importance loses against one.
const LEAST_SHIFT: u32 = LEAST_OCTAVE.unsigned_abs();

/// Code of an importance of one.
const CODE_OF_ONE: f32 = 129.0;

/// The importance of a code, in 2⁻²⁴; from 2⁸ to below 2⁴⁰, or 0.
#[inline(always)]
pub(super) fn importance_of(code: u8) -> u64 {
    let Some(steps) = code.checked_sub(1) else { return 0 };
    (step(steps) << (steps / STEPS_PER_OCTAVE)) >> LEAST_SHIFT
}

/// `rate` times the importance of a code, in 2⁻²⁴; below 2⁴⁸.
pub(super) fn scaled(code: u8, rate: Fraction) -> u64 {
    let Some(steps) = code.checked_sub(1) else { return 0 };
    let shift = FRACTION_BITS + LEAST_SHIFT - u32::from(steps / STEPS_PER_OCTAVE);
    (step(steps) * u64::from(rate.bits())) >> shift
}

#[inline(always)]
fn step(steps: u8) -> u64 {
    // Every remainder is in the table.
    STEPS.get(usize::from(steps % STEPS_PER_OCTAVE)).copied().map_or(0, u64::from)
}

/// One of the two codes around `importance` \[2⁻²⁴\], the upper one for as large a part of the dithers
/// \[2⁻²⁴, below 1\] as the importance is above the lower one: right on average. The greatest code beyond it.
#[inline(always)]
pub(super) fn dithered_code(importance: u64, dither: u32) -> u8 {
    let below = code_below(importance);
    let (lower, upper) = (importance_of(below), importance_of(below.saturating_add(1)));
    let passes = (importance - lower) << FRACTION_BITS > u64::from(dither) * (upper - lower);
    below.saturating_add(u8::from(passes))
}

/// The greatest code whose importance is not above `importance` \[2⁻²⁴\].
#[inline(always)]
fn code_below(importance: u64) -> u8 {
    let Some(octave) = importance.checked_ilog2().and_then(|log| log.checked_sub(FRACTION_BITS - LEAST_SHIFT))
    else {
        return 0;
    };
    let first = (octave * u32::from(STEPS_PER_OCTAVE) + 1).min(u32::from(u8::MAX)) as u8;
    let last = first.saturating_add(STEPS_PER_OCTAVE - 1);
    (first..=last).rev().find(|&code| importance_of(code) <= importance).unwrap_or(first)
}

/// The code nearest to an importance in ratio, within 4.4 %: for curvature that was computed in floating point.
///
/// Beyond the range it is the greatest code, or the least; below half of the least importance, and for NaN, none.
pub fn importance_code(importance: f32) -> u8 {
    let least = libm::exp2f(LEAST_OCTAVE as f32);
    if importance < 0.5 * least || importance.is_nan() {
        return 0;
    }
    let steps = libm::roundf(f32::from(STEPS_PER_OCTAVE) * libm::log2f(importance));
    // `as` saturates.
    (steps + CODE_OF_ONE).max(1.0) as u8
}

/// Whether an importance is not within half a step of any code.
pub(super) fn is_beyond(importance: f32) -> bool {
    let octaves = libm::log2f(importance);
    let half_step = 0.5 / f32::from(STEPS_PER_OCTAVE);
    let least = LEAST_OCTAVE as f32 - half_step;
    let greatest = (f32::from(u8::MAX) - CODE_OF_ONE) / f32::from(STEPS_PER_OCTAVE) + half_step;
    importance != 0.0 && !(least..=greatest).contains(&octaves)
}
