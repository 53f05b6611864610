//! Environment batches that act with the policy, and the columns that they leave to the learner.

mod critic_input;

use std::ops::Range;

use kestrel_core::seed::Seed;

use crate::actor_critic::{ActorCriticWorkspace, Networks};
use crate::advantage::{Columns, gae};
use crate::environment::{Environment, Episode, Outcome, TaskShape};
use crate::gaussian::Noise;
use crate::gru::forget;
use crate::network::InputBatch;
use crate::ppo::MemorySettings;
use crate::regulariser::Visited;
use critic_input::CriticInput;
pub use critic_input::CriticScope;

/// Rows of an environment batch unless their team does not divide it, and samples of a slice unless something asks for fewer
/// ([`slice_columns`]).
///
/// Enough columns for matrix products at full speed, few enough that the activations of a 64-64 network
/// (2 × 64 kB, as much again backwards) stay in a core's second-level cache.
pub const ENV_BATCH: usize = 256;

/// Samples of a slice with images: more do not make convolutions faster.
const IMAGE_SLICE: usize = 64;

/// Smallest minibatch that has two slices.
pub const SMALLEST_MINIBATCH: usize = 32;

/// Samples of a slice of a run: a divisor of [`ENV_BATCH`], half of the drones of a minibatch where these are fewer than that,
/// so that two threads have something to do.
pub fn slice_columns(drones: usize, sees: bool) -> usize {
    let most = if sees { IMAGE_SLICE } else { ENV_BATCH };
    if drones < ENV_BATCH { most.min(drones / 2) } else { most }
}

/// Rows of each environment batch of a run: the least multiple of [`ENV_BATCH`] into which the teams of all its tasks, of
/// so many agents each, fit without a rest; [`ENV_BATCH`] itself for teams of 1, 2, 4, …
pub fn batch_rows(teams: impl Iterator<Item = usize>) -> usize {
    teams.fold(ENV_BATCH, |rows, team| rows / common_divisor(rows, team) * team)
}

/// The greatest (Euclid).
fn common_divisor(one: usize, other: usize) -> usize {
    if other == 0 { one } else { common_divisor(other, one % other) }
}

/// What an environment batch needs to know to collect a rollout.
#[derive(Clone, Copy, Debug)]
pub struct Collection<'a> {
    /// The actor chooses the actions, the critic predicts the value of what is seen.
    pub(crate) networks: Networks<'a>,
    /// Steps that every row has made before.
    pub first_step: u64,
    /// Factor on rewards.
    pub reward_scale: f32,
    /// Discount per step.
    pub discount: f32,
    /// Trace decay of the advantage estimate.
    pub gae_lambda: f32,
    /// Whether the teacher says what it would do.
    pub asks_teacher: bool,
}

/// Environments of some [`batch_rows`] agents in all, stepped by one thread through a whole rollout; several agents of
/// an environment share the policy.
///
/// No environment batch waits for another, and none shares anything with another: the number of threads cannot matter.
#[derive(Clone, Debug)]
pub struct EnvBatch<E> {
    environment: E,
    critic_input: CriticInput,
    /// Of each slice of a step.
    noises: Vec<Noise>,
    rollout: Rollout,
    workspace: ActorCriticWorkspace,
    /// Noise of one slice `[action length][columns]`.
    normals: Vec<f32>,
    /// Actions of one step `[action length][rows]`.
    commands: Vec<f32>,
    truncated: Vec<Truncated>,
    /// What the agents remember between two steps, `[slices of a step][units][columns]`.
    hidden: Vec<f32>,
}

/// What was observed at the end of an episode that was cut off.
#[derive(Clone, Debug)]
struct Truncated {
    /// Place in the rollout.
    place: usize,
    /// What the critic reads.
    values: Vec<f32>,
    image: Vec<u8>,
    /// What it remembered of the steps before.
    hidden: Vec<f32>,
}

