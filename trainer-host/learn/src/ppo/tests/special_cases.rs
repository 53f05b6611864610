//! Actor-critic and REINFORCE are PPO with one gradient step for each rollout.

use super::*;
use crate::regulariser::{
    Coupling, Curvature, GradientTerm, Learning, QuadraticSettings, RegulariserSettings, Strength,
};

/// One epoch of one minibatch: the whole rollout.
fn one_step() -> PpoSettings {
    let settings = settings();
    PpoSettings { epochs: 1, minibatch: settings.batch(), entropy_weight: 0.0, ..settings }
}

/// `gae_lambda` of advantage actor-critic, as Stable-Baselines3 would have it, and of REINFORCE.
const LAMBDAS: [f32; 2] = [0.95, 1.0];

#[test]
fn the_clip_range_has_no_influence_on_a_bit() {
    let run = |gae_lambda: f32, clip_range: f32| {
        let settings = PpoSettings { gae_lambda, clip_range, ..one_step() };
        let mut trainer = Trainer::new(&[task(true)], &settings, Seed(21));
        (0..3).for_each(|_| drop(trainer.update()));
        trainer.save()
    };
    for gae_lambda in LAMBDAS {
        let reference = run(gae_lambda, 0.2);
        for clip_range in [1e-6, 1e6] {
            assert_eq!(run(gae_lambda, clip_range), reference, "clipped at {clip_range}");
        }
    }
    assert_ne!(run(LAMBDAS[0], 0.2), run(LAMBDAS[1], 0.2));
}

#[test]
fn the_gradient_of_an_update_is_the_policy_gradient() {
    for gae_lambda in LAMBDAS {
        let settings = PpoSettings { gae_lambda, ..one_step() };
        let mut trainer = Trainer::new(&[task(true)], &settings, Seed(22));
        // Away from the small first actions; one more update moves the networks between the rollouts.
        trainer.update();
        trainer.collect();
        trainer.normalise_advantages();
        trainer.differentiate(&trainer.shuffled(0));
        let expected = policy_gradient(&trainer);
        let found = [trainer.gradient.actor.as_slice(), &trainer.gradient.critic].concat();
        assert_eq!(found.len(), expected.len());
        let norm = expected.iter().map(|value| value * value).sum::<f64>().sqrt();
        assert!(norm > 1e-3, "the gradient is {norm} long");
        for (index, (found, expected)) in found.iter().zip(&expected).enumerate() {
            let error = (f64::from(*found) - expected).abs();
            assert!(error < 1e-5 * norm + 1e-4 * expected.abs(), "{index}: {found}, not {expected}");
        }
    }
}

/// Mean over all samples of −A ∇log π and the divergence from the teacher, then of the value term `value_weight`
/// ∇(V − return)², in `f64`.
pub(super) fn policy_gradient(trainer: &Trainer) -> Vec<f64> {
    let (mut actor, mut critic) = (Network::of(&trainer.actor), Network::of_critic(&trainer.critic));
    let mut log_std = vec![0.0; trainer.actor.action_len()];
    let std: Vec<f64> = trainer.actor.log_std().iter().map(|log_std| libm::exp(f64::from(*log_std))).collect();
    for rollout in trainer.env_batches.iter().map(EnvBatch::rollout) {
        for slice in (0..rollout.slices()).map(|slice| rollout.slice(slice)) {
            for index in 0..ENV_BATCH {
                let input = column(slice.batch.values, index);
                let (advantage, actions) = (f64::from(slice.advantages[index]), column(slice.actions, index));
                let means = actor.forward(&input[..trainer.actor.mlp().inputs()]);
                let deviations: Vec<f64> =
                    (0..std.len()).map(|row| (actions[row] - means[row]) / std[row]).collect();
                // ∂ log π / ∂ mean = deviation / σ, ∂ log π / ∂ log σ = deviation² − 1.
                let teacher_actions = column(slice.teacher_actions, index);
                let apart =
                    |row: usize| teacher_actions.get(row).map_or(0.0, |action| (means[row] - action) / std[row]);
                let gradient = |row: usize| {
                    (f64::from(trainer.imitation_weight) * apart(row) - advantage * deviations[row]) / std[row]
                };
                actor.backward((0..std.len()).map(gradient).collect());
                for (sum, deviation) in log_std.iter_mut().zip(&deviations) {
                    *sum -= advantage * (deviation * deviation - 1.0);
                }
                let error = critic.forward(&input)[0] - f64::from(slice.returns[index]);
                critic.backward(vec![f64::from(trainer.settings.value_weight) * 2.0 * error]);
            }
        }
    }
    let samples = trainer.settings.batch() as f64;
    [actor.gradient, log_std, critic.gradient].concat().into_iter().map(|sum| sum / samples).collect()
}

