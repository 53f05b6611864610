//! One part of a minibatch, differentiated by one thread.

use crate::actor_critic::{Actor, Critic};
use crate::network::{Workspace, square};
use crate::rollout::{PANEL, Tile};

use super::loss::{LossSums, Surrogate, differentiate_value};
use super::settings::PpoSettings;

/// The gradient of both networks, laid out as their parameters.
#[derive(Clone, Debug)]
pub(crate) struct Gradient {
    pub(crate) actor: Vec<f32>,
    pub(crate) critic: Vec<f32>,
}

impl Gradient {
    pub(crate) fn new(actor: &Actor, critic: &Critic) -> Self {
        Self { actor: vec![0.0; actor.parameters().len()], critic: vec![0.0; critic.parameters().len()] }
    }

    pub(crate) fn clear(&mut self) {
        self.actor.fill(0.0);
        self.critic.fill(0.0);
    }

    pub(crate) fn add(&mut self, other: &Self) {
        let pairs = self.actor.iter_mut().zip(&other.actor).chain(self.critic.iter_mut().zip(&other.critic));
        for (sum, value) in pairs {
            *sum += value;
        }
    }

    /// Euclidean length over both networks.
    pub(crate) fn norm(&self) -> f32 {
        (square(&self.actor) + square(&self.critic)).sqrt()
    }
}

/// The place where one part of a minibatch is differentiated.
#[derive(Clone, Debug)]
pub(crate) struct Shard {
    pub(crate) gradient: Gradient,
    pub(crate) sums: LossSums,
    actor_workspace: Workspace,
    critic_workspace: Workspace,
}

impl Shard {
    pub(crate) fn new(actor: &Actor, critic: &Critic) -> Self {
        Self {
            gradient: Gradient::new(actor, critic),
            sums: LossSums::default(),
            actor_workspace: Workspace::new(actor.mlp(), PANEL),
            critic_workspace: Workspace::new(critic.mlp(), PANEL),
        }
    }

    /// Forgets the gradient and the sums of the last minibatch.
    pub(crate) fn clear(&mut self) {
        self.gradient.clear();
        self.sums = LossSums::default();
    }

    /// Adds a tile's part of the minibatch's gradient, without the entropy's, which no sample enters.
    pub(crate) fn add(
        &mut self,
        tile: Tile<'_>,
        networks: (&Actor, &Critic),
        settings: &PpoSettings,
        sample_weight: f32,
    ) {
        self.add_policy(tile, networks.0, settings.clip_range, sample_weight);
        self.add_value(tile, networks.1, settings.value_weight * sample_weight);
    }

    fn add_policy(&mut self, tile: Tile<'_>, actor: &Actor, clip_range: f32, sample_weight: f32) {
        let (parameters, mlp) = (actor.parameters(), actor.mlp());
        let observations = &tile.observations[..mlp.inputs() * PANEL];
        mlp.forward(parameters, observations, &mut self.actor_workspace);
        let (means, deltas) = self.actor_workspace.output_delta();
        let (network, log_std) = self.gradient.actor.split_at_mut(mlp.parameter_count());
        let gaussian = actor.gaussian();
        let surrogate = Surrogate { tile, means, gaussian: &gaussian, clip_range, sample_weight };
        surrogate.differentiate(deltas, log_std, &mut self.sums);
        mlp.backward(parameters, observations, &mut self.actor_workspace, network);
    }

    fn add_value(&mut self, tile: Tile<'_>, critic: &Critic, weight: f32) {
        let (parameters, mlp) = (critic.parameters(), critic.mlp());
        mlp.forward(parameters, tile.observations, &mut self.critic_workspace);
        let (heads, deltas) = self.critic_workspace.output_delta();
        let head = tile.task * PANEL..(tile.task + 1) * PANEL;
        deltas.fill(0.0);
        let scale = critic.scale(tile.task);
        differentiate_value(
            &heads[head.clone()],
            (tile.returns, scale),
            weight,
            &mut deltas[head],
            &mut self.sums,
        );
        mlp.backward(parameters, tile.observations, &mut self.critic_workspace, &mut self.gradient.critic);
    }
}
