//! Actor and critic at work on slices of samples.

use super::{Actor, Critic};
use crate::encoder::{Encoder, EncoderWorkspace};
use crate::environment::Outcome;
use crate::gru::{Gru, GruWorkspace};
use crate::network::cnn::CnnWeights;
use crate::network::{InputBatch, Mlp, Workspace};

/// Both networks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Networks<'a> {
    pub(crate) actor: &'a Actor,
    pub(crate) critic: &'a Critic,
    pub(crate) encoders: &'a EncoderWeights,
}

/// The weights of both networks' encoders, arranged for many slices until they change.
#[derive(Clone, Debug, Default)]
pub(crate) struct EncoderWeights {
    actor: Option<CnnWeights>,
    critic: Option<CnnWeights>,
}

impl EncoderWeights {
    /// Takes the parameters as they are now.
    pub(crate) fn arrange(&mut self, actor: &Actor, critic: &Critic) {
        for (network_ref, weights) in
            [(actor.network_ref(), &mut self.actor), (critic.network_ref(), &mut self.critic)]
        {
            match (network_ref.encoder, weights) {
                (None, weights) => *weights = None,
                (Some(encoder), Some(weights)) => {
                    encoder.arrange_into(network_ref.front_parameters(), weights);
                }
                (Some(encoder), weights) => *weights = Some(encoder.arrange(network_ref.front_parameters())),
            }
        }
    }
}

/// One of the networks, and the encoder and the memory in front of it if it has its own.
#[derive(Clone, Copy, Debug)]
pub(super) struct NetworkRef<'a> {
    pub(super) mlp: &'a Mlp,
    pub(super) encoder: Option<&'a Encoder>,
    pub(super) memory: Option<&'a Gru>,
    /// All of them.
    pub(super) parameters: &'a [f32],
    /// Where those of the encoder begin, and behind them those of the memory.
    pub(super) front_from: usize,
}

impl<'a> NetworkRef<'a> {
    pub(super) fn front_parameters(&self) -> &'a [f32] {
        &self.parameters[self.front_from..]
    }

    pub(super) fn memory_parameters(&self) -> &'a [f32] {
        &self.parameters[self.memory_from()..]
    }

    fn memory_from(&self) -> usize {
        self.front_from + self.encoder.map_or(0, Encoder::parameter_count)
    }

    /// Values that its own encoder or memory makes.
    fn outputs(&self) -> usize {
        self.encoder.map_or(0, Encoder::outputs) + self.memory.map_or(0, Gru::units)
    }
}

/// The place where both networks evaluate slices of so many samples, and differentiate them.
#[derive(Clone, Debug)]
pub(crate) struct ActorCriticWorkspace {
    actor: NetworkWorkspace,
    critic: NetworkWorkspace,
}

impl ActorCriticWorkspace {
    /// For slices of `columns` samples.
    pub(crate) fn new(actor: &Actor, critic: &Critic, columns: usize) -> Self {
        let outputs = actor.network_ref().outputs();
        Self {
            actor: NetworkWorkspace::new(&actor.network_ref(), outputs, columns),
            critic: NetworkWorkspace::new(&critic.network_ref(), outputs, columns),
        }
    }

    /// Looks at the images of a slice, if there are any, and takes its observations into its hidden state, if it has one:
    /// for the two that follow.
    pub(crate) fn encode(&mut self, networks: &Networks<'_>, batch: InputBatch<'_>) {
        let Networks { actor, critic, encoders } = networks;
        self.actor.encode(&actor.network_ref(), encoders.actor.as_ref(), batch);
        self.actor.begin_window(&actor.network_ref(), batch);
        self.critic.encode(&critic.network_ref(), encoders.critic.as_ref(), batch);
    }

    /// As [`Self::encode`] of the next step of a window, whose hidden state is that of the step before; agents whose episode
    /// ended with that, by `outcomes [columns]`, have forgotten.
    pub(crate) fn encode_next(&mut self, networks: &Networks<'_>, batch: InputBatch<'_>, outcomes: &[Outcome]) {
        let Networks { actor, critic, encoders } = networks;
        self.actor.encode(&actor.network_ref(), encoders.actor.as_ref(), batch);
        self.actor.go_on(&actor.network_ref(), batch, outcomes);
        self.critic.encode(&critic.network_ref(), encoders.critic.as_ref(), batch);
    }

