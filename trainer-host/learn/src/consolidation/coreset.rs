//! A few states of every earlier task and what the policy did there: the policy is asked to do the same again.
//!
//! A state with its action stands for as many rows of the Fisher information as an action has values; the set has a
//! fixed size, which all tasks share equally.

use kestrel_sim::seed::{Purpose, Stream};
use serde::{Deserialize, Serialize};

use super::{Ended, REFERENCE_STD};
use crate::actor_critic::{Actor, Sight};
use crate::network::Workspace;
use crate::rollout::PANEL;

/// How many states, and how strongly they hold the policy.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CoresetSettings {
    /// Bytes of the whole set; absent: as many as a diagonal anchor has, two numbers per parameter.
    pub bytes: Option<usize>,
    /// Factor on the mean divergence \[nat\] over the states.
    pub strength: f32,
}

/// States of earlier tasks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coreset {
    settings: CoresetSettings,
    capacity: usize,
    /// For each task its states, in random order: each an observation, then the mean action.
    tasks: Vec<Vec<Vec<f32>>>,
}

impl Coreset {
    pub(super) fn new(settings: &CoresetSettings, actor: &Actor) -> Self {
        let state_bytes = 4 * (actor.mlp().inputs() + actor.action_len());
        let bytes = settings.bytes.unwrap_or(8 * actor.mlp().parameter_count());
        Self { settings: *settings, capacity: (bytes / state_bytes).max(1), tasks: Vec::new() }
    }

    pub(super) fn stored_bytes(&self) -> usize {
        self.states().map(|state| 4 * state.len()).sum()
    }

    /// The states of all tasks: each an observation, then the mean action.
    pub(super) fn states(&self) -> impl Iterator<Item = &Vec<f32>> {
        self.tasks.iter().flatten()
    }

    /// Gradient of `strength · mean ½ ‖μ − μ_old‖² / σ²` at the reference spread.
    pub(super) fn add_gradient(&mut self, actor: &Actor, gradient: &mut [f32]) {
        let count = self.states().count();
        if count > 0 {
            let weight = self.settings.strength / count as f32;
            let states: Vec<&[f32]> = self.states().map(Vec::as_slice).collect();
            clone_behaviour(actor, &states, weight, gradient);
        }
    }

    pub(super) fn consolidate(&mut self, ended: &Ended<'_>) {
        let share = (self.capacity / (self.tasks.len() + 1)).max(1);
        for states in &mut self.tasks {
            states.truncate(share);
        }
        self.tasks.push(draw_states(ended, share));
    }
}

/// Random states of the rollout: each an observation, then the mean action.
pub(super) fn draw_states(ended: &Ended<'_>, count: usize) -> Vec<Vec<f32>> {
    let (inputs, actor) = (ended.actor.mlp().inputs(), ended.actor);
    let mut stream = Stream::new(ended.seed, 0, Purpose::Coreset);
    let mut draw = || {
        let rollout = ended.rollouts[stream.below(ended.rollouts.len() as u32) as usize];
        let tile = rollout.tile(stream.below(rollout.tiles() as u32) as usize);
        let columns = rollout.columns();
        let column = stream.below(columns as u32) as usize;
        let observation = tile.sight.values.chunks_exact(columns).take(inputs).map(|row| row[column]);
        let mut state: Vec<f32> = observation.collect();
        let mut action = vec![0.0; actor.action_len()];
        actor.act_mean(Sight::blind(&state), &mut action);
        state.extend(action);
        state
    };
    (0..count).map(|_| draw()).collect()
}

/// Adds the gradient of `weight · Σ ½ ‖μ − μ_old‖² / σ²` over states that are an observation and a mean action each.
pub(super) fn clone_behaviour(actor: &Actor, states: &[&[f32]], weight: f32, gradient: &mut [f32]) {
    let inputs = actor.mlp().inputs();
    let mut workspace = Workspace::new(actor.mlp(), PANEL);
    let mut tile = vec![0.0; inputs * PANEL];
    let weight = weight / (REFERENCE_STD * REFERENCE_STD);
    for group in states.chunks(PANEL) {
        for (column, state) in group.iter().enumerate() {
            for (row, value) in state[..inputs].iter().enumerate() {
                tile[row * PANEL + column] = *value;
            }
        }
        let wanted = |place: usize| group.get(place % PANEL).map(|state| state[inputs + place / PANEL]);
        imitate(actor, &tile, wanted, weight, gradient, &mut workspace);
    }
}

/// Adds the gradient of `weight · Σ ½ (μ − wanted)²` over a tile of states; where nothing is wanted, none.
///
/// `wanted` is by places of the tile of actions, `[actions][PANEL]`.
pub(super) fn imitate(
    actor: &Actor,
    tile: &[f32],
    wanted: impl Fn(usize) -> Option<f32>,
    weight: f32,
    gradient: &mut [f32],
    workspace: &mut Workspace,
) {
    actor.mlp().forward(actor.parameters(), tile, workspace);
    let (means, deltas) = workspace.output_delta();
    for (place, (delta, mean)) in deltas.iter_mut().zip(means).enumerate() {
        *delta = wanted(place).map_or(0.0, |wanted| weight * (mean - wanted));
    }
    let network = &mut gradient[..actor.mlp().parameter_count()];
    actor.mlp().backward(actor.parameters(), tile, workspace, network);
}
