use super::*;
use crate::network::aligned::Aligned;
use crate::network::sample_matrix::{SampleMatrix, transpose};
use kestrel_core::activation::tanh;
use kestrel_core::seed::{Purpose, Seed, Stream};
use proptest::prelude::*;
use pulp::{Scalar, WithSimd};

fn normals(count: usize, index: u32) -> Vec<f32> {
    let mut stream = Stream::new(Seed(7), index, Purpose::Weights);
    (0..count).map(|_| stream.normal()).collect()
}

fn transposed(matrix: &[f32], columns: usize) -> Vec<f32> {
    let mut transposed = vec![0.0; matrix.len()];
    transpose(matrix, columns, &mut transposed);
    transposed
}

/// `[rows][terms]` times `[terms][width]` in `f64`, on top of `start`, and the sums of the magnitudes.
fn reference(left: &[f32], right: &[f32], start: &[f32], width: usize) -> Vec<(f64, f64)> {
    let terms = right.len() / width;
    let entry = |(index, start): (usize, &f32)| {
        let (row, column) = (index / width, index % width);
        let product = |term: usize| f64::from(left[row * terms + term]) * f64::from(right[term * width + column]);
        let magnitude: f64 = (0..terms).map(|term| product(term).abs()).sum();
        let start = f64::from(*start);
        (start + (0..terms).map(product).sum::<f64>(), start.abs() + magnitude)
    };
    start.iter().enumerate().map(entry).collect()
}

/// Rounding of so many additions, as a fraction of the sum of magnitudes (Higham 2002, eq. 3.3).
fn is_within_rounding(found: f32, (expected, magnitude): (f64, f64), terms: usize) -> bool {
    (f64::from(found) - expected).abs() <= (terms + 2) as f64 * f64::from(f32::EPSILON) * magnitude
}

fn check_product(rows: usize, terms: usize, width: usize) {
    let (left, right) = (normals(rows * terms, 1), normals(terms * width, 2));
    let start = normals(rows * width, 3);
    let expected = reference(&left, &right, &start, width);
    let by_term = transposed(&left, terms);
    let lefts = [Left::ByRow(&left, terms), Left::ByTerm(&by_term, rows)];
    let [by_row, by_term] = lefts.map(|left| {
        let mut result = start.clone();
        let (start, finish) = (Start::Result, Finish::Sum);
        dispatch(Product { left, right: &right, result: &mut result, width, start, finish });
        result
    });
    assert_eq!(by_row, by_term, "the order of the left factor changes nothing");
    for (found, expected) in by_row.iter().zip(&expected) {
        assert!(is_within_rounding(*found, *expected, terms), "{rows} x {terms} x {width}: {found}, {expected:?}");
    }
}

#[test]
fn products_of_every_shape_are_those_in_f64() {
    for (rows, terms, width) in [(1, 1, 1), (3, 2, 8), (4, 64, 64), (7, 130, 130), (256, 39, 16), (9, 256, 33)] {
        check_product(rows, terms, width);
    }
}

#[test]
fn sums_begin_and_end_as_asked() {
    let (rows, terms, width) = (6, 5, 70);
    let (left, right) = (normals(rows * terms, 4), normals(terms * width, 5));
    let (biases, activations) = (normals(width, 6), normals(rows * width, 7));
    let product = |start: Start<'_>, finish: Finish<'_>| {
        let mut result = vec![f32::NAN; rows * width];
        dispatch(Product {
            left: Left::ByRow(&left, terms),
            right: &right,
            result: &mut result,
            width,
            start,
            finish,
        });
        result
    };
    let biased = product(Start::Row(&biases), Finish::Sum);
    let expected = reference(&left, &right, &biases.repeat(rows), width);
    for (found, expected) in biased.iter().zip(&expected) {
        assert!(is_within_rounding(*found, *expected, terms));
    }
    assert_eq!(product(Start::Row(&biases), Finish::Tanh), biased.iter().copied().map(tanh).collect::<Vec<f32>>());
    let sums = product(Start::Zero, Finish::Sum);
    let scaled: Vec<f32> = sums.iter().zip(&activations).map(|(sum, a)| sum * (1.0 - a * a)).collect();
    assert_eq!(product(Start::Zero, Finish::TanhDerivative(&activations)), scaled);
    let passed: Vec<f32> =
        sums.iter().zip(&activations).map(|(sum, a)| if *a > 0.0 { *sum } else { 0.0 }).collect();
    assert_eq!(product(Start::Zero, Finish::ReluDerivative(&activations)), passed);
}

#[test]
fn heads_of_every_shape_are_products_in_f64() {
    for (outputs, terms, columns) in [(1, 1, 1), (1, 64, 8), (4, 64, 256), (3, 37, 9), (10, 16, 40)] {
        let (weights, biases) = (normals(outputs * terms, 8), normals(outputs, 9));
        let (inputs, mut found) = (normals(columns * terms, 10), vec![0.0; outputs * columns]);
        dispatch(Head { weights: &weights, biases: &biases, inputs: &inputs, outputs: &mut found });
        let start: Vec<f32> = biases.iter().flat_map(|bias| vec![*bias; columns]).collect();
        for (found, expected) in
            found.iter().zip(reference(&weights, &transposed(&inputs, terms), &start, columns))
        {
            assert!(is_within_rounding(*found, expected, terms), "{outputs} x {terms}: {found}, {expected:?}");
        }
    }
}

/// A product and a head, so that one call runs both with the same instruction set.
struct Both {
    rows: usize,
    terms: usize,
    width: usize,
}

