//! Multilayer perceptrons over columns of samples: forward, backward, initialisation.
//!
//! A slice of samples enters and leaves feature by feature, `[features][columns]`, as the simulation writes its
//! observations; between the layers it lies sample by sample.

mod aligned;
pub mod cnn;
mod dense;
mod kernel;
mod sample_matrix;
mod trunk;

use kestrel_core::activation::Activation;
use kestrel_core::seed::Stream;
use serde::{Deserialize, Serialize};

use aligned::Aligned;
pub use dense::Dense;
pub(crate) use dense::DenseGradient;
pub(crate) use kernel::{Accumulate, dispatch, dot, square};
pub(crate) use sample_matrix::SampleMatrix;
pub use trunk::{SharedTrunk, SharedTrunkWorkspace};

/// What agents observe at one step.
#[derive(Clone, Copy, Debug)]
pub struct InputBatch<'a> {
    /// `[values][columns]`: the observation; for critics, then what only they read.
    pub values: &'a [f32],
    /// `[columns][image]`; empty without a camera.
    pub images: &'a [u8],
    /// `[units][columns]`: what a recurrent policy remembers of the steps before; empty where nothing is remembered.
    pub hidden: &'a [f32],
}

impl<'a> InputBatch<'a> {
    /// Of agents without images or memory.
    pub fn without_images(values: &'a [f32]) -> Self {
        Self { values, images: &[], hidden: &[] }
    }
}

/// Parameters that one thread works on at a time: those of a large network are shared among all threads, those of a small
/// one are one piece.
pub(crate) const PIECE: usize = 1 << 15;

/// Gain of orthogonal weights before an activation, the choice of `CleanRL` and Stable-Baselines3 for tanh, and that of
/// He et al. (2015) for rectifiers.
const HIDDEN_GAIN: f32 = std::f32::consts::SQRT_2;

/// The shape of a multilayer perceptron: an activation, tanh by default, after every layer but the last.
///
/// Its parameters are one slice: for each layer the weights `[outputs][inputs]`, then the biases `[outputs]`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "Saved", into = "Saved")]
pub struct Mlp {
    widths: Vec<usize>,
    activation: Activation,
}

/// A shape in a checkpoint: the widths, behind a zero where rectifiers stand between the layers. Networks with tangents keep
/// the bytes that they have had since there was nothing else.
#[derive(Serialize, Deserialize)]
struct Saved {
    widths: Vec<usize>,
}

impl From<Saved> for Mlp {
    fn from(Saved { widths }: Saved) -> Self {
        match widths.split_first() {
            Some((0, widths)) => Self { widths: widths.to_vec(), activation: Activation::Relu },
            Some(_) | None => Self { widths, activation: Activation::Tanh },
        }
    }
}

impl From<Mlp> for Saved {
    fn from(Mlp { widths, activation }: Mlp) -> Self {
        match activation {
            Activation::Tanh => Self { widths },
            Activation::Relu => Self { widths: [&[0], widths.as_slice()].concat() },
        }
    }
}

impl Mlp {
    /// `inputs`, then the `hidden` widths, then `outputs`.
    pub fn new(inputs: usize, hidden: &[usize], outputs: usize) -> Self {
        let mut widths = vec![inputs];
        widths.extend_from_slice(hidden);
        widths.push(outputs);
        Self { widths, activation: Activation::Tanh }
    }

    /// The same shape with another activation.
    #[must_use]
    pub fn with_activation(self, activation: Activation) -> Self {
        Self { activation, ..self }
    }

    /// Number of inputs, widths of the hidden layers, number of outputs.
    pub fn widths(&self) -> &[usize] {
        &self.widths
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.widths[0]
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.widths[self.widths.len() - 1]
    }

    /// Number of weights and biases.
    pub fn parameter_count(&self) -> usize {
        self.widths.windows(2).map(|pair| (pair[0] + 1) * pair[1]).sum()
    }

    /// Multiply-accumulate operations of one forward pass of one sample.
    pub fn multiply_accumulates(&self) -> usize {
        self.widths.windows(2).map(|pair| pair[0] * pair[1]).sum()
    }

