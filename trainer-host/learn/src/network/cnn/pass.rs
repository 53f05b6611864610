//! A slice's way through a CNN, forward and backward.

use std::ops::Range;

use super::super::aligned::Aligned;
use super::super::kernel::{AddRowSums, dispatch};
use super::convolution::ReluDerivative;
use super::layer::Layer;
use super::pixels::Normalise;
use super::transposition::{add_transposed, write_transposed};
use super::workspace::{BackwardWorkspace, CHUNK, CnnWorkspace};
use super::{Cnn, CnnWeights};

impl Cnn {
    /// Evaluates a slice of `images [samples][rows][columns][channels]` and writes its `features [features][samples]`,
    /// for as many samples as the workspace has columns.
    ///
    /// The bits of a sample's features depend neither on the other samples nor on how many they are.
    ///
    /// # Panics
    /// When a slice is not of this shape, or weights or workspace are of another CNN.
    pub fn forward(
        &self,
        weights: &CnnWeights,
        images: &[u8],
        workspace: &mut CnnWorkspace,
        features: &mut [f32],
    ) {
        let columns = workspace.columns;
        self.check(images, features, columns);
        let CnnWorkspace { pixels, activations, features: kept, .. } = workspace;
        let (dense, convolutions) = self.dense_and_convolutions();
        for (chunk, images) in images.chunks(CHUNK * self.image_len()).enumerate() {
            let mut inputs: &[f32] = normalise(images, pixels);
            for (layer, (weights, outputs)) in
                convolutions.iter().zip(weights.layers.iter().zip(&mut *activations))
            {
                let range = of_chunk(chunk, layer.output.len(), outputs.len());
                let outputs = &mut outputs[range];
                layer.convolve(weights, inputs, outputs);
                inputs = outputs;
            }
        }
        let (before, behind) = activations.split_at_mut(convolutions.len());
        dense.convolve(&weights.layers[before.len()], &before[before.len() - 1], &mut behind[0]);
        kept.fill(0.0);
        add_transposed(&behind[0], dense.output, &(0..columns).collect::<Vec<usize>>(), kept);
        features.copy_from_slice(kept);
    }

    /// Adds the parameters' gradient of a slice to `gradient`, from the loss gradient of its features, `feature_deltas
    /// [features][samples]`, after [`Self::forward`] of the same images with the same weights.
    ///
    /// The gradient of a slice is summed up over its samples and their pixels in their order, then added.
    ///
    /// # Panics
    /// When a slice is not of this shape, or weights or workspace are of another CNN.
    pub fn backward(
        &self,
        weights: &CnnWeights,
        images: &[u8],
        workspace: &mut CnnWorkspace,
        feature_deltas: &[f32],
        gradient: &mut [f32],
    ) {
        let columns = workspace.columns;
        self.check(images, feature_deltas, columns);
        assert_eq!(gradient.len(), self.parameter_count(), "a gradient has a value for each parameter");
        let CnnWorkspace { pixels, activations, features, backward, .. } = workspace;
        let backward = backward.get_or_insert_with(|| BackwardWorkspace::new(self, columns));
        backward.feature_deltas.copy_from_slice(feature_deltas);
        dispatch(ReluDerivative { outputs: features, deltas: &mut backward.feature_deltas });
        let (dense, _) = self.dense_and_convolutions();
        let (convolution_gradient, dense_gradient) =
            gradient.split_at_mut(self.parameter_count() - dense.parameter_count());
        self.backward_dense(weights, activations, backward, dense_gradient);
        for sums in backward.products.iter_mut().chain(&mut backward.sums) {
            sums.fill(0.0);
        }
        for (chunk, images) in images.chunks(CHUNK * self.image_len()).enumerate() {
            let pixels = normalise(images, pixels);
            self.backward_chunk(weights, (chunk, pixels), activations, backward);
        }
        self.add_sums(backward, convolution_gradient);
    }

