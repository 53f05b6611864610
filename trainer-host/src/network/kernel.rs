//! The loops between the matrix products, compiled for every instruction set and chosen at run time.
//!
//! Each kernel is plain Rust over rows of `columns` consecutive values: elementwise loops and dot products whose
//! partial sums have a fixed shape, so the bits do not depend on the instruction set.

use kestrel_core::activation::tanh;
use pulp::{Arch, Simd, WithSimd};

/// Partial sums of a dot product: two AVX registers hide the latency of the additions.
const PARTIALS: usize = 16;

/// Columns that the narrow product keeps in registers.
const BLOCK: usize = 32;

/// Runs `kernel` with the widest instruction set of this machine.
pub(crate) fn dispatch<K: WithSimd>(kernel: K) -> K::Output {
    Arch::new().dispatch(kernel)
}

/// Sum of products, in an order that is fixed by this source.
///
/// Columns come in multiples of eight; a shorter remainder is summed last.
#[inline(always)]
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut partials = [0.0_f32; PARTIALS];
    let (a_blocks, b_blocks) = (a.chunks_exact(PARTIALS), b.chunks_exact(PARTIALS));
    let rest: f32 = a_blocks.remainder().iter().zip(b_blocks.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a_blocks.zip(b_blocks) {
        for lane in 0..PARTIALS {
            partials[lane] += a[lane] * b[lane];
        }
    }
    tree_sum(partials) + rest
}

/// Sum of a row, in the order of [`dot`].
#[inline(always)]
pub(crate) fn sum(row: &[f32]) -> f32 {
    let mut partials = [0.0_f32; PARTIALS];
    let blocks = row.chunks_exact(PARTIALS);
    let rest: f32 = blocks.remainder().iter().sum();
    for block in blocks {
        for lane in 0..PARTIALS {
            partials[lane] += block[lane];
        }
    }
    tree_sum(partials) + rest
}

#[inline(always)]
fn tree_sum(mut partials: [f32; PARTIALS]) -> f32 {
    let mut width = PARTIALS / 2;
    while width > 0 {
        for lane in 0..width {
            partials[lane] += partials[lane + width];
        }
        width /= 2;
    }
    partials[0]
}

/// `rows[r][c] = tanh(rows[r][c] + biases[r])`.
pub(crate) struct AddBiasTanh<'a> {
    pub(crate) rows: &'a mut [f32],
    pub(crate) biases: &'a [f32],
    pub(crate) columns: usize,
}

impl WithSimd for AddBiasTanh<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (row, bias) in self.rows.chunks_exact_mut(self.columns).zip(self.biases) {
            for value in row {
                *value = tanh(*value + bias);
            }
        }
    }
}

/// `rows[r][c] += biases[r]`.
pub(crate) struct AddBias<'a> {
    pub(crate) rows: &'a mut [f32],
    pub(crate) biases: &'a [f32],
    pub(crate) columns: usize,
}

impl WithSimd for AddBias<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (row, bias) in self.rows.chunks_exact_mut(self.columns).zip(self.biases) {
            for value in row {
                *value += bias;
            }
        }
    }
}

/// The derivative of tanh, from its value: `deltas[i] *= 1 - activations[i]^2`.
pub(crate) struct TanhBackward<'a> {
    pub(crate) deltas: &'a mut [f32],
    pub(crate) activations: &'a [f32],
}

impl WithSimd for TanhBackward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (delta, activation) in self.deltas.iter_mut().zip(self.activations) {
            *delta *= 1.0 - activation * activation;
        }
    }
}

/// `sums[r] += sum over c of rows[r][c]`.
pub(crate) struct AddRowSums<'a> {
    pub(crate) rows: &'a [f32],
    pub(crate) columns: usize,
    pub(crate) sums: &'a mut [f32],
}

impl WithSimd for AddRowSums<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (row, total) in self.rows.chunks_exact(self.columns).zip(self.sums) {
            *total += sum(row);
        }
    }
}

/// `outputs[r][c] = sum over k of weights[r][k] inputs[k][c]` for the few rows of a head.
///
/// A general matrix product falls to a quarter of its speed when one side is 4 or 1.
pub(crate) struct NarrowProduct<'a> {
    pub(crate) weights: &'a [f32],
    pub(crate) inputs: &'a [f32],
    pub(crate) columns: usize,
    pub(crate) outputs: &'a mut [f32],
}

impl WithSimd for NarrowProduct<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { weights, inputs, columns, outputs } = self;
        let width = inputs.len() / columns;
        for (weights, output) in weights.chunks_exact(width).zip(outputs.chunks_exact_mut(columns)) {
            let mut blocks = output.chunks_exact_mut(BLOCK);
            let mut first = 0;
            for block in &mut blocks {
                weighted_sum::<BLOCK>(weights, &inputs[first..], columns, block);
                first += BLOCK;
            }
            for (offset, value) in blocks.into_remainder().iter_mut().enumerate() {
                weighted_sum::<1>(weights, &inputs[first + offset..], columns, std::slice::from_mut(value));
            }
        }
    }
}

/// `N` columns of one output row, held in registers over all inputs.
#[inline(always)]
fn weighted_sum<const N: usize>(weights: &[f32], inputs: &[f32], columns: usize, output: &mut [f32]) {
    let mut totals = [0.0_f32; N];
    for (weight, row) in weights.iter().zip(inputs.chunks(columns)) {
        let row = &row[..N];
        for lane in 0..N {
            totals[lane] += weight * row[lane];
        }
    }
    output.copy_from_slice(&totals);
}

/// `inputs[k][c] = sum over r of weights[r][k] deltas[r][c]`: the narrow product backwards.
pub(crate) struct NarrowTransposedProduct<'a> {
    pub(crate) weights: &'a [f32],
    pub(crate) deltas: &'a [f32],
    pub(crate) columns: usize,
    pub(crate) inputs: &'a mut [f32],
}

impl WithSimd for NarrowTransposedProduct<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { weights, deltas, columns, inputs } = self;
        let width = inputs.len() / columns;
        for (input, row) in inputs.chunks_exact_mut(columns).enumerate() {
            row.fill(0.0);
            for (weights, delta) in weights.chunks_exact(width).zip(deltas.chunks_exact(columns)) {
                let weight = weights[input];
                for (value, delta) in row.iter_mut().zip(delta) {
                    *value += weight * delta;
                }
            }
        }
    }
}

/// `gradient[r][k] += sum over c of deltas[r][c] inputs[k][c]`: the weights' gradient of a narrow layer.
pub(crate) struct NarrowOuterProduct<'a> {
    pub(crate) deltas: &'a [f32],
    pub(crate) inputs: &'a [f32],
    pub(crate) columns: usize,
    pub(crate) gradient: &'a mut [f32],
}

impl WithSimd for NarrowOuterProduct<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { deltas, inputs, columns, gradient } = self;
        let width = inputs.len() / columns;
        for (delta, gradient) in deltas.chunks_exact(columns).zip(gradient.chunks_exact_mut(width)) {
            for (input, weight) in inputs.chunks_exact(columns).zip(gradient) {
                *weight += dot(delta, input);
            }
        }
    }
}
