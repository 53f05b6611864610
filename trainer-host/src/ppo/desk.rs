//! The places where tiles are differentiated.

use std::sync::{Mutex, MutexGuard};

use crate::actor_critic::{Actor, Critic};
use crate::network::Workspace;
use crate::rollout::{PANEL, Tile};

use super::loss::{Surrogate, differentiate_value};
use super::settings::PpoSettings;
use super::shard::Shard;

/// One desk for each thread: what is worked on stays in the cache of one core.
#[derive(Debug, Default)]
pub(crate) struct Desks {
    desks: Vec<Mutex<Desk>>,
}

impl Desks {
    /// Sees to it that each thread of the current rayon pool has one.
    pub(crate) fn provide(&mut self, actor: &Actor, critic: &Critic) {
        self.desks.resize_with(rayon::current_num_threads(), || Mutex::new(Desk::new(actor, critic)));
    }

    /// The calling thread's.
    ///
    /// # Panics
    /// Outside of the pool for which they were provided.
    pub(crate) fn mine(&self) -> MutexGuard<'_, Desk> {
        let thread = rayon::current_thread_index().expect("desks are for the threads of a pool");
        self.desks[thread].lock().expect("no desk outlives a panic of its thread")
    }
}

impl Clone for Desks {
    /// Nothing on a desk outlasts a tile: the clone is provided anew.
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// The place where one thread differentiates tile after tile.
#[derive(Debug)]
pub(crate) struct Desk {
    /// A tile's, copied in one go: the products read them in strides of a kilobyte, which no processor fetches ahead.
    observations: Vec<f32>,
    actor_workspace: Workspace,
    critic_workspace: Workspace,
}

impl Desk {
    pub(crate) fn new(actor: &Actor, critic: &Critic) -> Self {
        Self {
            observations: vec![0.0; critic.mlp().inputs() * PANEL],
            actor_workspace: Workspace::new(actor.mlp(), PANEL),
            critic_workspace: Workspace::new(critic.mlp(), PANEL),
        }
    }

    /// Adds a tile's part of the minibatch's gradient to a shard, without the entropy's, which no sample enters.
    pub(crate) fn add(
        &mut self,
        shard: &mut Shard,
        tile: Tile<'_>,
        networks: (&Actor, &Critic),
        settings: &PpoSettings,
        sample_weight: f32,
    ) {
        self.observations.copy_from_slice(tile.observations);
        self.add_policy(shard, tile, networks.0, (settings.clip_range, sample_weight));
        self.add_value(shard, tile, networks.1, settings.value_weight * sample_weight);
    }

    fn add_policy(
        &mut self,
        shard: &mut Shard,
        tile: Tile<'_>,
        actor: &Actor,
        (clip_range, sample_weight): (f32, f32),
    ) {
        let (parameters, mlp) = (actor.parameters(), actor.mlp());
        let observations = &self.observations[..mlp.inputs() * PANEL];
        mlp.forward(parameters, observations, &mut self.actor_workspace);
        let (means, deltas) = self.actor_workspace.output_delta();
        let (network, log_std) = shard.gradient.actor.split_at_mut(mlp.parameter_count());
        let gaussian = actor.gaussian();
        let surrogate = Surrogate { tile, means, gaussian: &gaussian, clip_range, sample_weight };
        surrogate.differentiate(deltas, log_std, &mut shard.sums);
        mlp.backward(parameters, observations, &mut self.actor_workspace, network);
    }

    fn add_value(&mut self, shard: &mut Shard, tile: Tile<'_>, critic: &Critic, weight: f32) {
        let (parameters, mlp) = (critic.parameters(), critic.mlp());
        mlp.forward(parameters, &self.observations, &mut self.critic_workspace);
        let (heads, deltas) = self.critic_workspace.output_delta();
        let head = tile.task * PANEL..(tile.task + 1) * PANEL;
        deltas.fill(0.0);
        let scale = critic.scale(tile.task);
        differentiate_value(
            &heads[head.clone()],
            (tile.returns, scale),
            weight,
            &mut deltas[head],
            &mut shard.sums,
        );
        mlp.backward(parameters, &self.observations, &mut self.critic_workspace, &mut shard.gradient.critic);
    }
}
