//! One layer in integers: parameters that are read where they lie, and the sums of products with them.

use super::{REQUANTISATION_SHIFT, SUM_FRACTION_BITS};
use crate::limits::{ROW_BLOCK, WIDTH_LIMIT};
use crate::policy_error::PolicyError;

#[cfg(all(feature = "assembly", target_arch = "arm"))]
use super::smlad::dense;
#[cfg(all(feature = "smlad", not(feature = "assembly"), target_arch = "arm"))]
use super::smlad::with_pair as with_pair_of_round;
#[cfg(not(all(feature = "smlad", target_arch = "arm")))]
use with_pair as with_pair_of_round;

/// Columns that are multiplied together.
pub(super) const COLUMN_GROUP: usize = 2;

/// One column pair of a row block: the weight of the first column is the low half of a word.
pub(super) type Group = [i32; ROW_BLOCK];

/// Column pairs in a round of the loop, which spares its own instructions; with more the portable loop has too few
/// registers. Widths are multiples of sixteen as a rule.
pub(super) const ROUND: usize = if cfg!(feature = "smlad") { 8 } else { 2 };

/// The pair of inputs that a group is multiplied with.
pub(super) type Pair = [i16; COLUMN_GROUP];

const _: () = assert!(cfg!(target_endian = "little"), "parameters are read in place, as policy files have them");

#[derive(Clone, Copy, Debug)]
pub(super) struct FixedLayer<'a> {
    pub(super) inputs: usize,
    pub(super) padded_outputs: usize,
    /// 2^(48−w−x).
    pub(super) multiplier: i32,
    pub(super) bias: &'a [[i32; ROW_BLOCK]],
    weights: &'a [Group],
}

impl<'a> FixedLayer<'a> {
    pub(super) fn new(
        parameters: &'a [u8],
        inputs: usize,
        outputs: usize,
        sum_fraction_bits: u32,
    ) -> Result<Self, PolicyError> {
        let padded_outputs = outputs.next_multiple_of(ROW_BLOCK);
        let found = parameters.as_ptr().addr() % size_of::<i32>();
        let words: &[[i32; ROW_BLOCK]] =
            bytemuck::try_cast_slice(parameters).map_err(|_| PolicyError::Misaligned { found })?;
        let (bias, weights) = words.split_at_checked(padded_outputs / ROW_BLOCK).unwrap_or_default();
        let multiplier = 1 << (REQUANTISATION_SHIFT + SUM_FRACTION_BITS - sum_fraction_bits);
        Ok(Self { inputs, padded_outputs, multiplier, bias, weights })
    }

    pub(super) fn weight_code(&self, row: usize, column: usize) -> i16 {
        if column >= self.inputs {
            return 0;
        }
        let groups = self.inputs.div_ceil(COLUMN_GROUP);
        let group = self.weights.get(row / ROW_BLOCK * groups + column / COLUMN_GROUP);
        let word = group.map_or(0, |group| group[row % ROW_BLOCK]);
        if column.is_multiple_of(COLUMN_GROUP) { word as i16 } else { (word >> i16::BITS) as i16 }
    }

    /// Refuses layer number `layer` where a sum could leave 32 bits with inputs up to `input_limit`.
    pub(super) fn check(&self, layer: usize, input_limit: i16) -> Result<(), PolicyError> {
        let blocks = self.weights.chunks_exact(self.inputs.div_ceil(COLUMN_GROUP).max(1));
        for (block, (biases, groups)) in self.bias.iter().zip(blocks).enumerate() {
            for (index, bias) in biases.iter().enumerate() {
                let magnitude: i64 = groups.iter().map(|group| magnitude_of_pair(group[index])).sum();
                let largest = magnitude * i64::from(input_limit) + i64::from(bias.unsigned_abs());
                if largest > i64::from(i32::MAX) {
                    return Err(PolicyError::Overflow { layer, row: block * ROW_BLOCK + index, largest });
                }
            }
        }
        Ok(())
    }
}

impl FixedLayer<'_> {
    pub(super) fn apply(&self, activations: &[i16], sums: &mut [i32; WIDTH_LIMIT]) {
        let groups = self.inputs.div_ceil(COLUMN_GROUP);
        let inputs = activations.as_chunks::<COLUMN_GROUP>().0.get(..groups).unwrap_or_default();
        let sums = sums.get_mut(..self.padded_outputs).unwrap_or_default();
        dense(self.weights, self.bias, inputs, sums);
    }
}

/// `sums = bias + weights · inputs`.
///
/// Wraps where a sum leaves 32 bits, which the formats of a parsed policy exclude.
#[cfg(not(all(feature = "assembly", target_arch = "arm")))]
#[inline(never)]
fn dense(mut weights: &[Group], bias: &[[i32; ROW_BLOCK]], inputs: &[Pair], sums: &mut [i32]) {
    let (rounds, rest) = inputs.as_chunks::<ROUND>();
    for (bias, total) in bias.iter().zip(sums.as_chunks_mut::<ROW_BLOCK>().0) {
        let Some((mut sums, others)) = with_rounds(*bias, weights, rounds) else { return };
        weights = others;
        // Always in portable form: with SMLAD here as well the rounds would have fewer registers.
        for inputs in rest {
            let Some((group, others)) = weights.split_first() else { return };
            weights = others;
            sums = with_pair(sums, group, *inputs);
        }
        *total = sums;
    }
}

/// Adds the products of whole rounds to the sums of a row block; and the weights behind theirs.
#[cfg(not(all(feature = "assembly", target_arch = "arm")))]
#[inline(always)]
fn with_rounds<'w>(
    mut sums: [i32; ROW_BLOCK],
    mut weights: &'w [Group],
    rounds: &[[Pair; ROUND]],
) -> Option<([i32; ROW_BLOCK], &'w [Group])> {
    for inputs in rounds {
        let (groups, others) = weights.split_first_chunk::<ROUND>()?;
        weights = others;
        sums =
            groups.iter().zip(inputs).fold(sums, |sums, (group, inputs)| with_pair_of_round(sums, group, *inputs));
    }
    Some((sums, weights))
}

/// Adds one column pair to the sums of a row block.
#[cfg(not(all(feature = "assembly", target_arch = "arm")))]
#[inline(always)]
fn with_pair(sums: [i32; ROW_BLOCK], group: &Group, inputs: Pair) -> [i32; ROW_BLOCK] {
    // One load, and a multiplication that takes either half of a register.
    let inputs: i32 = bytemuck::cast(inputs);
    core::array::from_fn(|row| {
        let low = i32::from(group[row] as i16).wrapping_mul(i32::from(inputs as i16));
        let high = (group[row] >> i16::BITS).wrapping_mul(inputs >> i16::BITS);
        sums[row].wrapping_add(low).wrapping_add(high)
    })
}

/// Bytes of the parameters of a layer in a policy file.
pub(crate) const fn layer_bytes(inputs: usize, outputs: usize) -> usize {
    let padded_outputs = outputs.next_multiple_of(ROW_BLOCK);
    padded_outputs * (size_of::<i32>() + size_of::<i16>() * inputs.next_multiple_of(COLUMN_GROUP))
}

fn magnitude_of_pair(pair: i32) -> i64 {
    let (first, second) = (pair as i16, (pair >> i16::BITS) as i16);
    i64::from(first.unsigned_abs()) + i64::from(second.unsigned_abs())
}
