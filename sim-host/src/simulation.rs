//! The façade: many environments stepped by one thread. Threads run several simulations side by side.

mod differentiated;
mod imaging;
mod saving;

use std::sync::Arc;

use kestrel_core::action::{ACTION_LIMIT, ActionSpace, Controls};
use kestrel_core::real::Real;
use kestrel_core::reference::bullet::BulletState;
use kestrel_core::vehicle::State;
use pulp::{Simd, WithSimd};

use crate::agent::{Agent, Finished, PRIVILEGED_LEN};
use crate::block::{Actions, Block};
use crate::contact::{Arena, ContactReport, ContactSolver};
use crate::episode_end;
use crate::outcome::{Episode, Outcome};
use crate::reward::RewardTerm;
use crate::rooms::{Arenas, Room};
use crate::scenario::{Contacts, CriticView, Preset, Scenario};
use crate::seed::{Purpose, Seed, Stream};
use crate::simd::Arch;
use crate::stage::Stage;
use crate::swarm::{Mechanics, set_row, vector};
use crate::world::Pose;
use imaging::{Imaging, Looking};
pub use saving::SimulationState;

/// Environments that step together, in blocks of `LANES` lanes, each with one drone or several.
///
/// A row is a drone: row `agent · environments + environment`. Columns are feature-major: value `f` of row `r` stands
/// at `f · rows + r`. The bits do not depend on `LANES`, nor on how environments are divided among simulations: an
/// environment's randomness follows from the seed and its index. With `f32` lanes it trains; `Simulation<1, f64>` is
/// the same arithmetic in double precision, for comparison with recordings.
#[derive(Clone, Debug)]
pub struct Simulation<const LANES: usize = 64, R: Real = f32> {
    scenario: Scenario,
    controls: Controls<R>,
    mechanics: Mechanics<R>,
    arenas: Option<Arenas>,
    solver: Option<Arc<ContactSolver>>,
    arch: Arch,
    first_environment: u32,
    environments: usize,
    blocks: Vec<Block<LANES, R>>,
    observations: Vec<R>,
    privileged: Vec<R>,
    rewards: Vec<R>,
    outcomes: Vec<Outcome>,
    final_observations: Vec<R>,
    final_privileged: Vec<R>,
    imaging: Option<Imaging>,
    episodes: Vec<Episode>,
}