/// What the rollouts of an environment batch hold.
#[derive(Clone, Copy, Debug)]
pub struct RolloutPlan {
    /// Steps of every row.
    pub steps: usize,
    /// Samples of a slice, as [`slice_columns`] says.
    pub columns: usize,
    /// Whose observations the critic reads.
    pub critic_scope: CriticScope,
    /// What the policy remembers.
    pub memory: Option<MemorySettings>,
    /// Whether a teacher says what it would do.
    pub has_teacher: bool,
}

/// The rows of an environment batch among all rows of a run.
#[derive(Clone, Copy, Debug)]
pub struct BatchRows {
    /// Index of their task among those of the run.
    pub task: usize,
    /// Rows in environment batches before.
    pub first: u32,
    /// Rows of this environment batch, as [`batch_rows`] says.
    pub count: usize,
}

impl<E: Environment> EnvBatch<E> {
    /// Environments at the start of their first episodes, for rollouts of such a size.
    ///
    /// # Panics
    /// When the rows do not fill slices and environments.
    pub(crate) fn new(
        task: &E::Task,
        plan: RolloutPlan,
        seed: Seed,
        rows: BatchRows,
        workspace: ActorCriticWorkspace,
    ) -> Self {
        let shape = E::shape(task);
        let (agents, columns) = (shape.agents, plan.columns);
        let fits = rows.count.is_multiple_of(columns) && rows.count.is_multiple_of(agents);
        assert!(fits, "{} agents in slices of {columns} and teams of {agents}", rows.count);
        let lengths = Lengths::new(&shape, plan.critic_scope);
        let firsts = (rows.first..rows.first + rows.count as u32).step_by(columns);
        let mut rollout = Rollout::new(rows.task, plan, rows.count, lengths);
        if plan.has_teacher {
            rollout.teacher_actions = vec![0.0; rollout.actions.len()];
        }
        Self {
            environment: E::begin(task, seed, rows.first / agents as u32, rows.count / agents),
            critic_input: CriticInput::new(&shape, rows.count, plan.critic_scope),
            noises: firsts.map(|first| Noise::new(seed, first, lengths.action)).collect(),
            rollout,
            workspace,
            normals: vec![0.0; lengths.action * columns],
            commands: vec![0.0; lengths.action * rows.count],
            truncated: Vec::new(),
            hidden: vec![0.0; plan.units() * rows.count],
        }
    }

    /// Acts with the actor for one rollout and estimates its advantages.
    pub fn collect(&mut self, collection: &Collection<'_>) {
        for step in 0..self.rollout.steps {
            for part in 0..self.noises.len() {
                let slice = step * self.noises.len() + part;
                self.observe(slice, part);
                self.encode(&collection.networks, slice, part);
                self.act(&collection.networks, slice, (part, collection.first_step + step as u64));
                self.predict_value(&collection.networks, slice);
                if collection.asks_teacher {
                    self.ask_teacher(slice, part);
                }
            }
            self.environment.step(&self.commands);
            self.record(step, collection.reward_scale);
        }
        self.predict_last_values(&collection.networks);
        self.predict_truncated_values(&collection.networks);
        self.rollout.estimate_advantages(collection.discount, collection.gae_lambda);
    }

    /// The environments.
    #[cfg(test)]
    pub(crate) fn environment(&self) -> &E {
        &self.environment
    }

    /// What the agents remember between two rollouts, `[slices of a step][units][columns]`; empty without memory.
    pub(crate) fn hidden(&self) -> &[f32] {
        &self.hidden
    }

    /// As [`Self::hidden`], to be written.
    pub(crate) fn hidden_mut(&mut self) -> &mut [f32] {
        &mut self.hidden
    }

    /// What was collected last.
    pub fn rollout(&self) -> &Rollout {
        &self.rollout
    }

    /// As [`Self::rollout`], to normalise its advantages.
    pub(crate) fn rollout_mut(&mut self) -> &mut Rollout {
        &mut self.rollout
    }

    /// Episodes that ended since the last call.
    pub fn take_episodes(&mut self) -> Vec<Episode> {
        self.environment.take_episodes()
    }

    /// Between rollouts, all of an environment batch that the next one depends on.
    pub fn save(&self) -> E::State {
        self.environment.save()
    }