fn column(rows: &[f32], index: usize) -> Vec<f64> {
    rows.chunks_exact(ENV_BATCH).map(|row| f64::from(row[index])).collect()
}

/// A network and the sum of its gradients, one sample at a time.
struct Network {
    widths: Vec<usize>,
    parameters: Vec<f64>,
    gradient: Vec<f64>,
    /// What each layer read, and the output.
    values: Vec<Vec<f64>>,
}

impl Network {
    fn of(actor: &Actor) -> Self {
        Self::new(actor.mlp(), &actor.parameters()[..actor.mlp().parameter_count()])
    }

    fn of_critic(critic: &Critic) -> Self {
        Self::new(critic.mlp(), critic.parameters())
    }

    fn new(mlp: &Mlp, parameters: &[f32]) -> Self {
        let parameters: Vec<f64> = parameters.iter().copied().map(f64::from).collect();
        Self {
            widths: mlp.widths().to_vec(),
            gradient: vec![0.0; parameters.len()],
            parameters,
            values: Vec::new(),
        }
    }

    fn forward(&mut self, input: &[f64]) -> Vec<f64> {
        self.values = vec![input.to_vec()];
        let mut from = 0;
        for layer in 1..self.widths.len() {
            let (width, read) = (self.widths[layer], &self.values[layer - 1]);
            let (weights, biases) = self.parameters[from..].split_at(width * read.len());
            let sum = |(row, bias): (&[f64], &f64)| row.iter().zip(read).map(|(w, x)| w * x).sum::<f64>() + bias;
            let is_hidden = layer + 1 < self.widths.len();
            let squash = |sum: f64| if is_hidden { libm::tanh(sum) } else { sum };
            let values = weights.chunks_exact(read.len()).zip(biases).map(sum).map(squash).collect();
            from += width * (read.len() + 1);
            self.values.push(values);
        }
        self.values.last().expect("there is a layer").clone()
    }

    /// Adds the gradient of a function whose derivative by the output is `delta`.
    fn backward(&mut self, mut delta: Vec<f64>) {
        let mut end = self.parameters.len();
        for layer in (1..self.widths.len()).rev() {
            let (width, read) = (self.widths[layer], &self.values[layer - 1]);
            let from = end - width * (read.len() + 1);
            let mut below = vec![0.0; read.len()];
            for (row, delta) in delta.iter().enumerate() {
                for (index, value) in read.iter().enumerate() {
                    let weight = from + row * read.len() + index;
                    self.gradient[weight] += delta * value;
                    below[index] += delta * self.parameters[weight];
                }
                self.gradient[end - width + row] += delta;
            }
            delta = below.iter().zip(read).map(|(sum, value)| sum * (1.0 - value * value)).collect();
            end = from;
        }
    }
}

/// A small minibatch has narrow slices; what a task leaves behind does not depend on them.
#[test]
fn the_width_of_slices_does_not_matter_to_a_regulariser() {
    let gradient = |minibatch: usize, curvature: Curvature| {
        let settings = PpoSettings { minibatch, ..settings() };
        let mut trainer = Trainer::new(&[task(true)], &settings, Seed(31));
        let anchor = QuadraticSettings {
            curvature,
            gradient: GradientTerm::Absent,
            coupling: Coupling::Gradient,
            strength: Strength::Fixed(1.0),
            decay: 1.0,
        };
        let mut regulariser = RegulariserSettings::Quadratic(anchor)
            .begin(Learning { actor: trainer.actor(), critic: trainer.critic() });
        trainer.consolidate(&mut regulariser);
        let columns = trainer.columns();
        let mut moved = trainer.actor.clone();
        let mut stream = Stream::new(Seed(32), 0, Purpose::Weights);
        moved.parameters_mut().iter_mut().for_each(|value| *value += 0.1 * stream.normal());
        let mut gradient = Gradient::new(&moved, &trainer.critic);
        regulariser.add_gradient(Learning { actor: &moved, critic: &trainer.critic }, &mut gradient);
        (columns, gradient.actor)
    };
    for curvature in [Curvature::Fisher, Curvature::Sensitivity, Curvature::Kronecker] {
        let ((wide, expected), (narrow, found)) = (gradient(ENV_BATCH, curvature), gradient(64, curvature));
        assert_eq!((wide, narrow), (256, 32));
        let norm = expected.iter().map(|value| value * value).sum::<f32>().sqrt();
        let error = expected.iter().zip(&found).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt();
        assert!(norm > 0.0 && error < 1e-4 * norm, "{curvature:?}: {error} of {norm}");
    }
}
