//! One block of environments: the step as a list of stages over `LANES` lanes and all their drones.

use kestrel_core::action::{ACTION_LIMIT, Controls};
use kestrel_core::airframe::GRAVITY;
use kestrel_core::attitude::Attitude;
use kestrel_core::bullet::BulletState;
use kestrel_core::real::Real;
use nalgebra::Vector3;

use crate::agent::{Agent, Finished};
use crate::contact::{Arena, ContactMemory, ContactSolver, Motion, Touch};
use crate::scenario::{Clock, Preset, Scenario, TeamEnd, TeamRewards};
use crate::seed::{Purpose, Seed};
use crate::swarm::{Column, row, set_row, vector};
use crate::termination;
use crate::world::Pose;

/// What a step needs beside the block.
pub(crate) struct Stage<'a, R: Real> {
    pub(crate) scenario: &'a Scenario,
    pub(crate) controls: &'a Controls<R>,
    pub(crate) arena: Option<&'a Arena>,
    pub(crate) solver: Option<&'a ContactSolver>,
    pub(crate) control_secs: R,
}

/// `LANES` environments that step together, with all their drones.
#[derive(Clone, Debug)]
pub(crate) struct Block<const LANES: usize, R: Real> {
    pub(crate) agents: Vec<Agent<LANES, R>>,
    /// Bodies that drones push, by lane.
    movables: Vec<Vec<Motion>>,
    /// Where bodies touched, by lane.
    contacts: Vec<ContactMemory>,
    /// Where all drones are.
    team: Vec<[Column<LANES, R>; 3]>,
    targets: Vec<[Column<LANES, R>; 4]>,
}

/// The actions of one agent of a block.
pub(crate) type Actions<const LANES: usize, R> = [Column<LANES, R>; ACTION_LIMIT];

impl<const LANES: usize, R: Real> Block<LANES, R> {
    /// Environments `first..first + LANES` at the start of their first episodes.
    pub(crate) fn new(scenario: &Scenario, arena: Option<&Arena>, source: (Seed, Purpose), first: u32) -> Self {
        let count = scenario.agents.count as usize;
        let nothing = [R::zero(); LANES];
        let mut block = Self {
            agents: (0..count).map(|index| Agent::new(scenario, arena, index, source, first)).collect(),
            movables: vec![standing(scenario); LANES],
            contacts: vec![ContactMemory::default(); LANES],
            team: vec![[nothing; 3]; count],
            targets: vec![[nothing; 4]; count],
        };
        block.locate();
        block
    }

    /// One control period, commanded before: everything but the resets.
    #[inline(always)]
    pub(crate) fn advance(&mut self, stage: &Stage<'_, R>, actions: &[Actions<LANES, R>]) {
        let scenario = stage.scenario;
        self.fly(stage);
        for (agent, actions) in self.agents.iter_mut().zip(actions) {
            let previous_distances = *agent.distances();
            agent.measure(scenario);
            agent.judge(scenario);
            agent.reward(scenario, actions, &previous_distances, &self.team);
        }
        self.end_together(scenario);
        self.share(scenario);
        for (agent, actions) in self.agents.iter_mut().zip(actions) {
            agent.bank();
            agent.remember(actions);
            agent.observe(stage);
        }
    }

    /// Actions to rotor targets, held over the substeps.
    #[inline(always)]
    pub(crate) fn command(&mut self, stage: &Stage<'_, R>, actions: &[Actions<LANES, R>]) {
        for ((agent, actions), targets) in self.agents.iter_mut().zip(actions).zip(&mut self.targets) {
            if stage.scenario.clock == Clock::Published {
                agent.aim(stage.scenario);
            }
            *targets = agent.command(stage, actions);
        }
    }