    /// The hidden state after the step that was encoded last, `[units][columns]`; empty where nothing is remembered.
    pub(crate) fn hidden(&self) -> &[f32] {
        self.actor.memory.as_ref().map_or(&[], GruWorkspace::hidden)
    }

    /// Mean actions `[action length][columns]` of the slice whose images were encoded.
    pub(crate) fn mean_actions(&mut self, networks: &Networks<'_>, batch: InputBatch<'_>) -> &[f32] {
        self.actor.forward(&networks.actor.network_ref(), batch.values)
    }

    /// Outputs of the critic's heads `[tasks][columns]` of the slice whose images were encoded.
    pub(crate) fn predict_value(&mut self, networks: &Networks<'_>, batch: InputBatch<'_>) -> &[f32] {
        let NetworkWorkspace { network, encoder, own_values, inputs, .. } = &mut self.critic;
        let own = last_rows(batch.values, *own_values);
        let made = match encoder {
            Some(encoder) => [encoder.outputs(), &[]],
            None => made(self.actor.encoder.as_ref(), self.actor.memory.as_ref()),
        };
        forward(&networks.critic.network_ref(), (own, made), inputs, network)
    }

    /// What [`Self::mean_actions`] returned and, to be written, the loss gradient of each value.
    pub(crate) fn action_deltas(&mut self) -> (&[f32], &mut [f32]) {
        self.actor.network.output_delta()
    }

    /// What [`Self::predict_value`] returned and, to be written, the loss gradient of each value.
    pub(crate) fn head_deltas(&mut self) -> (&[f32], &mut [f32]) {
        self.critic.network.output_delta()
    }

    /// Adds the gradient of both networks for the slice that was seen last, from the loss gradients that the caller has
    /// written. A common encoder or memory learns from both; a memory not before [`Self::backward_window`].
    pub(crate) fn backward(
        &mut self,
        networks: &Networks<'_>,
        batch: InputBatch<'_>,
        (actor_gradient, critic_gradient): (&mut [f32], &mut [f32]),
    ) {
        let Networks { actor, critic, encoders } = networks;
        let (actor, critic) = (actor.network_ref(), critic.network_ref());
        self.actor.backward(&actor, first_rows(batch.values, self.actor.own_values), actor_gradient);
        self.critic.backward(&critic, last_rows(batch.values, self.critic.own_values), critic_gradient);
        if critic.encoder.is_none() {
            for (sum, delta) in self.actor.front_deltas.iter_mut().zip(&self.critic.front_deltas) {
                *sum += delta;
            }
        }
        if self.actor.memory.is_some() {
            self.actor.keep_deltas();
        } else {
            self.actor.backward_encoder(&actor, encoders.actor.as_ref(), batch.images, actor_gradient);
        }
        self.critic.backward_encoder(&critic, encoders.critic.as_ref(), batch.images, critic_gradient);
    }

    /// Adds the gradient of the memory, if there is one, and of an encoder in front of it, for a window of which every step
    /// went through [`Self::backward`]; `seen` and `outcomes` are those of each of its steps.
    pub(crate) fn backward_window<'o>(
        &mut self,
        networks: &Networks<'_>,
        seen: impl Fn(usize) -> InputBatch<'o>,
        outcomes: impl Fn(usize) -> &'o [Outcome],
        actor_gradient: &mut [f32],
    ) {
        let Networks { actor, encoders, .. } = networks;
        self.actor.backward_window(
            &actor.network_ref(),
            encoders.actor.as_ref(),
            (seen, outcomes),
            actor_gradient,
        );
    }
}

/// The actor alone at work on slices of so many samples.
#[derive(Clone, Debug)]
pub struct ActorWorkspace {
    network: NetworkWorkspace,
    encoder: Option<CnnWeights>,
}

impl ActorWorkspace {
    /// For slices of `columns` samples, until the actor's parameters change.
    pub fn new(actor: &Actor, columns: usize) -> Self {
        let network_ref = actor.network_ref();
        let encoder = network_ref.encoder.map(|encoder| encoder.arrange(network_ref.front_parameters()));
        Self { network: NetworkWorkspace::new(&network_ref, network_ref.outputs(), columns), encoder }
    }

    /// Mean actions `[action length][columns]`, not limited to any range.
    pub fn means(&mut self, actor: &Actor, batch: InputBatch<'_>) -> &[f32] {
        self.network.encode(&actor.network_ref(), self.encoder.as_ref(), batch);
        self.network.begin_window(&actor.network_ref(), batch);
        self.network.forward(&actor.network_ref(), batch.values)
    }

