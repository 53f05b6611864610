//! One running anchor whose second order is taken in the actions.
//!
//! IL-SOAR keeps of a task the second order of its objective around the policy that ended it,
//! `−½ (θ − c)ᵀ H (θ − c)` with the Fisher information `H = E JᵀJ / σ²`. That is the divergence of the policies as long as
//! actions are linear in the parameters. They are not where a further task leads to: after a furnished room 0.001 nat
//! were predicted and 0.5 to 2 found. Here `J (θ − c)` is what it stands for, the difference of the actions:
//! `−½ E ‖μ_θ(s) − μ_c(s)‖² / σ²`, right at every distance. The state is the center `c`, the newest policy, and in place
//! of `H` a model of the states of all tasks so far, whose draws are the expectation (pseudo-rehearsal, Robins 1995).

use kestrel_sim::seed::{Purpose, Seed, Stream};
use serde::{Deserialize, Serialize};

use super::coreset::{draw_states, imitate};
use super::state_model::StateModel;
use super::{Ended, REFERENCE_STD};
use crate::actor_critic::Actor;
use crate::network::Workspace;
use crate::rollout::PANEL;

/// Observations that a model is fitted to.
const SAMPLES: usize = 8192;

/// Tiles of states that are drawn at once, and how often each is used before others are drawn.
const TILES: u32 = 4;
const USES: u32 = 16;

/// How an anchor in the actions is made and how strongly it pulls.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActionAnchorSettings {
    /// Parts of the model of states.
    pub parts: usize,
    /// Factor on the mean divergence \[nat\] from each earlier task.
    pub strength: f32,
}

/// The anchor of all tasks so far.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ActionAnchor {
    settings: ActionAnchorSettings,
    /// Of the network's parameters, without those of the standard deviation.
    center: Vec<f32>,
    inputs: usize,
    actions: usize,
    /// None before the first task.
    states: Option<StateModel>,
    tasks: u32,
    /// What the draws follow from: the seed of the newest task, and how often the anchor has pulled since.
    seed: Seed,
    pulls: u32,
    /// What is drawn at present; it follows from the rest.
    #[serde(skip)]
    lessons: Vec<Lesson>,
}

/// A tile of states, and what the policy of the center does there.
#[derive(Clone, Debug)]
struct Lesson {
    /// `[inputs][PANEL]`.
    states: Vec<f32>,
    /// `[actions][PANEL]`.
    actions: Vec<f32>,
}

impl PartialEq for ActionAnchor {
    fn eq(&self, other: &Self) -> bool {
        let state = |anchor: &Self| (anchor.settings, anchor.tasks, anchor.seed, anchor.pulls);
        state(self) == state(other) && self.center == other.center && self.states == other.states
    }
}

impl ActionAnchor {
    pub(super) fn new(settings: &ActionAnchorSettings, actor: &Actor) -> Self {
        Self {
            settings: *settings,
            center: vec![0.0; actor.mlp().parameter_count()],
            inputs: actor.mlp().inputs(),
            actions: actor.action_len(),
            states: None,
            tasks: 0,
            seed: Seed(0),
            pulls: 0,
            lessons: Vec::new(),
        }
    }

    pub(super) fn stored_bytes(&self) -> usize {
        // Beside them the number of tasks, the seed and the number of pulls.
        4 * (self.center.len() + StateModel::numbers(self.settings.parts, self.inputs) + 4)
    }

    pub(super) fn training_bytes(&self) -> usize {
        self.stored_bytes() + 4 * TILES as usize * PANEL * (self.inputs + self.actions)
    }

    /// Bytes of what is drawn at present.
    #[cfg(test)]
    pub(super) fn lesson_bytes(&self) -> usize {
        self.lessons.iter().map(|lesson| 4 * (lesson.states.len() + lesson.actions.len())).sum()
    }

    /// Gradient of `strength · Σ E ½ ‖μ − μ_c‖² / σ²`, a sum over the earlier tasks; the expectation is over a tile of
    /// states of all of them.
    pub(super) fn add_gradient(&mut self, actor: &Actor, gradient: &mut [f32]) {
        let Some(states) = &self.states else { return };
        if self.lessons.is_empty() || self.pulls.is_multiple_of(TILES * USES) {
            let first = self.pulls / (TILES * USES) * TILES;
            let stream = |tile: u32| Stream::new(self.seed, 1 + first.wrapping_add(tile), Purpose::Rehearsal);
            let lesson = |tile: u32| Lesson::drawn(states, (actor, &self.center), &mut stream(tile));
            self.lessons = (0..TILES).map(lesson).collect();
        }
        let Lesson { states, actions } = &self.lessons[(self.pulls % TILES) as usize];
        self.pulls = self.pulls.wrapping_add(1);
        let strength = self.settings.strength * self.tasks as f32;
        let weight = strength / (PANEL as f32 * REFERENCE_STD * REFERENCE_STD);
        let mut workspace = Workspace::new(actor.mlp(), PANEL);
        imitate(actor, states, |place| Some(actions[place]), weight, gradient, &mut workspace);
    }

    pub(super) fn consolidate(&mut self, ended: &Ended<'_>) {
        let mut stream = Stream::new(ended.seed, 0, Purpose::Rehearsal);
        let newest = SAMPLES / (self.tasks as usize + 1);
        let mut samples: Vec<f32> = Vec::with_capacity(SAMPLES * self.inputs);
        for state in draw_states(ended, newest) {
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
        (self.seed, self.pulls) = (ended.seed, 0);
        self.lessons.clear();
    }
}

impl Lesson {
    fn drawn(model: &StateModel, (actor, center): (&Actor, &[f32]), stream: &mut Stream) -> Self {
        let mut states = vec![0.0; actor.mlp().inputs() * PANEL];
        for column in 0..PANEL {
            for (row, value) in model.draw(stream).into_iter().enumerate() {
                states[row * PANEL + column] = value;
            }
        }
        let mut workspace = Workspace::new(actor.mlp(), PANEL);
        let actions = actor.mlp().forward(center, &states, &mut workspace).to_vec();
        Self { states, actions }
    }
}