impl<const LANES: usize, R: Real> Simulation<LANES, R> {
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
        let end = first_environment + environments as u32;
        let blocks = (first_environment..end).step_by(LANES).map(|first| first..end.min(first + LANES as u32));
        let rows = environments * scenario.agents.count as usize;
        let observation_len = scenario.observation.len();
        let privileged_len = match scenario.critic {
            CriticView::Observation => 0,
            CriticView::Privileged => PRIVILEGED_LEN,
        };
        let nothing = |len: usize| vec![R::zero(); len * rows];
        let arenas = arenas(scenario);
        let mut simulation = Self {
            controls: Controls::new(&scenario.action),
            mechanics: Mechanics::new(&scenario.physics, &scenario.airframe),
            solver: solver(scenario, arenas.as_ref()),
            arch: Arch::new(),
            first_environment,
            environments,
            blocks: blocks
                .map(|environments| Block::new(scenario, arenas.as_ref(), (seed, purpose), &environments))
                .collect(),
            observations: nothing(observation_len),
            privileged: nothing(privileged_len),
            rewards: nothing(1),
            outcomes: vec![Outcome::Running; rows],
            final_observations: nothing(observation_len),
            final_privileged: nothing(privileged_len),
            imaging: Imaging::new(scenario, environments, rows, |row| {
                let (agent, environment) = (row / environments, first_environment + (row % environments) as u32);
                Stream::of_camera(seed, environment, agent as u32, purpose)
            }),
            episodes: Vec::new(),
            scenario: scenario.clone(),
            arenas,
        };
        simulation.gather_outputs();
        simulation.take_images(|_| true);
        simulation
    }

    /// Number of environments.
    pub fn environments(&self) -> usize {
        self.environments
    }

    /// Number of drones in all environments.
    pub fn rows(&self) -> usize {
        self.environments * self.scenario.agents.count as usize
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
        self.privileged.len() / self.rows().max(1)
    }

    /// Observations after the last step and its resets, `[observation_len][rows]`.
    pub fn observations(&self) -> &[R] {
        &self.observations
    }

    /// Privileged values after the last step and its resets, `[privileged_len][rows]`.
    pub fn privileged(&self) -> &[R] {
        &self.privileged
    }

    /// What each drone's camera saw last, `[rows][image]`, an image as
    /// [`OnboardCamera::write`](crate::camera::OnboardCamera::write) says; empty without a camera.
    pub fn images(&self) -> &[u8] {
        self.imaging.as_ref().map_or(&[], Imaging::images)
    }

    /// The same before the reset; valid where the outcome is not `Running`.
    pub fn final_images(&self) -> &[u8] {
        self.imaging.as_ref().map_or(&[], Imaging::final_images)
    }

    /// Rewards of the last step, `[rows]`.
    pub fn rewards(&self) -> &[R] {
        &self.rewards
    }

    /// Value of each weighted reward term in the last step of a row, in the scenario's order.
    ///
    /// # Panics
    /// When there is no such row.
    pub fn terms(&self, row: usize) -> Vec<R> {
        let (agent, lane) = self.agent(row);
        agent.term_values.iter().map(|column| column[lane]).collect()
    }

    /// Outcomes of the last step, `[rows]`.
    pub fn outcomes(&self) -> &[Outcome] {
        &self.outcomes
    }

    /// Observations before the reset, `[observation_len][rows]`; valid where the outcome is not `Running`.
    pub fn final_observations(&self) -> &[R] {
        &self.final_observations
    }

    /// Privileged values before the reset, `[privileged_len][rows]`; valid as the observations are.
    pub fn final_privileged(&self) -> &[R] {
        &self.final_privileged
    }

    /// The true state of a drone.
    ///
    /// # Panics
    /// When there is no such row.
    pub fn state(&self, row: usize) -> State<R> {
        let (agent, lane) = self.agent(row);
        agent.swarm.state(lane)
    }

    /// The state that a drone knows: the true one, or an older one where its scenario has a latency.
    ///
    /// # Panics
    /// When there is no such row.
    pub fn known_state(&self, row: usize) -> State<R> {
        let (agent, lane) = self.agent(row);
        agent.known().state(lane)
    }

    /// Puts a drone into another state between two steps; what it sees and is paid for follows with the next one.
    pub(crate) fn put(&mut self, row: usize, state: State<R>) {
        let (agent, environment) = (row / self.environments, row % self.environments);
        let agent = &mut self.blocks[environment / LANES].agents[agent];
        agent.put(environment % LANES, &BulletState::placed(state));
    }

    /// The wind that a drone meets \[m/s, world\].
    pub(crate) fn wind(&self, row: usize) -> nalgebra::Vector3<R> {
        let (agent, lane) = self.agent(row);
        vector(&agent.swarm.wind, lane)
    }

    /// Lets a drone meet another wind \[m/s, world\] from the next step on, until its episode ends.
    pub(crate) fn set_wind(&mut self, row: usize, wind: nalgebra::Vector3<R>) {
        let (agent, environment) = (row / self.environments, row % self.environments);
        let agent = &mut self.blocks[environment / LANES].agents[agent];
        set_row(&mut agent.swarm.wind, environment % LANES, wind.into());
    }

    /// Lets a drone carry so much more \[kg\], at its centre of mass.
    pub(crate) fn add_load(&mut self, row: usize, mass: R) {
        let (agent, environment) = (row / self.environments, row % self.environments);
        self.blocks[environment / LANES].agents[agent].swarm.add_load(environment % LANES, mass);
    }

    /// Angular velocity of a drone \[rad/s\], world, as the physics preset reports it.
    ///
    /// # Panics
    /// When there is no such row.
    pub fn angular_velocity(&self, row: usize) -> nalgebra::Vector3<R> {
        let (agent, lane) = self.agent(row);
        agent.angular_velocity(&self.scenario, lane)
    }

    /// The room that a drone is in, zero where none is drawn.
    ///
    /// # Panics
    /// When there is no such row.
    pub fn room(&self, row: usize) -> u32 {
        let (agent, lane) = self.agent(row);
        agent.room(lane)
    }

    /// The point ahead on the way that a drone looks for by itself \[m, world\]; nothing where it looks for none.
    ///
    /// # Panics
    /// When there is no such row.
    pub fn ahead(&self, row: usize) -> Option<nalgebra::Vector3<f32>> {
        let (agent, lane) = self.agent(row);
        agent.ahead(lane)
    }

    /// The goal of a drone \[m, world\].
    ///
    /// # Panics
    /// When there is no such row.
    pub fn goal(&self, row: usize) -> nalgebra::Vector3<R> {
        let (agent, lane) = self.agent(row);
        agent.goal(lane)
    }

    /// The velocity of the goal of a drone \[m/s, world\].
    ///
    /// # Panics
    /// When there is no such row.
    pub fn goal_velocity(&self, row: usize) -> nalgebra::Vector3<R> {
        let (agent, lane) = self.agent(row);
        agent.goal_velocity(lane)
    }

    /// Where an environment's movable bodies are, in the order of the world.
    ///
    /// # Panics
    /// When there is no such environment.
    pub fn movables(&self, environment: usize) -> Vec<Pose> {
        assert!(environment < self.environments, "environment {environment} of {}", self.environments);
        self.blocks[environment / LANES].movables(environment % LANES).iter().map(|motion| motion.pose).collect()
    }

    /// Episodes that ended since the last call, in the order of steps, then blocks, agents and environments.
    pub fn take_episodes(&mut self) -> Vec<Episode> {
        core::mem::take(&mut self.episodes)
    }

    fn agent(&self, row: usize) -> (&Agent<LANES, R>, usize) {
        assert!(row < self.rows(), "row {row} of {}", self.rows());
        let (agent, environment) = (row / self.environments, row % self.environments);
        (&self.blocks[environment / LANES].agents[agent], environment % LANES)
    }

    /// Copies rewards and outcomes out of the blocks.
    fn gather_rewards(&mut self) {
        for (index, block) in self.blocks.iter().enumerate() {
            for (number, agent) in block.agents.iter().enumerate() {
                let rows = rows_of_block::<LANES>(self.environments, number, index);
                let count = rows.len();
                self.rewards[rows.clone()].copy_from_slice(&agent.rewards[..count]);
                let outcomes = &mut self.outcomes[rows];
                outcomes.fill(Outcome::Running);
                if agent.is_running() {
                    continue;
                }
                for (outcome, code) in outcomes.iter_mut().zip(agent.codes) {
                    *outcome = episode_end::outcome(code);
                }
            }
        }
    }

    /// Takes the images that are due, of drones whose last step had such an outcome.
    fn take_images(&mut self, is_asked: impl Fn(Outcome) -> bool) {
        let Some(mut imaging) = self.imaging.take() else { return };
        for row in 0..self.rows() {
            if !is_asked(self.outcomes[row]) {
                continue;
            }
            let (agent, lane) = self.agent(row);
            let (drone, environment) = (row / self.environments, row % self.environments);
            let looking = Looking { row, environment, drone, room: agent.room(lane), period: agent.period(lane) };
            if imaging.is_due(looking.period) {
                imaging.prepare(&looking, &self.scenario, || {
                    let team = self.blocks[environment / LANES].agents.iter();
                    (team.map(|agent| agent.motion(lane).pose).collect(), self.movables(environment))
                });
            }
            imaging.look(&looking, &agent.motion(lane));
        }
        self.imaging = Some(imaging);
    }

    /// Records the episodes that ended, with their last observations, and starts the next ones.
    fn restart_ended(&mut self) {
        let (environments, rows) = (self.environments, self.rows());
        for (index, block) in self.blocks.iter_mut().enumerate() {
            if block.agents.iter().all(Agent::is_running) {
                continue;
            }
            let first = self.first_environment + (index * LANES) as u32;
            block.restart_ended(
                &self.scenario,
                self.arenas.as_ref(),
                first,
                &mut |agent: usize, finished: Finished<R>| {
                    let environment = index * LANES + finished.lane;
                    if environment < environments {
                        let row = agent * environments + environment;
                        scatter(&mut self.final_observations, rows, row, &finished.observation);
                        scatter(&mut self.final_privileged, rows, row, &finished.privileged);
                        if let Some(imaging) = &mut self.imaging {
                            imaging.keep(row);
                        }
                        self.episodes.push(finished.episode);
                    }
                },
            );
            let (observations, privileged) = (&mut self.observations, &mut self.privileged);
            Outputs { environments, observations, privileged }.gather(index, block);
        }
    }

    /// Copies the blocks' observations into the columns.
    fn gather_outputs(&mut self) {
        let (observations, privileged) = (&mut self.observations, &mut self.privileged);
        let mut outputs = Outputs { environments: self.environments, observations, privileged };
        for (index, block) in self.blocks.iter().enumerate() {
            outputs.gather(index, block);
        }
    }
}

