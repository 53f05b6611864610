//! The façade: many environments stepped by one thread. Threads run several simulations side by side.

use kestrel_core::action::ACTION_LIMIT;
use pulp::{Arch, Simd, WithSimd};
use serde::{Deserialize, Serialize};

use crate::block::{Block, Finished, PRIVILEGED_LEN};
use crate::contact::Hull;
use crate::outcome::{Ending, Episode, Outcome};
use crate::scenario::{CriticView, Scenario};
use crate::seed::{Purpose, Seed, Stream};
use crate::swarm::{Column, Swarm};
use crate::termination;

/// Environments that step together, in blocks of `LANES` lanes.
///
/// Columns are feature-major: value `f` of environment `e` stands at `f * environments + e`. The bits do not depend
/// on `LANES`, nor on how environments are divided among simulations: an environment's randomness follows from the
/// seed and its index.
#[derive(Clone, Debug)]
pub struct Simulation<const LANES: usize = 64> {
    scenario: Scenario,
    hull: Hull,
    arch: Arch,
    first_environment: u32,
    environments: usize,
    blocks: Vec<Block<LANES>>,
    observations: Vec<f32>,
    privileged: Vec<f32>,
    rewards: Vec<f32>,
    outcomes: Vec<Outcome>,
    final_observations: Vec<f32>,
    final_privileged: Vec<f32>,
    episodes: Vec<Episode>,
}

/// Everything the next step depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SimulationState {
    columns: Vec<f32>,
    streams: Vec<Stream>,
    episodes: Vec<Episode>,
}

impl<const LANES: usize> Simulation<LANES> {
    /// Environments `first_environment..first_environment + environments` at the start of their first episodes.
    pub fn new(scenario: &Scenario, seed: Seed, first_environment: u32, environments: usize) -> Self {
        Self::with_purpose(scenario, seed, Purpose::Reset, first_environment, environments)
    }

    /// As [`Self::new`], with start states from the streams of another purpose.
    pub fn with_purpose(
        scenario: &Scenario,
        seed: Seed,
        purpose: Purpose,
        first_environment: u32,
        environments: usize,
    ) -> Self {
        let firsts = (0..environments.div_ceil(LANES)).map(|block| first_environment + (block * LANES) as u32);
        let observation_len = scenario.observation.len();
        let privileged_len = match scenario.critic {
            CriticView::Observation => 0,
            CriticView::Privileged => PRIVILEGED_LEN,
        };
        let mut simulation = Self {
            hull: Hull::new(&scenario.airframe),
            arch: Arch::new(),
            first_environment,
            environments,
            blocks: firsts.map(|first| Block::new(scenario, seed, purpose, first)).collect(),
            observations: vec![0.0; observation_len * environments],
            privileged: vec![0.0; privileged_len * environments],
            rewards: vec![0.0; environments],
            outcomes: vec![Outcome::Running; environments],
            final_observations: vec![0.0; observation_len * environments],
            final_privileged: vec![0.0; privileged_len * environments],
            episodes: Vec::new(),
            scenario: scenario.clone(),
        };
        simulation.publish();
        simulation
    }

    /// Advances every environment by one control period; environments that end start anew.
    ///
    /// `actions` is `[action length][environments]`; values are limited to \[-1, 1\], NaN counts as -1.
    ///
    /// # Panics
    /// When `actions` has another length.
    pub fn step(&mut self, actions: &[f32]) {
        let action_len = self.scenario.action.len();
        assert_eq!(actions.len(), action_len * self.environments, "actions are [{action_len}][environments]");
        self.arch.dispatch(Advance {
            scenario: &self.scenario,
            hull: &self.hull,
            blocks: &mut self.blocks,
            actions,
            environments: self.environments,
        });
        self.publish_rewards();
        self.restart_ended();
        self.publish();
    }

    /// Number of environments.
    pub fn environments(&self) -> usize {
        self.environments
    }

    /// The scenario they run.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Values of an observation.
    pub fn observation_len(&self) -> usize {
        self.scenario.observation.len()
    }

    /// Values that a privileged critic sees beside the observation; zero for other critics.
    pub fn privileged_len(&self) -> usize {
        self.privileged.len() / self.environments.max(1)
    }

    /// Observations after the last step and its resets, `[observation_len][environments]`.
    pub fn observations(&self) -> &[f32] {
        &self.observations
    }

    /// Privileged values after the last step and its resets, `[privileged_len][environments]`.
    pub fn privileged(&self) -> &[f32] {
        &self.privileged
    }

    /// Rewards of the last step, `[environments]`.
    pub fn rewards(&self) -> &[f32] {
        &self.rewards
    }

