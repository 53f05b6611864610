//! How much a policy's behaviour depends on each of its parameters.

use super::{REFERENCE_STD, Visited};
use crate::actor_critic::Actor;
use crate::network::Workspace;

/// Samples that are enough: estimates of a diagonal from twice as many differ by about a percent.
const SAMPLES: usize = 32_768;

/// Diagonal of the Fisher information \[nat\] of the policy's mean at [`REFERENCE_STD`], exact in the action:
/// `E Σ (∂μ_k/∂θ)² / σ²`, without the parameters of the standard deviation.
pub(super) fn fisher(actor: &Actor, visited: &[Visited<'_>]) -> Vec<f32> {
    let weight = 1.0 / (REFERENCE_STD * REFERENCE_STD);
    let outputs = actor.action_len();
    let mut sum = vec![0.0; actor.mlp().parameter_count()];
    let samples = for_each_tile(actor, visited, |inputs, workspace| {
        for output in 0..outputs {
            let (_, deltas) = workspace.output_delta();
            deltas.fill(0.0);
            let columns = deltas.len() / outputs;
            deltas[output * columns..(output + 1) * columns].fill(1.0);
            let square = |value: f32| value * value;
            actor.mlp().backward_sizes(actor.parameters(), inputs, workspace, square, &mut sum);
        }
    });
    scaled(sum, weight / samples as f32)
}

/// Sensitivity of the squared length of the mean action, `E |∂‖μ‖²/∂θ|` (Aljundi et al. 2018, memory aware synapses).
pub(super) fn sensitivity(actor: &Actor, visited: &[Visited<'_>]) -> Vec<f32> {
    let mut sum = vec![0.0; actor.mlp().parameter_count()];
    let samples = for_each_tile(actor, visited, |inputs, workspace| {
        let (means, deltas) = workspace.output_delta();
        for (delta, mean) in deltas.iter_mut().zip(means) {
            *delta = 2.0 * mean;
        }
        actor.mlp().backward_sizes(actor.parameters(), inputs, workspace, f32::abs, &mut sum);
    });
    scaled(sum, 1.0 / samples as f32)
}

/// Runs the network on evenly spread slices; returns the number of samples.
pub(super) fn for_each_tile(
    actor: &Actor,
    visited: &[Visited<'_>],
    mut visit: impl FnMut(&[f32], &mut Workspace),
) -> usize {
    let slices: usize = visited.iter().map(|batch| batch.slices.len()).sum();
    let columns = visited[0].columns;
    let stride = (slices * columns).div_ceil(SAMPLES).max(1);
    let mut workspace = Workspace::new(actor.mlp(), columns);
    let mut samples = 0;
    for slice in visited.iter().flat_map(|batch| &batch.slices).step_by(stride) {
        let inputs = &slice[..actor.mlp().inputs() * columns];
        actor.mlp().forward(actor.parameters(), inputs, &mut workspace);
        visit(inputs, &mut workspace);
        samples += columns;
    }
    samples
}

fn scaled(mut values: Vec<f32>, factor: f32) -> Vec<f32> {
    for value in &mut values {
        *value *= factor;
    }
    values
}