    /// Goes on from a saved state; `false` when that belongs to another scenario.
    #[must_use]
    pub fn restore(&mut self, state: &E::State) -> bool {
        self.environment.restore(state)
    }

    /// What the agents of part of a step observe, into a slice of the rollout.
    fn observe(&mut self, slice: usize, part: usize) {
        let Self { environment, critic_input, rollout, .. } = self;
        let (values, images) = (rollout.inputs_of(slice), rollout.images_of(slice));
        let first = part * rollout.columns;
        critic_input.write(environment, (first, rollout.columns), &mut rollout.observations[values]);
        let seen = &environment.images()[first * rollout.lengths.image..][..images.len()];
        rollout.images[images].copy_from_slice(seen);
    }

    /// Looks at a slice, and remembers it.
    fn encode(&mut self, networks: &Networks<'_>, slice: usize, part: usize) {
        let Self { rollout, workspace, hidden, noises, .. } = self;
        let hidden = part_mut(hidden, part, noises.len());
        rollout.keep_hidden(slice, noises.len(), hidden);
        workspace.encode(networks, InputBatch { hidden, ..rollout.input_batch(slice) });
        hidden.copy_from_slice(workspace.hidden());
    }

    fn act(&mut self, networks: &Networks<'_>, slice: usize, (part, noise_step): (usize, u64)) {
        let Self { rollout, workspace, .. } = self;
        let means = workspace.mean_actions(networks, rollout.input_batch(slice));
        self.noises[part].fill(noise_step, &mut self.normals);
        let (place, column) = (rollout.actions_of(slice), rollout.column_of(slice));
        let (actions, gaussian) = (&mut rollout.actions[place], networks.actor.gaussian());
        gaussian.sample(means, &self.normals, actions);
        gaussian.log_probs(means, actions, &mut rollout.log_probs[column]);
        let commands = self.commands.chunks_exact_mut(rollout.rows);
        for (command, action) in commands.zip(actions.chunks_exact(rollout.columns)) {
            command[part * rollout.columns..][..action.len()].copy_from_slice(action);
        }
    }

    /// What the teacher would have done in part of a step.
    fn ask_teacher(&mut self, slice: usize, part: usize) {
        let Self { environment, rollout, .. } = self;
        let (place, first) = (rollout.actions_of(slice), part * rollout.columns);
        environment.write_teacher_actions(first..first + rollout.columns, &mut rollout.teacher_actions[place]);
    }

    fn predict_value(&mut self, networks: &Networks<'_>, slice: usize) {
        let Self { rollout, workspace, .. } = self;
        let heads = workspace.predict_value(networks, rollout.input_batch(slice));
        let column = rollout.column_of(slice);
        networks.critic.write_values(heads, rollout.task, &mut rollout.values[column]);
    }

    fn record(&mut self, step: usize, reward_scale: f32) {
        let Self { environment, critic_input, rollout, truncated, hidden, .. } = self;
        let (rows, image_len, columns) = (rollout.rows, rollout.lengths.image, rollout.columns);
        let parts = rows / columns;
        let column = step * rows..(step + 1) * rows;
        for (scaled, reward) in rollout.rewards[column.clone()].iter_mut().zip(environment.rewards()) {
            *scaled = reward * reward_scale;
        }
        rollout.outcomes[column].copy_from_slice(environment.outcomes());
        for (row, outcome) in environment.outcomes().iter().enumerate() {
            if *outcome == Outcome::Truncated {
                truncated.push(Truncated {
                    place: step * rows + row,
                    values: critic_input.at_end(environment, row),
                    image: environment.final_images()[row * image_len..][..image_len].to_vec(),
                    hidden: part_mut(hidden, row / columns, parts)
                        .chunks_exact(columns)
                        .map(|unit| unit[row % columns])
                        .collect(),
                });
            }
        }
        for (part, outcomes) in environment.outcomes().chunks_exact(columns).enumerate() {
            forget(part_mut(hidden, part, parts), outcomes);
        }
    }

