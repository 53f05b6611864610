//! The loops between the matrix products, compiled for every instruction set and chosen at run time.
//!
//! Each kernel is plain Rust over rows of `columns` consecutive values: elementwise loops and dot products whose
//! partial sums have a fixed shape, so the bits do not depend on the instruction set.

use kestrel_core::activation::tanh;
use pulp::{Arch, Simd, WithSimd};

/// Partial sums of a dot product: four AVX registers hide the latency of the additions.
const PARTIALS: usize = 32;

/// Rows and columns of the block that the narrow product keeps in eight AVX registers.
const BLOCK_ROWS: usize = 4;
const BLOCK_COLUMNS: usize = 16;

/// Runs `kernel` with the widest instruction set of this machine.
pub(crate) fn dispatch<K: WithSimd>(kernel: K) -> K::Output {
    Arch::new().dispatch(kernel)
}

/// Sum of products, in an order that is fixed by this source.
///
/// Columns come in multiples of eight; a shorter remainder is summed last.
#[inline(always)]
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let ((a_blocks, a_rest), (b_blocks, b_rest)) = (a.as_chunks::<PARTIALS>(), b.as_chunks::<PARTIALS>());
    let mut partials = [0.0_f32; PARTIALS];
    for (a, b) in a_blocks.iter().zip(b_blocks) {
        for lane in 0..PARTIALS {
            partials[lane] += a[lane] * b[lane];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    tree_sum(partials) + rest
}

/// Sum of a row, in the order of [`dot`].
#[inline(always)]
fn sum(row: &[f32]) -> f32 {
    let (blocks, rest) = row.as_chunks::<PARTIALS>();
    let mut partials = [0.0_f32; PARTIALS];
    for block in blocks {
        for lane in 0..PARTIALS {
            partials[lane] += block[lane];
        }
    }
    tree_sum(partials) + rest.iter().sum::<f32>()
}

/// Out of line, because the optimiser otherwise shapes the loops above after this tree: two lanes wide.
#[inline(never)]
fn tree_sum(partials: [f32; PARTIALS]) -> f32 {
    let halved: [f32; PARTIALS / 2] = std::array::from_fn(|lane| partials[lane] + partials[lane + PARTIALS / 2]);
    let quartered: [f32; PARTIALS / 4] = std::array::from_fn(|lane| halved[lane] + halved[lane + PARTIALS / 4]);
    let [a, b, c, d]: [f32; PARTIALS / 8] =
        std::array::from_fn(|lane| quartered[lane] + quartered[lane + PARTIALS / 8]);
    (a + c) + (b + d)
}

/// Sum of squares, in the order of [`dot`].
pub(crate) fn square(row: &[f32]) -> f32 {
    dispatch(Square { row })
}

struct Square<'a> {
    row: &'a [f32],
}

impl WithSimd for Square<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f32 {
        dot(self.row, self.row)
    }
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

/// The derivative of tanh, from its value: `deltas[r][c] *= 1 - activations[r][c]^2`.
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

/// `outputs[r][c] = sum over k of W[r][k] inputs[k][c]`, for matrices with one short side.
///
/// A general matrix product falls to a quarter of its speed when one side is 4 or 1.
pub(crate) struct NarrowProduct<'a> {
    /// `W[r][k]` at `r * row_stride + k * term_stride`.
    pub(crate) weights: &'a [f32],
    pub(crate) row_stride: usize,
    pub(crate) term_stride: usize,
    pub(crate) inputs: &'a [f32],
    pub(crate) columns: usize,
    pub(crate) outputs: &'a mut [f32],
}

impl WithSimd for NarrowProduct<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) {
        let rows = self.outputs.len() / self.columns;
        let blocked = rows - rows % BLOCK_ROWS;
        for row in (0..blocked).step_by(BLOCK_ROWS) {
            self.rows::<BLOCK_ROWS>(row);
        }
        for row in blocked..rows {
            self.rows::<1>(row);
        }
    }
}

impl NarrowProduct<'_> {
    #[inline(always)]
    fn rows<const ROWS: usize>(&mut self, row: usize) {
        let blocked = self.columns - self.columns % BLOCK_COLUMNS;
        for column in (0..blocked).step_by(BLOCK_COLUMNS) {
            self.block::<ROWS, BLOCK_COLUMNS>(row, column);
        }
        for column in blocked..self.columns {
            self.block::<ROWS, 1>(row, column);
        }
    }

    /// A block of the result, held in registers over all terms.
    #[inline(always)]
    fn block<const ROWS: usize, const COLUMNS: usize>(&mut self, row: usize, column: usize) {
        let mut totals = [[0.0_f32; COLUMNS]; ROWS];
        for (term, input) in self.inputs.chunks_exact(self.columns).enumerate() {
            let input = &input[column..column + COLUMNS];
            let weights = &self.weights[row * self.row_stride + term * self.term_stride..];
            for (offset, totals) in totals.iter_mut().enumerate() {
                let weight = weights[offset * self.row_stride];
                for (total, input) in totals.iter_mut().zip(input) {
                    *total += weight * input;
                }
            }
        }
        for (offset, totals) in totals.iter().enumerate() {
            let start = (row + offset) * self.columns + column;
            self.outputs[start..start + COLUMNS].copy_from_slice(totals);
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