    /// Outcomes of the last step, `[environments]`.
    pub fn outcomes(&self) -> &[Outcome] {
        &self.outcomes
    }

    /// Observations before the reset, `[observation_len][environments]`; valid where the outcome is not `Running`.
    pub fn final_observations(&self) -> &[f32] {
        &self.final_observations
    }

    /// Privileged values before the reset, `[privileged_len][environments]`; valid as the observations are.
    pub fn final_privileged(&self) -> &[f32] {
        &self.final_privileged
    }

    /// The true state of an environment's drone.
    ///
    /// # Panics
    /// When there is no such environment.
    pub fn state(&self, environment: usize) -> kestrel_core::vehicle::State<f32> {
        assert!(environment < self.environments, "environment {environment} of {}", self.environments);
        self.swarm(environment).state(environment % LANES)
    }

    /// Episodes that ended since the last call, in the order of steps, then environments.
    pub fn take_episodes(&mut self) -> Vec<Episode> {
        core::mem::take(&mut self.episodes)
    }

    /// What [`Self::restore`] needs to go on to the same bits.
    pub fn save(&self) -> SimulationState {
        let mut blocks = self.blocks.clone();
        let mut columns = Vec::new();
        let mut streams = Vec::new();
        for block in &mut blocks {
            for column in block.columns_mut() {
                columns.extend_from_slice(column);
            }
            streams.extend_from_slice(block.streams_mut());
        }
        SimulationState { columns, streams, episodes: self.episodes.clone() }
    }

    /// Returns to a saved state; `false`, and nothing changes, when it belongs to another scenario or size.
    #[must_use]
    pub fn restore(&mut self, state: &SimulationState) -> bool {
        let mut blocks = self.blocks.clone();
        let columns: usize = blocks.iter_mut().map(|block| block.columns_mut().count()).sum();
        if state.columns.len() != columns * LANES || state.streams.len() != blocks.len() * LANES {
            return false;
        }
        let mut values = state.columns.chunks_exact(LANES);
        let mut streams = state.streams.chunks_exact(LANES);
        for block in &mut blocks {
            for (column, values) in block.columns_mut().zip(&mut values) {
                column.copy_from_slice(values);
            }
            for (stream, saved) in block.streams_mut().iter_mut().zip(streams.next().unwrap_or_default()) {
                stream.clone_from(saved);
            }
        }
        self.blocks = blocks;
        self.episodes.clone_from(&state.episodes);
        self.publish();
        true
    }

    fn swarm(&self, environment: usize) -> &Swarm<LANES> {
        &self.blocks[environment / LANES].swarm
    }

    /// Copies rewards and outcomes out of the blocks.
    fn publish_rewards(&mut self) {
        let rewards = self.rewards.chunks_mut(LANES);
        for ((block, rewards), outcomes) in self.blocks.iter().zip(rewards).zip(self.outcomes.chunks_mut(LANES)) {
            rewards.copy_from_slice(&block.rewards[..rewards.len()]);
            for (outcome, code) in outcomes.iter_mut().zip(block.codes) {
                *outcome = termination::decode(code).map_or(Outcome::Running, Ending::outcome);
            }
        }
    }

    /// Records the episodes that ended, with their last observations, and starts the next ones.
    fn restart_ended(&mut self) {
        let environments = self.environments;
        for (index, block) in self.blocks.iter_mut().enumerate() {
            if block.codes.iter().all(|code| *code == 0.0) {
                continue;
            }
            let first = self.first_environment + (index * LANES) as u32;
            block.restart_ended(&self.scenario, first, &mut |finished: Finished| {
                let environment = index * LANES + finished.lane;
                if environment < environments {
                    scatter(&mut self.final_observations, environments, environment, &finished.observation);
                    scatter(&mut self.final_privileged, environments, environment, &finished.privileged);
                    self.episodes.push(finished.episode);
                }
            });
        }
    }

    /// Copies the blocks' observations into the columns.
    fn publish(&mut self) {
        for (index, block) in self.blocks.iter().enumerate() {
            gather(&mut self.observations, self.environments, index * LANES, &block.observations);
            gather(&mut self.privileged, self.environments, index * LANES, &block.privileged);
        }
    }
}

/// The part of a step that runs in lanes, compiled for each instruction set.
struct Advance<'a, const LANES: usize> {
    scenario: &'a Scenario,
    hull: &'a Hull,
    blocks: &'a mut [Block<LANES>],
    actions: &'a [f32],
    environments: usize,
}

impl<const LANES: usize> WithSimd for Advance<'_, LANES> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        for (index, block) in self.blocks.iter_mut().enumerate() {
            let actions = actions_of_block(self.actions, self.environments, index * LANES);
            block.advance(self.scenario, self.hull, &actions);
        }
    }
}