    fn predict_last_values(&mut self, networks: &Networks<'_>) {
        let Self { environment, critic_input, rollout, workspace, hidden, noises, .. } = self;
        let (columns, image_len) = (rollout.columns, rollout.lengths.image);
        let mut values = vec![0.0; rollout.lengths.features * columns];
        for (part, last) in rollout.last_values.chunks_exact_mut(columns).enumerate() {
            let first = part * columns;
            critic_input.write(environment, (first, columns), &mut values);
            let images = &environment.images()[first * image_len..][..columns * image_len];
            let hidden = part_mut(hidden, part, noises.len());
            let batch = InputBatch { values: &values, images, hidden };
            workspace.encode(networks, batch);
            networks.critic.write_values(workspace.predict_value(networks, batch), rollout.task, last);
        }
    }

    /// Collected over the rollout, because a slice of one costs as much as a full one.
    fn predict_truncated_values(&mut self, networks: &Networks<'_>) {
        let Self { rollout, workspace, truncated, .. } = self;
        let (columns, image_len) = (rollout.columns, rollout.lengths.image);
        let mut slice = vec![0.0; rollout.lengths.features * columns];
        let mut images = vec![0; image_len * columns];
        let mut hidden = vec![0.0; rollout.units() * columns];
        for group in truncated.chunks(columns) {
            for (column, seen) in group.iter().enumerate() {
                for (row, value) in slice.chunks_exact_mut(columns).zip(&seen.values) {
                    row[column] = *value;
                }
                images[column * image_len..][..image_len].copy_from_slice(&seen.image);
                for (unit, value) in hidden.chunks_exact_mut(columns).zip(&seen.hidden) {
                    unit[column] = *value;
                }
            }
            let batch = InputBatch { values: &slice, images: &images, hidden: &hidden };
            workspace.encode(networks, batch);
            let mut values = [0.0; ENV_BATCH];
            let heads = workspace.predict_value(networks, batch);
            networks.critic.write_values(heads, rollout.task, &mut values[..columns]);
            for (seen, value) in group.iter().zip(values) {
                rollout.truncated_values[seen.place] = value;
            }
        }
        truncated.clear();
    }
}

/// One of so many equal parts.
fn part_mut(values: &mut [f32], part: usize, parts: usize) -> &mut [f32] {
    let len = values.len() / parts;
    &mut values[part * len..][..len]
}

impl RolloutPlan {
    /// Values of a hidden state.
    fn units(&self) -> usize {
        self.memory.map_or(0, |memory| memory.units)
    }
}

/// How many values belong to a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Lengths {
    /// Of the observation, which the actor reads.
    pub(crate) observation: usize,
    /// Of all that the critic reads, the observation first.
    pub(crate) features: usize,
    /// Bytes.
    pub(crate) image: usize,
    pub(crate) action: usize,
}

impl Lengths {
    pub(crate) fn new(shape: &TaskShape, scope: CriticScope) -> Self {
        Self {
            observation: shape.observation_len,
            features: scope.agents(shape.agents) * (shape.observation_len + shape.privileged_len),
            image: shape.image_len(),
            action: shape.action_len,
        }
    }
}

/// Columns of one environment batch over the steps of a rollout: `[steps][rows]`, which is `[slices][columns]`.
#[derive(Clone, Debug)]
pub struct Rollout {
    task: usize,
    steps: usize,
    /// Agents.
    rows: usize,
    /// Samples of a slice.
    columns: usize,
    lengths: Lengths,
    memory: Option<MemorySettings>,
    /// What was remembered at the start of each window, `[windows][units][columns]`.
    hidden: Vec<f32>,
    /// `[slices][features][columns]`: observation, privileged values, then those of team mates. The actor reads the
    /// observation.
    observations: Vec<f32>,
    /// `[slices][columns][image]`.
    images: Vec<u8>,
    /// `[slices][action length][columns]`, not limited to \[-1, 1\].
    actions: Vec<f32>,
    /// What the teacher would have done, as the actions; empty where nobody teaches.
    teacher_actions: Vec<f32>,
    log_probs: Vec<f32>,
    rewards: Vec<f32>,
    values: Vec<f32>,
    outcomes: Vec<Outcome>,
    truncated_values: Vec<f32>,
    last_values: Vec<f32>,
    advantages: Vec<f32>,
    returns: Vec<f32>,
}

