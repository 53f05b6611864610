//! The matrix product of every layer, forward and backward.
//!
//! Sums of products are fused multiply-adds, unlike everywhere else in the kernels: a fused multiply-add is one
//! correctly rounded operation, so that all machines which have it agree to the bit, and those which lack it call a
//! slow library function that does the same.

use kestrel_core::activation::tanh;
use pulp::{Simd, WithSimd};

use super::fused;

/// Rows of the block of the result that stays in registers over all terms.
const BLOCK_ROWS: usize = 4;

/// Rows that are finished together, while they are in the first-level cache.
const FINISHED_ROWS: usize = 4 * BLOCK_ROWS;

/// The left factor of a product, which is read value by value.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Left<'a> {
    /// `[rows][terms]`; from row to row so many values, the number of terms or more.
    ByRow(&'a [f32], usize),
    /// `[terms][rows]`; from term to term so many values, the number of rows or more.
    ByTerm(&'a [f32], usize),
}

/// What the sums of a product begin with.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Start<'a> {
    /// Nothing.
    Zero,
    /// The same row for all rows of the result, `[width]`.
    Row(&'a [f32]),
    /// What the result holds.
    Result,
}

/// What becomes of the finished sums, while they are still in the first-level cache.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Finish<'a> {
    /// They stay.
    Sum,
    /// Their hyperbolic tangent.
    Tanh,
    /// Zero where they are negative.
    Relu,
    /// They are multiplied by the derivative of tanh, `1 - a^2` of activations laid out as the result.
    TanhDerivative(&'a [f32]),
    /// They are multiplied by the derivative of a rectifier: zero where activations laid out as the result are.
    ReluDerivative(&'a [f32]),
}

/// `result[i][j] = finish(start[i][j] + sum over k of left[i][k] right[k][j])`.
///
/// Every sum is taken in the order of its terms, whatever the instruction set.
pub(crate) struct Product<'a> {
    pub(crate) left: Left<'a>,
    /// `[terms][width]`.
    pub(crate) right: &'a [f32],
    /// `[rows][width]`.
    pub(crate) result: &'a mut [f32],
    pub(crate) width: usize,
    pub(crate) start: Start<'a>,
    pub(crate) finish: Finish<'a>,
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let rows = self.result.len() / self.width;
        for first in (0..rows).step_by(FINISHED_ROWS) {
            let behind = rows.min(first + FINISHED_ROWS);
            let blocked = behind - (behind - first) % BLOCK_ROWS;
            for row in (first..blocked).step_by(BLOCK_ROWS) {
                self.rows::<S, BLOCK_ROWS>(simd, row);
            }
            for row in blocked..behind {
                self.rows::<S, 1>(simd, row);
            }
            let values = first * self.width..behind * self.width;
            finish_apart(simd, self.finish, &mut self.result[values.clone()], values.start);
        }
    }
}

/// Out of line: constants of a tangent that the optimiser brings along take registers from the sums, and PPO two
/// fifths of its speed.
#[inline(never)]
fn finish_apart<S: Simd>(simd: S, finish: Finish<'_>, sums: &mut [f32], place: usize) {
    if !matches!(finish, Finish::Sum) {
        simd.vectorize(Finishing { finish, sums, place });
    }
}

/// [`Finish::apply`] with the widest registers.
struct Finishing<'a> {
    finish: Finish<'a>,
    sums: &'a mut [f32],
    place: usize,
}

impl WithSimd for Finishing<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.finish.apply(self.sums, self.place);
    }
}