/// What policy and critic see of all environments.
struct Outputs<'a, R> {
    environments: usize,
    observations: &'a mut [R],
    privileged: &'a mut [R],
}

impl<R: Real> Outputs<'_, R> {
    /// Copies the observations of a block out of it, while it is in the cache.
    #[inline(always)]
    fn gather<const LANES: usize>(&mut self, index: usize, block: &Block<LANES, R>) {
        let all = self.environments * block.agents.len();
        for (number, agent) in block.agents.iter().enumerate() {
            let rows = rows_of_block::<LANES>(self.environments, number, index);
            gather(self.observations, all, rows.clone(), &agent.observations);
            gather(self.privileged, all, rows, &agent.privileged);
        }
    }
}

/// Widths and precisions whose steps are compiled in this crate, once: a step is several hundred kilobytes of
/// instructions for each instruction set, which no crate that steps simulations should have to generate again.
pub trait Compiled<R: Real> {
    /// Flies all blocks for one control period; actions and rotor speeds as [`Simulation::step_with_rotor_speeds`] has
    /// them.
    #[doc(hidden)]
    fn fly(&mut self, actions: &[R], rotor_speeds: Option<&[[R; 4]]>);
}

macro_rules! compiled {
    ($($lanes:literal $real:ty),*) => {$(
        impl Compiled<$real> for Simulation<$lanes, $real> {
            #[inline(never)]
            fn fly(&mut self, actions: &[$real], rotor_speeds: Option<&[[$real; 4]]>) {
                self.fly_blocks(actions, rotor_speeds);
            }
        }
    )*};
}
compiled!(64 f32, 1 f64);
#[cfg(test)]
compiled!(1 f32, 8 f32);

