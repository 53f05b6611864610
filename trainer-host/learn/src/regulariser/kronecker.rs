//! The Fisher information of a policy, one product of two matrices per layer (Martens & Grosse 2015, K-FAC).
//!
//! A diagonal says how much each weight matters alone. But weights of a layer act together: a change that the layer's
//! inputs never excite costs nothing, however much every single weight would. The information of a layer's weights is
//! the expectation of `δδᵀ ⊗ aaᵀ` with its inputs `a` (and a one, for the biases) and the sensitivities `δ` of the action
//! to its sums; the product of the two expectations stands for it.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use serde::{Deserialize, Serialize};

use super::curvature::for_each_tile;
use super::{REFERENCE_STD, Visited};
use crate::actor_critic::Actor;
use crate::network::{Mlp, SampleMatrix};

/// Share of their mean that is added to the diagonals. Without, a policy slides along what costs nothing to the first
/// order until the higher orders cost it everything: after a second furnished room 0.001 nat were predicted and 0.5 to 2
/// found. Sensitivities need much of it, because a unit that the action does not depend on today may matter once other
/// weights have moved; what inputs never excite stays free.
const OUTGOING_DAMPING: f32 = 1.0;
const INCOMING_DAMPING: f32 = 0.01;

/// What all tasks so far need of every layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Kronecker {
    layers: Vec<Factors>,
}

/// What they need of one layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Factors {
    /// `E aaᵀ`, `[inputs + 1][inputs + 1]`; the last is the one for the biases.
    incoming: Square,
    /// `E Σ δδᵀ / σ²` over the values of the action, `[outputs][outputs]`.
    outgoing: Square,
}

/// A symmetric matrix.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Square {
    size: usize,
    values: Vec<f32>,
}

impl Kronecker {
    /// Of no task.
    pub(super) fn new(mlp: &Mlp) -> Self {
        let factors =
            |pair: &[usize]| Factors { incoming: Square::zero(pair[0] + 1), outgoing: Square::zero(pair[1]) };
        Self { layers: mlp.widths().windows(2).map(factors).collect() }
    }