impl Product<'_> {
    #[inline(always)]
    fn rows<S: Simd, const ROWS: usize>(&mut self, simd: S, row: usize) {
        match self.left {
            Left::ByRow(values, stride) => {
                // Each window begins at the first row's factor and ends with the last row's: one length to check.
                let terms = self.right.len() / self.width;
                let span = (ROWS - 1) * stride;
                let factors = values[row * stride..][..span + terms]
                    .windows(span + 1)
                    .map(|window| std::array::from_fn::<_, ROWS, _>(|offset| &window[offset * stride]));
                self.columns(simd, row, &factors);
            }
            Left::ByTerm(values, stride) => {
                let factors = values
                    .chunks(stride)
                    .map(|values| std::array::from_fn::<_, ROWS, _>(|offset| &values[row..row + ROWS][offset]));
                self.columns(simd, row, &factors);
            }
        }
    }

    /// From left to right in blocks as wide as the registers allow, then in single vectors, the last one partial.
    #[inline(always)]
    fn columns<'f, S: Simd, const ROWS: usize>(
        &mut self,
        simd: S,
        row: usize,
        factors: &(impl Iterator<Item = [&'f f32; ROWS]> + Clone),
    ) {
        let mut column = 0;
        if S::REGISTER_COUNT >= 32 {
            while column + 4 * S::F32_LANES <= self.width {
                self.block::<S, ROWS, 4>(simd, (row, column), factors.clone());
                column += 4 * S::F32_LANES;
            }
        }
        while column + 2 * S::F32_LANES <= self.width {
            self.block::<S, ROWS, 2>(simd, (row, column), factors.clone());
            column += 2 * S::F32_LANES;
        }
        while column < self.width {
            self.edge(simd, (row, column), factors.clone());
            column += S::F32_LANES;
        }
    }

    #[inline(always)]
    fn block<'f, S: Simd, const ROWS: usize, const VECTORS: usize>(
        &mut self,
        simd: S,
        (row, column): (usize, usize),
        factors: impl Iterator<Item = [&'f f32; ROWS]>,
    ) {
        let end = column + VECTORS * S::F32_LANES;
        let mut totals = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
        for (offset, totals) in totals.iter_mut().enumerate() {
            if let Some(start) = self.start(row + offset) {
                totals.copy_from_slice(S::as_simd_f32s(&start[column..end]).0);
            }
        }
        for (right, factors) in self.right.chunks_exact(self.width).zip(factors) {
            let right = S::as_simd_f32s(&right[column..end]).0;
            for (totals, factor) in totals.iter_mut().zip(factors) {
                let factor = simd.splat_f32s(*factor);
                for (total, right) in totals.iter_mut().zip(right) {
                    *total = fused(simd, factor, *right, *total);
                }
            }
        }
        for (offset, totals) in totals.iter().enumerate() {
            let place = (row + offset) * self.width;
            let result = &mut self.result[place + column..place + end];
            S::as_mut_simd_f32s(result).0.copy_from_slice(totals);
        }
    }

    /// A block of one vector, of which only the values within the width count.
    #[inline(always)]
    fn edge<'f, S: Simd, const ROWS: usize>(
        &mut self,
        simd: S,
        (row, column): (usize, usize),
        factors: impl Iterator<Item = [&'f f32; ROWS]>,
    ) {
        let end = self.width.min(column + S::F32_LANES);
        let mut totals = [simd.splat_f32s(0.0); ROWS];
        for (offset, total) in totals.iter_mut().enumerate() {
            if let Some(start) = self.start(row + offset) {
                *total = simd.partial_load_f32s(&start[column..end]);
            }
        }
        for (right, factors) in self.right.chunks_exact(self.width).zip(factors) {
            let right = simd.partial_load_f32s(&right[column..end]);
            for (total, factor) in totals.iter_mut().zip(factors) {
                *total = fused(simd, simd.splat_f32s(*factor), right, *total);
            }
        }
        for (offset, total) in totals.iter().enumerate() {
            let place = (row + offset) * self.width;
            let result = &mut self.result[place + column..place + end];
            simd.partial_store_f32s(result, *total);
        }
    }

    /// What a row of the sums begins with, `[width]`.
    #[inline(always)]
    fn start(&self, row: usize) -> Option<&[f32]> {
        match self.start {
            Start::Zero => None,
            Start::Row(values) => Some(values),
            Start::Result => Some(&self.result[row * self.width..(row + 1) * self.width]),
        }
    }
}

impl Finish<'_> {
    /// On sums that lie at `place` in the result.
    #[inline(always)]
    pub(super) fn apply(self, sums: &mut [f32], place: usize) {
        match self {
            Self::Sum => {}
            Self::Relu => {
                for sum in sums {
                    *sum = if *sum > 0.0 { *sum } else { 0.0 };
                }
            }
            Self::Tanh => {
                for sum in sums {
                    *sum = tanh(*sum);
                }
            }
            Self::TanhDerivative(activations) => {
                let activations = &activations[place..place + sums.len()];
                for (sum, activation) in sums.iter_mut().zip(activations) {
                    *sum *= 1.0 - activation * activation;
                }
            }
            Self::ReluDerivative(activations) => {
                let activations = &activations[place..place + sums.len()];
                for (sum, activation) in sums.iter_mut().zip(activations) {
                    *sum = if *activation > 0.0 { *sum } else { 0.0 };
                }
            }
        }
    }
}
