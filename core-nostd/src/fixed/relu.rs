//! Rectifiers in integers.

use super::layer::FixedLayer;
use super::{RECTIFIED_FRACTION_BITS, SUM_FRACTION_BITS, requantised};
use crate::limits::{ROW_BLOCK, WIDTH_LIMIT};

const RESULT_SHIFT: u32 = SUM_FRACTION_BITS - RECTIFIED_FRACTION_BITS;

/// Greatest sum that is not cut off: its result is the greatest that 16 bits hold.
const SUM_LIMIT: i32 = (i16::MAX as i32) << RESULT_SHIFT;

/// Half of a result, in the fraction bits of sums.
const ROUNDING: i32 = 1 << (RESULT_SHIFT - 1);

/// Takes `activations` through hidden layers with rectifiers behind them.
#[inline(never)]
pub(super) fn hide(layers: &[FixedLayer<'_>], activations: &mut [i16], sums: &mut [i32; WIDTH_LIMIT]) {
    for layer in layers {
        layer.apply(activations, sums);
        let sums = sums.get(..layer.padded_outputs).unwrap_or_default();
        let blocks = activations.as_chunks_mut::<ROW_BLOCK>().0.iter_mut().zip(sums.as_chunks::<ROW_BLOCK>().0);
        for (activations, sums) in blocks {
            *activations = sums.map(|sum| relu(requantised(sum, layer.multiplier)));
        }
    }
}

/// `sum` \[2⁻¹⁶\] where it is positive, in 2⁻¹¹, halves upwards; what lies beyond 16 bits is cut off.
#[inline(always)]
fn relu(sum: i32) -> i16 {
    ((sum.clamp(0, SUM_LIMIT) + ROUNDING) >> RESULT_SHIFT) as i16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rectified_sum_is_rounded_and_cut_off() {
        let half = 1 << (RESULT_SHIFT - 1);
        for (sum, expected) in [
            (i32::MIN, 0),
            (-1, 0),
            (0, 0),
            (half - 1, 0),
            (half, 1),
            (1 << SUM_FRACTION_BITS, 2048),
            (i32::MAX, i16::MAX),
        ] {
            assert_eq!(relu(sum), expected, "{sum}");
        }
    }
}
