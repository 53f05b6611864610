//! One block of environments: the step as a list of stages over `LANES` lanes.

use kestrel_core::action::{ACTION_LIMIT, ControlMemory, Controls, Persistence};
use kestrel_core::controller::Setpoint;
use kestrel_core::observation::{OBSERVATION_LIMIT, ObservationLayout, Seen};

use crate::contact::{self, Hull};
use crate::outcome::{Ending, Episode};
use crate::reset::{self, Beginning};
use crate::reward::{Ends, StepView};
use crate::scenario::{CriticView, Scenario, Success};
use crate::seed::{Purpose, Seed, Stream};
use crate::swarm::{Column, Swarm, row, set_row};
use crate::termination::{self, FlightView};

/// Values a privileged critic sees beside the observation: rotor speeds relative to hover − 1 (4), wind \[m/s\] (3),
/// mass and thrust factors − 1 (2), share of the episode left (1).
pub const PRIVILEGED_LEN: usize = 10;

/// `LANES` environments that step together.
#[derive(Clone, Debug)]
pub(crate) struct Block<const LANES: usize> {
    pub(crate) swarm: Swarm<LANES>,
    pub(crate) observations: Vec<Column<LANES>>,
    pub(crate) privileged: [Column<LANES>; PRIVILEGED_LEN],
    pub(crate) rewards: Column<LANES>,
    pub(crate) codes: Column<LANES>,
    factors: [Column<LANES>; 2],
    memories: [ControlMemory<f32>; LANES],
    previous_actions: [Column<LANES>; ACTION_LIMIT],
    distances: Column<LANES>,
    steps: Column<LANES>,
    /// Last step at which the drone was outside the radius it must settle in.
    last_outside: Column<LANES>,
    /// One where an episode just ended in success.
    successes: Column<LANES>,
    totals: Column<LANES>,
    term_totals: Vec<Column<LANES>>,
    streams: Vec<Stream>,
}

/// An environment whose episode ended in this step.
pub(crate) struct Finished {
    pub(crate) lane: usize,
    pub(crate) episode: Episode,
    pub(crate) observation: [f32; OBSERVATION_LIMIT],
    pub(crate) privileged: [f32; PRIVILEGED_LEN],
}

/// Reciprocals, computed once per step.
struct PrivilegedScales {
    per_hover_speed: f32,
    per_episode_steps: f32,
}

impl PrivilegedScales {
    fn of(scenario: &Scenario) -> Self {
        Self {
            per_hover_speed: 1.0 / scenario.airframe.hover_rotor_speed() as f32,
            per_episode_steps: 1.0 / scenario.episode_steps() as f32,
        }
    }
}

impl<const LANES: usize> Block<LANES> {
    /// Environments `first..first + LANES` at the start of their first episodes.
    pub(crate) fn new(scenario: &Scenario, seed: Seed, purpose: Purpose, first: u32) -> Self {
        let nothing = [0.0; LANES];
        let streams = (0..LANES as u32).map(|lane| Stream::new(seed, first + lane, purpose)).collect();
        let mut block = Self {
            swarm: Swarm::new(&scenario.airframe),
            observations: vec![nothing; scenario.observation.len()],
            privileged: [nothing; PRIVILEGED_LEN],
            rewards: nothing,
            codes: nothing,
            factors: [[1.0; LANES]; 2],
            memories: [ControlMemory::new(); LANES],
            previous_actions: [nothing; ACTION_LIMIT],
            distances: nothing,
            steps: nothing,
            last_outside: nothing,
            successes: nothing,
            totals: nothing,
            term_totals: vec![nothing; scenario.rewards.len()],
            streams,
        };
        for lane in 0..LANES {
            block.reset(scenario, lane);
        }
        block
    }

    /// One control period: everything but the resets.
    #[inline(always)]
    pub(crate) fn advance(&mut self, scenario: &Scenario, hull: &Hull, actions: &[Column<LANES>; ACTION_LIMIT]) {
        let previous_distances = self.distances;
        self.fly(scenario, actions);
        self.measure(scenario);
        self.judge(scenario, hull);
        self.reward(scenario, actions, &previous_distances);
        self.previous_actions = *actions;
        self.observe(scenario);
    }

    /// Action to rotor targets, held over the substeps.
    #[inline(always)]
    fn fly(&mut self, scenario: &Scenario, actions: &[Column<LANES>; ACTION_LIMIT]) {
        let targets = self.rotor_targets(scenario, actions);
        for _ in 0..scenario.physics.substeps {
            self.swarm.advance(&scenario.physics, &targets);
        }
    }

