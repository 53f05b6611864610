//! Panels of drones that fly the policy, and the columns that they leave to the learner.

mod critic_input;

use std::ops::Range;

use kestrel_sim::outcome::{Episode, Outcome};
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;
use kestrel_sim::simulation::{Simulation, SimulationState};

use crate::actor_critic::{Networks, Pass, Sight};
use crate::advantage::{Columns, gae};
use crate::gaussian::Noise;
use crate::teacher::Teacher;
use critic_input::CriticInput;
pub use critic_input::CriticScope;

/// Drones of a panel unless their team does not divide it, and samples of a tile unless something asks for fewer
/// ([`tile_columns`]).
///
/// Enough columns for matrix products at full speed, few enough that the activations of a 64-64 network
/// (2 × 64 kB, as much again backwards) stay in a core's second-level cache.
pub const PANEL: usize = 256;

/// Samples of a tile with images: more do not make convolutions faster.
const SEEING_TILE: usize = 64;

/// Smallest minibatch that has two tiles.
pub const SMALLEST_MINIBATCH: usize = 32;

/// Samples of a tile of a run: a divisor of [`PANEL`], half of a minibatch that is smaller than that, so that two threads
/// have something to do.
pub fn tile_columns(minibatch: usize, sees: bool) -> usize {
    let most = if sees { SEEING_TILE } else { PANEL };
    if minibatch < PANEL { most.min(minibatch / 2) } else { most }
}

/// Drones of each panel of a run: the least multiple of [`PANEL`] into which the teams of all its tasks fit without a
/// rest, [`PANEL`] itself for teams of 1, 2, 4, …
pub fn panel_rows(tasks: &[Scenario]) -> usize {
    tasks
        .iter()
        .map(|task| task.agents.count as usize)
        .fold(PANEL, |rows, team| rows / common_divisor(rows, team) * team)
}

/// The greatest (Euclid).
fn common_divisor(one: usize, other: usize) -> usize {
    if other == 0 { one } else { common_divisor(other, one % other) }
}

/// What a panel needs to know to collect a rollout.
#[derive(Clone, Copy, Debug)]
pub struct Collection<'a> {
    /// The actor chooses the actions, the critic appraises what is seen.
    pub(crate) networks: Networks<'a>,
    /// Steps that every drone has made before.
    pub first_step: u64,
    /// Factor on rewards.
    pub reward_scale: f32,
    /// Discount per step.
    pub discount: f32,
    /// Trace decay of the advantage estimate.
    pub gae_lambda: f32,
    /// Whether the teacher says what it would do.
    pub is_taught: bool,
}

/// Environments of some [`panel_rows`] drones in all, stepped by one thread through a whole rollout; several drones of
/// an environment share the policy.
///
/// No panel waits for another, and none shares anything with another: the number of threads cannot matter.
#[derive(Clone, Debug)]
pub struct Panel {
    simulation: Simulation,
    critic_input: CriticInput,
    /// Of each tile of a step.
    noises: Vec<Noise>,
    teacher: Option<Teacher>,
    rollout: Rollout,
    pass: Pass,
    /// Noise of one tile `[action length][columns]`.
    normals: Vec<f32>,
    /// Actions of one step `[action length][rows]`.
    commands: Vec<f32>,
    truncated: Vec<Truncated>,
}

/// What was seen at the end of an episode that was cut off.
#[derive(Clone, Debug)]
struct Truncated {
    /// Place in the rollout.
    place: usize,
    /// What the critic reads.
    values: Vec<f32>,
    image: Vec<u8>,
}

/// Of what size the rollouts of a panel are.
#[derive(Clone, Copy, Debug)]
pub struct RolloutSize {
    /// Steps of every drone.
    pub steps: usize,
    /// Samples of a tile, as [`tile_columns`] says.
    pub columns: usize,
}

/// The drones of a panel among all drones of a run.
#[derive(Clone, Copy, Debug)]
pub struct PanelRows {
    /// Drones in panels before.
    pub first: u32,
    /// Drones of this panel, as [`panel_rows`] says.
    pub count: usize,
}

