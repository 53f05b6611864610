//! The matrix product of convolutions, forward and backward, whose left factor is read where an image holds it.
//!
//! What a pixel of the result sees, its patch, is never copied: a value of the image belongs to as many patches as
//! cover it, and is found by the place of the patch plus the place in the patch.

use pulp::{Simd, WithSimd};

use super::fused;
use super::product::{Finish, Start};

/// Widths are multiples of so many values: the widest register.
pub(crate) const LANES: usize = 16;

/// Widest block of the result that stays in registers.
pub(crate) const STRIPE: usize = 4 * LANES;

/// Most rows of such a block; so many successive rows must not overlap in the result.
pub(crate) const MOST_ROWS: usize = 8;

/// Terms whose rows of the right factor, a stripe wide, fit into the first-level cache beside the left ones.
const TERMS: usize = 128;

/// Where a row begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    pub(crate) left: usize,
    pub(crate) result: usize,
}

/// `result[p.result + j] = finish(start + sum over k of left[p.left + terms[k]] right[k][j])` for every place `p` and
/// every `j` within the width.
///
/// Every sum is taken in the order of its terms, whatever the instruction set. Places that overlap in the result add
/// up if they start with it; they must then be [`MOST_ROWS`] places apart.
pub(crate) struct PatchProduct<'a> {
    pub(crate) left: &'a [f32],
    pub(crate) places: &'a [Place],
    /// Ascending.
    pub(crate) terms: &'a [usize],
    /// `[terms][width]`.
    pub(crate) right: &'a [f32],
    /// A multiple of [`LANES`].
    pub(crate) width: usize,
    pub(crate) result: &'a mut [f32],
    /// A row has the width.
    pub(crate) start: Start<'a>,
    pub(crate) finish: Finish<'a>,
}

/// Some terms of a stripe of a product.
#[derive(Clone, Copy)]
struct Part<'a> {
    /// First column and the one behind the last.
    stripe: (usize, usize),
    terms: &'a [usize],
    right: &'a [f32],
    start: Start<'a>,
    finish: Finish<'a>,
}

impl WithSimd for PatchProduct<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let last = self.terms.len().div_ceil(TERMS).saturating_sub(1);
        let blocks = self.terms.chunks(TERMS).zip(self.right.chunks(TERMS * self.width));
        for (block, (terms, right)) in blocks.enumerate() {
            let start = if block == 0 { self.start } else { Start::Result };
            let finish = if block == last { self.finish } else { Finish::Sum };
            for column in (0..self.width).step_by(STRIPE) {
                let stripe = (column, self.width.min(column + STRIPE));
                self.stripe(simd, Part { stripe, terms, right, start, finish });
            }
        }
    }
}

impl PatchProduct<'_> {
    /// In blocks as large as the registers allow.
    #[inline(always)]
    fn stripe<S: Simd>(&mut self, simd: S, part: Part<'_>) {
        let vectors = (part.stripe.1 - part.stripe.0).div_ceil(S::F32_LANES);
        if S::F32_LANES < LANES {
            self.rows::<S, 6, 2>(simd, part);
        } else if vectors == 4 {
            self.rows::<S, 4, 4>(simd, part);
        } else if vectors == 3 {
            self.rows::<S, MOST_ROWS, 3>(simd, part);
        } else if vectors == 2 {
            self.rows::<S, MOST_ROWS, 2>(simd, part);
        } else {
            self.rows::<S, MOST_ROWS, 1>(simd, part);
        }
    }

    #[inline(always)]
    fn rows<S: Simd, const ROWS: usize, const VECTORS: usize>(&mut self, simd: S, part: Part<'_>) {
        let (blocks, rest) = self.places.as_chunks::<ROWS>();
        for places in blocks {
            self.columns::<S, ROWS, VECTORS>(simd, places, part);
        }
        let (pairs, rest) = rest.as_chunks::<2>();
        for places in pairs {
            self.columns::<S, 2, VECTORS>(simd, places, part);
        }
        for place in rest {
            self.columns::<S, 1, VECTORS>(simd, &[*place], part);
        }
    }

    /// All columns of a stripe before the next place, so that the sums of places that overlap have one order, however
    /// wide a block is.
    #[inline(always)]
    fn columns<S: Simd, const ROWS: usize, const VECTORS: usize>(
        &mut self,
        simd: S,
        places: &[Place; ROWS],
        part: Part<'_>,
    ) {
        for column in (part.stripe.0..part.stripe.1).step_by(VECTORS * S::F32_LANES) {
            self.block::<S, ROWS, VECTORS>(simd, places, column, part);
        }
    }

    #[inline(always)]
    fn block<S: Simd, const ROWS: usize, const VECTORS: usize>(
        &mut self,
        simd: S,
        places: &[Place; ROWS],
        column: usize,
        Part { terms, right, start, finish, .. }: Part<'_>,
    ) {
        let columns = column..column + VECTORS * S::F32_LANES;
        let mut totals = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
        for (place, totals) in places.iter().zip(&mut totals) {
            let start = match start {
                Start::Zero => continue,
                Start::Row(row) => row,
                Start::Result => &self.result[place.result..],
            };
            totals.copy_from_slice(S::as_simd_f32s(&start[columns.clone()]).0);
        }
        let span = terms.last().map_or(0, |last| last + 1);
        let patches: [&[f32]; ROWS] = std::array::from_fn(|row| &self.left[places[row].left..][..span]);
        for (right, term) in right.chunks_exact(self.width).zip(terms) {
            let right = S::as_simd_f32s(&right[columns.clone()]).0;
            for (totals, patch) in totals.iter_mut().zip(patches) {
                let factor = simd.splat_f32s(patch[*term]);
                for (total, right) in totals.iter_mut().zip(right) {
                    *total = fused(simd, factor, *right, *total);
                }
            }
        }
        for (place, totals) in places.iter().zip(&totals) {
            let result = &mut self.result[place.result..][columns.clone()];
            S::as_mut_simd_f32s(result).0.copy_from_slice(totals);
            finish.apply(result, place.result + column);
        }
    }
}
