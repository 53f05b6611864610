//! One fully connected layer over columns of samples.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::kernel::{AddBias, AddBiasTanh, AddRowSums, NarrowOuterProduct, NarrowProduct, dispatch};

/// Below this many outputs the general matrix product wastes its registers and the narrow kernels win.
const NARROW: usize = 8;

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
}

impl Dense<'_> {
    /// `W x + b` for every column of `inputs [inputs][columns]`, into `outputs [outputs][columns]`.
    pub(crate) fn affine(&self, inputs: &[f32], columns: usize, outputs: &mut [f32]) {
        self.product(inputs, columns, outputs);
        dispatch(AddBias { rows: outputs, biases: self.biases, columns });
    }

    /// `tanh(W x + b)`, shapes as in [`Self::affine`].
    pub(crate) fn affine_tanh(&self, inputs: &[f32], columns: usize, outputs: &mut [f32]) {
        self.product(inputs, columns, outputs);
        dispatch(AddBiasTanh { rows: outputs, biases: self.biases, columns });
    }

    fn product(&self, inputs: &[f32], columns: usize, outputs: &mut [f32]) {
        if self.outputs < NARROW {
            let (weights, row_stride, term_stride) = (self.weights, self.inputs, 1);
            return dispatch(NarrowProduct { weights, row_stride, term_stride, inputs, columns, outputs });
        }
        let weights = MatRef::from_row_major_slice(self.weights, self.outputs, self.inputs);
        let inputs = MatRef::from_row_major_slice(inputs, self.inputs, columns);
        let outputs = MatMut::from_row_major_slice_mut(outputs, self.outputs, columns);
        matmul(outputs, Accum::Replace, weights, inputs, 1.0, Par::Seq);
    }

    /// The loss gradient of the inputs, `W' d`, from that of the outputs.
    pub(crate) fn backward(&self, deltas: &[f32], columns: usize, inputs: &mut [f32]) {
        if self.outputs < NARROW {
            let (weights, row_stride, term_stride) = (self.weights, 1, self.inputs);
            let (inputs, outputs) = (deltas, inputs);
            return dispatch(NarrowProduct { weights, row_stride, term_stride, inputs, columns, outputs });
        }
        let weights = MatRef::from_row_major_slice(self.weights, self.outputs, self.inputs);
        let deltas = MatRef::from_row_major_slice(deltas, self.outputs, columns);
        let inputs = MatMut::from_row_major_slice_mut(inputs, self.inputs, columns);
        matmul(inputs, Accum::Replace, weights.transpose(), deltas, 1.0, Par::Seq);
    }
}

/// The gradient of one layer, laid out as its weights.
pub(crate) struct DenseGradient<'a> {
    pub(crate) weights: &'a mut [f32],
    pub(crate) biases: &'a mut [f32],
}

impl DenseGradient<'_> {
    /// Adds the gradient over all columns: `d x'` to the weights, the row sums of `d` to the biases.
    pub(crate) fn add(&mut self, deltas: &[f32], inputs: &[f32], columns: usize) {
        dispatch(AddRowSums { rows: deltas, columns, sums: self.biases });
        let gradient = &mut *self.weights;
        let (rows, width) = (self.biases.len(), inputs.len() / columns);
        if rows < NARROW {
            return dispatch(NarrowOuterProduct { deltas, inputs, columns, gradient });
        }
        let deltas = MatRef::from_row_major_slice(deltas, rows, columns);
        let inputs = MatRef::from_row_major_slice(inputs, width, columns);
        let gradient = MatMut::from_row_major_slice_mut(gradient, rows, width);
        matmul(gradient, Accum::Add, deltas, inputs.transpose(), 1.0, Par::Seq);
    }
}
