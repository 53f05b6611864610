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

/// One of the networks, and the encoder or the memory in front of it if it has one of its own.
#[derive(Clone, Copy, Debug)]
pub(super) struct NetworkRef<'a> {
    pub(super) mlp: &'a Mlp,
    pub(super) encoder: Option<&'a Encoder>,
    pub(super) memory: Option<&'a Gru>,
    /// All of them.
    pub(super) parameters: &'a [f32],
    /// Where those of the encoder or the memory begin.
    pub(super) front_from: usize,
}

impl<'a> NetworkRef<'a> {
    pub(super) fn front_parameters(&self) -> &'a [f32] {
        &self.parameters[self.front_from..]
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
        let network_ref = networks.actor.network_ref();
        if let (Some(memory), Some(workspace)) = (network_ref.memory, &mut self.actor.memory) {
            let observation = first_rows(batch.values, memory.observation_len() * outcomes.len());
            workspace.go_on(memory, network_ref.front_parameters(), observation, outcomes);
        }
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
        let made = encoder
            .as_ref()
            .map(EncoderWorkspace::outputs)
            .or(made(self.actor.encoder.as_ref(), self.actor.memory.as_ref()));
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
        self.actor.backward_encoder(&actor, encoders.actor.as_ref(), batch.images, actor_gradient);
        self.critic.backward_encoder(&critic, encoders.critic.as_ref(), batch.images, critic_gradient);
        if let Some(memory) = &mut self.actor.memory {
            memory.keep_last_deltas(&self.actor.front_deltas);
        }
    }

    /// Adds the gradient of the memory, if there is one, for a window of which every step went through [`Self::backward`];
    /// `outcomes` are those of each of its steps.
    pub(crate) fn backward_window<'o>(
        &mut self,
        actor: &Actor,
        outcomes: impl Fn(usize) -> &'o [Outcome],
        actor_gradient: &mut [f32],
    ) {
        let network_ref = actor.network_ref();
        if let (Some(memory), Some(workspace)) = (network_ref.memory, &mut self.actor.memory) {
            let gradient = &mut actor_gradient[network_ref.front_from..];
            workspace.backward(memory, network_ref.front_parameters(), outcomes, gradient);
        }
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
        }
    }

    fn encode(&mut self, network_ref: &NetworkRef<'_>, weights: Option<&CnnWeights>, batch: InputBatch<'_>) {
        if let (Some(encoder), Some(weights), Some(workspace)) = (network_ref.encoder, weights, &mut self.encoder)
        {
            encoder.encode((network_ref.front_parameters(), weights), batch, workspace);
        }
    }

    /// Takes a slice's observations into its hidden state, if the network has a memory.
    fn begin_window(&mut self, network_ref: &NetworkRef<'_>, batch: InputBatch<'_>) {
        if let (Some(memory), Some(workspace)) = (network_ref.memory, &mut self.memory) {
            let columns = batch.hidden.len() / memory.units();
            let observation = first_rows(batch.values, memory.observation_len() * columns);
            workspace.begin(memory, network_ref.front_parameters(), observation, batch.hidden);
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
            encoder.backward(
                (network_ref.front_parameters(), weights),
                images,
                (workspace, front_deltas),
                gradient,
            );
        }
    }
}

/// Evaluates a network on its own values and on what stands in front has made, if anything does.
fn forward<'w>(
    network_ref: &NetworkRef<'_>,
    (own, made): (&[f32], Option<&[f32]>),
    inputs: &'w mut [f32],
    network: &'w mut Workspace,
) -> &'w [f32] {
    let Some(made) = made else {
        return network_ref.mlp.forward(network_ref.parameters, own, network);
    };
    let (front, back) = inputs.split_at_mut(own.len());
    front.copy_from_slice(own);
    back.copy_from_slice(made);
    network_ref.mlp.forward(network_ref.parameters, inputs, network)
}

/// What stands in front of a network has made, `[outputs][columns]`.
fn made<'w>(encoder: Option<&'w EncoderWorkspace>, memory: Option<&'w GruWorkspace>) -> Option<&'w [f32]> {
    encoder.map(EncoderWorkspace::outputs).or(memory.map(GruWorkspace::hidden))
}

fn first_rows(values: &[f32], count: usize) -> &[f32] {
    &values[..count]
}

fn last_rows(values: &[f32], count: usize) -> &[f32] {
    &values[values.len() - count..]
}
