//! Actor and critic at work on tiles of samples.

use super::{Actor, Critic};
use crate::network::eye::EyeWeights;
use crate::network::{Mlp, Workspace};
use crate::perception::{Perception, PerceptionWorkspace};

/// What drones see at one step.
#[derive(Clone, Copy, Debug)]
pub struct Sight<'a> {
    /// `[values][columns]`: the observation; for critics, then what only they read.
    pub values: &'a [f32],
    /// `[columns][image]`; empty without a camera.
    pub images: &'a [u8],
}

impl<'a> Sight<'a> {
    /// Of drones without a camera.
    pub fn blind(values: &'a [f32]) -> Self {
        Self { values, images: &[] }
    }
}

/// Both networks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Networks<'a> {
    pub(crate) actor: &'a Actor,
    pub(crate) critic: &'a Critic,
    pub(crate) eyes: &'a Eyes,
}

/// The weights of both networks' eyes, arranged for many tiles until they change.
#[derive(Clone, Debug, Default)]
pub(crate) struct Eyes {
    actor: Option<EyeWeights>,
    critic: Option<EyeWeights>,
}

impl Eyes {
    /// Takes the parameters as they are now.
    pub(crate) fn arrange(&mut self, actor: &Actor, critic: &Critic) {
        for (half, weights) in [(actor.half(), &mut self.actor), (critic.half(), &mut self.critic)] {
            match (half.perception, weights) {
                (None, weights) => *weights = None,
                (Some(perception), Some(weights)) => {
                    perception.arrange_into(half.perception_parameters(), weights);
                }
                (Some(perception), weights) => *weights = Some(perception.arrange(half.perception_parameters())),
            }
        }
    }
}

/// One of the networks, and the eye in front of it if it has one of its own.
#[derive(Clone, Copy, Debug)]
pub(super) struct Half<'a> {
    pub(super) mlp: &'a Mlp,
    pub(super) perception: Option<&'a Perception>,
    /// All of them.
    pub(super) parameters: &'a [f32],
    /// Where those of the perception begin.
    pub(super) perception_from: usize,
}

impl<'a> Half<'a> {
    pub(super) fn perception_parameters(&self) -> &'a [f32] {
        &self.parameters[self.perception_from..]
    }
}

/// The place where both networks evaluate tiles of so many samples, and differentiate them.
#[derive(Clone, Debug)]
pub(crate) struct Pass {
    actor: Side,
    critic: Side,
}

impl Pass {
    /// For tiles of `columns` samples.
    pub(crate) fn new(actor: &Actor, critic: &Critic, columns: usize) -> Self {
        let outputs = actor.half().perception.map_or(0, Perception::outputs);
        Self {
            actor: Side::new(&actor.half(), outputs, columns),
            critic: Side::new(&critic.half(), outputs, columns),
        }
    }

    /// Looks at the images of a tile, if there are any, for the two that follow.
    pub(crate) fn look(&mut self, networks: &Networks<'_>, sight: Sight<'_>) {
        let Networks { actor, critic, eyes } = networks;
        self.actor.look(&actor.half(), eyes.actor.as_ref(), sight);
        self.critic.look(&critic.half(), eyes.critic.as_ref(), sight);
    }

    /// Mean actions `[action length][columns]` of the tile that was looked at.
    pub(crate) fn act(&mut self, networks: &Networks<'_>, sight: Sight<'_>) -> &[f32] {
        self.actor.act(&networks.actor.half(), sight.values)
    }

    /// Outputs of the critic's heads `[tasks][columns]` of the tile that was looked at.
    pub(crate) fn appraise(&mut self, networks: &Networks<'_>, sight: Sight<'_>) -> &[f32] {
        let Side { network, perception, own_values, inputs, .. } = &mut self.critic;
        let own = last_rows(sight.values, *own_values);
        let eye = perception.as_ref().or(self.actor.perception.as_ref());
        forward(&networks.critic.half(), (own, eye), inputs, network)
    }

    /// What [`Self::act`] returned and, to be written, the loss gradient of each value.
    pub(crate) fn action_deltas(&mut self) -> (&[f32], &mut [f32]) {
        self.actor.network.output_delta()
    }

    /// What [`Self::appraise`] returned and, to be written, the loss gradient of each value.
    pub(crate) fn head_deltas(&mut self) -> (&[f32], &mut [f32]) {
        self.critic.network.output_delta()
    }

    /// Adds the gradient of both networks for the tile that was seen last, from the loss gradients that the caller has
    /// written. A common eye learns from both.
    pub(crate) fn learn(
        &mut self,
        networks: &Networks<'_>,
        sight: Sight<'_>,
        (actor_gradient, critic_gradient): (&mut [f32], &mut [f32]),
    ) {
        let Networks { actor, critic, eyes } = networks;
        let (actor, critic) = (actor.half(), critic.half());
        self.actor.learn(&actor, first_rows(sight.values, self.actor.own_values), actor_gradient);
        self.critic.learn(&critic, last_rows(sight.values, self.critic.own_values), critic_gradient);
        if critic.perception.is_none() {
            for (sum, delta) in self.actor.eye_deltas.iter_mut().zip(&self.critic.eye_deltas) {
                *sum += delta;
            }
        }
        self.actor.learn_to_look(&actor, eyes.actor.as_ref(), sight.images, actor_gradient);
        self.critic.learn_to_look(&critic, eyes.critic.as_ref(), sight.images, critic_gradient);
    }
}

