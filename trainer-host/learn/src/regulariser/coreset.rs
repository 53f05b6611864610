//! A few states of every earlier task and what the policy did there: the policy is asked to do the same again.
//!
//! A state with its action stands for as many rows of the Fisher information as an action has values; the set has a
//! fixed size, which all tasks share equally.

use kestrel_config::{ConfigError, Field};
use kestrel_core::seed::{Purpose, Stream};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{EndedTask, Flight, Learning, REFERENCE_STD, Regulariser, STRENGTH, Visited, check_number};
use crate::actor_critic::{Actor, Gradient};
use crate::network::{InputBatch, Workspace};
use crate::rollout::ENV_BATCH;

/// How many states, and how strongly the policy is asked to do there what it did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CoresetSettings {
    /// Bytes of the whole set; left out: as many as a diagonal anchor has, two numbers per parameter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<usize>,
    /// Factor on the mean divergence \[nat\] over the states.
    #[serde(default = "super::one")]
    pub strength: f32,
}

impl CoresetSettings {
    /// Whether all numbers are in their range.
    ///
    /// # Errors
    /// The first that is not.
    pub fn check(&self, field: &Field<'_>) -> Result<(), ConfigError> {
        if let Some(bytes) = self.bytes {
            field.at("bytes").whole(bytes as u64, 1024..=1 << 30)?;
        }
        check_number(field, "strength", self.strength, &STRENGTH)
    }
}

/// States of earlier tasks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coreset {
    /// Bytes, where they are given, and the strength: as checkpoints hold them.
    settings: (Option<usize>, f32),
    capacity: usize,
    /// For each task its states, in random order: each an observation, then the mean action.
    tasks: Vec<Vec<Vec<f32>>>,
}

impl Coreset {
    pub(super) fn new(settings: &CoresetSettings, Learning { actor, .. }: Learning<'_>) -> Self {
        let state_bytes = 4 * (actor.mlp().inputs() + actor.action_len());
        let bytes = settings.bytes.unwrap_or(8 * actor.mlp().parameter_count());
        Self {
            settings: (settings.bytes, settings.strength),
            capacity: (bytes / state_bytes).max(1),
            tasks: Vec::new(),
        }
    }

    /// The states of all tasks: each an observation, then the mean action.
    pub(super) fn states(&self) -> impl Iterator<Item = &Vec<f32>> {
        self.tasks.iter().flatten()
    }
}

impl Regulariser for Coreset {
    fn stored_bytes(&self) -> usize {
        self.states().map(|state| 4 * state.len()).sum()
    }

    /// Gradient of `strength · mean ½ ‖μ − μ_old‖² / σ²` at the reference spread.
    fn add_gradient(&mut self, Learning { actor, .. }: Learning<'_>, gradient: &mut Gradient) {
        let count = self.states().count();
        if count > 0 {
            let weight = self.settings.1 / count as f32;
            let states: Vec<&[f32]> = self.states().map(Vec::as_slice).collect();
            clone_behaviour(actor, &states, weight, &mut gradient.actor);
        }
    }

    fn consolidate(&mut self, ended: &EndedTask<'_>) {
        let share = (self.capacity / (self.tasks.len() + 1)).max(1);
        for states in &mut self.tasks {
            states.truncate(share);
        }
        self.tasks.push(draw_states(&ended.flight(), share));
    }
}

/// Random states of the flight: each an observation, what a memory held before, then the mean action.
pub(super) fn draw_states(flight: &Flight<'_>, count: usize) -> Vec<Vec<f32>> {
    let Flight { actor, visited, seed } = *flight;
    let inputs = actor.mlp().inputs();
    let mut stream = Stream::new(seed, 0, Purpose::Coreset);
    let mut draw = || {
        let Visited { columns, slices } = &visited[stream.below(visited.len() as u32) as usize];
        let slice = slices[stream.below(slices.len() as u32) as usize];
        let column = stream.below(*columns as u32) as usize;
        let observation = slice.chunks_exact(*columns).take(inputs).map(|row| row[column]);
        let mut state: Vec<f32> = observation.collect();
        let mut action = vec![0.0; actor.action_len()];
        let (values, hidden) = state.split_at(inputs - actor.units());
        actor.act_mean(InputBatch { values, images: &[], hidden }, &mut action);
        state.extend(action);
        state
    };
    (0..count).map(|_| draw()).collect()
}

/// Adds the gradient of `weight · Σ ½ ‖μ − μ_old‖² / σ²` over states that are an observation and a mean action each.
pub(super) fn clone_behaviour(actor: &Actor, states: &[&[f32]], weight: f32, gradient: &mut [f32]) {
    let inputs = actor.mlp().inputs();
    let mut workspace = Workspace::new(actor.mlp(), ENV_BATCH);
    let mut slice = vec![0.0; inputs * ENV_BATCH];
    let weight = weight / (REFERENCE_STD * REFERENCE_STD);
    for group in states.chunks(ENV_BATCH) {
        for (column, state) in group.iter().enumerate() {
            for (row, value) in state[..inputs].iter().enumerate() {
                slice[row * ENV_BATCH + column] = *value;
            }
        }
        let wanted = |place: usize| group.get(place % ENV_BATCH).map(|state| state[inputs + place / ENV_BATCH]);
        imitate(actor, &slice, wanted, weight, gradient, &mut workspace);
    }
}

/// Adds the gradient of `weight · Σ ½ (μ − wanted)²` over a slice of states, where nothing is wanted none; returns the sum.
///
/// `wanted` is by places of the slice of actions, `[actions][ENV_BATCH]`.
pub(super) fn imitate(
    actor: &Actor,
    slice: &[f32],
    wanted: impl Fn(usize) -> Option<f32>,
    weight: f32,
    gradient: &mut [f32],
    workspace: &mut Workspace,
) -> f32 {
    actor.mlp().forward(actor.parameters(), slice, workspace);
    let (means, deltas) = workspace.output_delta();
    let mut sum = 0.0;
    for (place, (delta, mean)) in deltas.iter_mut().zip(means).enumerate() {
        let away = wanted(place).map_or(0.0, |wanted| mean - wanted);
        *delta = weight * away;
        sum += 0.5 * *delta * away;
    }
    let network = &mut gradient[..actor.mlp().parameter_count()];
    actor.mlp().backward(actor.parameters(), slice, workspace, network);
    sum
}