    fn check(&self, images: &[u8], features: &[f32], columns: usize) {
        assert_eq!(images.len(), self.image_len() * columns, "a slice has an image for each column");
        assert_eq!(features.len(), self.features() * columns, "a slice has a row for each feature");
    }

    fn dense_and_convolutions(&self) -> (&Layer, &[Layer]) {
        self.layers().split_last().expect("a CNN ends with a dense layer")
    }

    /// Of the last layer, for the whole slice.
    fn backward_dense(
        &self,
        weights: &CnnWeights,
        activations: &[Aligned],
        backward: &mut BackwardWorkspace,
        gradient: &mut [f32],
    ) {
        let (dense, convolutions) = self.dense_and_convolutions();
        let last = convolutions.len();
        let BackwardWorkspace { feature_deltas, deltas, .. } = backward;
        let columns = feature_deltas.len() / self.features();
        let (weight_gradient, bias_gradient) = gradient.split_at_mut(dense.weight_count());
        dispatch(AddRowSums { rows: feature_deltas, columns, sums: bias_gradient });
        let inputs = &activations[last - 1];
        dense.add_dense(inputs, feature_deltas, weight_gradient);
        let (below, deltas) = deltas.split_at_mut(last);
        write_transposed(feature_deltas, columns, dense.output, &mut deltas[0]);
        dense.spread(&weights.layers[last], &deltas[0], inputs, &mut below[last - 1]);
    }

    /// Of the convolutions, for the samples of a chunk.
    fn backward_chunk(
        &self,
        weights: &CnnWeights,
        (chunk, pixels): (usize, &[f32]),
        activations: &[Aligned],
        backward: &mut BackwardWorkspace,
    ) {
        let BackwardWorkspace { deltas, products, sums, .. } = backward;
        let (_, convolutions) = self.dense_and_convolutions();
        let samples = pixels.len() / self.image_len();
        for (index, layer) in convolutions.iter().enumerate().rev() {
            let output = samples * layer.output.len();
            let (below, deltas) = deltas.split_at_mut(index);
            // Behind the last convolution are those of the whole slice.
            let first = if index + 1 == convolutions.len() { chunk * CHUNK * layer.output.len() } else { 0 };
            let deltas = &deltas[0][first..first + output];
            layer.add_deltas(deltas, &mut sums[index]);
            let Some(below) = below.last_mut() else {
                return layer.add_products(pixels, deltas, &mut products[index]);
            };
            let inputs = &activations[index - 1];
            let inputs = &inputs[of_chunk(chunk, layer.input.len(), inputs.len())];
            layer.add_products(inputs, deltas, &mut products[index]);
            layer.spread(&weights.layers[index], deltas, inputs, &mut below[..inputs.len()]);
        }
    }

    /// What a slice added up in an order of its own, into the order of the parameters.
    fn add_sums(&self, backward: &BackwardWorkspace, gradient: &mut [f32]) {
        let (_, convolutions) = self.dense_and_convolutions();
        let mut rest = gradient;
        for (layer, (products, sums)) in convolutions.iter().zip(backward.products.iter().zip(&backward.sums)) {
            let (weights, left) = rest.split_at_mut(layer.weight_count());
            let (biases, left) = left.split_at_mut(layer.output.channels);
            add_transposed(products, layer.output, &layer.weight_places(), weights);
            for (bias, sum) in biases.iter_mut().zip(&sums[..]) {
                *bias += sum;
            }
            rest = left;
        }
    }
}

/// What the network sees of a chunk's images.
fn normalise<'p>(images: &[u8], pixels: &'p mut Aligned) -> &'p [f32] {
    let pixels = &mut pixels[..images.len()];
    dispatch(Normalise { bytes: images, values: pixels });
    pixels
}

/// Where the values of a chunk's samples lie, if each has so many and there are so many in all.
fn of_chunk(chunk: usize, len: usize, all: usize) -> Range<usize> {
    chunk * CHUNK * len..all.min((chunk + 1) * CHUNK * len)
}