    /// The layers, first to last.
    pub fn layers<'a>(&self, parameters: &'a [f32]) -> Vec<Dense<'a>> {
        let mut rest = parameters;
        let mut take = |count: usize| {
            let (taken, left) = rest.split_at(count);
            rest = left;
            taken
        };
        let layer = |pair: &[usize]| Dense {
            inputs: pair[0],
            outputs: pair[1],
            weights: take(pair[0] * pair[1]),
            biases: take(pair[1]),
            activation: self.activation,
        };
        self.widths.windows(2).map(layer).collect()
    }

    /// Weights and biases of each layer, to be written.
    pub(crate) fn layers_mut<'a>(&self, parameters: &'a mut [f32]) -> Vec<(&'a mut [f32], &'a mut [f32])> {
        let layers = self.layer_gradients(parameters).into_iter();
        layers.map(|DenseGradient { weights, biases }| (weights, biases)).collect()
    }

    /// The gradient of a network of one layer.
    pub(crate) fn only_gradient<'a>(&self, gradient: &'a mut [f32]) -> DenseGradient<'a> {
        let [weights, biases] = [self.inputs() * self.outputs(), self.outputs()];
        let (weights, rest) = gradient.split_at_mut(weights);
        DenseGradient { weights, biases: &mut rest[..biases] }
    }

    fn layer_gradients<'a>(&self, gradient: &'a mut [f32]) -> Vec<DenseGradient<'a>> {
        let mut rest = gradient;
        let mut layers = Vec::with_capacity(self.widths.len() - 1);
        for pair in self.widths.windows(2) {
            let (weights, left) = rest.split_at_mut(pair[0] * pair[1]);
            let (biases, left) = left.split_at_mut(pair[1]);
            layers.push(DenseGradient { weights, biases });
            rest = left;
        }
        layers
    }

    /// Orthogonal weights (Saxe et al. 2014) and zero biases; the last layer's gain is `head_gain`.
    pub fn initialise(&self, head_gain: f32, stream: &mut Stream) -> Vec<f32> {
        let mut parameters = Vec::with_capacity(self.parameter_count());
        let last = self.widths.len() - 2;
        for (index, pair) in self.widths.windows(2).enumerate() {
            let gain = if index == last { head_gain } else { HIDDEN_GAIN };
            parameters.extend(orthogonal(pair[1], pair[0], gain, stream));
            parameters.extend(std::iter::repeat_n(0.0, pair[1]));
        }
        parameters
    }

    /// Evaluates a slice, `inputs [inputs][columns]`, and returns the network's outputs `[outputs][columns]`.
    ///
    /// # Panics
    /// When `inputs` is not of this shape or the workspace is of another network.
    pub fn forward<'w>(&self, parameters: &[f32], inputs: &[f32], workspace: &'w mut Workspace) -> &'w [f32] {
        let (head, behind_hidden, outputs) = self.forward_hidden(parameters, inputs, workspace);
        head.affine(behind_hidden, outputs);
        outputs
    }

    /// All but the last layer, which is returned with its inputs and the place of its outputs.
    fn forward_hidden<'p, 'b, 'w: 'b>(
        &self,
        parameters: &'p [f32],
        inputs: &'b [f32],
        workspace: &'w mut Workspace,
    ) -> (Dense<'p>, SampleMatrix<'b>, &'w mut [f32]) {
        let Workspace { columns, transposed, activations, outputs, .. } = workspace;
        assert_eq!(inputs.len(), self.inputs() * *columns, "a slice has a row for each input");
        let layers = self.layers(parameters);
        let (head, hidden) = layers.split_last().expect("a network has at least one layer");
        let mut input = SampleMatrix::by_feature(inputs, *columns);
        for ((layer, activation), transposed) in hidden.iter().zip(activations).zip(transposed) {
            layer.affine_activated(input, transposed, activation);
            input = SampleMatrix::by_sample(activation, *columns);
        }
        (*head, input, outputs)
    }

    /// Adds the parameters' gradient of a slice to `gradient`, from the loss gradient of the outputs that the
    /// caller has written to [`Workspace::output_delta`] after [`Self::forward`] of the same `inputs`.
    pub fn backward(&self, parameters: &[f32], inputs: &[f32], workspace: &mut Workspace, gradient: &mut [f32]) {
        let mut gradients = self.layer_gradients(gradient);
        self.backward_layers(parameters, inputs, workspace, |index, deltas, inputs| {
            gradients[index].add(deltas, inputs);
        });
    }

    /// As [`Self::backward`], and writes the loss gradient of the last inputs, as many as `input_deltas
    /// [inputs][columns]` has rows: those that another network made.
    pub fn backward_to_inputs(
        &self,
        parameters: &[f32],
        inputs: &[f32],
        workspace: &mut Workspace,
        gradient: &mut [f32],
        input_deltas: &mut [f32],
    ) {
        let mut gradients = self.layer_gradients(gradient);
        let first = self.layers(parameters)[0];
        self.backward_layers(parameters, inputs, workspace, |index, deltas, inputs| {
            gradients[index].add(deltas, inputs);
            if index == 0 {
                first.input_deltas(deltas, input_deltas);
            }
        });
    }

    /// As [`Self::backward`], but adds up what `size` makes of each sample's own gradient: with squares the diagonal
    /// of the sum of outer products, with absolute values the sum of sensitivities.
    ///
    /// `size(a b)` must be `size(a) size(b)`, because the gradient of a weight is the product of a delta and an input.
    pub(crate) fn backward_sizes(
        &self,
        parameters: &[f32],
        inputs: &[f32],
        workspace: &mut Workspace,
        size: fn(f32) -> f32,
        sizes: &mut [f32],
    ) {
        let sized = |batch: SampleMatrix<'_>| batch.values.iter().copied().map(size).collect::<Vec<f32>>();
        let mut sizes = self.layer_gradients(sizes);
        self.backward_layers(parameters, inputs, workspace, |index, deltas, inputs| {
            sizes[index].add(
                SampleMatrix { values: &sized(deltas), ..deltas },
                SampleMatrix { values: &sized(inputs), ..inputs },
            );
        });
    }

    /// As [`Self::backward`], but only shows each layer, last to first: its index, its deltas and its inputs.
    pub(crate) fn backward_layers(
        &self,
        parameters: &[f32],
        inputs: &[f32],
        workspace: &mut Workspace,
        mut visit: impl FnMut(usize, SampleMatrix<'_>, SampleMatrix<'_>),
    ) {
        let Workspace { columns, activations, deltas, output_deltas, .. } = workspace;
        let columns = *columns;
        let layers = self.layers(parameters);
        for index in (0..layers.len()).rev() {
            let (below, from) = deltas.split_at_mut(index);
            let from = match from.first() {
                Some(deltas) => SampleMatrix::by_sample(deltas, columns),
                None => SampleMatrix::by_feature(output_deltas, columns),
            };
            let Some(below) = below.last_mut() else {
                return visit(0, from, SampleMatrix::by_feature(inputs, columns));
            };
            let activations = &activations[index - 1];
            visit(index, from, SampleMatrix::by_sample(activations, columns));
            layers[index].backward(from, activations, below);
        }
    }
}

