//! The two networks of PPO.

mod gradient;
mod pass;

use std::ops::Range;

use kestrel_core::activation::Activation;
use kestrel_core::mlp::DenseLayer;
use kestrel_core::seed::Stream;
use serde::{Deserialize, Serialize};

use crate::advantage::Moments;
use crate::encoder::Encoder;
use crate::gaussian::Gaussian;
use crate::gru::Gru;
use crate::network::cnn::Cnn;
use crate::network::{Dense, InputBatch, Mlp};
pub use gradient::Gradient;
pub use pass::ActorWorkspace;
use pass::NetworkRef;
pub(crate) use pass::{ActorCriticWorkspace, EncoderWeights, Networks};

/// Gain of the actor's last layer: first actions are near the middle of their range (Andrychowicz et al. 2021).
const ACTOR_HEAD_GAIN: f32 = 0.01;
/// Gain of the critic's last layer, as in `CleanRL`.
const CRITIC_HEAD_GAIN: f32 = 1.0;

/// The policy: a network for the mean action and a logarithm of the standard deviation per action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Actor {
    mlp: Mlp,
    front: Front,
    /// The network's, then `log_std [action length]`, then those in front of it.
    parameters: Vec<f32>,
}

/// What stands in front of an actor's network, which reads the observation and what this makes of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Front {
    /// Nothing: it acts on the observation alone.
    Nothing,
    /// What looks at images.
    Encoder(Encoder),
    /// What remembers.
    Memory(Gru),
    /// What looks at images, without a trunk, and what remembers the observation with what that makes of it.
    EncoderMemory(Encoder, Gru),
}

impl Front {
    /// Values that it makes.
    pub fn outputs(&self) -> usize {
        match self {
            Self::Nothing => 0,
            Self::Encoder(encoder) => encoder.outputs(),
            Self::Memory(memory) => memory.units(),
            Self::EncoderMemory(encoder, memory) => encoder.outputs() + memory.units(),
        }
    }

    fn encoder(&self) -> Option<&Encoder> {
        match self {
            Self::Encoder(encoder) | Self::EncoderMemory(encoder, _) => Some(encoder),
            Self::Nothing | Self::Memory(_) => None,
        }
    }

    fn memory(&self) -> Option<&Gru> {
        match self {
            Self::Memory(memory) | Self::EncoderMemory(_, memory) => Some(memory),
            Self::Nothing | Self::Encoder(_) => None,
        }
    }

    fn initialise(&self, stream: &mut Stream) -> Vec<f32> {
        let mut parameters = self.encoder().map_or_else(Vec::new, |encoder| encoder.initialise(stream));
        parameters.extend(self.memory().into_iter().flat_map(|memory| memory.initialise(stream)));
        parameters
    }

    /// Inputs of a network that reads so many values, which begin with the observation, and what this makes.
    fn inputs(&self, observation_len: usize, values_len: usize) -> usize {
        match self {
            Self::Nothing | Self::Memory(_) | Self::EncoderMemory(..) => values_len + self.outputs(),
            Self::Encoder(seen) => values_len - observation_len + seen.unread(observation_len) + seen.outputs(),
        }
    }
}

/// How many values an [`Actor`] reads and commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ActorLengths {
    /// Of an observation, images apart.
    pub observation: usize,
    /// Of an action.
    pub action: usize,
}

impl Actor {
    /// With random orthogonal weights, behind what stands in `front` of it.
    pub fn new(
        ActorLengths { observation, action }: ActorLengths,
        front: Front,
        hidden: &[usize],
        initial_log_std: f32,
        stream: &mut Stream,
    ) -> Self {
        let mlp = Mlp::new(front.inputs(observation, observation), hidden, action);
        let mut parameters = mlp.initialise(ACTOR_HEAD_GAIN, stream);
        parameters.extend(std::iter::repeat_n(initial_log_std, action));
        parameters.extend(front.initialise(stream));
        Self { mlp, front, parameters }
    }

    /// The same parameters with another activation behind the hidden layers of the mean's network.
    #[must_use]
    pub fn with_activation(self, activation: Activation) -> Self {
        Self { mlp: self.mlp.with_activation(activation), ..self }
    }

    /// Of observations alone.
    pub fn state_based(lengths: ActorLengths, hidden: &[usize], log_std: f32, stream: &mut Stream) -> Self {
        Self::new(lengths, Front::Nothing, hidden, log_std, stream)
    }

