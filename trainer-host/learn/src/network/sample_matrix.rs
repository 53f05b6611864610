//! Values of a slice of samples, in one of two orders.

use std::borrow::Cow;

use super::kernel::Left;

/// Which values lie side by side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// `[features][columns]`, as the simulation writes and the loss reads.
    ByFeature,
    /// `[columns][features]`: between layers, because then every product, forward and backward, has its sums in the
    /// lanes of a register from the first term to the last, and nothing is transposed or added across lanes.
    BySample,
}

/// Some features of the samples of a slice.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SampleMatrix<'a> {
    pub(crate) values: &'a [f32],
    pub(crate) columns: usize,
    pub(crate) order: Order,
}

impl<'a> SampleMatrix<'a> {
    /// `values [features][columns]`.
    pub(crate) fn by_feature(values: &'a [f32], columns: usize) -> Self {
        Self { values, columns, order: Order::ByFeature }
    }

    /// `values [columns][features]`.
    pub(crate) fn by_sample(values: &'a [f32], columns: usize) -> Self {
        Self { values, columns, order: Order::BySample }
    }

    /// Number of values per sample.
    pub(crate) fn features(&self) -> usize {
        self.values.len() / self.columns
    }

    /// Its values, `[columns][features]`.
    pub(crate) fn by_sample_values(&self) -> Cow<'a, [f32]> {
        match self.order {
            Order::ByFeature => transposed(self.values, self.columns).into(),
            Order::BySample => self.values.into(),
        }
    }

    /// As a left factor with a row per sample.
    pub(crate) fn samples(&self) -> Left<'a> {
        match self.order {
            Order::ByFeature => Left::ByTerm(self.values, self.columns),
            Order::BySample => Left::ByRow(self.values, self.features()),
        }
    }

    /// As a left factor with a row per feature, from this sample on.
    pub(crate) fn features_from(&self, sample: usize) -> Left<'a> {
        match self.order {
            Order::ByFeature => Left::ByRow(&self.values[sample..], self.columns),
            Order::BySample => Left::ByTerm(&self.values[sample * self.features()..], self.features()),
        }
    }
}

/// Writes the transpose of `matrix [rows][columns]`.
pub(crate) fn transpose(matrix: &[f32], columns: usize, transposed: &mut [f32]) {
    let rows = matrix.len() / columns;
    for (column, values) in transposed.chunks_exact_mut(rows).enumerate() {
        for (value, row) in values.iter_mut().zip(matrix.chunks_exact(columns)) {
            *value = row[column];
        }
    }
}

/// The transpose of `matrix [rows][columns]`.
pub(crate) fn transposed(matrix: &[f32], columns: usize) -> Vec<f32> {
    let mut transposed = vec![0.0; matrix.len()];
    transpose(matrix, columns, &mut transposed);
    transposed
}