impl WithSimd for Both {
    type Output = (Vec<f32>, Vec<f32>);

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> Self::Output {
        let Self { rows, terms, width } = self;
        let (left, right, biases) = (normals(rows * terms, 1), normals(terms * width, 2), normals(width, 3));
        let mut result = vec![0.0; rows * width];
        let (start, finish, left) = (Start::Row(&biases), Finish::Tanh, Left::ByRow(&left, terms));
        Product { left, right: &right, result: &mut result, width, start, finish }.with_simd(simd);
        let mut outputs = vec![0.0; rows * 3];
        let (weights, biases) = (normals(3 * width, 4), &biases[..1].repeat(3));
        Head { weights: &weights, biases, inputs: &result, outputs: &mut outputs }.with_simd(simd);
        (result, outputs)
    }
}

/// Patches that overlap, before the product and behind it.
struct Patches {
    rows: usize,
    terms: usize,
    width: usize,
}

impl Patches {
    /// Eight in turn do not overlap, and the next ones lie a vector further.
    fn places(&self) -> Vec<Place> {
        let apart = self.width + self.rows * LANES;
        let result = |row| row % MOST_ROWS * apart + row / MOST_ROWS * LANES;
        (0..self.rows).map(|row| Place { left: 10 * row, result: result(row) }).collect()
    }

    /// Every third value of the left factor.
    fn offsets(&self) -> Vec<usize> {
        (0..self.terms).map(|term| 3 * term).collect()
    }

    fn left(&self) -> Vec<f32> {
        normals(10 * self.rows + 3 * self.terms, 1)
    }

    fn right(&self) -> Vec<f32> {
        normals(self.terms * self.width, 2)
    }

    fn result(&self) -> Vec<f32> {
        normals(MOST_ROWS * (self.width + self.rows * LANES), 3)
    }
}

impl WithSimd for Patches {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> Vec<f32> {
        let mut result = self.result();
        PatchProduct {
            left: &self.left(),
            places: &self.places(),
            terms: &self.offsets(),
            right: &self.right(),
            width: self.width,
            result: &mut result,
            start: Start::Result,
            finish: Finish::Sum,
        }
        .with_simd(simd);
        result
    }
}

const PATCHES: [(usize, usize, usize); 5] = [(1, 1, 16), (7, 5, 32), (9, 130, 48), (30, 300, 64), (21, 40, 240)];

#[test]
fn products_of_patches_add_up_in_the_order_of_their_terms() {
    for (rows, terms, width) in PATCHES {
        let patches = Patches { rows, terms, width };
        let (left, right, mut expected) = (patches.left(), patches.right(), patches.result());
        for place in patches.places() {
            for (offset, right) in patches.offsets().iter().zip(right.chunks_exact(width)) {
                for (sum, right) in expected[place.result..].iter_mut().zip(right) {
                    *sum = left[place.left + offset].mul_add(*right, *sum);
                }
            }
        }
        // Where places overlap, blocks of terms alternate.
        for (found, expected) in dispatch(patches).iter().zip(&expected) {
            assert!((found - expected).abs() <= 1e-4 * expected.abs().max(10.0), "{rows} x {terms} x {width}");
        }
    }
}

#[test]
fn every_instruction_set_has_the_same_bits_of_products_of_patches() {
    for (rows, terms, width) in PATCHES {
        let found = everywhere(|| Patches { rows, terms, width });
        assert!(found.windows(2).all(|pair| pair[0] == pair[1]), "{rows} x {terms} x {width}");
    }
}

/// The bits of every instruction set that this machine has.
fn everywhere<K: WithSimd>(kernel: impl Fn() -> K) -> Vec<K::Output> {
    let mut found = vec![kernel().with_simd(Scalar), dispatch(kernel())];
    #[cfg(target_arch = "x86_64")]
    {
        found.extend(pulp::x86::V3::try_new().map(|simd| pulp::Simd::vectorize(simd, kernel())));
        found.extend(pulp::x86::V4::try_new().map(|simd| pulp::Simd::vectorize(simd, kernel())));
    }
    found
}

#[test]
fn aligned_values_begin_with_a_cache_line() {
    for len in [1, 7, 64, 4096] {
        let mut values = Aligned::zeros(len);
        values.copy_from_slice(&normals(len, 11));
        for values in [&values.clone(), &values] {
            assert_eq!((values.as_ptr().align_offset(64), &values[..]), (0, &normals(len, 11)[..]));
        }
    }
}

#[test]
fn a_batch_has_the_same_factors_in_both_orders() {
    let (features, columns) = (5, 8);
    let by_feature = normals(features * columns, 12);
    let by_sample = transposed(&by_feature, columns);
    let weights = normals(features * 6, 13);
    let [one, other] =
        [SampleMatrix::by_feature(&by_feature, columns), SampleMatrix::by_sample(&by_sample, columns)].map(
            |batch| {
                let mut result = vec![0.0; columns * 6];
                let (left, start, finish) = (batch.samples(), Start::Zero, Finish::Sum);
                dispatch(Product { left, right: &weights, result: &mut result, width: 6, start, finish });
                result
            },
        );
    assert_eq!(one, other);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn products_of_odd_shapes_are_those_in_f64(rows in 1_usize..131, terms in 1_usize..131, width in 1_usize..131) {
        check_product(rows, terms, width);
    }

    #[test]
    fn every_instruction_set_has_the_same_bits(rows in 1_usize..40, terms in 1_usize..70, width in 1_usize..131) {
        let found = everywhere(|| Both { rows, terms, width });
        for other in &found[1..] {
            prop_assert_eq!(other, &found[0]);
        }
    }
}
