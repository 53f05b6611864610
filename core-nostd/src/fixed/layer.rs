//! One layer in integers: parameters that are read where they lie, and the sums of products with them.

use super::{REQUANTISATION_SHIFT, SUM_FRACTION_BITS, input_limit};
use crate::mlp::{ROW_BLOCK, WIDTH_LIMIT};
use crate::policy_file::PolicyError;

/// Columns that are multiplied together.
pub(super) const COLUMN_GROUP: usize = 2;

/// One column pair of a row block: the weight of the first column is the low half of a word.
pub(super) type Group = [i32; ROW_BLOCK];

/// The pair of inputs that a group is multiplied with.
pub(super) type Pair = [i16; COLUMN_GROUP];

const _: () = assert!(cfg!(target_endian = "little"), "parameters are read in place, as policy files have them");

#[derive(Clone, Copy, Debug)]
pub(super) struct PackedLayer<'a> {
    pub(super) inputs: usize,
    pub(super) padded_outputs: usize,
    /// 2^(48−w−x).
    pub(super) multiplier: i32,
    pub(super) bias: &'a [[i32; ROW_BLOCK]],
    weights: &'a [Group],
}

impl<'a> PackedLayer<'a> {
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

    /// Refuses a layer of which a sum could leave 32 bits with the inputs that layer number `layer` can have.
    pub(super) fn check(&self, layer: usize) -> Result<(), PolicyError> {
        let blocks = self.weights.chunks_exact(self.inputs.div_ceil(COLUMN_GROUP).max(1));
        for (block, (biases, groups)) in self.bias.iter().zip(blocks).enumerate() {
            for (index, bias) in biases.iter().enumerate() {
                let magnitude: i64 = groups.iter().map(|group| magnitude_of_pair(group[index])).sum();
                let largest = magnitude * i64::from(input_limit(layer)) + i64::from(bias.unsigned_abs());
                if largest > i64::from(i32::MAX) {
                    return Err(PolicyError::Overflow { layer, row: block * ROW_BLOCK + index, largest });
                }
            }
        }
        Ok(())
    }
}

impl PackedLayer<'_> {
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
#[inline(never)]
fn dense(weights: &[Group], bias: &[[i32; ROW_BLOCK]], inputs: &[Pair], sums: &mut [i32]) {
    let blocks = weights.chunks_exact(inputs.len().max(1));
    for ((bias, groups), sums) in bias.iter().zip(blocks).zip(sums.as_chunks_mut::<ROW_BLOCK>().0) {
        *sums = with_products(bias, groups, inputs);
    }
}

/// `bias` with the products of a row block.
#[inline(always)]
fn with_products(bias: &[i32; ROW_BLOCK], groups: &[Group], inputs: &[Pair]) -> [i32; ROW_BLOCK] {
    #[cfg(all(feature = "smlad", target_arch = "arm"))]
    let (sums, groups, inputs) = super::smlad::with_products_of_rounds(bias, groups, inputs);
    #[cfg(not(all(feature = "smlad", target_arch = "arm")))]
    let sums = *bias;
    groups.iter().zip(inputs).fold(sums, |sums, (group, inputs)| with_pair(sums, group, *inputs))
}

/// Adds one column pair to the sums of a row block.
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