    #[inline(always)]
    fn rotor_targets(
        &mut self,
        scenario: &Scenario,
        actions: &[Column<LANES>; ACTION_LIMIT],
    ) -> [Column<LANES>; 4] {
        // Matched here rather than in the loop, which then has no branch and vectorises.
        match Controls::new(&scenario.action) {
            Controls::RotorSpeeds(numbers) => {
                self.lane_targets(scenario, &Controls::RotorSpeeds(numbers), actions)
            }
            Controls::ThrustBodyRates(numbers) => {
                self.lane_targets(scenario, &Controls::ThrustBodyRates(numbers), actions)
            }
            Controls::Published(controls) => self.lane_targets(scenario, &Controls::Published(controls), actions),
        }
    }

    #[inline(always)]
    fn lane_targets(
        &mut self,
        scenario: &Scenario,
        controls: &Controls<f32>,
        actions: &[Column<LANES>; ACTION_LIMIT],
    ) -> [Column<LANES>; 4] {
        let (setpoint, secs) = (Setpoint::at(scenario.aviary.goal), scenario.physics.control_secs);
        let mut targets = [[0.0; LANES]; 4];
        for lane in 0..LANES {
            let (action, state) = (row(actions, lane), self.swarm.state(lane));
            let memory = &mut self.memories[lane];
            set_row(&mut targets, lane, controls.rotor_targets(&action, &state, &setpoint, memory, secs));
        }
        targets
    }

    /// Distance to the goal, and whether the drone has settled.
    #[inline(always)]
    fn measure(&mut self, scenario: &Scenario) {
        let goal = &scenario.aviary.goal;
        let radius = match scenario.success {
            Success::Settle { radius_m, .. } => radius_m,
            Success::Reach { .. } => 0.0,
        };
        let [x, y, z] = &self.swarm.position;
        for lane in 0..LANES {
            let (dx, dy, dz) = (x[lane] - goal.x, y[lane] - goal.y, z[lane] - goal.z);
            self.distances[lane] = (dx * dx + dy * dy + dz * dz).sqrt();
            self.steps[lane] += 1.0;
            self.last_outside[lane] =
                if self.distances[lane] < radius { self.last_outside[lane] } else { self.steps[lane] };
        }
    }

    #[inline(always)]
    fn judge(&mut self, scenario: &Scenario, hull: &Hull) {
        let mut hits = [0.0; LANES];
        contact::find_hits(&self.swarm, &scenario.aviary, hull, &mut hits);
        let view = FlightView {
            swarm: &self.swarm,
            hits: &hits,
            distances: &self.distances,
            steps: &self.steps,
            episode_steps: scenario.episode_steps() as f32,
        };
        termination::find_endings(&view, &scenario.terminations, &scenario.success, &mut self.codes);
    }

    #[inline(always)]
    fn reward(
        &mut self,
        scenario: &Scenario,
        actions: &[Column<LANES>; ACTION_LIMIT],
        previous_distances: &Column<LANES>,
    ) {
        let ends = self.ends(scenario);
        let view = StepView {
            swarm: &self.swarm,
            actions,
            previous_actions: &self.previous_actions,
            distances: &self.distances,
            previous_distances,
            ends: &ends,
            control_secs: scenario.physics.control_secs,
        };
        let mut rewards = [0.0; LANES];
        let mut values = [0.0; LANES];
        for (weighted, totals) in scenario.rewards.iter().zip(&mut self.term_totals) {
            weighted.term.evaluate(&view, weighted.weight, &mut values);
            add(&mut rewards, &values);
            add(totals, &values);
        }
        add(&mut self.totals, &rewards);
        self.rewards = rewards;
        self.successes = ends.success;
    }

    /// Which lanes ended in success and which in failure.
    #[inline(always)]
    fn ends(&self, scenario: &Scenario) -> Ends<LANES> {
        let codes = &self.codes;
        let mark = |marked: bool| if marked { 1.0 } else { 0.0 };
        Ends {
            success: match scenario.success {
                Success::Reach { .. } => {
                    let success = termination::code(Ending::Success);
                    core::array::from_fn(|lane| mark(codes[lane] == success))
                }
                Success::Settle { within_secs, .. } => {
                    let (time_limit, secs) = (termination::code(Ending::TimeLimit), scenario.physics.control_secs);
                    let settled = |lane: usize| self.last_outside[lane] * secs <= within_secs;
                    core::array::from_fn(|lane| mark((codes[lane] == time_limit) & settled(lane)))
                }
            },
            failure: core::array::from_fn(|lane| mark(termination::is_failure(codes[lane]))),
        }
    }

    /// Encodes every lane.
    #[inline(always)]
    pub(crate) fn observe(&mut self, scenario: &Scenario) {
        for lane in 0..LANES {
            self.observe_lane(scenario, lane);
        }
        match scenario.critic {
            CriticView::Observation => {}
            CriticView::Privileged => {
                let scales = PrivilegedScales::of(scenario);
                for lane in 0..LANES {
                    self.reveal_lane(&scales, lane);
                }
            }
        }
    }

