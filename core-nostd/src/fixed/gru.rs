//! The memory of a recurrent policy in integers; what [`crate::gru`] computes in float.
//!
//! The hidden state is in 2⁻¹⁵, gates in 2⁻¹⁴. Matrices read it in the format of the observation beside it, rounded: their
//! sums are those of a first layer.

use super::layer::FixedLayer;
use super::{ACTIVATION_FRACTION_BITS, FixedFormat, requantised, split_layer, tanh};
use crate::gru::MemoryShape;
use crate::limits::{LAYER_LIMIT, WIDTH_LIMIT};
use crate::policy_error::PolicyError;

/// Fraction bits of the hidden state, which is in \[-1, 1\].
pub const HIDDEN_FRACTION_BITS: u32 = 15;

/// Fraction bits of gates: the two of `tanh` and the half by which it is scaled.
const GATE_FRACTION_BITS: u32 = ACTIVATION_FRACTION_BITS + 1;

const HALF_GATE: i32 = 1 << (GATE_FRACTION_BITS - 1);

/// Memory whose parameters lie in borrowed bytes.
#[derive(Clone, Copy, Debug)]
pub struct FixedGru<'a> {
    gates: FixedLayer<'a>,
    candidate: FixedLayer<'a>,
    shape: MemoryShape,
    /// Bits that the hidden state loses beside the observation.
    shift: u32,
}

impl<'a> FixedGru<'a> {
    /// A view of `parameters`, of both layers one after the other; the sizes were checked. The observation is in the format
    /// of `network`.
    pub(crate) fn from_parameters(
        shape: MemoryShape,
        network: FixedFormat,
        weight_fraction_bits: [u8; 2],
        parameters: &'a [u8],
    ) -> Result<Self, PolicyError> {
        let (inputs, units) = (shape.inputs(), shape.units);
        let bits = |weights: u8| gru_format(network, weights).sum_fraction_bits(0);
        let [gate_bits, candidate_bits] = weight_fraction_bits;
        let (gates, rest) = split_layer(parameters, inputs, 2 * units)?;
        let (candidate, _) = split_layer(rest, inputs, units)?;
        let gates = FixedLayer::new(gates, inputs, 2 * units, bits(gate_bits)?)?;
        let candidate = FixedLayer::new(candidate, inputs, units, bits(candidate_bits)?)?;
        gates.check(0, network.input_limit(0))?;
        candidate.check(0, network.input_limit(0))?;
        let shift = HIDDEN_FRACTION_BITS - u32::from(network.input_fraction_bits);
        Ok(Self { gates, candidate, shape, shift })
    }

    /// Values of an observation.
    pub(crate) fn observation_len(&self) -> usize {
        self.shape.observation_len
    }

    /// Takes the observation at the start of `activations` into the `hidden` state, and writes that behind it.
    pub(crate) fn advance(&self, activations: &mut [i16], sums: &mut [i32; WIDTH_LIMIT], hidden: &mut [i16]) {
        let hidden = hidden.get_mut(..self.shape.units).unwrap_or_default();
        self.show(hidden, activations);
        self.gates.apply(activations, sums);
        let back = activations.get_mut(self.shape.observation_len..).unwrap_or_default();
        for ((input, hidden), sum) in back.iter_mut().zip(&*hidden).zip(&*sums) {
            let gate = sigmoid(requantised(*sum, self.gates.multiplier));
            *input = self.rounded((gate * i32::from(*hidden) + HALF_GATE) >> GATE_FRACTION_BITS);
        }
        // The candidate's sums take the place of those of r.
        self.candidate.apply(activations, sums);
        let (candidates, updates) = sums.split_at_mut_checked(self.shape.units).unwrap_or_default();
        for ((hidden, candidate), update) in hidden.iter_mut().zip(candidates).zip(updates) {
            let kept = sigmoid(requantised(*update, self.gates.multiplier));
            let candidate = i32::from(tanh::tanh(requantised(*candidate, self.candidate.multiplier)))
                << (HIDDEN_FRACTION_BITS - ACTIVATION_FRACTION_BITS);
            // A gate of 2^14 times a difference of 2^16 just fits.
            let step = i64::from(kept) * i64::from(i32::from(*hidden) - candidate);
            let next = candidate + ((step + i64::from(HALF_GATE)) >> GATE_FRACTION_BITS) as i32;
            *hidden = next.clamp(-i32::from(i16::MAX), i32::from(i16::MAX)) as i16;
        }
        self.show(hidden, activations);
    }

    fn show(&self, hidden: &[i16], activations: &mut [i16]) {
        let back = activations.get_mut(self.shape.observation_len..).unwrap_or_default();
        for (slot, value) in back.iter_mut().zip(hidden) {
            *slot = self.rounded(i32::from(*value));
        }
    }

    /// A value in 2⁻¹⁵ in the format of the observation, halves up.
    #[inline(always)]
    fn rounded(&self, value: i32) -> i16 {
        ((value + (1 << self.shift >> 1)) >> self.shift) as i16
    }

    /// The stored weight in `row` and `column` of the gates (0) or the candidate (1).
    pub(crate) fn weight_code(&self, layer: usize, row: usize, column: usize) -> i16 {
        self.layer(layer).weight_code(row, column)
    }

    /// The stored bias in `row`, as [`Self::weight_code`]; zero beyond the rows.
    pub(crate) fn bias_code(&self, layer: usize, row: usize) -> i32 {
        self.layer(layer).bias.as_flattened().get(row).copied().unwrap_or_default()
    }

    fn layer(&self, index: usize) -> &FixedLayer<'a> {
        if index == 0 { &self.gates } else { &self.candidate }
    }
}

/// The logistic function of a sum in 2⁻¹⁶, in 2⁻¹⁴.
#[inline(always)]
fn sigmoid(sum: i32) -> i32 {
    i32::from(tanh::tanh(sum >> 1)) + HALF_GATE
}

/// As a network of one layer has it, which reads what `network` reads.
pub(crate) fn gru_format(network: FixedFormat, weights: u8) -> FixedFormat {
    let mut weight_fraction_bits = [0; LAYER_LIMIT];
    weight_fraction_bits[0] = weights;
    FixedFormat { weight_fraction_bits, ..network }
}
