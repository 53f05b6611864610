//! A tile of images on its way through an eye, and its gradient on the way back.

use super::super::aligned::Aligned;
use super::super::kernel::{LANES, dispatch};
use super::convolution::ReluDerivative;
use super::layer::Grid;
use super::pixels::Normalise;
use super::{Eye, EyeWeights};

/// Samples that pass all convolutions together: their values stay in the second-level cache.
const CHUNK: usize = 8;

/// What a tile leaves behind on its way through an eye, and the loss gradients on the way back.
#[derive(Clone, Debug)]
pub struct EyeWorkspace {
    columns: usize,
    /// Of a chunk, `[CHUNK][rows][columns][channels]`.
    pixels: Aligned,
    /// Per layer, `[columns][output]`.
    activations: Vec<Aligned>,
    /// Per layer, of the sums before the activation function: `[CHUNK][output]`, and `[columns][output]` of the last
    /// two layers; empty until the first backward pass.
    deltas: Vec<Aligned>,
    /// Per convolution `[patch][output channels]`, empty until the first backward pass.
    products: Vec<Aligned>,
    /// Per layer `[output channels]`, empty until the first backward pass.
    sums: Vec<Aligned>,
}

impl EyeWorkspace {
    /// For tiles of `columns` samples.
    pub fn new(eye: &Eye, columns: usize) -> Self {
        Self {
            columns,
            pixels: Aligned::zeros(CHUNK * eye.image_len()),
            activations: eye.layers().iter().map(|layer| Aligned::zeros(columns * layer.output.len())).collect(),
            deltas: Vec::new(),
            products: Vec::new(),
            sums: Vec::new(),
        }
    }

    fn prepare_backward(&mut self, eye: &Eye) {
        let layers = eye.layers();
        if self.deltas.is_empty() {
            let samples = |index: usize| if index + 2 < layers.len() { CHUNK } else { self.columns };
            let deltas = layers.iter().enumerate();
            self.deltas =
                deltas.map(|(index, layer)| Aligned::zeros(samples(index) * layer.output.len())).collect();
            let convolutions = layers[..layers.len() - 1].iter();
            self.products =
                convolutions.map(|layer| Aligned::zeros(layer.patch().len() * layer.output.stored)).collect();
            self.sums = layers.iter().map(|layer| Aligned::zeros(layer.output.stored)).collect();
        }
        for sums in self.products.iter_mut().chain(&mut self.sums) {
            sums.fill(0.0);
        }
    }
}

impl Eye {
    /// Evaluates a tile of images, `[columns][rows][columns of pixels][channels]`, and writes their features,
    /// `[features][columns]`.
    ///
    /// The bits of a sample's features do not depend on the other samples or on how many they are.
    ///
    /// # Panics
    /// When a slice is not of this shape or weights or workspace are of another eye.
    pub fn forward(
        &self,
        weights: &EyeWeights,
        images: &[u8],
        workspace: &mut EyeWorkspace,
        features: &mut [f32],
    ) {
        let EyeWorkspace { columns, pixels, activations, .. } = workspace;
        assert_eq!(images.len(), self.image_len() * *columns, "a tile has an image for each column");
        assert_eq!(features.len(), self.features() * *columns, "a tile has a row for each feature");
        let (dense, convolutions) = self.layers().split_last().expect("an eye ends with a dense layer");
        for (chunk, images) in images.chunks(CHUNK * self.image_len()).enumerate() {
            let pixels = &mut pixels[..images.len()];
            dispatch(Normalise { bytes: images, values: pixels });
            let samples = chunk * CHUNK..chunk * CHUNK + images.len() / self.image_len();
            let mut inputs: &[f32] = pixels;
            for (layer, (weights, outputs)) in
                convolutions.iter().zip(weights.layers.iter().zip(&mut *activations))
            {
                let outputs = &mut outputs[samples.start * layer.output.len()..samples.end * layer.output.len()];
                layer.convolve(weights, inputs, outputs);
                inputs = outputs;
            }
        }
        let last = convolutions.len();
        let (before, behind) = activations.split_at_mut(last);
        dense.convolve(&weights.layers[last], &before[last - 1], &mut behind[0]);
        features.fill(0.0);
        add_transposed(&behind[0], dense.output, &(0..*columns).collect::<Vec<usize>>(), features);
    }

    /// Adds the parameters' gradient of a tile to `gradient`, from the loss gradient of the features, `[features]
    /// [columns]`, after [`Self::forward`] of the same images.
    ///
    /// A tile's own gradient is summed up over its samples and their pixels in order, then added.
    ///
    /// # Panics
    /// When a slice is not of this shape or weights or workspace are of another eye.
    pub fn backward(
        &self,
        weights: &EyeWeights,
        images: &[u8],
        workspace: &mut EyeWorkspace,
        feature_deltas: &[f32],
        gradient: &mut [f32],
    ) {
        assert_eq!(images.len(), self.image_len() * workspace.columns, "a tile has an image for each column");
        assert_eq!(gradient.len(), self.parameter_count(), "a gradient has a value for each parameter");
        workspace.prepare_backward(self);
        let dense_gradient = self.parameter_count() - self.layers()[self.layers().len() - 1].parameter_count();
        self.backward_dense(weights, workspace, feature_deltas, &mut gradient[dense_gradient..]);
        for chunk in 0..workspace.columns.div_ceil(CHUNK) {
            let len = CHUNK * self.image_len();
            let images = &images[chunk * len..images.len().min((chunk + 1) * len)];
            self.backward_chunk(weights, (chunk, images), workspace);
        }
        self.add_sums(workspace, gradient);
    }

