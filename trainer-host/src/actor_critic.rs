//! The two networks of PPO.

use kestrel_sim::seed::Stream;
use serde::{Deserialize, Serialize};

use crate::advantage::Moments;
use crate::gaussian::Gaussian;
use crate::network::{Dense, Mlp, Workspace};

/// Gain of the actor's last layer: first actions are near the middle of their range (Andrychowicz et al. 2021).
const ACTOR_HEAD_GAIN: f32 = 0.01;
/// Gain of the critic's last layer, as in `CleanRL`.
const CRITIC_HEAD_GAIN: f32 = 1.0;

/// The policy: a network for the mean action and a logarithm of the standard deviation per action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Actor {
    mlp: Mlp,
    /// The network's, then `log_std [action length]`.
    parameters: Vec<f32>,
}

impl Actor {
    /// With random orthogonal weights.
    pub fn new(
        (observation_len, action_len): (usize, usize),
        hidden: &[usize],
        initial_log_std: f32,
        stream: &mut Stream,
    ) -> Self {
        let mlp = Mlp::new(observation_len, hidden, action_len);
        let mut parameters = mlp.initialise(ACTOR_HEAD_GAIN, stream);
        parameters.extend(std::iter::repeat_n(initial_log_std, action_len));
        Self { mlp, parameters }
    }

    /// Shape of the mean's network.
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// The layers of the mean's network, first to last; tanh after all but the last.
    pub fn layers(&self) -> Vec<Dense<'_>> {
        self.mlp.layers(&self.parameters)
    }

    /// Values of an action.
    pub fn action_len(&self) -> usize {
        self.mlp.outputs()
    }

    /// Logarithm of the standard deviation of each value of an action.
    pub fn log_std(&self) -> &[f32] {
        &self.parameters[self.mlp.parameter_count()..]
    }

    /// The distribution of actions around their means.
    pub fn gaussian(&self) -> Gaussian {
        Gaussian::new(self.log_std())
    }

    /// Mean actions `[action length][columns]`, not limited to any range, of `observations [observation_len][columns]`.
    ///
    /// # Panics
    /// When the slices are not of these shapes.
    pub fn act_mean(&self, observations: &[f32], actions: &mut [f32]) {
        let columns = actions.len() / self.action_len();
        actions.copy_from_slice(self.means(observations, &mut Workspace::new(&self.mlp, columns)));
    }

    /// As [`Self::act_mean`], in a workspace of [`Self::mlp`] that the caller keeps from step to step.
    pub fn means<'w>(&self, observations: &[f32], workspace: &'w mut Workspace) -> &'w [f32] {
        self.mlp.forward(&self.parameters, observations, workspace)
    }

    /// The network's parameters, then `log_std [action length]`.
    pub(crate) fn parameters(&self) -> &[f32] {
        &self.parameters
    }

    pub(crate) fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.parameters
    }

    /// Keeps the spread of the actions within `[low, high]` (logarithms).
    pub(crate) fn limit_log_std(&mut self, low: f32, high: f32) {
        for log_std in &mut self.parameters[self.mlp.parameter_count()..] {
            *log_std = log_std.clamp(low, high);
        }
    }
}

/// The value function: a network with one output, a head, for each task, and the scale of each task's returns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Critic {
    mlp: Mlp,
    parameters: Vec<f32>,
    scales: Vec<ValueScale>,
}

impl Critic {
    /// With random orthogonal weights; `input_len` is the observation's length plus the privileged values'.
    pub fn new(input_len: usize, hidden: &[usize], tasks: usize, stream: &mut Stream) -> Self {
        let mlp = Mlp::new(input_len, hidden, tasks);
        let parameters = mlp.initialise(CRITIC_HEAD_GAIN, stream);
        Self { mlp, parameters, scales: vec![ValueScale::default(); tasks] }
    }

    /// Shape of the network.
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// Writes the values `[columns]` of `inputs [input_len][columns]` in a task.
    pub(crate) fn appraise(&self, inputs: &[f32], task: usize, workspace: &mut Workspace, values: &mut [f32]) {
        let heads = self.mlp.forward(&self.parameters, inputs, workspace);
        let ValueScale { mean, std, .. } = self.scales[task];
        let columns = values.len();
        for (value, head) in values.iter_mut().zip(&heads[task * columns..(task + 1) * columns]) {
            *value = head * std + mean;
        }
    }