/// What a slice leaves behind on its way through a network, and the loss gradients on the way back.
#[derive(Clone, Debug)]
pub struct Workspace {
    columns: usize,
    /// Per hidden layer its weights, `[inputs][outputs]`.
    transposed: Vec<Aligned>,
    /// Per hidden layer `[columns][outputs]`.
    activations: Vec<Aligned>,
    /// `[outputs][columns]`.
    outputs: Vec<f32>,
    /// Per hidden layer, of the sums before the activation function, `[columns][outputs]`; empty until the first
    /// backward pass.
    deltas: Vec<Aligned>,
    /// `[outputs][columns]`, empty until the first backward pass.
    output_deltas: Vec<f32>,
}

impl Workspace {
    /// For slices of `columns` samples.
    pub fn new(mlp: &Mlp, columns: usize) -> Self {
        let hidden = &mlp.widths[..mlp.widths.len() - 1];
        Self {
            columns,
            transposed: hidden.windows(2).map(|pair| Aligned::zeros(pair[0] * pair[1])).collect(),
            activations: hidden[1..].iter().map(|width| Aligned::zeros(width * columns)).collect(),
            outputs: vec![0.0; mlp.outputs() * columns],
            deltas: Vec::new(),
            output_deltas: Vec::new(),
        }
    }

    /// The network's outputs `[outputs][columns]` and, to be written, the loss gradient of each.
    pub fn output_delta(&mut self) -> (&[f32], &mut [f32]) {
        if self.output_deltas.is_empty() {
            self.deltas.clone_from(&self.activations);
            self.output_deltas.clone_from(&self.outputs);
        }
        (&self.outputs, &mut self.output_deltas)
    }
}

/// A random `[rows][columns]` matrix whose rows (or columns, if those are fewer) are orthogonal with norm `gain`.
fn orthogonal(rows: usize, columns: usize, gain: f32, stream: &mut Stream) -> Vec<f32> {
    let (count, length) = (rows.min(columns), rows.max(columns));
    let mut basis: Vec<Vec<f64>> = Vec::with_capacity(count);
    for _ in 0..count {
        let mut vector: Vec<f64> = (0..length).map(|_| f64::from(stream.normal())).collect();
        // Twice is enough (Giraud et al. 2005): the second pass removes what rounding left of the first.
        remove_components(&mut vector, &basis);
        remove_components(&mut vector, &basis);
        let norm = inner(&vector, &vector).sqrt();
        basis.push(vector.iter().map(|value| value / norm).collect());
    }
    let entry = |row: usize, column: usize| if rows <= columns { basis[row][column] } else { basis[column][row] };
    let entries = (0..rows * columns).map(|index| entry(index / columns, index % columns));
    entries.map(|value| gain * value as f32).collect()
}

fn remove_components(vector: &mut [f64], basis: &[Vec<f64>]) {
    for direction in basis {
        let component = inner(vector, direction);
        for (value, direction) in vector.iter_mut().zip(direction) {
            *value -= component * direction;
        }
    }
}

fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests;
