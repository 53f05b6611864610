//! Panels of drones that fly the policy, and the columns that they leave to the learner.

use kestrel_sim::outcome::{Episode, Outcome};
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;
use kestrel_sim::simulation::{Simulation, SimulationState};

use crate::actor_critic::{Actor, Critic};
use crate::advantage::{Columns, gae};
use crate::gaussian::Noise;
use crate::network::Workspace;

/// Drones of a panel, and samples of a tile.
///
/// Enough columns for matrix products at full speed, few enough that the activations of a 64-64 network
/// (2 × 64 kB, as much again backwards) stay in a core's second-level cache.
pub const PANEL: usize = 256;

/// Whether panels can be made of environments with so many drones.
pub(crate) fn is_trainable(drones: u32) -> bool {
    PANEL.is_multiple_of(drones as usize)
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

/// Environments of [`PANEL`] drones in all, stepped by one thread through a whole rollout; several drones of an
/// environment share the policy.
///
/// No panel waits for another, and none shares anything with another: the number of threads cannot matter.
#[derive(Clone, Debug)]
pub struct Panel {
    simulation: Simulation,
    noise: Noise,
    rollout: Rollout,
    actor_workspace: Workspace,
    critic_workspace: Workspace,
    /// Noise of one step `[action length][PANEL]`.
    normals: Vec<f32>,
    /// Place in the rollout and critic input of every truncated step.
    truncated: Vec<(usize, Vec<f32>)>,
}

impl Panel {
    /// Environments at the start of their first episodes; the first `first_row` drones of the run are in panels before.
    ///
    /// # Panics
    /// When the drones of an environment do not divide [`PANEL`].
    pub fn new(
        (task, scenario): (usize, &Scenario),
        seed: Seed,
        first_row: u32,
        steps: usize,
        networks: (&Actor, &Critic),
    ) -> Self {
        let drones = scenario.agents.count;
        assert!(is_trainable(drones), "{drones} drones in an environment do not divide {PANEL}");
        let simulation = Simulation::new(scenario, seed, first_row / drones, PANEL / drones as usize);
        let features = simulation.observation_len() + simulation.privileged_len();
        let action_len = scenario.action.len();
        Self {
            noise: Noise::new(seed, first_row, action_len),
            rollout: Rollout::new(task, steps, (features, action_len)),
            actor_workspace: Workspace::new(networks.0.mlp(), PANEL),
            critic_workspace: Workspace::new(networks.1.mlp(), PANEL),
            normals: vec![0.0; action_len * PANEL],
            truncated: Vec::new(),
            simulation,
        }
    }

    /// Flies the actor through one rollout and estimates its advantages.
    pub fn collect(&mut self, collection: &Collection<'_>) {
        for step in 0..self.rollout.steps {
            self.observe(step);
            self.act(collection.actor, step, collection.first_step + step as u64);
            self.appraise(collection.critic, step);
            self.simulation.step(self.rollout.actions(step));
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

    fn observe(&mut self, step: usize) {
        let input = &mut self.rollout.observations[step * self.rollout.features * PANEL..];
        write_critic_input(self.simulation.observations(), self.simulation.privileged(), input);
    }

    fn act(&mut self, actor: &Actor, step: usize, noise_step: u64) {
        let rollout = &mut self.rollout;
        let means = actor.means(rollout.actor_input(step, actor), &mut self.actor_workspace);
        self.noise.fill(noise_step, &mut self.normals);
        let place = rollout.actions_of(step);
        let (actions, gaussian) = (&mut rollout.actions[place], actor.gaussian());
        gaussian.sample(means, &self.normals, actions);
        gaussian.log_probs(means, actions, &mut rollout.log_probs[column_of(step)]);
    }

    fn appraise(&mut self, critic: &Critic, step: usize) {
        let mut values = [0.0; PANEL];
        critic.appraise(
            self.rollout.critic_input(step),
            self.rollout.task,
            &mut self.critic_workspace,
            &mut values,
        );
        self.rollout.values[column_of(step)].copy_from_slice(&values);
    }

    fn record(&mut self, step: usize, reward_scale: f32) {
        let rewards = &mut self.rollout.rewards[column_of(step)];
        for (scaled, reward) in rewards.iter_mut().zip(self.simulation.rewards()) {
            *scaled = reward * reward_scale;
        }
        self.rollout.outcomes[column_of(step)].copy_from_slice(self.simulation.outcomes());
        for (row, outcome) in self.simulation.outcomes().iter().enumerate() {
            if *outcome == Outcome::Truncated {
                let observation = self.simulation.final_observations().chunks_exact(PANEL);
                let privileged = self.simulation.final_privileged().chunks_exact(PANEL);
                let input = observation.chain(privileged).map(|column| column[row]).collect();
                self.truncated.push((step * PANEL + row, input));
            }
        }
    }

    fn appraise_last(&mut self, critic: &Critic) {
        let mut input = vec![0.0; self.rollout.features * PANEL];
        write_critic_input(self.simulation.observations(), self.simulation.privileged(), &mut input);
        critic.appraise(&input, self.rollout.task, &mut self.critic_workspace, &mut self.rollout.last_values);
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

fn write_critic_input(observations: &[f32], privileged: &[f32], input: &mut [f32]) {
    let (seen, hidden) = input.split_at_mut(observations.len());
    seen.copy_from_slice(observations);
    hidden[..privileged.len()].copy_from_slice(privileged);
}

fn column_of(step: usize) -> std::ops::Range<usize> {
    step * PANEL..(step + 1) * PANEL
}

/// Columns of one panel over the steps of a rollout.
#[derive(Clone, Debug)]
pub struct Rollout {
    task: usize,
    steps: usize,
    features: usize,
    action_len: usize,
    /// `[steps][features][PANEL]`: observation, then privileged values. The actor reads the first rows.
    observations: Vec<f32>,
    /// `[steps][action length][PANEL]`, not limited to \[-1, 1\].
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

/// The samples of one step of one panel: what a minibatch is made of.
#[derive(Clone, Copy, Debug)]
pub struct Tile<'a> {
    /// Index of its task among those of the run.
    pub task: usize,
    /// `[features][PANEL]`: observation, then privileged values.
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
    fn new(task: usize, steps: usize, (features, action_len): (usize, usize)) -> Self {
        let column = || vec![0.0; steps * PANEL];
        Self {
            task,
            steps,
            features,
            action_len,
            observations: vec![0.0; steps * features * PANEL],
            actions: vec![0.0; steps * action_len * PANEL],
            log_probs: column(),
            rewards: column(),
            values: column(),
            outcomes: vec![Outcome::Running; steps * PANEL],
            truncated_values: column(),
            last_values: vec![0.0; PANEL],
            advantages: column(),
            returns: column(),
        }
    }

    /// A rollout of nothing but these observations `[steps][features][PANEL]`.
    #[cfg(test)]
    pub(crate) fn of_observations(observations: Vec<f32>, features: usize, action_len: usize) -> Self {
        let steps = observations.len() / (features * PANEL);
        Self { observations, ..Self::new(0, steps, (features, action_len)) }
    }

    /// Index of its task among those of the run.
    pub fn task(&self) -> usize {
        self.task
    }

    /// Number of steps.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// The samples of one step.
    ///
    /// # Panics
    /// When the rollout has no such step.
    pub fn tile(&self, step: usize) -> Tile<'_> {
        Tile {
            task: self.task,
            observations: self.critic_input(step),
            actions: self.actions(step),
            log_probs: &self.log_probs[column_of(step)],
            advantages: &self.advantages[column_of(step)],
            returns: &self.returns[column_of(step)],
        }
    }

    /// Estimated advantages, `[steps][PANEL]`.
    pub fn advantages(&self) -> &[f32] {
        &self.advantages
    }

    pub(crate) fn advantages_mut(&mut self) -> &mut [f32] {
        &mut self.advantages
    }

    /// Advantages plus values, `[steps][PANEL]`.
    pub fn returns(&self) -> &[f32] {
        &self.returns
    }

    /// The critic's values, `[steps][PANEL]`.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    fn actions(&self, step: usize) -> &[f32] {
        &self.actions[self.actions_of(step)]
    }

    fn actions_of(&self, step: usize) -> std::ops::Range<usize> {
        let length = self.action_len * PANEL;
        step * length..(step + 1) * length
    }

    fn critic_input(&self, step: usize) -> &[f32] {
        let length = self.features * PANEL;
        &self.observations[step * length..(step + 1) * length]
    }

    fn actor_input(&self, step: usize, actor: &Actor) -> &[f32] {
        &self.critic_input(step)[..actor.mlp().inputs() * PANEL]
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