    /// Rotor targets of each agent, lane by lane, instead of commanded ones.
    pub(crate) fn command_directly<'a>(&mut self, speeds: impl Fn(usize) -> &'a [[R; 4]])
    where
        R: 'a,
    {
        for (agent, targets) in self.targets.iter_mut().enumerate() {
            for (lane, speeds) in speeds(agent).iter().enumerate() {
                set_row(targets, lane, *speeds);
            }
        }
    }

    /// All lanes fly as if nothing stood in their way; those near something do it again, step by step.
    #[inline(always)]
    fn fly(&mut self, stage: &Stage<'_, R>) {
        let near = stage.arena.map(|arena| self.near_lanes(stage.scenario, arena)).unwrap_or_default();
        let starts: Vec<Vec<BulletState<R>>> = near.iter().map(|lane| self.drones(*lane)).collect();
        let physics = &stage.scenario.physics;
        for _ in 0..physics.substeps {
            for (agent, targets) in self.agents.iter_mut().zip(&self.targets) {
                agent.swarm.advance(physics, targets, &self.team);
            }
            if physics.has_downwash() {
                self.locate();
            }
        }
        for agent in &mut self.agents {
            agent.touches = [[R::zero(); LANES]; 2];
        }
        if let Some(arena) = stage.arena {
            for (lane, drones) in near.into_iter().zip(starts) {
                self.fly_near(stage, arena, lane, drones);
            }
        }
        self.locate();
    }

    #[inline(always)]
    fn locate(&mut self) {
        for (place, agent) in self.team.iter_mut().zip(&self.agents) {
            *place = agent.swarm.position;
        }
    }

    fn drones(&self, lane: usize) -> Vec<BulletState<R>> {
        self.agents.iter().map(|agent| agent.swarm.drone(lane)).collect()
    }

    /// The lanes in which a drone can touch something within the coming control period.
    #[inline(always)]
    fn near_lanes(&self, scenario: &Scenario, arena: &Arena) -> Vec<usize> {
        let secs = scenario.physics.control_secs();
        let reach = arena.reach() + 0.5 * greatest_acceleration(scenario) * secs * secs;
        let mut near = [0.0_f32; LANES];
        for agent in &self.agents {
            let swarm = &agent.swarm;
            for lane in 0..LANES {
                let [x, y, z] = row(&swarm.position, lane).map(Real::to_f32);
                let [vx, vy, vz] = row(&swarm.velocity, lane).map(Real::to_f32);
                let speed = (vx * vx + vy * vy + vz * vz).sqrt();
                let room = arena.clearance(x, y, z) - reach - speed * secs;
                near[lane] = if room > 0.0 { near[lane] } else { 1.0 };
            }
        }
        self.mark_meetings(2.0 * reach, secs, &mut near);
        self.mark_movables(scenario, reach, secs, &mut near);
        (0..LANES).filter(|lane| near[*lane] > 0.5).collect()
    }

    /// Marks lanes in which two drones can meet.
    #[inline(always)]
    fn mark_meetings(&self, reach: f32, secs: f32, near: &mut Column<LANES>) {
        for (index, one) in self.agents.iter().enumerate() {
            for other in &self.agents[..index] {
                for lane in 0..LANES {
                    let [dx, dy, dz] = difference(&one.swarm.position, &other.swarm.position, lane);
                    let [vx, vy, vz] = difference(&one.swarm.velocity, &other.swarm.velocity, lane);
                    let travel = reach + (vx * vx + vy * vy + vz * vz).sqrt() * secs;
                    let close = dx * dx + dy * dy + dz * dz < travel * travel;
                    near[lane] = if close { 1.0 } else { near[lane] };
                }
            }
        }
    }

    /// Marks lanes in which a body moves or a drone can push one.
    fn mark_movables(&self, scenario: &Scenario, reach: f32, secs: f32, near: &mut Column<LANES>) {
        let reaches: Vec<f64> =
            scenario.aviary.world.movables.iter().map(|body| body.solid.shape.reach()).collect();
        for (lane, movables) in self.movables.iter().enumerate() {
            for (movable, own_reach) in movables.iter().zip(&reaches) {
                let moves = movable.velocity.norm_squared() + movable.body_rates.norm_squared() > 0.0;
                let close = self.agents.iter().any(|agent| {
                    let swarm = &agent.swarm;
                    let position = vector(&swarm.position, lane).map(Real::to_f64);
                    let velocity = vector(&swarm.velocity, lane).map(Real::to_f64);
                    let travel = f64::from(reach) + own_reach + velocity.norm() * f64::from(secs);
                    (position - movable.pose.position).norm() < travel
                });
                if moves || close {
                    near[lane] = 1.0;
                }
            }
        }
    }

    /// Redoes the control period of one lane with contacts, from where its drones were at its start.
    fn fly_near(&mut self, stage: &Stage<'_, R>, arena: &Arena, lane: usize, mut drones: Vec<BulletState<R>>) {
        let physics = &stage.scenario.physics;
        let mut touches = Vec::new();
        for substep in 0..physics.substeps {
            let last = substep + 1 == physics.substeps;
            // Bullet reports what its last collision detection saw, which is at the start of the last step.
            if last && matches!(physics.preset, Preset::Bullet { .. }) {
                touches = touching(arena, &drones, &self.movables[lane]);
            }
            let team: Vec<Vector3<R>> = drones.iter().map(|drone| drone.motion.position).collect();
            let before: Vec<Motion> = drones.iter().map(motion).collect();
            for ((drone, agent), targets) in drones.iter_mut().zip(&self.agents).zip(&self.targets) {
                *drone = agent.swarm.advanced(physics, lane, drone, &row(targets, lane), &team);
            }
            if let Some(solver) = stage.solver {
                let bodies = (&mut self.movables[lane], &mut self.contacts[lane]);
                resolve(solver, &before, &mut drones, bodies, physics.substep_secs());
            }
        }
        if matches!(physics.preset, Preset::Clean { .. }) {
            touches = touching(arena, &drones, &self.movables[lane]);
        }
        for ((agent, drone), touch) in self.agents.iter_mut().zip(&drones).zip(touches) {
            agent.swarm.set_drone(lane, drone);
            let mark = |touched: bool| if touched { R::one() } else { R::zero() };
            set_row(&mut agent.touches, lane, [mark(touch.obstacle), mark(touch.landing)]);
        }
    }

    /// Ends the episodes of drones whose teammate's ended.
    #[inline(always)]
    fn end_together(&mut self, scenario: &Scenario) {
        if self.agents.len() == 1 || scenario.agents.ends == TeamEnd::Alone {
            return;
        }
        for lane in 0..LANES {
            let Some(first) = self.agents.iter().map(|agent| agent.codes[lane]).find(|code| *code > 0.0) else {
                continue;
            };
            for agent in &mut self.agents {
                if agent.codes[lane] == 0.0 {
                    agent.codes[lane] = termination::code_of_teammate(first);
                }
            }
        }
    }

    /// Pays every drone the sum of all, where they share.
    #[inline(always)]
    fn share(&mut self, scenario: &Scenario) {
        if self.agents.len() == 1 || scenario.agents.rewards == TeamRewards::Own {
            return;
        }
        for lane in 0..LANES {
            let sum = self.agents.iter().fold(R::zero(), |sum, agent| sum + agent.rewards[lane]);
            for agent in &mut self.agents {
                agent.rewards[lane] = sum;
            }
        }
    }

    /// Takes the ended episodes out and starts the next ones, by agent and lane.
    pub(crate) fn restart_ended(
        &mut self,
        scenario: &Scenario,
        arena: Option<&Arena>,
        first: u32,
        finished: &mut impl FnMut(usize, Finished<R>),
    ) {
        for lane in 0..LANES {
            if self.agents[0].codes[lane] > 0.0 {
                self.contacts[lane] = ContactMemory::default();
                if scenario.agents.ends == TeamEnd::Together {
                    self.movables[lane] = standing(scenario);
                }
            }
        }
        for (index, agent) in self.agents.iter_mut().enumerate() {
            agent.restart_ended(scenario, arena, first, &mut |done| finished(index, done));
        }
        self.locate();
    }

    pub(crate) fn contacts_mut(&mut self) -> &mut [ContactMemory] {
        &mut self.contacts
    }

    pub(crate) fn movables(&self, lane: usize) -> &[Motion] {
        &self.movables[lane]
    }

    pub(crate) fn movables_mut(&mut self) -> impl Iterator<Item = &mut Motion> {
        self.movables.iter_mut().flatten()
    }

    pub(crate) fn locate_all(&mut self) {
        self.locate();
    }
}