    /// Of the last layer, for the whole tile.
    fn backward_dense(
        &self,
        weights: &EyeWeights,
        workspace: &mut EyeWorkspace,
        feature_deltas: &[f32],
        gradient: &mut [f32],
    ) {
        let EyeWorkspace { columns, activations, deltas, sums, .. } = workspace;
        let last = self.layers().len() - 1;
        let dense = &self.layers()[last];
        assert_eq!(feature_deltas.len(), self.features() * *columns, "a tile has a row for each feature");
        let (below, deltas) = deltas.split_at_mut(last);
        let deltas = &mut deltas[0];
        write_transposed(feature_deltas, *columns, dense.output, deltas);
        dispatch(ReluDerivative { outputs: &activations[last], deltas });
        let inputs = &activations[last - 1];
        dense.add_deltas(deltas, &mut sums[last]);
        dense.add_dense(inputs, deltas, gradient);
        dense.spread(&weights.layers[last], deltas, inputs, &mut below[last - 1]);
    }

    /// Of the convolutions, for the samples of a chunk.
    fn backward_chunk(&self, weights: &EyeWeights, (chunk, images): (usize, &[u8]), workspace: &mut EyeWorkspace) {
        let EyeWorkspace { pixels, activations, deltas, products, sums, .. } = workspace;
        let samples = chunk * CHUNK..chunk * CHUNK + images.len() / self.image_len();
        let pixels = &mut pixels[..images.len()];
        dispatch(Normalise { bytes: images, values: pixels });
        let of_chunk = |len: usize| samples.start * len..samples.end * len;
        let convolutions = &self.layers()[..self.layers().len() - 1];
        for (index, layer) in convolutions.iter().enumerate().rev() {
            let (below, deltas) = deltas.split_at_mut(index);
            let output = layer.output.len();
            let is_last = index + 1 == convolutions.len();
            let range = if is_last { of_chunk(output) } else { 0..samples.len() * output };
            let deltas = &deltas[0][range];
            layer.add_deltas(deltas, &mut sums[index]);
            let Some(below) = below.last_mut() else {
                layer.add_products(pixels, deltas, &mut products[0]);
                continue;
            };
            let inputs = &activations[index - 1][of_chunk(layer.input.len())];
            layer.add_products(inputs, deltas, &mut products[index]);
            layer.spread(&weights.layers[index], deltas, inputs, &mut below[..inputs.len()]);
        }
    }

    /// What a tile added up in an order of its own, into the order of the parameters.
    fn add_sums(&self, workspace: &EyeWorkspace, gradient: &mut [f32]) {
        let mut rest = gradient;
        for (index, (layer, sums)) in self.layers().iter().zip(&workspace.sums).enumerate() {
            let (weights, left) = rest.split_at_mut(layer.weight_count());
            let (biases, left) = left.split_at_mut(layer.output.channels);
            if let Some(products) = workspace.products.get(index) {
                add_transposed(products, layer.output, &layer.weight_places(), weights);
            }
            for (bias, sum) in biases.iter_mut().zip(&sums[..]) {
                *bias += sum;
            }
            rest = left;
        }
    }
}

/// `sums[channel][i] += values[places[i]][channel]`, where `values` has rows of stored channels.
///
/// As many channels at a time as one cache line holds: it is read once, and there are as many lines to write to.
fn add_transposed(values: &[f32], Grid { channels, stored, .. }: Grid, places: &[usize], sums: &mut [f32]) {
    let len = sums.len() / channels;
    for (block, sums) in sums.chunks_mut(LANES * len).enumerate() {
        for (index, place) in places.iter().enumerate() {
            let line = &values[*place * stored + block * LANES..][..LANES];
            for (sum, value) in sums[index..].iter_mut().step_by(len).zip(line) {
                *sum += value;
            }
        }
    }
}

/// `rows[column][channel] = values[channel][column]`.
fn write_transposed(values: &[f32], columns: usize, Grid { stored, .. }: Grid, rows: &mut [f32]) {
    for (block, values) in values.chunks(LANES * columns).enumerate() {
        for (column, row) in rows.chunks_exact_mut(stored).enumerate() {
            let line = &mut row[block * LANES..][..LANES];
            for (place, value) in line.iter_mut().zip(values[column..].iter().step_by(columns)) {
                *place = *value;
            }
        }
    }
}
