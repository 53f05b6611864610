//! One layer of a CNN on some samples: forward, and what its gradient adds up to.

use pulp::{Simd, WithSimd};

use super::super::aligned::Aligned;
use super::super::kernel::{Finish, LANES, MOST_ROWS, PatchProduct, Place, STRIPE, Start, dispatch};
use super::layer::{Layer, pieces};
use super::weights::LayerWeights;

/// Filters of the last layer whose gradient is added up at a time: with a stripe, it fits into the first-level cache.
const BAND: usize = 64;

/// Ones for sums over pixels.
const ONES: [f32; 128] = [1.0; 128];

impl Layer {
    /// `relu(W * x + b)` of each sample: from `inputs [samples][input]` into `outputs [samples][output]`.
    pub(super) fn convolve(&self, weights: &LayerWeights, inputs: &[f32], outputs: &mut [f32]) {
        let places = self.forward_places(inputs.len() / self.input.len());
        let terms = self.patch();
        for stripe in pieces(self.output.stored, STRIPE) {
            dispatch(PatchProduct {
                left: inputs,
                places: &places,
                terms: &terms,
                right: weights.forward_stripe(self, &stripe),
                width: stripe.len(),
                result: &mut outputs[stripe.start..],
                start: Start::Row(&weights.biases[stripe]),
                finish: Finish::Relu,
            });
        }
    }

    /// The loss gradient of what the layer below summed up, `below [samples][input]`, from `deltas [samples][output]`,
    /// that of this layer's sums, and what the layer below put out, `inputs`.
    pub(super) fn spread(&self, weights: &LayerWeights, deltas: &[f32], inputs: &[f32], below: &mut [f32]) {
        let samples = inputs.len() / self.input.len();
        let places = self.backward_places(samples);
        // Only patches of one sample overlap; few samples go pixel by pixel.
        let apart = if samples < MOST_ROWS { samples } else { places.len() };
        let terms: Vec<usize> = (0..self.output.stored).collect();
        below.fill(0.0);
        for (offset, right) in weights.backward_stripes(self) {
            for places in places.chunks(apart) {
                dispatch(PatchProduct {
                    left: deltas,
                    places,
                    terms: &terms,
                    right,
                    width: right.len() / terms.len(),
                    result: &mut below[offset..],
                    start: Start::Result,
                    finish: Finish::Sum,
                });
            }
        }
        dispatch(ReluDerivative { outputs: inputs, deltas: below });
    }

    /// `sums[k][f] += sum of x d` over the pixels of all samples, in that order: `sums [patch][output channels]`.
    pub(super) fn add_products(&self, inputs: &[f32], deltas: &[f32], sums: &mut [f32]) {
        let width = self.output.stored;
        let pixels: Vec<usize> =
            self.forward_places(inputs.len() / self.input.len()).iter().map(|place| place.left).collect();
        let places: Vec<Place> = self
            .patch()
            .iter()
            .enumerate()
            .map(|(row, left)| Place { left: *left, result: row * width })
            .collect();
        dispatch(PatchProduct {
            left: inputs,
            places: &places,
            terms: &pixels,
            right: deltas,
            width,
            result: sums,
            start: Start::Result,
            finish: Finish::Sum,
        });
    }

    /// `sums[f] += sum of d` over the pixels of all samples.
    pub(super) fn add_deltas(&self, deltas: &[f32], sums: &mut [f32]) {
        let width = self.output.stored;
        let terms: [usize; ONES.len()] = std::array::from_fn(|term| term);
        for right in deltas.chunks(ONES.len() * width) {
            dispatch(PatchProduct {
                left: &ONES,
                places: &[Place { left: 0, result: 0 }],
                terms: &terms[..right.len() / width],
                right,
                width,
                result: sums,
                start: Start::Result,
                finish: Finish::Sum,
            });
        }
    }

    /// As [`Self::add_products`] for the layer whose patch is all there is before it, straight into the gradient
    /// `[filters][weights]`, because such a layer has many weights, and few samples to add up; from `deltas
    /// [filters][samples]`, because then those of a filter lie side by side.
    pub(super) fn add_dense(&self, inputs: &[f32], deltas: &[f32], gradient: &mut [f32]) {
        let samples = inputs.len() / self.input.len();
        let inputs_of = self.weight_places();
        let terms: Vec<usize> = (0..samples).collect();
        let mut right = Aligned::zeros(samples * STRIPE);
        let mut band = Aligned::zeros(BAND * STRIPE);
        for stripe in pieces(self.inputs(), STRIPE) {
            let width = stripe.len().next_multiple_of(LANES);
            let right = &mut right[..samples * width];
            gather(inputs, self.input.len(), &inputs_of[stripe.clone()], right);
            for filters in pieces(self.output.channels, BAND) {
                let places: Vec<Place> = filters
                    .clone()
                    .enumerate()
                    .map(|(row, filter)| Place { left: filter * samples, result: row * width })
                    .collect();
                let result = &mut band[..places.len() * width];
                dispatch(PatchProduct {
                    left: deltas,
                    places: &places,
                    terms: &terms,
                    right,
                    width,
                    result,
                    start: Start::Zero,
                    finish: Finish::Sum,
                });
                let sums = &mut gradient[filters.start * self.inputs()..filters.end * self.inputs()];
                dispatch(AddColumns {
                    values: result,
                    width,
                    sums,
                    columns: stripe.clone(),
                    stride: self.inputs(),
                });
            }
        }
    }
}

/// Copies some values of each sample, `inputs [samples][len]`, into `[samples][width]`.
fn gather(inputs: &[f32], len: usize, places: &[usize], gathered: &mut [f32]) {
    let samples = inputs.len() / len;
    let width = gathered.len() / samples;
    let side_by_side = places.last().map_or(0, |last| last + 1) - places[0] == places.len();
    for (sample, row) in inputs.chunks_exact(len).zip(gathered.chunks_exact_mut(width)) {
        if side_by_side {
            row[..places.len()].copy_from_slice(&sample[places[0]..][..places.len()]);
        } else {
            for (value, place) in row.iter_mut().zip(places) {
                *value = sample[*place];
            }
        }
    }
}

/// `sums[r][columns] += values[r]`.
struct AddColumns<'a> {
    /// `[rows][width]`, of which as many count as there are columns.
    values: &'a [f32],
    width: usize,
    /// `[rows][stride]`.
    sums: &'a mut [f32],
    columns: std::ops::Range<usize>,
    stride: usize,
}

impl WithSimd for AddColumns<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (row, sums) in self.values.chunks_exact(self.width).zip(self.sums.chunks_exact_mut(self.stride)) {
            for (sum, value) in sums[self.columns.clone()].iter_mut().zip(row) {
                *sum += value;
            }
        }
    }
}

/// Deltas are zero where the layer put out zero.
pub(super) struct ReluDerivative<'a> {
    pub(super) outputs: &'a [f32],
    pub(super) deltas: &'a mut [f32],
}

impl WithSimd for ReluDerivative<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (delta, output) in self.deltas.iter_mut().zip(self.outputs) {
            *delta = if *output > 0.0 { *delta } else { 0.0 };
        }
    }
}
