//! The numbers of a policy file, layer by layer.

use kestrel_core::activation::Activation;
use kestrel_core::mlp::DenseLayer;
use kestrel_core::policy_file::{PolicyFile, RecurrentPolicy};

/// A dense layer, `y = W x + b`.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Columns.
    pub inputs: usize,
    /// Rows.
    pub outputs: usize,
    /// `[outputs][inputs]`.
    pub weights: Vec<f32>,
    /// `[outputs]`.
    pub biases: Vec<f32>,
}

impl Layer {
    /// The layers from the observation, and the hidden state behind it where there is one, to the action; in fixed point as
    /// they were rounded.
    pub fn of_network(network: &PolicyFile<'_>) -> Vec<Self> {
        let layer = |(index, shape)| {
            let weight = |row, column| network.weight(index, row, column);
            Self::read(shape, weight, |row| network.bias(index, row))
        };
        network.shapes().enumerate().map(layer).collect()
    }

    /// Gates and candidate of a recurrent policy, which [`kestrel_core::gru`] defines.
    pub fn of_memory(policy: &RecurrentPolicy<'_>) -> [Self; 2] {
        let inputs = policy.metadata().observation.len() + policy.units();
        [(0, 2 * policy.units()), (1, policy.units())].map(|(index, outputs)| {
            let weight = |row, column| policy.memory().weight(index, row, column);
            Self::read((inputs, outputs), weight, |row| policy.memory().bias(index, row))
        })
    }

    /// The same layer, borrowed, with what follows it.
    pub fn dense(&self, activation: Activation) -> DenseLayer<'_> {
        let Self { inputs, outputs, ref weights, ref biases } = *self;
        DenseLayer { inputs, outputs, weights, bias: biases, activation }
    }

    fn read(
        (inputs, outputs): (usize, usize),
        weight: impl Fn(usize, usize) -> f32,
        bias: impl Fn(usize) -> f32,
    ) -> Self {
        let places = (0..outputs).flat_map(|row| (0..inputs).map(move |column| (row, column)));
        let weights = places.map(|(row, column)| weight(row, column)).collect();
        Self { inputs, outputs, weights, biases: (0..outputs).map(bias).collect() }
    }
}
