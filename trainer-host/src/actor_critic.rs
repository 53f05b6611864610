//! The two networks of PPO.

use kestrel_sim::seed::Stream;
use serde::{Deserialize, Serialize};

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

/// The value function: a network with one output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Critic {
    mlp: Mlp,
    parameters: Vec<f32>,
}

impl Critic {
    /// With random orthogonal weights; `input_len` is the observation's length plus the privileged values'.
    pub fn new(input_len: usize, hidden: &[usize], stream: &mut Stream) -> Self {
        let mlp = Mlp::new(input_len, hidden, 1);
        let parameters = mlp.initialise(CRITIC_HEAD_GAIN, stream);
        Self { mlp, parameters }
    }

    /// Shape of the network.
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// Values `[columns]` of `inputs [input_len][columns]`.
    pub(crate) fn values<'w>(&self, inputs: &[f32], workspace: &'w mut Workspace) -> &'w [f32] {
        self.mlp.forward(&self.parameters, inputs, workspace)
    }

    pub(crate) fn parameters(&self) -> &[f32] {
        &self.parameters
    }

    pub(crate) fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.parameters
    }
}