    #[inline(always)]
    fn observe_lane(&mut self, scenario: &Scenario, lane: usize) {
        let (state, goal, previous_action) =
            (self.swarm.state(lane), &scenario.aviary.goal, row(&self.previous_actions, lane));
        let mut observation = [0.0; OBSERVATION_LIMIT];
        if let ObservationLayout::Pilot(layout) = &scenario.observation {
            let [a, b, c, d, _, _] = previous_action;
            for (column, value) in self.observations.iter_mut().zip(layout.encode(&state, goal, &[a, b, c, d])) {
                column[lane] = value;
            }
            return;
        }
        let seen = Seen {
            state: &state,
            angular_velocity_in_world: state.world_from_body.rotate(state.body_rates),
            goal,
            history: &[previous_action],
            measurements: &[],
        };
        scenario.observation.encode(&seen, &mut observation);
        for (column, value) in self.observations.iter_mut().zip(observation) {
            column[lane] = value;
        }
    }

    #[inline(always)]
    fn reveal_lane(&mut self, scales: &PrivilegedScales, lane: usize) {
        let [a, b, c, d] = row(&self.swarm.rotor_speeds, lane).map(|speed| speed * scales.per_hover_speed - 1.0);
        let [x, y, z] = row(&self.swarm.wind, lane);
        let [mass, thrust] = row(&self.factors, lane);
        let left = 1.0 - self.steps[lane] * scales.per_episode_steps;
        set_row(&mut self.privileged, lane, [a, b, c, d, x, y, z, mass - 1.0, thrust - 1.0, left]);
    }

    /// Takes the ended episodes out and starts the next ones, in lane order.
    pub(crate) fn restart_ended(&mut self, scenario: &Scenario, first: u32, finished: &mut impl FnMut(Finished)) {
        for lane in 0..LANES {
            let Some(ending) = termination::decode(self.codes[lane]) else { continue };
            finished(Finished {
                lane,
                episode: self.episode(first, lane, ending),
                observation: core::array::from_fn(|feature| {
                    self.observations.get(feature).map_or(0.0, |column| column[lane])
                }),
                privileged: row(&self.privileged, lane),
            });
            self.reset(scenario, lane);
        }
    }

    fn episode(&self, first: u32, lane: usize, ending: Ending) -> Episode {
        Episode {
            environment: first + lane as u32,
            steps: self.steps[lane] as u32,
            total_reward: self.totals[lane],
            success: self.successes[lane] > 0.5,
            ending,
            terms: self.term_totals.iter().map(|totals| totals[lane]).collect(),
        }
    }

    /// Begins the lane's next episode; its last reward and code stay readable.
    fn reset(&mut self, scenario: &Scenario, lane: usize) {
        let beginning = reset::begin(scenario, &mut self.streams[lane]);
        self.place(scenario, lane, &beginning);
    }

    fn place(&mut self, scenario: &Scenario, lane: usize, beginning: &Beginning) {
        self.swarm.set_state(lane, &beginning.state);
        self.swarm.set_vehicle(lane, &beginning.vehicle);
        set_row(&mut self.swarm.wind, lane, beginning.wind.into());
        set_row(&mut self.factors, lane, beginning.factors);
        if scenario.action.persistence() == Persistence::ResetEachEpisode {
            self.memories[lane] = ControlMemory::new();
        }
        set_row(&mut self.previous_actions, lane, [0.0; ACTION_LIMIT]);
        self.distances[lane] = (beginning.state.position - scenario.aviary.goal).norm();
        self.steps[lane] = 0.0;
        self.last_outside[lane] = 0.0;
        self.totals[lane] = 0.0;
        for totals in &mut self.term_totals {
            totals[lane] = 0.0;
        }
        self.observe_lane(scenario, lane);
        self.reveal_lane(&PrivilegedScales::of(scenario), lane);
    }

    /// Every column that the next step depends on, for saving and restoring.
    pub(crate) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Column<LANES>> {
        self.swarm
            .columns_mut()
            .chain(&mut self.observations)
            .chain(&mut self.privileged)
            .chain([&mut self.rewards, &mut self.codes])
            .chain(&mut self.factors)
            .chain(&mut self.previous_actions)
            .chain([&mut self.distances, &mut self.steps, &mut self.last_outside, &mut self.totals])
            .chain(&mut self.term_totals)
    }

    pub(crate) fn streams_mut(&mut self) -> &mut [Stream] {
        &mut self.streams
    }
}

#[inline(always)]
fn add<const LANES: usize>(sum: &mut Column<LANES>, values: &Column<LANES>) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum += value;
    }
}
