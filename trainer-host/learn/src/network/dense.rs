//! One fully connected layer over the samples of a slice.

use std::borrow::Cow;

use kestrel_core::activation::Activation;
use kestrel_core::mlp::DenseLayer;

use super::aligned::Aligned;
use super::kernel::{AddRowSums, Finish, Head, Left, Product, Start, dispatch};
use super::sample_matrix::{Order, SampleMatrix, transpose, transposed};

/// Samples whose gradient is added up at a time: 64 wide layers then fit into the first-level cache.
const GRADIENT_SAMPLES: usize = 64;

/// The weights of one layer inside a network's parameters.
#[derive(Clone, Copy, Debug)]
pub struct Dense<'a> {
    /// Number of inputs.
    pub inputs: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// `[outputs][inputs]`, row after row.
    pub weights: &'a [f32],
    /// `[outputs]`.
    pub biases: &'a [f32],
    /// What follows hidden layers of the network.
    pub activation: Activation,
}

impl<'a> From<Dense<'a>> for DenseLayer<'a> {
    fn from(layer: Dense<'a>) -> Self {
        let Dense { inputs, outputs, weights, biases, activation } = layer;
        Self { inputs, outputs, weights, bias: biases, activation }
    }
}

impl Dense<'_> {
    /// The activation of `W x + b` of every sample, into `outputs [columns][outputs]`; `transposed` is overwritten by `W'`.
    pub(crate) fn affine_activated(&self, inputs: SampleMatrix<'_>, transposed: &mut [f32], outputs: &mut [f32]) {
        transpose(self.weights, self.inputs, transposed);
        dispatch(Product {
            left: inputs.samples(),
            right: transposed,
            result: outputs,
            width: self.outputs,
            start: Start::Row(self.biases),
            finish: match self.activation {
                Activation::Tanh => Finish::Tanh,
                Activation::Relu => Finish::Relu,
            },
        });
    }

    /// `W x + b` of every sample, into `outputs [outputs][columns]`.
    pub(crate) fn affine(&self, inputs: SampleMatrix<'_>, outputs: &mut [f32]) {
        if inputs.order == Order::BySample {
            let inputs = inputs.values;
            return dispatch(Head { weights: self.weights, biases: self.biases, inputs, outputs });
        }
        for (row, bias) in outputs.chunks_exact_mut(inputs.columns).zip(self.biases) {
            row.fill(*bias);
        }
        dispatch(Product {
            left: Left::ByRow(self.weights, self.inputs),
            right: inputs.values,
            result: outputs,
            width: inputs.columns,
            start: Start::Result,
            finish: Finish::Sum,
        });
    }

    /// The loss gradient of what the layer below summed up, `W' d` times the derivative of its activation, from that of the
    /// outputs; `activations` and `below` are `[columns][inputs]`.
    pub(crate) fn backward(&self, deltas: SampleMatrix<'_>, activations: &[f32], below: &mut [f32]) {
        // Among the parameters they begin anywhere, and each of their vectors is loaded as often as there are samples.
        let mut weights = Aligned::zeros(self.weights.len());
        weights.copy_from_slice(self.weights);
        dispatch(Product {
            left: deltas.samples(),
            right: &weights,
            result: below,
            width: self.inputs,
            start: Start::Zero,
            finish: match self.activation {
                Activation::Tanh => Finish::TanhDerivative(activations),
                Activation::Relu => Finish::ReluDerivative(activations),
            },
        });
    }

    /// The loss gradient of the last inputs, as many as `input_deltas [inputs][columns]` has rows, from that of what
    /// this layer summed up.
    pub(crate) fn input_deltas(&self, deltas: SampleMatrix<'_>, input_deltas: &mut [f32]) {
        let right = match deltas.order {
            Order::ByFeature => Cow::Borrowed(deltas.values),
            Order::BySample => Cow::Owned(transposed(deltas.values, self.outputs)),
        };
        let first = self.inputs - input_deltas.len() / deltas.columns;
        dispatch(Product {
            left: Left::ByTerm(&self.weights[first..], self.inputs),
            right: &right,
            result: input_deltas,
            width: deltas.columns,
            start: Start::Zero,
            finish: Finish::Sum,
        });
    }
}

/// The gradient of one layer, laid out as its weights.
pub(crate) struct DenseGradient<'a> {
    pub(crate) weights: &'a mut [f32],
    pub(crate) biases: &'a mut [f32],
}

impl DenseGradient<'_> {
    /// Adds the gradient over all samples: `d x'` to the weights, the sums of `d` to the biases.
    pub(crate) fn add(&mut self, deltas: SampleMatrix<'_>, inputs: SampleMatrix<'_>) {
        self.add_sums(deltas);
        match (deltas.order, inputs.order) {
            (_, Order::BySample) => add_products(inputs, self.weights, |sample| deltas.features_from(sample)),
            (Order::BySample, Order::ByFeature) => self.add_transposed(deltas, inputs),
            (Order::ByFeature, Order::ByFeature) => {
                let inputs = transposed(inputs.values, deltas.columns);
                let inputs = SampleMatrix::by_sample(&inputs, deltas.columns);
                add_products(inputs, self.weights, |sample| deltas.features_from(sample));
            }
        }
    }

    /// By way of `x d'`, because only the deltas lie sample by sample.
    fn add_transposed(&mut self, deltas: SampleMatrix<'_>, inputs: SampleMatrix<'_>) {
        let mut products = Aligned::zeros(self.weights.len());
        add_products(deltas, &mut products, |sample| inputs.features_from(sample));
        for (input, row) in products.chunks_exact(self.biases.len()).enumerate() {
            for (weight, sum) in self.weights[input..].iter_mut().step_by(inputs.features()).zip(row) {
                *weight += sum;
            }
        }
    }

    fn add_sums(&mut self, deltas: SampleMatrix<'_>) {
        match deltas.order {
            Order::ByFeature => {
                dispatch(AddRowSums { rows: deltas.values, columns: deltas.columns, sums: self.biases });
            }
            // A row of ones times the deltas.
            Order::BySample => {
                add_products(deltas, self.biases, |_| Left::ByRow(&[1.0; GRADIENT_SAMPLES], GRADIENT_SAMPLES));
            }
        }
    }
}

/// `sums[i][j] += sum over the samples c of left[i][c] right[c][j]`, where `right` lies sample by sample and `left`
/// gives its rows from a sample on.
fn add_products<'a>(right: SampleMatrix<'_>, sums: &mut [f32], left: impl Fn(usize) -> Left<'a>) {
    let width = right.features();
    for (part, right) in right.values.chunks(GRADIENT_SAMPLES * width).enumerate() {
        dispatch(Product {
            left: left(part * GRADIENT_SAMPLES),
            right,
            result: sums,
            width,
            start: Start::Result,
            finish: Finish::Sum,
        });
    }
}