/// Full thrust along gravity \[m/s²\], of the lightest and strongest drone that an episode can have; what drag or
/// Bullet's damping can add is never more.
fn greatest_acceleration(scenario: &Scenario) -> f32 {
    let (airframe, spread) = (&scenario.airframe, &scenario.randomisation);
    let drawn = f64::from((1.0 + spread.thrust) / (1.0 - spread.mass));
    (drawn * airframe.thrust_limit() / airframe.mass + GRAVITY) as f32
}

/// The movable bodies where episodes begin.
fn standing(scenario: &Scenario) -> Vec<Motion> {
    scenario.aviary.world.movables.iter().map(|movable| Motion::at_rest(movable.solid.pose)).collect()
}

#[inline(always)]
fn difference<const LANES: usize, R: Real>(
    one: &[Column<LANES, R>; 3],
    other: &[Column<LANES, R>; 3],
    lane: usize,
) -> [f32; 3] {
    core::array::from_fn(|axis| (one[axis][lane] - other[axis][lane]).to_f32())
}

/// What each drone touches.
fn touching<R: Real>(arena: &Arena, drones: &[BulletState<R>], movables: &[Motion]) -> Vec<Touch> {
    let poses: Vec<Pose> = drones.iter().map(|drone| motion(drone).pose).collect();
    let mut touches: Vec<Touch> = poses.iter().map(|pose| arena.touch(pose, movables)).collect();
    for index in 0..poses.len() {
        for other in 0..index {
            if arena.drones_touch(&poses[index], &poses[other]) {
                touches[index].obstacle = true;
                touches[other].obstacle = true;
            }
        }
    }
    touches
}

