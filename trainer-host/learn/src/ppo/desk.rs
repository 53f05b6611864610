//! The places where tiles are differentiated.

use std::sync::{Mutex, MutexGuard};

use crate::actor_critic::{Networks, Pass, Sight};
use crate::rollout::Tile;

use super::loss::{Surrogate, differentiate_value};
use super::settings::PpoSettings;
use super::shard::Shard;

/// One desk for each thread: what is worked on stays in the cache of one core.
#[derive(Debug, Default)]
pub(crate) struct Desks {
    desks: Vec<Mutex<Desk>>,
}

impl Desks {
    /// Sees to it that each thread of the current rayon pool has one, for tiles of so many samples.
    pub(crate) fn provide(&mut self, networks: &Networks<'_>, columns: usize) {
        let desk = || Mutex::new(Desk::new(networks, columns));
        self.desks.resize_with(rayon::current_num_threads(), desk);
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
    values: Vec<f32>,
    pass: Pass,
}

impl Desk {
    pub(crate) fn new(networks: &Networks<'_>, columns: usize) -> Self {
        Self { values: Vec::new(), pass: Pass::new(networks.actor, networks.critic, columns) }
    }

    /// Adds a tile's part of the minibatch's gradient to a shard, without the entropy's, which no sample enters: with the
    /// weight of one sample, and that of its divergence from the teacher.
    pub(crate) fn add(
        &mut self,
        shard: &mut Shard,
        tile: Tile<'_>,
        networks: &Networks<'_>,
        settings: &PpoSettings,
        (sample_weight, lesson_weight): (f32, f32),
    ) {
        let Self { values, pass } = self;
        values.clear();
        values.extend_from_slice(tile.sight.values);
        let sight = Sight { values, ..tile.sight };
        pass.look(networks, sight);
        pass.act(networks, sight);
        pass.appraise(networks, sight);
        let actor = networks.actor;
        let (means, deltas) = pass.action_deltas();
        let gaussian = actor.gaussian();
        let clip_range = settings.clip_range;
        let surrogate = Surrogate { tile, means, gaussian: &gaussian, clip_range, lesson_weight, sample_weight };
        let log_std = &mut shard.gradient.actor[actor.log_std_places()];
        surrogate.differentiate(deltas, log_std, &mut shard.sums);
        add_value(pass, shard, tile, networks, settings.value_weight * sample_weight);
        pass.learn(networks, sight, (&mut shard.gradient.actor, &mut shard.gradient.critic));
    }
}

/// Writes the loss gradient of the critic's heads.
fn add_value(pass: &mut Pass, shard: &mut Shard, tile: Tile<'_>, networks: &Networks<'_>, weight: f32) {
    let (heads, deltas) = pass.head_deltas();
    let columns = tile.returns.len();
    let head = tile.task * columns..(tile.task + 1) * columns;
    deltas.fill(0.0);
    let target = (tile.returns, networks.critic.scale(tile.task));
    differentiate_value(&heads[head.clone()], target, weight, &mut deltas[head], &mut shard.sums);
}