    /// The hidden state after that, `[units][columns]`; empty where nothing is remembered.
    pub fn hidden(&self) -> &[f32] {
        self.network.memory.as_ref().map_or(&[], GruWorkspace::hidden)
    }
}

/// The place of one network.
#[derive(Clone, Debug)]
struct NetworkWorkspace {
    network: Workspace,
    /// Where the network has an encoder of its own.
    encoder: Option<EncoderWorkspace>,
    memory: Option<GruWorkspace>,
    /// How many of a slice's values the network reads itself, in all columns.
    own_values: usize,
    /// Its inputs where something stands in front: its own, then what that makes, `[inputs][columns]`; else empty.
    inputs: Vec<f32>,
    /// The loss gradient of what stands in front has made, `[outputs][columns]`.
    front_deltas: Vec<f32>,
    /// Of each step of a window that of the features, `[features][columns]`, where a memory stands behind an encoder.
    feature_deltas: Vec<Vec<f32>>,
    /// Steps of the window that have theirs.
    kept: usize,
}

impl NetworkWorkspace {
    /// `outputs` are those of an encoder or a memory, its own or the common one; none where there is neither.
    fn new(network_ref: &NetworkRef<'_>, outputs: usize, columns: usize) -> Self {
        let inputs = network_ref.mlp.inputs();
        Self {
            network: Workspace::new(network_ref.mlp, columns),
            encoder: network_ref.encoder.map(|encoder| EncoderWorkspace::new(encoder, columns)),
            memory: network_ref.memory.map(|memory| GruWorkspace::new(memory, columns, 1)),
            own_values: (inputs - outputs) * columns,
            inputs: vec![0.0; if outputs == 0 { 0 } else { inputs * columns }],
            front_deltas: vec![0.0; outputs * columns],
            feature_deltas: Vec::new(),
            kept: 0,
        }
    }

    fn encode(&mut self, network_ref: &NetworkRef<'_>, weights: Option<&CnnWeights>, batch: InputBatch<'_>) {
        if let (Some(encoder), Some(weights), Some(workspace)) = (network_ref.encoder, weights, &mut self.encoder)
        {
            encoder.encode((network_ref.front_parameters(), weights), batch, workspace);
        }
    }

    /// Takes a slice's observations, with what was seen, into its hidden state, if the network has a memory.
    fn begin_window(&mut self, network_ref: &NetworkRef<'_>, batch: InputBatch<'_>) {
        self.kept = 0;
        let Self { encoder, memory, inputs, own_values, .. } = self;
        if let (Some(memory), Some(workspace)) = (network_ref.memory, memory) {
            let observation = observed(first_rows(batch.values, *own_values), encoder.as_ref(), inputs);
            workspace.begin(memory, network_ref.memory_parameters(), observation, batch.hidden);
        }
    }

    /// As [`Self::begin_window`] of the next step.
    fn go_on(&mut self, network_ref: &NetworkRef<'_>, batch: InputBatch<'_>, outcomes: &[Outcome]) {
        let Self { encoder, memory, inputs, own_values, .. } = self;
        if let (Some(memory), Some(workspace)) = (network_ref.memory, memory) {
            let observation = observed(first_rows(batch.values, *own_values), encoder.as_ref(), inputs);
            workspace.go_on(memory, network_ref.memory_parameters(), observation, outcomes);
        }
    }

    /// Keeps the loss gradients of what the last step made, until the whole window has its own.
    fn keep_deltas(&mut self) {
        let Self { encoder, memory, front_deltas, feature_deltas, kept, .. } = self;
        let features = encoder.as_ref().map_or(0, |encoder| encoder.outputs().len());
        let (of_features, of_state) = front_deltas.split_at(features);
        if let Some(memory) = memory {
            memory.keep_last_deltas(of_state);
        }
        if feature_deltas.len() == *kept {
            feature_deltas.push(Vec::new());
        }
        feature_deltas[*kept].clear();
        feature_deltas[*kept].extend_from_slice(of_features);
        *kept += 1;
    }

