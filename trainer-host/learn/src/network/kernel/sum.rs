//! Sums over many values, each in an order that is fixed by this source.

use pulp::{Simd, WithSimd};

use super::fused;

/// Partial sums of a dot product: four AVX registers hide the latency of the additions.
const PARTIALS: usize = 32;

/// Partial sums of a head's output: one AVX-512 register.
const HEAD_PARTIALS: usize = 16;

/// Sum of products.
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

/// Out of line, because the optimiser otherwise shapes the loop above after this tree: two lanes wide.
#[inline(never)]
fn tree_sum(partials: [f32; PARTIALS]) -> f32 {
    let halved = std::array::from_fn(|lane| partials[lane] + partials[lane + PARTIALS / 2]);
    head_tree_sum(&halved)
}

#[inline(always)]
fn head_tree_sum(partials: &[f32; HEAD_PARTIALS]) -> f32 {
    let halved: [f32; 8] = std::array::from_fn(|lane| partials[lane] + partials[lane + 8]);
    let [a, b, c, d]: [f32; 4] = std::array::from_fn(|lane| halved[lane] + halved[lane + 4]);
    (a + c) + (b + d)
}

/// Sum of the squares of a row.
pub(crate) struct Square<'a> {
    pub(crate) row: &'a [f32],
}

impl WithSimd for Square<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f32 {
        dot(self.row, self.row)
    }
}

/// `sums[i] += values[i]`.
pub(crate) struct Accumulate<'a> {
    pub(crate) values: &'a [f32],
    pub(crate) sums: &'a mut [f32],
}

impl WithSimd for Accumulate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (sum, value) in self.sums.iter_mut().zip(self.values) {
            *sum += value;
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
            let (blocks, rest) = row.as_chunks::<PARTIALS>();
            let mut partials = [0.0_f32; PARTIALS];
            for block in blocks {
                for lane in 0..PARTIALS {
                    partials[lane] += block[lane];
                }
            }
            *total += tree_sum(partials) + rest.iter().sum::<f32>();
        }
    }
}

/// `outputs[r][c] = biases[r] + sum over k of weights[r][k] inputs[c][k]`: the last layer, which turns samples, one
/// after another, into rows.
pub(crate) struct Head<'a> {
    /// `[outputs][terms]`.
    pub(crate) weights: &'a [f32],
    pub(crate) biases: &'a [f32],
    /// `[columns][terms]`.
    pub(crate) inputs: &'a [f32],
    pub(crate) outputs: &'a mut [f32],
}

impl WithSimd for Head<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let terms = self.weights.len() / self.biases.len();
        let columns = self.inputs.len() / terms;
        for (column, inputs) in self.inputs.chunks_exact(terms).enumerate() {
            for (row, (weights, bias)) in self.weights.chunks_exact(terms).zip(self.biases).enumerate() {
                self.outputs[row * columns + column] = bias + fused_dot(simd, weights, inputs);
            }
        }
    }
}

/// Term `k` belongs to partial sum `k` modulo [`HEAD_PARTIALS`], however many of them fit into a register.
#[inline(always)]
fn fused_dot<S: Simd>(simd: S, a: &[f32], b: &[f32]) -> f32 {
    let ((a_blocks, a_rest), (b_blocks, b_rest)) =
        (a.as_chunks::<HEAD_PARTIALS>(), b.as_chunks::<HEAD_PARTIALS>());
    let mut partials = [0.0; HEAD_PARTIALS];
    for (part, partials) in S::as_mut_simd_f32s(&mut partials).0.iter_mut().enumerate() {
        for (a, b) in a_blocks.iter().zip(b_blocks) {
            *partials = fused(simd, S::as_simd_f32s(a).0[part], S::as_simd_f32s(b).0[part], *partials);
        }
    }
    for (partial, (a, b)) in partials.iter_mut().zip(a_rest.iter().zip(b_rest)) {
        *partial = a.mul_add(*b, *partial);
    }
    head_tree_sum(&partials)
}