    /// With the numbers of these layers, each of which reads what the one before it writes; its actions spread as those of a
    /// fresh actor with a `log_std` of zero.
    ///
    /// # Panics
    /// Without a layer.
    pub fn of_layers(layers: &[DenseLayer<'_>]) -> Self {
        let (last, hidden) = layers.split_last().expect("a network has at least one layer");
        let first = hidden.first().unwrap_or(last);
        let widths: Vec<usize> = hidden.iter().map(|layer| layer.outputs).collect();
        let mlp = Mlp::new(first.inputs, &widths, last.outputs).with_activation(first.activation);
        let numbers = layers.iter().flat_map(|layer| layer.weights.iter().chain(layer.bias).copied());
        let parameters = numbers.chain(std::iter::repeat_n(0.0, last.outputs)).collect();
        Self { mlp, front: Front::Nothing, parameters }
    }

    /// The same behind a memory that reads `observation` values, with the numbers of these layers: gates and candidate.
    #[must_use]
    pub fn behind_memory(mut self, observation: usize, layers: [DenseLayer<'_>; 2]) -> Self {
        self.front = Front::Memory(Gru::new(observation, layers[1].outputs));
        self.parameters.extend(layers.iter().flat_map(|layer| layer.weights.iter().chain(layer.bias).copied()));
        self
    }

    /// Shape of the mean's network.
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// What looks at images in front of it.
    pub fn encoder(&self) -> Option<&Encoder> {
        self.front.encoder()
    }

    /// What remembers in front of it, behind the encoder if there is one.
    pub fn memory(&self) -> Option<&Gru> {
        self.front.memory()
    }

    /// Values of the hidden state of [`Self::memory`]; none without.
    pub fn units(&self) -> usize {
        self.memory().map_or(0, Gru::units)
    }

    /// Parameters of what stands in front of the network: the encoder's, then the memory's.
    pub fn front_parameters(&self) -> &[f32] {
        self.network_ref().front_parameters()
    }

    /// Those of them that are the memory's.
    pub fn memory_parameters(&self) -> &[f32] {
        self.network_ref().memory_parameters()
    }

    /// The layers between observation, features and mean action, first to last; an activation after all but the last.
    pub fn layers(&self) -> Vec<Dense<'_>> {
        let trunk = self.encoder().into_iter().flat_map(|seen| seen.trunk_layers(self.front_parameters()));
        trunk.chain(self.mlp.layers(&self.parameters)).collect()
    }

    /// Weights and biases of each of [`Self::layers`], to be written.
    pub(crate) fn layers_mut(&mut self) -> Vec<(&mut [f32], &mut [f32])> {
        let Self { mlp, front, parameters } = self;
        let (network, rest) = parameters.split_at_mut(mlp.parameter_count());
        let seen = &mut rest[mlp.outputs()..];
        let mut layers = match front {
            Front::Encoder(encoder) => encoder.trunk_layers_mut(seen),
            Front::Nothing | Front::Memory(_) | Front::EncoderMemory(..) => Vec::new(),
        };
        layers.extend(mlp.layers_mut(network));
        layers
    }

    /// The encoder in front of it, and its parameters, to be written.
    pub(crate) fn cnn_mut(&mut self) -> Option<(&Cnn, &mut [f32])> {
        let from = self.log_std_places().end;
        let encoder = self.front.encoder()?.cnn();
        Some((encoder, &mut self.parameters[from..][..encoder.parameter_count()]))
    }

    /// Values of an action.
    pub fn action_len(&self) -> usize {
        self.mlp.outputs()
    }

    /// Logarithm of the standard deviation of each value of an action.
    pub fn log_std(&self) -> &[f32] {
        &self.parameters[self.log_std_places()]
    }

    /// The distribution of actions around their means.
    pub fn gaussian(&self) -> Gaussian {
        Gaussian::new(self.log_std())
    }

    /// Mean actions `[action length][columns]`, not limited to any range, of what agents observe.
    ///
    /// # Panics
    /// When the slices are not of these shapes.
    pub fn act_mean(&self, batch: InputBatch<'_>, actions: &mut [f32]) {
        let columns = actions.len() / self.action_len();
        actions.copy_from_slice(ActorWorkspace::new(self, columns).means(self, batch));
    }

    /// Whether another one has the same shape.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        (&self.mlp, &self.front) == (&other.mlp, &other.front)
    }

    /// Where `log_std` is among the parameters.
    pub fn log_std_places(&self) -> Range<usize> {
        let network = self.mlp.parameter_count();
        network..network + self.action_len()
    }

