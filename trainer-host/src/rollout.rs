//! Panels of drones that fly the policy, and the columns that they leave to the learner.

mod critic_input;

use kestrel_sim::outcome::{Episode, Outcome};
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;
use kestrel_sim::simulation::{Simulation, SimulationState};

use crate::actor_critic::{Actor, Critic};
use crate::advantage::{Columns, gae};
use crate::gaussian::Noise;
use crate::network::Workspace;
use critic_input::CriticInput;
pub use critic_input::CriticScope;

/// Samples of a tile, and drones of a panel unless their team does not divide it.
///
/// Enough columns for matrix products at full speed, few enough that the activations of a 64-64 network
/// (2 × 64 kB, as much again backwards) stay in a core's second-level cache.
pub const PANEL: usize = 256;

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
    /// Chooses the actions.
    pub actor: &'a Actor,
    /// Appraises the observations.
    pub critic: &'a Critic,
    /// Steps that every drone has made before.
    pub first_step: u64,
    /// Factor on rewards.
    pub reward_scale: f32,
    /// Discount per step.
    pub discount: f32,
    /// Trace decay of the advantage estimate.
    pub gae_lambda: f32,
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
    rollout: Rollout,
    actor_workspace: Workspace,
    critic_workspace: Workspace,
    /// Noise of one tile `[action length][PANEL]`.
    normals: Vec<f32>,
    /// Actions of one step `[action length][rows]`.
    commands: Vec<f32>,
    /// Place in the rollout and critic input of every truncated step.
    truncated: Vec<(usize, Vec<f32>)>,
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
    /// Environments at the start of their first episodes, which fly and appraise rollouts of so many `steps`.
    ///
    /// # Panics
    /// When the drones do not fill tiles and environments.
    pub fn new(
        (task, scenario): (usize, &Scenario),
        seed: Seed,
        rows: PanelRows,
        (steps, scope): (usize, CriticScope),
        networks: (&Actor, &Critic),
    ) -> Self {
        let (team, count) = (scenario.agents.count, rows.count);
        let fits = count.is_multiple_of(PANEL) && count.is_multiple_of(team as usize);
        assert!(fits, "{count} drones in tiles of {PANEL} and teams of {team}");
        let simulation = Simulation::new(scenario, seed, rows.first / team, count / team as usize);
        let critic_input = CriticInput::new(&simulation, scope);
        let action_len = scenario.action.len();
        let firsts = (rows.first..rows.first + count as u32).step_by(PANEL);
        Self {
            noises: firsts.map(|first| Noise::new(seed, first, action_len)).collect(),
            rollout: Rollout::new(task, (steps, count), (critic_input.len(&simulation), action_len)),
            actor_workspace: Workspace::new(networks.0.mlp(), PANEL),
            critic_workspace: Workspace::new(networks.1.mlp(), PANEL),
            normals: vec![0.0; action_len * PANEL],
            commands: vec![0.0; action_len * count],
            truncated: Vec::new(),
            critic_input,
            simulation,
        }
    }

    /// Flies the actor through one rollout and estimates its advantages.
    pub fn collect(&mut self, collection: &Collection<'_>) {
        for step in 0..self.rollout.steps {
            for part in 0..self.noises.len() {
                let tile = step * self.noises.len() + part;
                self.observe(tile, part);
                self.act(collection.actor, tile, (part, collection.first_step + step as u64));
                self.appraise(collection.critic, tile);
            }
            self.simulation.step(&self.commands);
            self.record(step, collection.reward_scale);
        }
        self.appraise_last(collection.critic);
        self.appraise_truncated(collection.critic);
        self.rollout.estimate_advantages(collection.discount, collection.gae_lambda);
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
        let place = self.rollout.inputs_of(tile);
        self.critic_input.write(&self.simulation, part * PANEL, &mut self.rollout.observations[place]);
    }

    fn act(&mut self, actor: &Actor, tile: usize, (part, noise_step): (usize, u64)) {
        let rollout = &mut self.rollout;
        let means = actor.means(rollout.actor_input(tile, actor), &mut self.actor_workspace);
        self.noises[part].fill(noise_step, &mut self.normals);
        let place = rollout.actions_of(tile);
        let (actions, gaussian) = (&mut rollout.actions[place], actor.gaussian());
        gaussian.sample(means, &self.normals, actions);
        gaussian.log_probs(means, actions, &mut rollout.log_probs[column_of(tile)]);
        let commands = self.commands.chunks_exact_mut(rollout.rows);
        for (command, action) in commands.zip(actions.chunks_exact(PANEL)) {
            command[column_of(part)].copy_from_slice(action);
        }
    }

    fn appraise(&mut self, critic: &Critic, tile: usize) {
        let place = self.rollout.inputs_of(tile);
        let Rollout { task, observations, values, .. } = &mut self.rollout;
        critic.appraise(&observations[place], *task, &mut self.critic_workspace, &mut values[column_of(tile)]);
    }

    fn record(&mut self, step: usize, reward_scale: f32) {
        let rows = self.rollout.rows;
        let column = step * rows..(step + 1) * rows;
        for (scaled, reward) in self.rollout.rewards[column.clone()].iter_mut().zip(self.simulation.rewards()) {
            *scaled = reward * reward_scale;
        }
        self.rollout.outcomes[column].copy_from_slice(self.simulation.outcomes());
        for (row, outcome) in self.simulation.outcomes().iter().enumerate() {
            if *outcome == Outcome::Truncated {
                let input = self.critic_input.at_end(&self.simulation, row);
                self.truncated.push((step * rows + row, input));
            }
        }
    }

    fn appraise_last(&mut self, critic: &Critic) {
        let mut input = vec![0.0; self.rollout.features * PANEL];
        for (part, values) in self.rollout.last_values.chunks_exact_mut(PANEL).enumerate() {
            self.critic_input.write(&self.simulation, part * PANEL, &mut input);
            critic.appraise(&input, self.rollout.task, &mut self.critic_workspace, values);
        }
    }

    /// Collected over the rollout, because a tile of one costs as much as a full one.
    fn appraise_truncated(&mut self, critic: &Critic) {
        let mut tile = vec![0.0; self.rollout.features * PANEL];
        for group in self.truncated.chunks(PANEL) {
            for (column, (_, input)) in group.iter().enumerate() {
                for (row, value) in tile.chunks_exact_mut(PANEL).zip(input) {
                    row[column] = *value;
                }
            }
            let mut values = [0.0; PANEL];
            critic.appraise(&tile, self.rollout.task, &mut self.critic_workspace, &mut values);
            for ((place, _), value) in group.iter().zip(values) {
                self.rollout.truncated_values[*place] = value;
            }
        }
        self.truncated.clear();
    }
}