    /// Of the policy's mean at [`REFERENCE_STD`] \[nat\], exact in the action.
    pub(super) fn measured(actor: &Actor, visited: &[Visited<'_>]) -> Self {
        let mut sum = Self::new(actor.mlp());
        let samples = for_each_tile(actor, visited, |inputs, workspace| {
            for output in 0..actor.action_len() {
                let (_, deltas) = workspace.output_delta();
                deltas.fill(0.0);
                let columns = deltas.len() / actor.action_len();
                deltas[output * columns..(output + 1) * columns].fill(1.0);
                actor.mlp().backward_layers(actor.parameters(), inputs, workspace, |index, deltas, inputs| {
                    let Factors { incoming, outgoing } = &mut sum.layers[index];
                    outgoing.add_products(&deltas.by_sample_values());
                    if output == 0 {
                        incoming.add_products(&with_one(&inputs));
                    }
                });
            }
        });
        let share = 1.0 / samples as f32;
        for Factors { incoming, outgoing } in &mut sum.layers {
            incoming.scale(share);
            outgoing.scale(share / (REFERENCE_STD * REFERENCE_STD));
        }
        sum
    }

    /// Numbers that are kept.
    pub(super) fn len(&self) -> usize {
        self.layers.iter().map(|layer| layer.incoming.values.len() + layer.outgoing.values.len()).sum()
    }

    /// Mean over all parameters of the diagonal.
    pub(super) fn mean(&self) -> f32 {
        let trace = |layer: &Factors| layer.incoming.trace() * layer.outgoing.trace();
        let count = |layer: &Factors| layer.incoming.size * layer.outgoing.size;
        self.layers.iter().map(trace).sum::<f32>() / self.layers.iter().map(count).sum::<usize>() as f32
    }

    /// Takes in the `newest` of so many tasks, divided by its mean, after earlier ones have faded by `decay`.
    ///
    /// A sum of products is no product: inputs, which differ from task to task, are summed, sensitivities averaged.
    pub(super) fn add(&mut self, newest: &Self, tasks: u32, decay: f32) {
        let unit = newest.mean().max(f32::MIN_POSITIVE);
        let share = 1.0 / tasks as f32;
        for (sum, newest) in self.layers.iter_mut().zip(&newest.layers) {
            sum.incoming.blend(decay, &newest.incoming.levelled(INCOMING_DAMPING), 1.0);
            sum.outgoing.blend(1.0 - share, &newest.outgoing.levelled(OUTGOING_DAMPING), share / unit);
        }
    }

    /// The information times a displacement of the parameters, in their layout.
    pub(super) fn times(&self, displacement: &[f32]) -> Vec<f32> {
        let mut product = Vec::with_capacity(displacement.len());
        let mut rest = displacement;
        for layer in &self.layers {
            let (of_layer, others) = rest.split_at(layer.incoming.size * layer.outgoing.size);
            layer.append_product(of_layer, &mut product);
            rest = others;
        }
        product
    }
}

/// Each sample of a slice with a one behind it, `[columns][features + 1]`.
fn with_one(inputs: &SampleMatrix<'_>) -> Vec<f32> {
    let samples = inputs.by_sample_values();
    samples.chunks_exact(inputs.features()).flat_map(|sample| sample.iter().chain([&1.0]).copied()).collect()
}

impl Factors {
    /// `outgoing · D · incoming` with the displacements of weights and biases side by side.
    fn append_product(&self, displacement: &[f32], product: &mut Vec<f32>) {
        let (rows, columns) = (self.outgoing.size, self.incoming.size);
        let (weights, biases) = displacement.split_at(rows * (columns - 1));
        let joined = weights.chunks_exact(columns - 1).zip(biases);
        let joined: Vec<f32> = joined.flat_map(|(row, bias)| row.iter().chain([bias]).copied()).collect();
        let joined = MatRef::from_row_major_slice(&joined, rows, columns);
        let mut half = vec![0.0; rows * columns];
        let half_mut = MatMut::from_row_major_slice_mut(&mut half, rows, columns);
        matmul(half_mut, Accum::Replace, self.outgoing.view(), joined, 1.0, Par::Seq);
        let mut whole = vec![0.0; rows * columns];
        let whole_mut = MatMut::from_row_major_slice_mut(&mut whole, rows, columns);
        let half = MatRef::from_row_major_slice(&half, rows, columns);
        matmul(whole_mut, Accum::Replace, half, self.incoming.view(), 1.0, Par::Seq);
        for row in whole.chunks_exact(columns) {
            product.extend_from_slice(&row[..columns - 1]);
        }
        product.extend(whole.chunks_exact(columns).map(|row| row[columns - 1]));
    }
}

impl Square {
    fn zero(size: usize) -> Self {
        Self { size, values: vec![0.0; size * size] }
    }

    fn view(&self) -> MatRef<'_, f32> {
        MatRef::from_row_major_slice(&self.values, self.size, self.size)
    }

    fn trace(&self) -> f32 {
        self.values.iter().step_by(self.size + 1).sum()
    }

    fn scale(&mut self, factor: f32) {
        self.values.iter_mut().for_each(|value| *value *= factor);
    }

    /// As if so much of the mean of the diagonal were added to all of it, with the trace unchanged.
    fn levelled(&self, share: f32) -> Self {
        let mut levelled = self.clone();
        let mean = self.trace() / self.size as f32;
        for (index, value) in levelled.values.iter_mut().enumerate() {
            let own = if index % (self.size + 1) == 0 { *value + share * mean } else { *value };
            *value = own / (1.0 + share);
        }
        levelled
    }

    fn blend(&mut self, own: f32, other: &Self, share: f32) {
        for (value, other) in self.values.iter_mut().zip(&other.values) {
            *value = own * *value + share * other;
        }
    }

    /// Adds `x xᵀ` of every sample of `samples [columns][size]`.
    fn add_products(&mut self, samples: &[f32]) {
        let samples = MatRef::from_row_major_slice(samples, samples.len() / self.size, self.size);
        let sum = MatMut::from_row_major_slice_mut(&mut self.values, self.size, self.size);
        matmul(sum, Accum::Add, samples.transpose(), samples, 1.0, Par::Seq);
    }
}
