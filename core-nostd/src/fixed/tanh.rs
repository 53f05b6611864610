//! Hyperbolic tangent in integers: a table with linear interpolation.

use super::{ACTIVATION_FRACTION_BITS, SUM_FRACTION_BITS};

/// Table entries per unit: interpolation errs by at most h² / 8 · max |tanh''| = 2.4e-5 with h = 1/64.
const STEPS_PER_UNIT_BITS: u32 = 6;

/// From this argument on the result is one: tanh 6 differs from it by 1.2e-5, a fifth of the result's rounding.
const LIMIT: u32 = 6;

/// The table goes on with ones to this argument, a power of two, because then a sum is limited by one instruction
/// (`ssat`).
const TABLE_LIMIT: u32 = 8;

const ENTRIES: usize = ((TABLE_LIMIT << STEPS_PER_UNIT_BITS) + 1) as usize;

/// Greatest magnitude that is looked up.
const SUM_LIMIT: i32 = (TABLE_LIMIT << SUM_FRACTION_BITS) as i32;

/// Tangents in the table carry two bits more than results.
const TABLE_FRACTION_BITS: u32 = ACTIVATION_FRACTION_BITS + 2;

const POSITION_BITS: u32 = SUM_FRACTION_BITS - STEPS_PER_UNIT_BITS;

const RESULT_SHIFT: u32 = POSITION_BITS + TABLE_FRACTION_BITS - ACTIVATION_FRACTION_BITS;

/// Half of a result, in the fraction bits of the table.
const ROUNDING: u32 = 1 << (TABLE_FRACTION_BITS - ACTIVATION_FRACTION_BITS - 1);

/// Of each step of 1/64, in 2⁻¹⁵: the tangent at its start in the high half, with 2 added as the rounding of the result, and
/// what it grows by in the low half. One load for both.
pub const TABLE: [u32; ENTRIES] = table();

/// `tanh` of `sum` \[2⁻¹⁶\], in 2⁻¹³, to within 1.2e-4 (the rounding of the result is half of that); odd, never
/// beyond ±1.
#[inline(always)]
pub(super) fn tanh(sum: i32) -> i16 {
    let limited = sum.clamp(-SUM_LIMIT, SUM_LIMIT - 1);
    let magnitude = limited.unsigned_abs();
    let position = (magnitude & ((1 << POSITION_BITS) - 1)) as i32;
    // In the table for every magnitude up to the limit; `get` keeps the proof out of the optimiser's hands.
    let entry = TABLE.get((magnitude >> POSITION_BITS) as usize).copied().unwrap_or_default();
    let (below, growth) = ((entry >> 16) as i32, i32::from(entry as i16));
    let result = ((below << POSITION_BITS) + growth * position) >> RESULT_SHIFT;
    (if limited < 0 { -result } else { result }) as i16
}

const fn table() -> [u32; ENTRIES] {
    let mut entries = [0; ENTRIES];
    let mut index = 0;
    while index < ENTRIES {
        let below = tangent(index);
        entries[index] = (below + ROUNDING) << 16 | (tangent(index + 1) - below);
        index += 1;
    }
    entries
}

/// At the start of a step, in the fraction bits of the table.
const fn tangent(index: usize) -> u32 {
    let one = 1 << TABLE_FRACTION_BITS;
    if index >= (LIMIT << STEPS_PER_UNIT_BITS) as usize {
        return one;
    }
    let argument = index as f64 / (1_u32 << STEPS_PER_UNIT_BITS) as f64;
    (exact_tanh(argument) * one as f64 + 0.5) as u32
}

/// `(1 - e) / (1 + e)` with `e` = exp(-2x), the latter from the series of exp(-x / 512) squared ten times.
const fn exact_tanh(argument: f64) -> f64 {
    let small = -argument / 512.0;
    let mut power = 1.0;
    let mut term = 12;
    while term > 0 {
        power = 1.0 + power * small / term as f64;
        term -= 1;
    }
    let mut squarings = 0;
    while squarings < 10 {
        power *= power;
        squarings += 1;
    }
    (1.0 - power) / (1.0 + power)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn real(sum: i32) -> f64 {
        f64::from(tanh(sum)) / f64::from(1 << ACTIVATION_FRACTION_BITS)
    }

    #[test]
    fn every_argument_is_within_the_stated_error() {
        let unit = f64::from(1 << SUM_FRACTION_BITS);
        let largest = (0..9 << SUM_FRACTION_BITS)
            .map(|sum| (real(sum) - libm::tanh(f64::from(sum) / unit)).abs())
            .fold(0.0, f64::max);
        assert!(largest < 1.2e-4, "{largest}");
    }

    #[test]
    fn it_is_odd_monotone_and_saturates() {
        let mut previous = 0;
        for sum in 0..8 << SUM_FRACTION_BITS {
            let value = tanh(sum);
            assert!(value >= previous && tanh(-sum) == -value);
            previous = value;
        }
        assert_eq!((real(i32::MAX), real(i32::MIN)), (1.0, -1.0));
    }

    #[test]
    fn the_table_holds_rounded_tangents() {
        for (index, entry) in TABLE.iter().enumerate().take((LIMIT << STEPS_PER_UNIT_BITS) as usize) {
            let exact = |index: usize| libm::tanh(index as f64 / 64.0) * f64::from(1_u32 << TABLE_FRACTION_BITS);
            let (below, growth) = ((entry >> 16) - ROUNDING, entry & 0xffff);
            assert!((f64::from(below) - exact(index)).abs() <= 0.500_001);
            assert!((f64::from(below + growth) - exact(index + 1)).abs() <= 0.500_001);
        }
    }
}