/// The block's actions, limited to \[-1, 1\]; lanes beyond the last environment hover.
#[inline(always)]
fn actions_of_block<const LANES: usize>(
    actions: &[f32],
    environments: usize,
    first: usize,
) -> [Column<LANES>; ACTION_LIMIT] {
    let mut columns = [[0.0; LANES]; ACTION_LIMIT];
    let count = LANES.min(environments - first);
    for (column, actions) in columns.iter_mut().zip(actions.chunks_exact(environments)) {
        column[..count].copy_from_slice(&actions[first..first + count]);
        for value in column {
            let floored = if *value > -1.0 { *value } else { -1.0 };
            *value = if floored < 1.0 { floored } else { 1.0 };
        }
    }
    columns
}

/// Copies block columns to `first..` of each feature's column; `target` may hold fewer features.
fn gather<const LANES: usize>(target: &mut [f32], environments: usize, first: usize, columns: &[Column<LANES>]) {
    let count = LANES.min(environments - first);
    for (target, column) in target.chunks_exact_mut(environments.max(1)).zip(columns) {
        target[first..first + count].copy_from_slice(&column[..count]);
    }
}

/// Writes one environment's values into its place in each feature's column.
fn scatter(target: &mut [f32], environments: usize, environment: usize, values: &[f32]) {
    for (column, value) in target.chunks_exact_mut(environments.max(1)).zip(values) {
        column[environment] = *value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Cuboid, StartPosition, Success, Termination};
    use crate::testing::hover;
    use crate::world::{Floor, Solid};
    use kestrel_core::action::ActionSpace;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn noise(step: usize, count: usize) -> Vec<f32> {
        let mut stream = Stream::new(Seed(99), step as u32, Purpose::Actions);
        (0..count).map(|_| stream.between(-1.2, 1.2)).collect()
    }

    /// Observations, rewards and episodes of `steps` steps of noise, environment by environment.
    fn fly<const LANES: usize>(parts: &[(u32, usize)], steps: usize) -> (Vec<Vec<u32>>, Vec<Episode>) {
        let total: usize = parts.iter().map(|(_, count)| count).sum();
        let mut traces = vec![Vec::new(); total];
        let mut episodes = Vec::new();
        for &(first, count) in parts {
            let mut simulation = Simulation::<LANES>::new(&hover(), Seed(5), first, count);
            for step in 0..steps {
                let all = noise(step, 4 * total);
                let from = first as usize;
                let actions: Vec<f32> =
                    all.chunks_exact(total).flat_map(|column| column[from..from + count].to_vec()).collect();
                simulation.step(&actions);
                for environment in 0..count {
                    let trace = &mut traces[from + environment];
                    trace.push(simulation.rewards()[environment].to_bits());
                    let values = simulation.observations().chunks_exact(count);
                    trace.extend(values.map(|column| column[environment].to_bits()));
                }
            }
            episodes.extend(simulation.take_episodes());
        }
        episodes.sort_by_key(|episode| episode.environment);
        (traces, episodes)
    }

    #[test]
    fn bits_do_not_depend_on_lanes_or_on_how_environments_are_divided() {
        let reference = fly::<64>(&[(0, 40)], 150);
        assert!(reference.1.len() >= 40);
        assert!(reference == fly::<1>(&[(0, 40)], 150));
        assert!(reference == fly::<8>(&[(0, 40)], 150));
        assert!(reference == fly::<16>(&[(0, 11), (11, 29)], 150));
    }

    #[test]
    fn a_lane_equals_a_lone_drone_bit_for_bit() {
        let scenario = hover();
        let mut simulation = Simulation::<64>::new(&scenario, Seed(1), 0, 3);
        let mut stream = Stream::new(Seed(1), 2, Purpose::Reset);
        let beginning = crate::reset::begin(&scenario, &mut stream);
        let mut state = beginning.state;
        let air = kestrel_core::vehicle::Air {
            wind: beginning.wind,
            force: Vector3::zeros(),
            ground: scenario.physics.ground,
        };
        for step in 0..20 {
            let actions = noise(step, 12);
            simulation.step(&actions);
            let action = [actions[2], actions[5], actions[8], actions[11]];
            let ActionSpace::RotorSpeeds(space) = &scenario.action else { unreachable!() };
            let targets = space.rotor_targets(&action);
            for _ in 0..scenario.physics.substeps {
                let secs = scenario.physics.substep_secs();
                state = scenario.physics.integrator.advance(&beginning.vehicle, &state, &targets, &air, secs);
            }
            assert_eq!(simulation.state(2), state);
        }
    }

    #[test]
    fn a_restored_simulation_goes_on_to_the_same_bits() {
        let mut simulation = Simulation::<64>::new(&hover(), Seed(8), 0, 70);
        for step in 0..77 {
            simulation.step(&noise(step, 280));
        }
        let saved = simulation.save();
        let mut other = Simulation::<64>::new(&hover(), Seed(9), 0, 70);
        assert!(other.restore(&saved));
        for step in 77..150 {
            simulation.step(&noise(step, 280));
            other.step(&noise(step, 280));
            assert_eq!(simulation.observations(), other.observations());
            assert_eq!(simulation.rewards(), other.rewards());
        }
        assert_eq!(simulation.take_episodes(), other.take_episodes());
        assert!(!Simulation::<64>::new(&hover(), Seed(9), 0, 7).restore(&saved));
    }

    #[test]
    fn the_clock_truncates_and_keeps_the_last_observation() {
        let mut scenario = hover();
        scenario.terminations.clear();
        scenario.aviary.world.floor = Floor::Absent;
        scenario.episode_secs = 0.05;
        let mut simulation = Simulation::<64>::new(&scenario, Seed(2), 0, 2);
        for _ in 0..5 {
            assert!(simulation.outcomes().iter().all(|outcome| *outcome == Outcome::Running));
            simulation.step(&[0.3; 8]);
        }
        assert_eq!(simulation.outcomes(), [Outcome::Truncated; 2]);
        // The previous action is the last thing an observation holds; a reset clears it.
        assert_eq!(simulation.final_observations()[21 * 2], 0.3);
        assert_eq!(simulation.observations()[21 * 2], 0.0);
        let episodes = simulation.take_episodes();
        assert!(episodes.iter().all(|episode| episode.steps == 5));
    }

    #[test]
    fn a_drone_that_meets_a_wall_collides() {
        let mut scenario = hover();
        scenario.start.position =
            StartPosition::Within(Cuboid { low: Vector3::new(0.0, 0.0, 1.0), high: Vector3::new(0.0, 0.0, 1.0) });
        scenario.start.speed_limit = 0.0;
        let wall = |x: f64| Solid::block("wall", Vector3::new(x, -1.0, 0.0), Vector3::new(x + 0.1, 1.0, 2.0));
        scenario.aviary.world.solids = vec![wall(0.061)];
        let mut near = Simulation::<64>::new(&scenario, Seed(2), 0, 1);
        near.step(&[0.0; 4]);
        assert_eq!(near.outcomes(), [Outcome::Running]);
        scenario.aviary.world.solids = vec![wall(0.059)];
        let mut touching = Simulation::<64>::new(&scenario, Seed(2), 0, 1);
        touching.step(&[0.0; 4]);
        assert_eq!(touching.outcomes(), [Outcome::Terminated]);
        assert_eq!(touching.take_episodes()[0].ending, crate::outcome::Ending::Collision);
    }

    #[test]
    fn reaching_the_region_slowly_enough_is_success() {
        let mut scenario = hover();
        let everywhere = Cuboid { low: Vector3::repeat(-5.0), high: Vector3::repeat(5.0) };
        scenario.success = Success::Reach { region: everywhere, speed_limit: 20.0 };
        let mut simulation = Simulation::<64>::new(&scenario, Seed(2), 0, 1);
        simulation.step(&[0.0; 4]);
        assert!(simulation.take_episodes()[0].success);
        scenario.success = Success::Reach { region: everywhere, speed_limit: 0.0 };
        let mut simulation = Simulation::<64>::new(&scenario, Seed(2), 0, 1);
        simulation.step(&[0.0; 4]);
        assert!(simulation.take_episodes().is_empty());
    }

    #[test]
    fn terms_add_up_to_the_return() {
        let mut simulation = Simulation::<64>::new(&hover(), Seed(3), 0, 16);
        for step in 0..120 {
            simulation.step(&noise(step, 64));
        }
        for episode in simulation.take_episodes() {
            let sum: f32 = episode.terms.iter().sum();
            assert!((sum - episode.total_reward).abs() < 1e-3 * episode.total_reward.abs().max(1.0));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn no_action_breaks_an_observation(bits in prop::collection::vec(any::<u32>(), 16), steps in 1_usize..40) {
            let mut scenario = hover();
            scenario.terminations = vec![Termination::Distance { limit_m: 50.0 }];
            let mut simulation = Simulation::<64>::new(&scenario, Seed(4), 0, 4);
            let actions: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
            for _ in 0..steps {
                simulation.step(&actions);
                prop_assert!(simulation.observations().iter().all(|value| value.is_finite()));
                prop_assert!(simulation.rewards().iter().all(|value| value.is_finite()));
            }
        }
    }
}