    fn network_ref(&self) -> NetworkRef<'_> {
        let Self { mlp, parameters, .. } = self;
        let front_from = self.log_std_places().end;
        NetworkRef { mlp, encoder: self.encoder(), memory: self.memory(), parameters, front_from }
    }

    /// The network's parameters, then `log_std [action length]`, then those in front of it.
    pub fn parameters(&self) -> &[f32] {
        &self.parameters
    }

    /// As [`Self::parameters`].
    pub fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.parameters
    }

    /// Keeps the spread of the actions within `[low, high]` (logarithms).
    pub(crate) fn limit_log_std(&mut self, low: f32, high: f32) {
        let places = self.log_std_places();
        for log_std in &mut self.parameters[places] {
            *log_std = log_std.clamp(low, high);
        }
    }
}

/// The value function: a network with one output, a head, for each task, and the scale of each task's returns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Critic {
    mlp: Mlp,
    /// Where it does not see through the actor's.
    encoder: Option<Encoder>,
    /// The network's, then those of the encoder.
    parameters: Vec<f32>,
    scales: Vec<ValueScale>,
}

impl Critic {
    /// With random orthogonal weights, and a head for each of the tasks. It reads `values_len` values: the observation,
    /// of the actor's length, then what only critics read; and what stands in front of the actor, or an encoder of its own
    /// of the same shape. A memory is always the actor's, and so is the encoder in front of it.
    pub fn new(
        (observation_len, values_len): (usize, usize),
        (front, sharing): (&Front, EncoderSharing),
        hidden: &[usize],
        tasks: usize,
        stream: &mut Stream,
    ) -> Self {
        let own = match (front, sharing) {
            (Front::Encoder(encoder), EncoderSharing::Separate) => Some(encoder.clone()),
            (Front::Nothing | Front::Encoder(_) | Front::Memory(_) | Front::EncoderMemory(..), _) => None,
        };
        let mlp = Mlp::new(front.inputs(observation_len, values_len), hidden, tasks);
        let mut parameters = mlp.initialise(CRITIC_HEAD_GAIN, stream);
        parameters.extend(own.iter().flat_map(|encoder| encoder.initialise(stream)));
        Self { mlp, encoder: own, parameters, scales: vec![ValueScale::default(); tasks] }
    }

    /// The same parameters with another activation behind the hidden layers of its network.
    #[must_use]
    pub fn with_activation(self, activation: Activation) -> Self {
        Self { mlp: self.mlp.with_activation(activation), ..self }
    }

    /// Of so many values alone.
    pub fn state_based(values_len: usize, hidden: &[usize], tasks: usize, stream: &mut Stream) -> Self {
        Self::new((values_len, values_len), (&Front::Nothing, EncoderSharing::Shared), hidden, tasks, stream)
    }

    /// Shape of the network.
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// Whether another one has the same shape.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        (&self.mlp, &self.encoder) == (&other.mlp, &other.encoder)
    }

    fn network_ref(&self) -> NetworkRef<'_> {
        let Self { mlp, encoder, parameters, .. } = self;
        let front_from = mlp.parameter_count();
        NetworkRef { mlp, encoder: encoder.as_ref(), memory: None, parameters, front_from }
    }

    /// Writes the values `[columns]` that `heads [tasks][columns]` mean in a task.
    pub(crate) fn write_values(&self, heads: &[f32], task: usize, values: &mut [f32]) {
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
            let end = self.mlp.parameter_count();
            self.parameters[end - heads * (width + 1)..end].split_at_mut(heads * width)
        };
        for weight in &mut weights[task * width..(task + 1) * width] {
            *weight *= old.std / new.std;
        }
        biases[task] = (old.std * biases[task] + old.mean - new.mean) / new.std;
        self.scales[task] = new;
    }

    /// The network's, then those of its encoder.
    pub fn parameters(&self) -> &[f32] {
        &self.parameters
    }

    /// As [`Self::parameters`].
    pub fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.parameters
    }
}

/// Whether actor and critic have one encoder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum EncoderSharing {
    /// They do, and it learns from both.
    #[default]
    Shared,
    /// Each has its own.
    Separate,
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
    use crate::network::Workspace;
    use kestrel_core::seed::{Purpose, Seed};

    #[test]
    fn rescaling_a_head_leaves_every_value_as_it_was() {
        let mut stream = Stream::new(Seed(1), 0, Purpose::Weights);
        let mut critic = Critic::state_based(5, &[8, 7], 3, &mut stream);
        let inputs: Vec<f32> = (0..5 * 4).map(|_| stream.normal()).collect();
        let mut workspace = Workspace::new(critic.mlp(), 4);
        let mut values = |critic: &Critic, task| {
            let mut values = [0.0; 4];
            let heads = critic.mlp().forward(critic.parameters(), &inputs, &mut workspace);
            critic.write_values(heads, task, &mut values);
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