impl Panel {
    /// Environments at the start of their first episodes, which fly and appraise rollouts of such a size.
    ///
    /// # Panics
    /// When the drones do not fill tiles and environments.
    pub(crate) fn new(
        (task, scenario): (usize, &Scenario),
        seed: Seed,
        rows: PanelRows,
        (size, scope): (RolloutSize, CriticScope),
        pass: Pass,
    ) -> Self {
        let (team, count) = (scenario.agents.count, rows.count);
        let columns = size.columns;
        let fits = count.is_multiple_of(columns) && count.is_multiple_of(team as usize);
        assert!(fits, "{count} drones in tiles of {columns} and teams of {team}");
        let simulation = Simulation::new(scenario, seed, rows.first / team, count / team as usize);
        let critic_input = CriticInput::new(&simulation, scope);
        let action_len = scenario.action.len();
        let firsts = (rows.first..rows.first + count as u32).step_by(columns);
        let lengths = Lengths {
            features: critic_input.len(&simulation),
            image: simulation.images().len() / count,
            action: action_len,
        };
        Self {
            noises: firsts.map(|first| Noise::new(seed, first, action_len)).collect(),
            teacher: None,
            rollout: Rollout::new(task, size, count, lengths),
            pass,
            normals: vec![0.0; action_len * columns],
            commands: vec![0.0; action_len * count],
            truncated: Vec::new(),
            critic_input,
            simulation,
        }
    }

    /// The same panel with the teacher of its task.
    ///
    /// # Panics
    /// When that task has none.
    #[must_use]
    pub(crate) fn taught(mut self) -> Self {
        self.rollout.lessons = vec![0.0; self.rollout.actions.len()];
        self.teacher =
            Some(Teacher::of(self.simulation.scenario()).expect("the task is checked to have a teacher"));
        self
    }

    /// Flies the actor through one rollout and estimates its advantages.
    pub fn collect(&mut self, collection: &Collection<'_>) {
        for step in 0..self.rollout.steps {
            for part in 0..self.noises.len() {
                let tile = step * self.noises.len() + part;
                self.observe(tile, part);
                self.pass.look(&collection.networks, self.rollout.sight(tile));
                self.act(&collection.networks, tile, (part, collection.first_step + step as u64));
                self.appraise(&collection.networks, tile);
                if collection.is_taught {
                    self.ask_teacher(tile, part);
                }
            }
            self.simulation.step(&self.commands);
            self.record(step, collection.reward_scale);
        }
        self.appraise_last(&collection.networks);
        self.appraise_truncated(&collection.networks);
        self.rollout.estimate_advantages(collection.discount, collection.gae_lambda);
    }

    /// The environments.
    #[cfg(test)]
    pub(crate) fn simulation(&self) -> &Simulation {
        &self.simulation
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
        self.simulation.take_episodes()
    }

    /// Between rollouts, all of a panel that the next one depends on.
    pub fn save(&self) -> SimulationState {
        self.simulation.save()
    }

    /// Goes on from a saved state; `false` when that belongs to another scenario.
    #[must_use]
    pub fn restore(&mut self, state: &SimulationState) -> bool {
        self.simulation.restore(state)
    }

    /// What the drones of part of a step see, into a tile of the rollout.
    fn observe(&mut self, tile: usize, part: usize) {
        let Self { simulation, critic_input, rollout, .. } = self;
        let (values, images) = (rollout.inputs_of(tile), rollout.images_of(tile));
        let first = part * rollout.columns;
        critic_input.write(simulation, (first, rollout.columns), &mut rollout.observations[values]);
        let seen = &simulation.images()[first * rollout.lengths.image..][..images.len()];
        rollout.images[images].copy_from_slice(seen);
    }

    fn act(&mut self, networks: &Networks<'_>, tile: usize, (part, noise_step): (usize, u64)) {
        let Self { rollout, pass, .. } = self;
        let means = pass.act(networks, rollout.sight(tile));
        self.noises[part].fill(noise_step, &mut self.normals);
        let (place, column) = (rollout.actions_of(tile), rollout.column_of(tile));
        let (actions, gaussian) = (&mut rollout.actions[place], networks.actor.gaussian());
        gaussian.sample(means, &self.normals, actions);
        gaussian.log_probs(means, actions, &mut rollout.log_probs[column]);
        let commands = self.commands.chunks_exact_mut(rollout.rows);
        for (command, action) in commands.zip(actions.chunks_exact(rollout.columns)) {
            command[part * rollout.columns..][..action.len()].copy_from_slice(action);
        }
    }