/// Samples of one step of one environment batch: what a minibatch is made of.
#[derive(Clone, Copy, Debug)]
pub struct MinibatchSlice<'a> {
    /// Index of its task among those of the run.
    pub task: usize,
    /// Observation, privileged values, then those of team mates where the critic reads them; and images.
    pub batch: InputBatch<'a>,
    /// `[action length][columns]`.
    pub actions: &'a [f32],
    /// What the teacher would have done, as the actions; empty where nobody teaches.
    pub teacher_actions: &'a [f32],
    /// `[columns]`, of the actions under the policy that chose them.
    pub log_probs: &'a [f32],
    /// `[columns]`.
    pub advantages: &'a [f32],
    /// `[columns]`: what the critic should have said.
    pub returns: &'a [f32],
    /// `[columns]`: which episodes ended with it.
    pub outcomes: &'a [Outcome],
}

impl Rollout {
    fn new(task: usize, plan: RolloutPlan, rows: usize, lengths: Lengths) -> Self {
        let RolloutPlan { steps, columns, memory, .. } = plan;
        let windows = memory.map_or(0, |memory| steps / memory.steps_per_window);
        let column = || vec![0.0; steps * rows];
        Self {
            task,
            steps,
            rows,
            columns,
            memory,
            hidden: vec![0.0; windows * plan.units() * rows],
            observations: vec![0.0; steps * lengths.features * rows],
            images: vec![0; steps * lengths.image * rows],
            actions: vec![0.0; steps * lengths.action * rows],
            teacher_actions: Vec::new(),
            lengths,
            log_probs: column(),
            rewards: column(),
            values: column(),
            outcomes: vec![Outcome::Running; steps * rows],
            truncated_values: column(),
            last_values: vec![0.0; rows],
            advantages: column(),
            returns: column(),
        }
    }

    /// A rollout of [`ENV_BATCH`] rows and nothing but these observations `[steps][features][ENV_BATCH]`.
    #[cfg(test)]
    pub(crate) fn of_observations(observations: Vec<f32>, features: usize, action_len: usize) -> Self {
        let steps = observations.len() / (features * ENV_BATCH);
        let critic_scope = CriticScope::Own;
        let plan = RolloutPlan { steps, columns: ENV_BATCH, critic_scope, memory: None, has_teacher: false };
        let lengths = Lengths { observation: features, features, image: 0, action: action_len };
        Self { observations, ..Self::new(0, plan, ENV_BATCH, lengths) }
    }

    /// Index of its task among those of the run.
    pub fn task(&self) -> usize {
        self.task
    }

    /// Number of windows: slices that are differentiated together because the policy remembers; without memory, of slices.
    pub fn windows(&self) -> usize {
        self.slices() / self.steps_per_window()
    }