impl<const LANES: usize, R: Real> Simulation<LANES, R>
where
    Self: Compiled<R>,
{
    /// Advances every environment by one control period; drones whose episodes end start anew.
    ///
    /// `actions` is `[action_len][rows]`. Kestrel's own action spaces limit values to \[-1, 1\] and take NaN for -1;
    /// those of the reference limit nothing, as it does.
    ///
    /// # Panics
    /// When `actions` has another length.
    pub fn step(&mut self, actions: &[R]) {
        self.advance(actions, None);
    }

    /// As [`Self::step`], with these rotor speeds \[rad/s\], one set for each row, instead of those that the actions
    /// ask for: a recorded flight, whose controller would amplify every rounding.
    ///
    /// # Panics
    /// When a length is wrong.
    pub fn step_with_rotor_speeds(&mut self, actions: &[R], rotor_speeds: &[[R; 4]]) {
        assert_eq!(rotor_speeds.len(), self.rows(), "rotor speeds are [rows][4]");
        self.advance(actions, Some(rotor_speeds));
    }

    fn advance(&mut self, actions: &[R], rotor_speeds: Option<&[[R; 4]]>) {
        let len = self.scenario.action.len();
        assert_eq!(actions.len(), len * self.rows(), "actions are [{len}][rows]");
        self.fly(actions, rotor_speeds);
        self.gather_rewards();
        self.take_images(|_| true);
        self.restart_ended();
        self.take_images(|outcome| outcome != Outcome::Running);
    }
}

impl<const LANES: usize, R: Real> Simulation<LANES, R> {
    fn fly_blocks(&mut self, actions: &[R], rotor_speeds: Option<&[[R; 4]]>) {
        let advance = Advance {
            stage: Stage {
                scenario: &self.scenario,
                controls: &self.controls,
                mechanics: &self.mechanics,
                arenas: self.arenas.as_ref(),
                solver: self.solver.as_deref(),
                control_secs: R::from_f64(1.0 / self.scenario.physics.control_rate_hz),
            },
            blocks: &mut self.blocks,
            actions,
            rotor_speeds,
            outputs: Outputs {
                environments: self.environments,
                observations: &mut self.observations,
                privileged: &mut self.privileged,
            },
        };
        // Few lanes gain little from wide instructions, and the step takes long to compile for each set of them.
        if const { LANES < 16 } { advance.with_simd(pulp::Scalar::new()) } else { self.arch.dispatch(advance) }
    }
}

impl Scenario {
    /// Makes a room that is drawn ready before a drone comes in, which otherwise does it: the room, its arena, and its ways if
    /// a reward is about them.
    pub fn prepare_room(&self, room: u32) {
        let Some(rooms) = &self.drawn else { return };
        let Room { ways, aviary, .. } = rooms.room(room);
        let follows = |term: &RewardTerm| term.ways().is_some();
        if let Some(ways) = ways.as_ref().filter(|_| self.rewards.iter().any(follows)) {
            ways.length(aviary.goal.into());
        }
        if let Some(arenas) = arenas(self) {
            arenas.of(room);
        }
    }
}