    /// What the teacher would have done in part of a step.
    fn ask_teacher(&mut self, tile: usize, part: usize) {
        let Self { simulation, teacher, rollout, .. } = self;
        let Some(teacher) = teacher else { return };
        let (place, columns) = (rollout.actions_of(tile), rollout.columns);
        for column in 0..columns {
            let lesson = teacher.act(&simulation.state(part * columns + column));
            for (row, value) in rollout.lessons[place.clone()].chunks_exact_mut(columns).zip(lesson) {
                row[column] = value;
            }
        }
    }

    fn appraise(&mut self, networks: &Networks<'_>, tile: usize) {
        let Self { rollout, pass, .. } = self;
        let heads = pass.appraise(networks, rollout.sight(tile));
        let column = rollout.column_of(tile);
        networks.critic.write_values(heads, rollout.task, &mut rollout.values[column]);
    }

    fn record(&mut self, step: usize, reward_scale: f32) {
        let Self { simulation, critic_input, rollout, truncated, .. } = self;
        let (rows, image_len) = (rollout.rows, rollout.lengths.image);
        let column = step * rows..(step + 1) * rows;
        for (scaled, reward) in rollout.rewards[column.clone()].iter_mut().zip(simulation.rewards()) {
            *scaled = reward * reward_scale;
        }
        rollout.outcomes[column].copy_from_slice(simulation.outcomes());
        for (row, outcome) in simulation.outcomes().iter().enumerate() {
            if *outcome == Outcome::Truncated {
                truncated.push(Truncated {
                    place: step * rows + row,
                    values: critic_input.at_end(simulation, row),
                    image: simulation.final_images()[row * image_len..][..image_len].to_vec(),
                });
            }
        }
    }

    fn appraise_last(&mut self, networks: &Networks<'_>) {
        let Self { simulation, critic_input, rollout, pass, .. } = self;
        let (columns, image_len) = (rollout.columns, rollout.lengths.image);
        let mut values = vec![0.0; rollout.lengths.features * columns];
        for (part, last) in rollout.last_values.chunks_exact_mut(columns).enumerate() {
            let first = part * columns;
            critic_input.write(simulation, (first, columns), &mut values);
            let images = &simulation.images()[first * image_len..][..columns * image_len];
            let sight = Sight { values: &values, images };
            pass.look(networks, sight);
            networks.critic.write_values(pass.appraise(networks, sight), rollout.task, last);
        }
    }

    /// Collected over the rollout, because a tile of one costs as much as a full one.
    fn appraise_truncated(&mut self, networks: &Networks<'_>) {
        let Self { rollout, pass, truncated, .. } = self;
        let (columns, image_len) = (rollout.columns, rollout.lengths.image);
        let mut tile = vec![0.0; rollout.lengths.features * columns];
        let mut images = vec![0; image_len * columns];
        for group in truncated.chunks(columns) {
            for (column, seen) in group.iter().enumerate() {
                for (row, value) in tile.chunks_exact_mut(columns).zip(&seen.values) {
                    row[column] = *value;
                }
                images[column * image_len..][..image_len].copy_from_slice(&seen.image);
            }
            let sight = Sight { values: &tile, images: &images };
            pass.look(networks, sight);
            let mut values = [0.0; PANEL];
            let heads = pass.appraise(networks, sight);
            networks.critic.write_values(heads, rollout.task, &mut values[..columns]);
            for (seen, value) in group.iter().zip(values) {
                rollout.truncated_values[seen.place] = value;
            }
        }
        truncated.clear();
    }
}

/// How many values belong to a sample.
#[derive(Clone, Copy, Debug)]
struct Lengths {
    features: usize,
    /// Bytes.
    image: usize,
    action: usize,
}

/// Columns of one panel over the steps of a rollout: `[steps][rows]`, which is `[tiles][columns]`.
#[derive(Clone, Debug)]
pub struct Rollout {
    task: usize,
    steps: usize,
    /// Drones.
    rows: usize,
    /// Samples of a tile.
    columns: usize,
    lengths: Lengths,
    /// `[tiles][features][columns]`: observation, privileged values, then those of team mates. The actor reads the
    /// observation.
    observations: Vec<f32>,
    /// `[tiles][columns][image]`.
    images: Vec<u8>,
    /// `[tiles][action length][columns]`, not limited to \[-1, 1\].
    actions: Vec<f32>,
    /// What the teacher would have done, as the actions; empty where nobody teaches.
    lessons: Vec<f32>,
    log_probs: Vec<f32>,
    rewards: Vec<f32>,
    values: Vec<f32>,
    outcomes: Vec<Outcome>,
    truncated_values: Vec<f32>,
    last_values: Vec<f32>,
    advantages: Vec<f32>,
    returns: Vec<f32>,
}

