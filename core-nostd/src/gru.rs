//! The memory of a recurrent policy: a gated recurrent unit (GRU, Cho et al. 2014, arXiv 1406.1078, eq. 5 to 8), in `f32`.
//!
//! Before it acts, the policy takes the observation x into its hidden state h, of H units in \[-1, 1\]:
//!
//! ```text
//! r  = σ(W_r [x, h] + b_r)          what is looked at of the old state
//! z  = σ(W_z [x, h] + b_z)          what is kept of it
//! n  = tanh(W_n [x, r ∘ h] + b_n)
//! h' = z ∘ h + (1 − z) ∘ n
//! ```
//!
//! and the layers of the network read x and h'. That is `GRU` of ONNX with its default `linear_before_reset = 0`;
//! `PyTorch`'s and Keras's multiply by r behind the matrix instead. The policy file has two layers for it, as
//! [`crate::mlp`] lays them out: the gates, rows of r before those of z, and the candidate n.

use crate::activation::{sigmoid, tanh};
use crate::limits::{ROW_BLOCK, WIDTH_LIMIT};
use crate::mlp::FloatLayer;
use crate::policy_error::PolicyError;

pub use crate::limits::UNITS_LIMIT;

/// Memory whose parameters lie in borrowed bytes.
#[derive(Clone, Copy, Debug)]
pub struct Gru<'a> {
    gates: FloatLayer<'a>,
    candidate: FloatLayer<'a>,
    shape: MemoryShape,
}

/// What a recurrent policy remembers, in either arithmetic (384 bytes): zero at the start of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct HiddenState {
    pub(crate) float: [f32; UNITS_LIMIT],
    /// In 2⁻¹⁵.
    pub(crate) fixed: [i16; UNITS_LIMIT],
}

/// Sizes of a memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MemoryShape {
    /// Values of an observation.
    pub(crate) observation_len: usize,
    /// Values of the hidden state.
    pub(crate) units: usize,
}

impl MemoryShape {
    /// Values that gates and candidate read.
    pub(crate) fn inputs(self) -> usize {
        self.observation_len + self.units
    }

    /// Refuses sizes that no policy can have.
    pub(crate) fn check(self) -> Result<(), PolicyError> {
        let Self { observation_len, units } = self;
        let fits = units.is_multiple_of(ROW_BLOCK)
            && (ROW_BLOCK..=UNITS_LIMIT).contains(&units)
            && self.inputs() <= WIDTH_LIMIT;
        fits.then_some(()).ok_or(PolicyError::Units { found: units, observation: observation_len })
    }
}

impl<'a> Gru<'a> {
    /// A view of `parameters`, of both layers one after the other; the sizes were checked.
    pub(crate) fn from_parameters(shape: MemoryShape, parameters: &'a [u8]) -> Result<Self, PolicyError> {
        let (gates, rest) = FloatLayer::split(parameters, shape.inputs(), 2 * shape.units)?;
        let (candidate, _) = FloatLayer::split(rest, shape.inputs(), shape.units)?;
        gates.check(0)?;
        candidate.check(1)?;
        Ok(Self { gates, candidate, shape })
    }

    /// Values of an observation.
    pub(crate) fn observation_len(&self) -> usize {
        self.shape.observation_len
    }

    /// Takes the observation at the start of `inputs` into the `hidden` state, and writes that behind it.
    pub(crate) fn advance(&self, inputs: &mut [f32], sums: &mut [f32], hidden: &mut [f32]) {
        let MemoryShape { observation_len, units } = self.shape;
        let hidden = hidden.get_mut(..units).unwrap_or_default();
        copy(hidden, inputs.get_mut(observation_len..).unwrap_or_default());
        self.gates.apply(inputs, sums);
        let back = inputs.get_mut(observation_len..).unwrap_or_default();
        for ((input, hidden), sum) in back.iter_mut().zip(&*hidden).zip(&*sums) {
            *input = sigmoid(*sum) * hidden;
        }
        // The candidate's sums take the place of those of r.
        self.candidate.apply(inputs, sums);
        let (candidates, updates) = sums.split_at_mut_checked(units).unwrap_or_default();
        for ((hidden, candidate), update) in hidden.iter_mut().zip(candidates).zip(updates) {
            let (kept, candidate) = (sigmoid(*update), tanh(*candidate));
            *hidden = candidate + kept * (*hidden - candidate);
        }
        copy(hidden, inputs.get_mut(observation_len..).unwrap_or_default());
    }

    /// Weight and bias readers for exporters: of the gates, then of the candidate.
    pub(crate) fn layer(&self, index: usize) -> &FloatLayer<'a> {
        if index == 0 { &self.gates } else { &self.candidate }
    }
}

fn copy(source: &[f32], destination: &mut [f32]) {
    for (slot, value) in destination.iter_mut().zip(source) {
        *slot = *value;
    }
}

impl HiddenState {
    /// As at the start of an episode. Usable as the initial value of a static.
    pub const fn new() -> Self {
        Self { float: [0.0; UNITS_LIMIT], fixed: [0; UNITS_LIMIT] }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.float.fill(0.0);
        self.fixed.fill(0);
    }
}

impl Default for HiddenState {
    fn default() -> Self {
        Self::new()
    }
}
