//! The parameters of a CNN in the order in which its products read them.

use rayon::prelude::*;

use super::super::aligned::Aligned;
use super::super::kernel::{LANES, STRIPE};
use super::Cnn;
use super::layer::{Layer, pieces};

/// The parameters of a CNN, arranged for [`Cnn::forward`] and [`Cnn::backward`]; all threads may read the same.
///
/// They are arranged once for all slices between two changes of the parameters, because that costs as much as a few
/// samples.
#[derive(Clone, Debug)]
pub struct CnnWeights {
    pub(super) layers: Vec<LayerWeights>,
}

/// The parameters of one layer; what is stored but not a weight is zero.
#[derive(Clone, Debug)]
pub(super) struct LayerWeights {
    /// Stripe of filters after stripe, `[patch][stripe]`.
    forward: Aligned,
    /// Stripe of the patch after stripe, segment by segment, `[filters][stripe]`; not of the first layer, behind which
    /// there is nothing to train.
    backward: Aligned,
    /// `[filters]`.
    pub(super) biases: Aligned,
}

impl CnnWeights {
    pub(super) fn new(cnn: &Cnn, parameters: &[f32]) -> Self {
        let layers = cnn.layers().iter().enumerate();
        let mut weights =
            Self { layers: layers.map(|(index, layer)| LayerWeights::zeros(index, layer)).collect() };
        weights.arrange(cnn, parameters);
        weights
    }

    /// Takes changed parameters of the same CNN.
    ///
    /// # Panics
    /// When they are not as many as the CNN's.
    pub fn arrange(&mut self, cnn: &Cnn, parameters: &[f32]) {
        assert_eq!(parameters.len(), cnn.parameter_count(), "a CNN has so many parameters");
        let mut rest = parameters;
        let mut layers = Vec::new();
        for (arranged, layer) in self.layers.iter_mut().zip(cnn.layers()) {
            let (own, left) = rest.split_at(layer.parameter_count());
            layers.push((arranged, layer, own));
            rest = left;
        }
        layers.into_par_iter().for_each(|(arranged, layer, parameters)| arranged.arrange(layer, parameters));
    }
}

impl LayerWeights {
    fn zeros(index: usize, layer: &Layer) -> Self {
        let stored = layer.patch().len() * layer.output.stored;
        Self {
            forward: Aligned::zeros(stored),
            backward: Aligned::zeros(if index == 0 { 0 } else { stored }),
            biases: Aligned::zeros(layer.output.stored),
        }
    }

    fn arrange(&mut self, layer: &Layer, parameters: &[f32]) {
        let (weights, biases) = parameters.split_at(layer.weight_count());
        self.biases[..biases.len()].copy_from_slice(biases);
        let places = layer.weight_places();
        let len = layer.patch().len();
        let mut patches = vec![0.0; LANES * len];
        for (block, weights) in weights.chunks(LANES * layer.inputs()).enumerate() {
            let filters = weights.len() / layer.inputs();
            for (patch, weights) in patches.chunks_exact_mut(len).zip(weights.chunks_exact(layer.inputs())) {
                for (place, weight) in places.iter().zip(weights) {
                    patch[*place] = *weight;
                }
            }
            let patches = &patches[..filters * len];
            self.arrange_forward(layer, block * LANES, patches);
            if !self.backward.is_empty() {
                for (filter, patch) in (block * LANES..).zip(patches.chunks_exact(len)) {
                    self.arrange_backward(layer, filter, patch);
                }
            }
        }
    }

    /// Of at most [`LANES`] filters from one on, whose weights then share cache lines.
    fn arrange_forward(&mut self, layer: &Layer, first: usize, patches: &[f32]) {
        let len = self.forward.len() / layer.output.stored;
        let stripe = first / STRIPE * STRIPE;
        let width = STRIPE.min(layer.output.stored - stripe);
        let lines = self.forward[len * stripe + first - stripe..].chunks_mut(width);
        for (place, line) in lines.take(len).enumerate() {
            for (value, weight) in line.iter_mut().zip(patches[place..].iter().step_by(len)) {
                *value = *weight;
            }
        }
    }

    fn arrange_backward(&mut self, layer: &Layer, filter: usize, patch: &[f32]) {
        let mut from = 0;
        for (_, len) in layer.segments() {
            for stripe in pieces(len, STRIPE) {
                let width = stripe.len();
                self.backward[from * layer.output.stored + filter * width..][..width]
                    .copy_from_slice(&patch[from..from + width]);
                from += width;
            }
        }
    }

    /// Weights of a stripe of filters, `[patch][width]`.
    pub(super) fn forward_stripe(&self, layer: &Layer, stripe: &std::ops::Range<usize>) -> &[f32] {
        let patch = self.forward.len() / layer.output.stored;
        &self.forward[patch * stripe.start..patch * stripe.end]
    }

    /// Each stripe of the patch: where it lies behind the first value, and its weights, `[filters][width]`.
    pub(super) fn backward_stripes(&self, layer: &Layer) -> impl Iterator<Item = (usize, &[f32])> {
        let stripes = layer.segments().flat_map(|(offset, len)| {
            pieces(len, STRIPE).map(move |stripe| (offset + stripe.start, stripe.len()))
        });
        let filters = layer.output.stored;
        let mut rest = &self.backward[..];
        stripes.map(move |(offset, width)| {
            let (stripe, left) = rest.split_at(filters * width);
            rest = left;
            (offset, stripe)
        })
    }
}