/// The samples of a tile in a column of values.
fn column_of(tile: usize) -> std::ops::Range<usize> {
    tile * PANEL..(tile + 1) * PANEL
}

/// Columns of one panel over the steps of a rollout: `[steps][rows]`, which is `[tiles][PANEL]`.
#[derive(Clone, Debug)]
pub struct Rollout {
    task: usize,
    steps: usize,
    /// Drones.
    rows: usize,
    features: usize,
    action_len: usize,
    /// `[tiles][features][PANEL]`: observation, privileged values, then those of team mates. The actor reads the
    /// observation.
    observations: Vec<f32>,
    /// `[tiles][action length][PANEL]`, not limited to \[-1, 1\].
    actions: Vec<f32>,
    log_probs: Vec<f32>,
    rewards: Vec<f32>,
    values: Vec<f32>,
    outcomes: Vec<Outcome>,
    truncated_values: Vec<f32>,
    last_values: Vec<f32>,
    advantages: Vec<f32>,
    returns: Vec<f32>,
}

/// [`PANEL`] samples of one step of one panel: what a minibatch is made of.
#[derive(Clone, Copy, Debug)]
pub struct Tile<'a> {
    /// Index of its task among those of the run.
    pub task: usize,
    /// `[features][PANEL]`: observation, privileged values, then those of team mates where the critic reads them.
    pub observations: &'a [f32],
    /// `[action length][PANEL]`.
    pub actions: &'a [f32],
    /// `[PANEL]`, of the actions under the policy that chose them.
    pub log_probs: &'a [f32],
    /// `[PANEL]`.
    pub advantages: &'a [f32],
    /// `[PANEL]`: what the critic should have said.
    pub returns: &'a [f32],
}

impl Rollout {
    fn new(task: usize, (steps, rows): (usize, usize), (features, action_len): (usize, usize)) -> Self {
        let column = || vec![0.0; steps * rows];
        Self {
            task,
            steps,
            rows,
            features,
            action_len,
            observations: vec![0.0; steps * features * rows],
            actions: vec![0.0; steps * action_len * rows],
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
        let steps = observations.len() / (features * PANEL);
        Self { observations, ..Self::new(0, (steps, PANEL), (features, action_len)) }
    }

    /// Index of its task among those of the run.
    pub fn task(&self) -> usize {
        self.task
    }

    /// Number of tiles.
    pub fn tiles(&self) -> usize {
        self.steps * self.rows / PANEL
    }

    /// Some samples, those of a step together.
    ///
    /// # Panics
    /// When the rollout has no such tile.
    pub fn tile(&self, index: usize) -> Tile<'_> {
        Tile {
            task: self.task,
            observations: &self.observations[self.inputs_of(index)],
            actions: &self.actions[self.actions_of(index)],
            log_probs: &self.log_probs[column_of(index)],
            advantages: &self.advantages[column_of(index)],
            returns: &self.returns[column_of(index)],
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

    /// All that a learner reads of it.
    pub(crate) fn columns_mut(&mut self) -> [&mut [f32]; 6] {
        let Self { observations, actions, log_probs, values, advantages, returns, .. } = self;
        [observations, actions, log_probs, values, advantages, returns].map(Vec::as_mut_slice)
    }

    fn actions_of(&self, tile: usize) -> std::ops::Range<usize> {
        let length = self.action_len * PANEL;
        tile * length..(tile + 1) * length
    }

    fn inputs_of(&self, tile: usize) -> std::ops::Range<usize> {
        let length = self.features * PANEL;
        tile * length..(tile + 1) * length
    }

    fn actor_input(&self, tile: usize, actor: &Actor) -> &[f32] {
        &self.observations[self.inputs_of(tile)][..actor.mlp().inputs() * PANEL]
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
