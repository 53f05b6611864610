//! What an agent learns in: the trait between the learner and any environment.
//!
//! Many environments of one task step together, in columns: a row is an agent, and value `f` of row `r` stands at
//! `f · rows + r`. Where several agents share an environment, row `agent · environments + environment` is one of them.
//! After a step the columns hold the next observations, with the environments whose episode ended reset; what those
//! looked like before their reset stands in the `final_` columns, so that a truncated episode is worth what its last
//! observation promises.
//!
//! Two implementations ship: [`Pendulum`](crate::pendulum::Pendulum), and the drones of `kestrel-experiments`.

use std::ops::Range;

use kestrel_core::encoder::Volume;
pub use kestrel_core::outcome::Outcome;
use kestrel_core::seed::Seed;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::actor_critic::{Actor, ActorWorkspace};
use crate::gru::forget;
use crate::network::InputBatch;

/// What an agent of a task sees and does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TaskShape {
    /// Agents of an environment, at least 1.
    pub agents: usize,
    /// Values of an observation.
    pub observation_len: usize,
    /// Values that only critics read.
    pub privileged_len: usize,
    /// Values of an action, at most [`ACTION_LIMIT`](kestrel_core::action::ACTION_LIMIT).
    pub action_len: usize,
    /// The image beside the observation, if there is one.
    pub image: Option<Volume>,
}

impl TaskShape {
    /// Bytes of an image; zero without.
    pub fn image_len(&self) -> usize {
        self.image.map_or(0, |image| image.len())
    }
}

/// An episode that ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// Steps.
    pub steps: u32,
    /// Undiscounted return.
    pub total_reward: f32,
    /// Whether it was a success; none where the task has no such notion.
    pub success: Option<bool>,
    /// Undiscounted return of each term of the reward, if it has terms.
    pub terms: Vec<f32>,
}

/// Environments of one task that step together.
///
/// Everything random follows from the seed and an environment's index, so that the same environment behaves alike in
/// any batch.
pub trait Environment: Send {
    /// What is to be done.
    type Task: Sync;
    /// Everything that the next step depends on.
    type State: Serialize + DeserializeOwned;

    /// Name of a task, for messages.
    fn name(task: &Self::Task) -> &str;

    /// What its agents see and do.
    fn shape(task: &Self::Task) -> TaskShape;

    /// Whether [`Self::write_teacher_actions`] knows what to do in a task.
    fn has_teacher(_task: &Self::Task) -> bool {
        false
    }

    /// Environments `first..first + count` of all those of a run, at the start of their first episodes.
    fn begin(task: &Self::Task, seed: Seed, first: u32, count: usize) -> Self;

    /// One step of every environment with `actions [action_len][rows]`, which no range limits; ended episodes begin anew.
    fn step(&mut self, actions: &[f32]);

    /// What the agents see now, `[observation_len][rows]`.
    fn observations(&self) -> &[f32];

    /// What only critics read now, `[privileged_len][rows]`.
    fn privileged(&self) -> &[f32] {
        &[]
    }

    /// The agents' images now, `[rows][image]`.
    fn images(&self) -> &[u8] {
        &[]
    }

    /// Rewards of the last step, `[rows]`.
    fn rewards(&self) -> &[f32];

    /// What the last step means for the value of the future, `[rows]`.
    fn outcomes(&self) -> &[Outcome];

    /// [`Self::observations`] before the resets; valid where the outcome is not `Running`.
    fn final_observations(&self) -> &[f32];

    /// [`Self::privileged`] before the resets; valid where the outcome is not `Running`.
    fn final_privileged(&self) -> &[f32] {
        &[]
    }

    /// [`Self::images`] before the resets; valid where the outcome is not `Running`.
    fn final_images(&self) -> &[u8] {
        &[]
    }

    /// What a teacher would do for some rows now, into `actions [action_len][those rows]`.
    fn write_teacher_actions(&mut self, _rows: Range<usize>, _actions: &mut [f32]) {}

    /// Episodes that ended since the last call.
    fn take_episodes(&mut self) -> Vec<Episode>;

    /// What [`Self::restore`] goes on from.
    fn save(&self) -> Self::State;

    /// Goes on from a saved state; `false` when that belongs to another task.
    #[must_use]
    fn restore(&mut self, state: &Self::State) -> bool;
}

/// Returns of the first episode of every agent of so many environments, which act with the policy's mean actions.
pub fn evaluate<E: Environment>(task: &E::Task, actor: &Actor, seed: Seed, environments: usize) -> Vec<f32> {
    let mut environment = E::begin(task, seed, 0, environments);
    let rows = environments * E::shape(task).agents;
    let mut actions = vec![0.0; rows * actor.action_len()];
    let (mut pass, mut hidden) = (ActorWorkspace::new(actor, rows), vec![0.0; rows * actor.units()]);
    let (mut returns, mut outcomes) = (vec![0.0; rows], vec![Outcome::Running; rows]);
    while outcomes.contains(&Outcome::Running) {
        let (values, images) = (environment.observations(), environment.images());
        actions.copy_from_slice(pass.means(actor, InputBatch { values, images, hidden: &hidden }));
        hidden.copy_from_slice(pass.hidden());
        environment.step(&actions);
        forget(&mut hidden, environment.outcomes());
        for (row, (reward, outcome)) in environment.rewards().iter().zip(environment.outcomes()).enumerate() {
            if outcomes[row] == Outcome::Running {
                returns[row] += reward;
                outcomes[row] = *outcome;
            }
        }
    }
    returns
}