    /// The scale of a task's returns.
    pub(crate) fn scale(&self, task: usize) -> &ValueScale {
        &self.scales[task]
    }

    /// Takes the returns of a rollout into a task's scale and rewrites its head, so that its values stay the same:
    /// PopArt (van Hasselt et al. 2016, eq. 9).
    pub(crate) fn rescale(&mut self, task: usize, returns: &Moments) {
        let old = self.scales[task];
        let new = old.after(returns);
        let width = self.mlp.widths()[self.mlp.widths().len() - 2];
        let heads = self.mlp.outputs();
        let (weights, biases) = {
            let from = self.parameters.len() - heads * (width + 1);
            self.parameters[from..].split_at_mut(heads * width)
        };
        for weight in &mut weights[task * width..(task + 1) * width] {
            *weight *= old.std / new.std;
        }
        biases[task] = (old.std * biases[task] + old.mean - new.mean) / new.std;
        self.scales[task] = new;
    }

    pub(crate) fn parameters(&self) -> &[f32] {
        &self.parameters
    }

    pub(crate) fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.parameters
    }
}

/// Mean and spread of a task's returns, by which its head of the critic is scaled; mean 0 and spread 1 until the first
/// [`Critic::rescale`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ValueScale {
    pub(crate) mean: f32,
    pub(crate) std: f32,
    /// Running means of the returns and of their squares, and how much of them has been seen, in \[0, 1).
    first: f64,
    second: f64,
    seen: f64,
}

impl Default for ValueScale {
    fn default() -> Self {
        Self { mean: 0.0, std: 1.0, first: 0.0, second: 0.0, seen: 0.0 }
    }
}

impl ValueScale {
    /// Share of a new rollout in the running means: a memory of about ten rollouts.
    const SHARE: f64 = 0.1;
    /// Smallest spread: a task whose returns are all the same keeps finite values.
    const SMALLEST_STD: f64 = 1e-4;

    fn after(&self, returns: &Moments) -> Self {
        let mix = |old: f64, new: f64| old + Self::SHARE * (new - old);
        let square = returns.variance() + returns.mean() * returns.mean();
        let (first, second) = (mix(self.first, returns.mean()), mix(self.second, square));
        let seen = mix(self.seen, 1.0);
        // As Adam does, the means are corrected for having begun at zero.
        let mean = first / seen;
        let std = (second / seen - mean * mean).max(0.0).sqrt().max(Self::SMALLEST_STD);
        Self { mean: mean as f32, std: std as f32, first, second, seen }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kestrel_sim::seed::{Purpose, Seed};

    #[test]
    fn rescaling_a_head_leaves_every_value_as_it_was() {
        let mut stream = Stream::new(Seed(1), 0, Purpose::Weights);
        let mut critic = Critic::new(5, &[8, 7], 3, &mut stream);
        let inputs: Vec<f32> = (0..5 * 4).map(|_| stream.normal()).collect();
        let mut workspace = Workspace::new(critic.mlp(), 4);
        let mut values = |critic: &Critic, task| {
            let mut values = [0.0; 4];
            critic.appraise(&inputs, task, &mut workspace, &mut values);
            values
        };
        let before: Vec<[f32; 4]> = (0..3).map(|task| values(&critic, task)).collect();
        let mut returns = Moments::default();
        returns.add(&[10.0, 30.0, 20.0]);
        critic.rescale(1, &returns);
        let ValueScale { mean, std, .. } = *critic.scale(1);
        assert!((mean - 20.0).abs() < 1e-4 && (std - (200.0_f32 / 3.0).sqrt()).abs() < 1e-4, "{mean} {std}");
        for (task, before) in before.iter().enumerate() {
            for (now, before) in values(&critic, task).iter().zip(before) {
                assert!((now - before).abs() < 1e-4, "task {task}: {now}, before {before}");
            }
        }
    }
}