/// The actor alone at work on tiles of so many samples.
#[derive(Clone, Debug)]
pub struct ActorPass {
    side: Side,
    eye: Option<EyeWeights>,
}

impl ActorPass {
    /// For tiles of `columns` samples, until the actor's parameters change.
    pub fn new(actor: &Actor, columns: usize) -> Self {
        let half = actor.half();
        let eye = half.perception.map(|perception| perception.arrange(half.perception_parameters()));
        Self { side: Side::new(&half, half.perception.map_or(0, Perception::outputs), columns), eye }
    }

    /// Mean actions `[action length][columns]`, not limited to any range.
    pub fn means(&mut self, actor: &Actor, sight: Sight<'_>) -> &[f32] {
        self.side.look(&actor.half(), self.eye.as_ref(), sight);
        self.side.act(&actor.half(), sight.values)
    }
}

/// The place of one network.
#[derive(Clone, Debug)]
struct Side {
    network: Workspace,
    /// Where the network has an eye of its own.
    perception: Option<PerceptionWorkspace>,
    /// How many of a tile's values the network reads itself, in all columns.
    own_values: usize,
    /// Its inputs where an eye has seen something: its own, then the eye's `[inputs][columns]`; empty where all are blind.
    inputs: Vec<f32>,
    /// The loss gradient of what the eye has made, `[outputs][columns]`.
    eye_deltas: Vec<f32>,
}

impl Side {
    /// `outputs` are those of an eye, its own or the common one; none where all are blind.
    fn new(half: &Half<'_>, outputs: usize, columns: usize) -> Self {
        let inputs = half.mlp.inputs();
        Self {
            network: Workspace::new(half.mlp, columns),
            perception: half.perception.map(|perception| PerceptionWorkspace::new(perception, columns)),
            own_values: (inputs - outputs) * columns,
            inputs: vec![0.0; if outputs == 0 { 0 } else { inputs * columns }],
            eye_deltas: vec![0.0; outputs * columns],
        }
    }

    fn look(&mut self, half: &Half<'_>, weights: Option<&EyeWeights>, sight: Sight<'_>) {
        if let (Some(perception), Some(weights), Some(workspace)) =
            (half.perception, weights, &mut self.perception)
        {
            perception.look((half.perception_parameters(), weights), sight, workspace);
        }
    }

    fn act(&mut self, half: &Half<'_>, values: &[f32]) -> &[f32] {
        let own = first_rows(values, self.own_values);
        forward(half, (own, self.perception.as_ref()), &mut self.inputs, &mut self.network)
    }

    /// Adds the network's gradient, and keeps that of what an eye has made.
    fn learn(&mut self, half: &Half<'_>, own: &[f32], gradient: &mut [f32]) {
        let Self { network, inputs, eye_deltas, .. } = self;
        let gradient = &mut gradient[..half.mlp.parameter_count()];
        if inputs.is_empty() {
            half.mlp.backward(half.parameters, own, network, gradient);
        } else {
            half.mlp.backward_to_inputs(half.parameters, inputs, network, gradient, eye_deltas);
        }
    }

    /// Adds the gradient of the network's own eye, if it has one.
    fn learn_to_look(
        &mut self,
        half: &Half<'_>,
        weights: Option<&EyeWeights>,
        images: &[u8],
        gradient: &mut [f32],
    ) {
        let Self { perception: workspace, eye_deltas, .. } = self;
        if let (Some(perception), Some(weights), Some(workspace)) = (half.perception, weights, workspace) {
            let gradient = &mut gradient[half.perception_from..];
            perception.learn((half.perception_parameters(), weights), images, (workspace, eye_deltas), gradient);
        }
    }
}

/// Evaluates a network on its own values and on what an eye has made, if there is one.
fn forward<'w>(
    half: &Half<'_>,
    (own, eye): (&[f32], Option<&PerceptionWorkspace>),
    inputs: &'w mut [f32],
    network: &'w mut Workspace,
) -> &'w [f32] {
    let Some(eye) = eye else {
        return half.mlp.forward(half.parameters, own, network);
    };
    let (front, back) = inputs.split_at_mut(own.len());
    front.copy_from_slice(own);
    back.copy_from_slice(eye.outputs());
    half.mlp.forward(half.parameters, inputs, network)
}

fn first_rows(values: &[f32], count: usize) -> &[f32] {
    &values[..count]
}

fn last_rows(values: &[f32], count: usize) -> &[f32] {
    &values[values.len() - count..]
}