/// Samples of one step of one panel: what a minibatch is made of.
#[derive(Clone, Copy, Debug)]
pub struct Tile<'a> {
    /// Index of its task among those of the run.
    pub task: usize,
    /// Observation, privileged values, then those of team mates where the critic reads them; and images.
    pub sight: Sight<'a>,
    /// `[action length][columns]`.
    pub actions: &'a [f32],
    /// What the teacher would have done, as the actions; empty where nobody teaches.
    pub lessons: &'a [f32],
    /// `[columns]`, of the actions under the policy that chose them.
    pub log_probs: &'a [f32],
    /// `[columns]`.
    pub advantages: &'a [f32],
    /// `[columns]`: what the critic should have said.
    pub returns: &'a [f32],
}

impl Rollout {
    fn new(task: usize, size: RolloutSize, rows: usize, lengths: Lengths) -> Self {
        let RolloutSize { steps, columns } = size;
        let column = || vec![0.0; steps * rows];
        Self {
            task,
            steps,
            rows,
            columns,
            observations: vec![0.0; steps * lengths.features * rows],
            images: vec![0; steps * lengths.image * rows],
            actions: vec![0.0; steps * lengths.action * rows],
            lessons: Vec::new(),
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

    /// A rollout of [`PANEL`] drones and nothing but these observations `[steps][features][PANEL]`.
    #[cfg(test)]
    pub(crate) fn of_observations(observations: Vec<f32>, features: usize, action_len: usize) -> Self {
        let size = RolloutSize { steps: observations.len() / (features * PANEL), columns: PANEL };
        let lengths = Lengths { features, image: 0, action: action_len };
        Self { observations, ..Self::new(0, size, PANEL, lengths) }
    }

    /// Index of its task among those of the run.
    pub fn task(&self) -> usize {
        self.task
    }

    /// Number of tiles.
    pub fn tiles(&self) -> usize {
        self.steps * self.rows / self.columns
    }

    /// Samples of a tile.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Some samples, those of a step together.
    ///
    /// # Panics
    /// When the rollout has no such tile.
    pub fn tile(&self, index: usize) -> Tile<'_> {
        Tile {
            task: self.task,
            sight: self.sight(index),
            actions: &self.actions[self.actions_of(index)],
            lessons: self.lessons.get(self.actions_of(index)).unwrap_or_default(),
            log_probs: &self.log_probs[self.column_of(index)],
            advantages: &self.advantages[self.column_of(index)],
            returns: &self.returns[self.column_of(index)],
        }
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
    pub(crate) fn columns_mut(&mut self) -> [&mut [f32]; 7] {
        let Self { observations, actions, lessons, log_probs, values, advantages, returns, .. } = self;
        [observations, actions, lessons, log_probs, values, advantages, returns].map(Vec::as_mut_slice)
    }

    /// The images that a learner reads of it.
    pub(crate) fn images_mut(&mut self) -> &mut [u8] {
        &mut self.images
    }

    fn sight(&self, tile: usize) -> Sight<'_> {
        Sight { values: &self.observations[self.inputs_of(tile)], images: &self.images[self.images_of(tile)] }
    }

    /// The samples of a tile in a column of values.
    fn column_of(&self, tile: usize) -> Range<usize> {
        self.part_of(tile, 1)
    }

    fn actions_of(&self, tile: usize) -> Range<usize> {
        self.part_of(tile, self.lengths.action)
    }

    fn inputs_of(&self, tile: usize) -> Range<usize> {
        self.part_of(tile, self.lengths.features)
    }

    fn images_of(&self, tile: usize) -> Range<usize> {
        self.part_of(tile, self.lengths.image)
    }

    /// What belongs to a tile where each sample has so many values.
    fn part_of(&self, tile: usize, values: usize) -> Range<usize> {
        tile * self.columns * values..(tile + 1) * self.columns * values
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