    /// Adds the gradients of the memory and of the encoder in front of it. Of all steps but the last, images are looked at
    /// once more: what an encoder leaves behind is a hundred times as large as what it makes.
    fn backward_window<'o>(
        &mut self,
        network_ref: &NetworkRef<'_>,
        weights: Option<&CnnWeights>,
        (seen, outcomes): (impl Fn(usize) -> InputBatch<'o>, impl Fn(usize) -> &'o [Outcome]),
        gradient: &mut [f32],
    ) {
        let Some(gru) = network_ref.memory else { return };
        let mut index = self.kept;
        while let (Some(step), Some(memory)) = (index.checked_sub(1), &mut self.memory) {
            if index == self.kept {
                memory.begin_backward();
            } else {
                memory.forget(outcomes(step));
            }
            let of_memory = &mut gradient[network_ref.memory_from()..];
            memory.step_back(
                gru,
                network_ref.memory_parameters(),
                step,
                of_memory,
                &mut self.feature_deltas[step],
            );
            if network_ref.encoder.is_some() {
                if index < self.kept {
                    self.encode(network_ref, weights, seen(step));
                }
                self.front_deltas[..self.feature_deltas[step].len()].copy_from_slice(&self.feature_deltas[step]);
                self.backward_encoder(network_ref, weights, seen(step).images, gradient);
            }
            index = step;
        }
    }

    fn forward(&mut self, network_ref: &NetworkRef<'_>, values: &[f32]) -> &[f32] {
        let own = first_rows(values, self.own_values);
        let Self { network, encoder, memory, inputs, .. } = self;
        forward(network_ref, (own, made(encoder.as_ref(), memory.as_ref())), inputs, network)
    }

    /// Adds the network's gradient, and keeps that of what stands in front has made.
    fn backward(&mut self, network_ref: &NetworkRef<'_>, own: &[f32], gradient: &mut [f32]) {
        let Self { network, inputs, front_deltas, .. } = self;
        let gradient = &mut gradient[..network_ref.mlp.parameter_count()];
        if inputs.is_empty() {
            network_ref.mlp.backward(network_ref.parameters, own, network, gradient);
        } else {
            network_ref.mlp.backward_to_inputs(network_ref.parameters, inputs, network, gradient, front_deltas);
        }
    }

    /// Adds the gradient of the network's own encoder, if it has one.
    fn backward_encoder(
        &mut self,
        network_ref: &NetworkRef<'_>,
        weights: Option<&CnnWeights>,
        images: &[u8],
        gradient: &mut [f32],
    ) {
        let Self { encoder: workspace, front_deltas, .. } = self;
        if let (Some(encoder), Some(weights), Some(workspace)) = (network_ref.encoder, weights, workspace) {
            let gradient = &mut gradient[network_ref.front_from..];
            let (gradient, _) = gradient.split_at_mut(encoder.parameter_count());
            let deltas = &front_deltas[..workspace.outputs().len()];
            encoder.backward((network_ref.front_parameters(), weights), images, (workspace, deltas), gradient);
        }
    }
}

/// Evaluates a network on its own values and on what stands in front has made, if anything does.
fn forward<'w>(
    network_ref: &NetworkRef<'_>,
    (own, [features, state]): (&[f32], [&[f32]; 2]),
    inputs: &'w mut [f32],
    network: &'w mut Workspace,
) -> &'w [f32] {
    if inputs.is_empty() {
        return network_ref.mlp.forward(network_ref.parameters, own, network);
    }
    let (front, back) = inputs.split_at_mut(own.len());
    front.copy_from_slice(own);
    let (front, back) = back.split_at_mut(features.len());
    front.copy_from_slice(features);
    back.copy_from_slice(state);
    network_ref.mlp.forward(network_ref.parameters, inputs, network)
}

/// What stands in front of a network has made: what was seen, and the hidden state, `[outputs][columns]` each.
fn made<'w>(encoder: Option<&'w EncoderWorkspace>, memory: Option<&'w GruWorkspace>) -> [&'w [f32]; 2] {
    [encoder.map_or(&[], EncoderWorkspace::outputs), memory.map_or(&[], GruWorkspace::hidden)]
}

/// What a memory takes in: an observation and, behind it, what was seen, written to the start of `inputs`.
fn observed<'w>(own: &'w [f32], encoder: Option<&EncoderWorkspace>, inputs: &'w mut [f32]) -> &'w [f32] {
    let Some(encoder) = encoder else { return own };
    let (front, back) = inputs.split_at_mut(own.len());
    let seen = encoder.outputs();
    front.copy_from_slice(own);
    back[..seen.len()].copy_from_slice(seen);
    &inputs[..own.len() + seen.len()]
}

fn first_rows(values: &[f32], count: usize) -> &[f32] {
    &values[..count]
}

fn last_rows(values: &[f32], count: usize) -> &[f32] {
    &values[values.len() - count..]
}