/// Lets contacts change what free flight made of the drones.
fn resolve<R: Real>(
    solver: &ContactSolver,
    before: &[Motion],
    drones: &mut [BulletState<R>],
    (movables, memory): (&mut Vec<Motion>, &mut ContactMemory),
    secs: f64,
) {
    let free: Vec<Motion> = drones.iter().map(motion).collect();
    let mut after = free.clone();
    solver.resolve(before, &mut after, movables, memory, secs);
    for ((drone, free), after) in drones.iter_mut().zip(&free).zip(&after) {
        if after != free {
            let state = &mut drone.motion;
            state.position = after.pose.position.map(R::from_f64);
            state.world_from_body = after.pose.world_from_body.map(R::from_f64);
            state.velocity = after.velocity.map(R::from_f64);
            state.body_rates = after.body_rates.map(R::from_f64);
            drone.reported_angular_velocity = state.world_from_body.rotate(state.body_rates);
        }
    }
}

fn motion<R: Real>(drone: &BulletState<R>) -> Motion {
    let state = &drone.motion;
    Motion {
        pose: Pose {
            position: state.position.map(Real::to_f64),
            world_from_body: state.world_from_body.map(Real::to_f64),
        },
        velocity: state.velocity.map(Real::to_f64),
        body_rates: state.body_rates.map(Real::to_f64),
    }
}

/// Numbers of a [`Motion`].
pub(crate) const MOTION_LEN: usize = 13;

pub(crate) fn motion_to_array(motion: &Motion) -> [f64; MOTION_LEN] {
    let (p, v, r) = (motion.pose.position, motion.velocity, motion.body_rates);
    let q = motion.pose.world_from_body;
    [p.x, p.y, p.z, q.w, q.x, q.y, q.z, v.x, v.y, v.z, r.x, r.y, r.z]
}

pub(crate) fn motion_from_array(numbers: &[f64; MOTION_LEN]) -> Motion {
    let [px, py, pz, w, x, y, z, vx, vy, vz, rx, ry, rz] = *numbers;
    Motion {
        pose: Pose { position: Vector3::new(px, py, pz), world_from_body: Attitude { w, x, y, z } },
        velocity: Vector3::new(vx, vy, vz),
        body_rates: Vector3::new(rx, ry, rz),
    }
}
