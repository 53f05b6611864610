//! From trained weights to the integers of a policy file: choosing formats, rounding, laying out.

use super::{
    COLUMN_GROUP, FixedFormat, INPUT_FRACTION_BITS_LIMIT, OBSERVATION_CODE_LIMIT, WEIGHT_FRACTION_BITS_LIMIT,
};
use crate::limits::{LAYER_LIMIT, ROW_BLOCK};
use crate::mlp::{DenseLayer, hidden_activation};
use crate::policy_error::PolicyError;

impl FixedFormat {
    /// The finest formats in which observations up to `largest_observation` do not saturate, no weight saturates
    /// and no sum can leave 32 bits.
    ///
    /// # Errors
    /// [`PolicyError::LayerCount`], and [`PolicyError::WeightsTooLarge`] where no format is coarse enough for a layer
    /// or where it holds a number that is not finite.
    pub fn finest(layers: &[DenseLayer<'_>], largest_observation: f32) -> Result<Self, PolicyError> {
        let input_fraction_bits = finest_input_bits(largest_observation);
        let activation = hidden_activation(layers);
        let mut format = Self { input_fraction_bits, weight_fraction_bits: [0; LAYER_LIMIT], activation };
        if layers.len() > LAYER_LIMIT {
            return Err(PolicyError::LayerCount { found: layers.len() });
        }
        for (index, layer) in layers.iter().enumerate() {
            format = (0..=WEIGHT_FRACTION_BITS_LIMIT)
                .rev()
                .map(|bits| format.with_weight_bits(index, bits))
                .find(|format| format.sum_fraction_bits(index).is_ok() && layer.fits(*format, index))
                .ok_or(PolicyError::WeightsTooLarge { layer: index })?;
        }
        Ok(format)
    }

    #[cfg(feature = "recurrent")]
    /// The finest format of the weights of a `layer` that reads what the network reads.
    pub(crate) fn finest_weight_bits(self, layer: &DenseLayer<'_>) -> Option<u8> {
        let fits = |bits: &u8| {
            let format = self.with_weight_bits(0, *bits);
            format.sum_fraction_bits(0).is_ok() && layer.fits(format, 0)
        };
        (0..=WEIGHT_FRACTION_BITS_LIMIT).rev().find(fits)
    }

    fn with_weight_bits(mut self, layer: usize, bits: u8) -> Self {
        if let Some(slot) = self.weight_fraction_bits.get_mut(layer) {
            *slot = bits;
        }
        self
    }
}

fn finest_input_bits(largest_observation: f32) -> u8 {
    let fits = |bits: &u8| largest_observation * (1_u32 << bits) as f32 <= f32::from(OBSERVATION_CODE_LIMIT);
    (0..=INPUT_FRACTION_BITS_LIMIT).rev().find(fits).unwrap_or(0)
}

impl DenseLayer<'_> {
    /// Whether the layer, as number `index`, keeps its weights and sums in range in these formats.
    pub(crate) fn fits(&self, format: FixedFormat, index: usize) -> bool {
        let weight_bits = format.weight_fraction_bits.get(index).copied().unwrap_or_default();
        let (input_bits, limit) = (format.fraction_bits_into(index), format.input_limit(index));
        (0..self.outputs).all(|row| self.fixed_row_fits(row, weight_bits, input_bits, limit))
    }

    /// The biases in the order of the policy file, padding included, in 2^-`fraction_bits`.
    pub(crate) fn fixed_biases(&self, fraction_bits: u32) -> impl Iterator<Item = i32> + '_ {
        (0..self.outputs.next_multiple_of(ROW_BLOCK))
            .map(move |row| rounded(self.bias_of(row), fraction_bits) as i32)
    }

    /// The weights in the order of the policy file, padding included, in 2^-`fraction_bits`.
    pub(crate) fn fixed_weights(&self, fraction_bits: u8) -> impl Iterator<Item = i16> + '_ {
        let groups = self.inputs.div_ceil(COLUMN_GROUP);
        (0..self.outputs.next_multiple_of(ROW_BLOCK)).step_by(ROW_BLOCK).flat_map(move |first| {
            (0..groups * ROW_BLOCK * COLUMN_GROUP).map(move |place| {
                let group = place / (ROW_BLOCK * COLUMN_GROUP);
                let row = first + place / COLUMN_GROUP % ROW_BLOCK;
                let column = group * COLUMN_GROUP + place % COLUMN_GROUP;
                rounded(self.weight(row, column), u32::from(fraction_bits)) as i16
            })
        })
    }

    fn fixed_row_fits(&self, row: usize, bits: u8, input_fraction_bits: u32, input_limit: i16) -> bool {
        let magnitude = |column| rounded(self.weight(row, column), u32::from(bits)).abs();
        let bias = rounded(self.bias_of(row), u32::from(bits) + input_fraction_bits).abs();
        let sum: f64 = (0..self.inputs).map(magnitude).sum();
        // The comparisons are false for NaN.
        (0..self.inputs).all(|column| magnitude(column) <= f64::from(i16::MAX))
            && sum * f64::from(input_limit) + bias <= f64::from(i32::MAX)
    }
}

/// `value` in 2^-`fraction_bits`, halves away from zero.
fn rounded(value: f32, fraction_bits: u32) -> f64 {
    libm::round(f64::from(value) * (1_u64 << fraction_bits) as f64)
}
