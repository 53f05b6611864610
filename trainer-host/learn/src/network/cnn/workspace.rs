//! The place where a slice of images is evaluated and differentiated.

use super::super::aligned::Aligned;
use super::Cnn;
use super::layer::Layer;

/// Samples that pass all convolutions together: their values stay in the second-level cache.
pub(super) const CHUNK: usize = 8;

/// What a slice leaves behind on its way through a CNN, and the loss gradients on the way back.
#[derive(Clone, Debug)]
pub struct CnnWorkspace {
    pub(super) columns: usize,
    /// Of a chunk, `[CHUNK][rows][columns][channels]`.
    pub(super) pixels: Aligned,
    /// Per layer, `[columns][output]`.
    pub(super) activations: Vec<Aligned>,
    /// `[features][columns]`.
    pub(super) features: Vec<f32>,
    /// Empty until the first backward pass.
    pub(super) backward: Option<BackwardWorkspace>,
}

/// The loss gradients of a slice.
#[derive(Clone, Debug)]
pub(super) struct BackwardWorkspace {
    /// Of the last layer's sums, `[features][columns]`.
    pub(super) feature_deltas: Vec<f32>,
    /// Per layer, of the sums before the activation function: `[CHUNK][output]`, and `[columns][output]` of the last
    /// two layers.
    pub(super) deltas: Vec<Aligned>,
    /// Per convolution, what the slice adds to its weights' gradient, `[patch][output channels]`.
    pub(super) products: Vec<Aligned>,
    /// Per convolution, what the slice adds to its biases' gradient, `[output channels]`.
    pub(super) sums: Vec<Aligned>,
}

impl CnnWorkspace {
    /// For slices of `columns` samples.
    pub fn new(cnn: &Cnn, columns: usize) -> Self {
        Self {
            columns,
            pixels: Aligned::zeros(CHUNK * cnn.image_len()),
            activations: cnn.layers().iter().map(|layer| Aligned::zeros(columns * layer.output.len())).collect(),
            features: vec![0.0; cnn.features() * columns],
            backward: None,
        }
    }
}

impl BackwardWorkspace {
    pub(super) fn new(cnn: &Cnn, columns: usize) -> Self {
        let layers = cnn.layers();
        let samples = |index: usize| if index + 2 < layers.len() { CHUNK } else { columns };
        let deltas = |(index, layer): (usize, &Layer)| Aligned::zeros(samples(index) * layer.output.len());
        let convolutions = &layers[..layers.len() - 1];
        let products = |layer: &Layer| Aligned::zeros(layer.patch().len() * layer.output.stored);
        Self {
            feature_deltas: vec![0.0; cnn.features() * columns],
            deltas: layers.iter().enumerate().map(deltas).collect(),
            products: convolutions.iter().map(products).collect(),
            sums: convolutions.iter().map(|layer| Aligned::zeros(layer.output.stored)).collect(),
        }
    }
}