/// What the drones can touch, unless nothing is touched.
fn arenas(scenario: &Scenario) -> Option<Arenas> {
    let report = match scenario.physics.preset {
        Preset::Clean { .. } => ContactReport::Touch,
        Preset::Bullet { .. } => ContactReport::Bullet,
    };
    match scenario.physics.contacts {
        Contacts::Absent => None,
        Contacts::Reported | Contacts::Solved => {
            let (airframe, scan) = (&scenario.airframe, scenario.sensors.scan());
            Some(match &scenario.drawn {
                None => Arenas::Same(Arena::shared(&scenario.aviary.world, airframe, report, scan)),
                Some(drawn) => Arenas::of_rooms(drawn, airframe, report, scan),
            })
        }
    }
}

/// What contacts do to them, where they do anything.
fn solver(scenario: &Scenario, arenas: Option<&Arenas>) -> Option<Arc<ContactSolver>> {
    match (scenario.physics.contacts, arenas) {
        (Contacts::Solved, Some(Arenas::Same(arena))) => {
            Some(Arc::new(ContactSolver::new(arena, &scenario.aviary.world, &scenario.airframe)))
        }
        (Contacts::Solved, Some(Arenas::Drawn(_)) | None) | (Contacts::Absent | Contacts::Reported, _) => None,
    }
}

/// The rows of an agent of a block.
fn rows_of_block<const LANES: usize>(environments: usize, agent: usize, block: usize) -> core::ops::Range<usize> {
    let first = block * LANES;
    let start = agent * environments + first;
    start..start + LANES.min(environments - first)
}

/// The part of a step that runs in lanes, compiled for each instruction set.
struct Advance<'a, const LANES: usize, R: Real> {
    stage: Stage<'a, R>,
    blocks: &'a mut [Block<LANES, R>],
    actions: &'a [R],
    rotor_speeds: Option<&'a [[R; 4]]>,
    outputs: Outputs<'a, R>,
}

impl<const LANES: usize, R: Real> WithSimd for Advance<'_, LANES, R> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _simd: S) {
        let environments = self.outputs.environments;
        let agents = self.stage.scenario.agents.count as usize;
        let mut actions = vec![[[R::zero(); LANES]; ACTION_LIMIT]; agents];
        // The reference limits nothing.
        let limits = !matches!(self.stage.scenario.action, ActionSpace::Reference(_));
        let rows = environments * agents;
        for (index, block) in self.blocks.iter_mut().enumerate() {
            for (agent, columns) in actions.iter_mut().enumerate() {
                let range = rows_of_block::<LANES>(environments, agent, index);
                load_actions(self.actions, rows, range, limits, columns);
            }
            block.command(&self.stage, &actions);
            if let Some(rotor_speeds) = self.rotor_speeds {
                let row = |agent| rows_of_block::<LANES>(environments, agent, index);
                block.command_directly(|agent| &rotor_speeds[row(agent)]);
            }
            block.advance(&self.stage, &actions);
            self.outputs.gather(index, block);
        }
    }
}

/// An agent's actions, limited to \[-1, 1\] where the space limits them; lanes beyond the last environment hover.
#[inline(always)]
fn load_actions<const LANES: usize, R: Real>(
    actions: &[R],
    rows: usize,
    range: core::ops::Range<usize>,
    limits: bool,
    columns: &mut Actions<LANES, R>,
) {
    let count = range.len();
    for (column, actions) in columns.iter_mut().zip(actions.chunks_exact(rows)) {
        *column = [R::zero(); LANES];
        column[..count].copy_from_slice(&actions[range.clone()]);
        if limits {
            for value in column {
                *value = value.limited(-R::one(), R::one());
            }
        }
    }
}

/// Copies block columns to `rows` of each feature's column; `target` may hold fewer features.
#[inline(always)]
fn gather<const LANES: usize, R: Copy>(
    target: &mut [R],
    all: usize,
    rows: core::ops::Range<usize>,
    columns: &[[R; LANES]],
) {
    for (target, column) in target.chunks_exact_mut(all.max(1)).zip(columns) {
        let target = &mut target[rows.clone()];
        match target.first_chunk_mut::<LANES>() {
            // A size that the compiler knows, and no call.
            Some(whole) => *whole = *column,
            None => target.copy_from_slice(&column[..rows.len()]),
        }
    }
}

/// Writes one row's values into its place in each feature's column.
fn scatter<R: Copy>(target: &mut [R], rows: usize, row: usize, values: &[R]) {
    for (column, value) in target.chunks_exact_mut(rows.max(1)).zip(values) {
        column[row] = *value;
    }
}

#[cfg(test)]
mod tests;