    /// The slices of a window, step after step; the first has the hidden state.
    ///
    /// # Panics
    /// When the rollout has no such window.
    pub fn window(&self, index: usize) -> impl Iterator<Item = MinibatchSlice<'_>> {
        let (parts, steps) = (self.rows / self.columns, self.steps_per_window());
        let first = index / parts * steps * parts + index % parts;
        let units = self.units() * self.columns;
        let hidden = &self.hidden[index * units..][..units];
        (0..steps).map(move |step| {
            let slice = self.slice(first + step * parts);
            MinibatchSlice { batch: InputBatch { hidden, ..slice.batch }, ..slice }
        })
    }

    fn steps_per_window(&self) -> usize {
        self.memory.map_or(1, |memory| memory.steps_per_window)
    }

    fn units(&self) -> usize {
        self.memory.map_or(0, |memory| memory.units)
    }

    /// Keeps what is remembered before a slice, of which a step has so many, where a window begins.
    fn keep_hidden(&mut self, slice: usize, parts: usize, hidden: &[f32]) {
        let (step, part) = (slice / parts, slice % parts);
        if self.memory.is_some() && step.is_multiple_of(self.steps_per_window()) {
            let window = step / self.steps_per_window() * parts + part;
            self.hidden[window * hidden.len()..][..hidden.len()].copy_from_slice(hidden);
        }
    }

    /// Number of slices.
    pub fn slices(&self) -> usize {
        self.steps * self.rows / self.columns
    }

    /// Samples of a slice.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Some samples, those of a step together.
    ///
    /// # Panics
    /// When the rollout has no such slice.
    pub fn slice(&self, index: usize) -> MinibatchSlice<'_> {
        MinibatchSlice {
            task: self.task,
            batch: self.input_batch(index),
            actions: &self.actions[self.actions_of(index)],
            teacher_actions: self.teacher_actions.get(self.actions_of(index)).unwrap_or_default(),
            log_probs: &self.log_probs[self.column_of(index)],
            advantages: &self.advantages[self.column_of(index)],
            returns: &self.returns[self.column_of(index)],
            outcomes: &self.outcomes[self.column_of(index)],
        }
    }

    /// What was observed.
    pub fn visited(&self) -> Visited<'_> {
        let slices = (0..self.slices()).map(|index| self.input_batch(index).values);
        Visited { columns: self.columns, slices: slices.collect() }
    }

    /// Estimated advantages, `[steps][rows]`.
    pub fn advantages(&self) -> &[f32] {
        &self.advantages
    }

    pub(crate) fn advantages_mut(&mut self) -> &mut [f32] {
        &mut self.advantages
    }

    /// Advantages plus values, `[steps][rows]`.
    pub fn returns(&self) -> &[f32] {
        &self.returns
    }

    /// The critic's values, `[steps][rows]`.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// All numbers that a learner reads of it.
    pub(crate) fn columns_mut(&mut self) -> [&mut [f32]; 8] {
        let Self {
            hidden, observations, actions, teacher_actions, log_probs, values, advantages, returns, ..
        } = self;
        [hidden, observations, actions, teacher_actions, log_probs, values, advantages, returns]
            .map(Vec::as_mut_slice)
    }

    /// How its steps ended.
    pub(crate) fn outcomes_mut(&mut self) -> &mut [Outcome] {
        &mut self.outcomes
    }

    /// The images that a learner reads of it.
    pub(crate) fn images_mut(&mut self) -> &mut [u8] {
        &mut self.images
    }

    fn input_batch(&self, slice: usize) -> InputBatch<'_> {
        InputBatch {
            values: &self.observations[self.inputs_of(slice)],
            images: &self.images[self.images_of(slice)],
            hidden: &[],
        }
    }

    /// The samples of a slice in a column of values.
    fn column_of(&self, slice: usize) -> Range<usize> {
        self.part_of(slice, 1)
    }

    fn actions_of(&self, slice: usize) -> Range<usize> {
        self.part_of(slice, self.lengths.action)
    }

    fn inputs_of(&self, slice: usize) -> Range<usize> {
        self.part_of(slice, self.lengths.features)
    }

    fn images_of(&self, slice: usize) -> Range<usize> {
        self.part_of(slice, self.lengths.image)
    }

    /// What belongs to a slice where each sample has so many values.
    fn part_of(&self, slice: usize, values: usize) -> Range<usize> {
        slice * self.columns * values..(slice + 1) * self.columns * values
    }

    fn estimate_advantages(&mut self, discount: f32, gae_lambda: f32) {
        let columns = Columns {
            rewards: &self.rewards,
            values: &self.values,
            outcomes: &self.outcomes,
            truncated_values: &self.truncated_values,
            last_values: &self.last_values,
        };
        gae(&columns, discount, gae_lambda, &mut self.advantages);
        for ((target, advantage), value) in self.returns.iter_mut().zip(&self.advantages).zip(&self.values) {
            *target = advantage + value;
        }
    }
}
