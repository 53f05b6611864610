//! A function-space regulariser: distillation on generated states of earlier tasks.
//!
//! IL-SOAR keeps of a task the second order of its objective around the policy that ended it,
//! `−½ (θ − c)ᵀ H (θ − c)` with the Fisher information `H = E JᵀJ / σ²`. That is the divergence of the policies as long as
//! actions are linear in the parameters. They are not where a further task leads to: after a furnished room 0.001 nat
//! were predicted and 0.5 to 2 found. Here `J (θ − c)` is what it stands for, the difference of the actions:
//! `−½ E ‖μ_θ(s) − μ_c(s)‖² / σ²`, right at every distance. The state is the center `c`, the newest policy, and in place
//! of `H` a model of the states of all tasks so far, whose draws are the expectation (pseudo-rehearsal, Robins 1995).

use kestrel_config::{ConfigError, Field};
use kestrel_core::seed::{Purpose, Seed, Stream};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::coreset::{draw_states, imitate};
use super::state_model::StateModel;
use super::{EndedTask, Learning, REFERENCE_STD, Regulariser, STRENGTH, check_number};
use crate::actor_critic::{Actor, Gradient};
use crate::network::Workspace;
use crate::rollout::ENV_BATCH;

/// Observations that a model is fitted to.
const SAMPLES: usize = 8192;

/// Slices of states that are drawn at once, and how often each is used before others are drawn.
const SLICES: u32 = 4;
const USES: u32 = 16;

/// A function-space regulariser on generated states.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FunctionSpaceSettings {
    /// Normal distributions that stand for the states of earlier tasks.
    #[serde(default = "components")]
    pub parts: usize,
    /// Factor on the mean divergence \[nat\] over the states of each earlier task.
    #[serde(default = "super::one")]
    pub strength: f32,
}

const fn components() -> usize {
    32
}

impl FunctionSpaceSettings {
    pub(super) fn check(&self, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("parts").whole(self.parts as u64, 1..=256)?;
        check_number(field, "strength", self.strength, &STRENGTH)
    }
}

/// The anchor of all tasks so far.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FunctionSpace {
    settings: FunctionSpaceSettings,
    /// Of the network's parameters, without those of the standard deviation.
    center: Vec<f32>,
    inputs: usize,
    actions: usize,
    /// None before the first task.
    states: Option<StateModel>,
    tasks: u32,
    /// What the draws follow from: the seed of the newest task, and how often the penalty was computed since.
    seed: Seed,
    penalties: u32,
    /// What is drawn at present; it follows from the rest.
    #[serde(skip)]
    batches: Vec<StateBatch>,
}

/// A slice of states, and what the policy of the center does there.
#[derive(Clone, Debug)]
struct StateBatch {
    /// `[inputs][ENV_BATCH]`.
    states: Vec<f32>,
    /// `[actions][ENV_BATCH]`.
    actions: Vec<f32>,
}

impl PartialEq for FunctionSpace {
    fn eq(&self, other: &Self) -> bool {
        let state = |anchor: &Self| (anchor.settings, anchor.tasks, anchor.seed, anchor.penalties);
        state(self) == state(other) && self.center == other.center && self.states == other.states
    }
}

impl FunctionSpace {
    pub(super) fn new(settings: &FunctionSpaceSettings, Learning { actor, .. }: Learning<'_>) -> Self {
        Self {
            settings: *settings,
            center: vec![0.0; actor.mlp().parameter_count()],
            inputs: actor.mlp().inputs(),
            actions: actor.action_len(),
            states: None,
            tasks: 0,
            seed: Seed(0),
            penalties: 0,
            batches: Vec::new(),
        }
    }

    /// Bytes of what is drawn at present.
    #[cfg(test)]
    pub(super) fn state_bytes(&self) -> usize {
        self.batches.iter().map(|batch| 4 * (batch.states.len() + batch.actions.len())).sum()
    }
}

impl Regulariser for FunctionSpace {
    fn stored_bytes(&self) -> usize {
        // Beside them the number of tasks, the seed and the number of penalties.
        4 * (self.center.len() + StateModel::numbers(self.settings.parts, self.inputs) + 4)
    }

    fn training_bytes(&self) -> usize {
        self.stored_bytes() + 4 * SLICES as usize * ENV_BATCH * (self.inputs + self.actions)
    }

    /// Gradient of `strength · Σ E ½ ‖μ − μ_c‖² / σ²`, a sum over the earlier tasks; the expectation is over a slice of
    /// states of all of them.
    fn add_gradient(&mut self, Learning { actor, .. }: Learning<'_>, gradient: &mut Gradient) {
        let Some(states) = &self.states else { return };
        if self.batches.is_empty() || self.penalties.is_multiple_of(SLICES * USES) {
            let first = self.penalties / (SLICES * USES) * SLICES;
            let stream = |slice: u32| Stream::new(self.seed, 1 + first.wrapping_add(slice), Purpose::Rehearsal);
            let batch = |slice: u32| StateBatch::drawn(states, (actor, &self.center), &mut stream(slice));
            self.batches = (0..SLICES).map(batch).collect();
        }
        let StateBatch { states, actions } = &self.batches[(self.penalties % SLICES) as usize];
        self.penalties = self.penalties.wrapping_add(1);
        let strength = self.settings.strength * self.tasks as f32;
        let weight = strength / (ENV_BATCH as f32 * REFERENCE_STD * REFERENCE_STD);
        let mut workspace = Workspace::new(actor.mlp(), ENV_BATCH);
        imitate(actor, states, |place| Some(actions[place]), weight, &mut gradient.actor, &mut workspace);
    }

    fn consolidate(&mut self, ended: &EndedTask<'_>) {
        let mut stream = Stream::new(ended.seed, 0, Purpose::Rehearsal);
        let newest = SAMPLES / (self.tasks as usize + 1);
        let mut samples: Vec<f32> = Vec::with_capacity(SAMPLES * self.inputs);
        for state in draw_states(&ended.flight(), newest) {
            samples.extend_from_slice(&state[..self.inputs]);
        }
        if let Some(states) = &self.states {
            for _ in newest..SAMPLES {
                samples.extend(states.draw(&mut stream));
            }
        }
        self.states = Some(StateModel::fit(&samples, self.inputs, self.settings.parts, &mut stream));
        let count = self.center.len();
        self.center.copy_from_slice(&ended.actor.parameters()[..count]);
        self.tasks += 1;
        (self.seed, self.penalties) = (ended.seed, 0);
        self.batches.clear();
    }
}

impl StateBatch {
    fn drawn(model: &StateModel, (actor, center): (&Actor, &[f32]), stream: &mut Stream) -> Self {
        let mut states = vec![0.0; actor.mlp().inputs() * ENV_BATCH];
        for column in 0..ENV_BATCH {
            for (row, value) in model.draw(stream).into_iter().enumerate() {
                states[row * ENV_BATCH + column] = value;
            }
        }
        let mut workspace = Workspace::new(actor.mlp(), ENV_BATCH);
        let actions = actor.mlp().forward(center, &states, &mut workspace).to_vec();
        Self { states, actions }
    }
}
