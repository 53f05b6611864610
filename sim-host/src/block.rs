//! One block of environments: the step as a list of stages over `LANES` lanes and all their drones.

use core::ops::Range;

use kestrel_core::action::ACTION_LIMIT;
use kestrel_core::airframe::GRAVITY;
use kestrel_core::attitude::Attitude;
use kestrel_core::real::Real;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use crate::agent::{Agent, Finished, Passing, looks_ahead_secs};
use crate::contact::{Arena, ContactMemory, ContactSolver, Motion, Touch};
use crate::episode_end;
use crate::rate_loop::RateLoops;
use crate::rooms::{Arenas, Around};
use crate::scenario::{Clock, Preset, Scenario, TeamEnd, TeamRewards, TeamSuccess};
use crate::seed::{Purpose, Seed};
use crate::sensor::{Course, Told};
use crate::stage::Stage;
use crate::swarm::{Column, Mechanics, Swarm, one_lane, row, set_row, vector};
use crate::world::{Drive, Movable, Pose};

/// `LANES` environments that step together, with all their drones.
#[derive(Clone, Debug)]
pub(crate) struct Block<const LANES: usize, R: Real> {
    pub(crate) agents: Vec<Agent<LANES, R>>,
    /// Bodies that move, by lane.
    movables: Vec<Vec<Motion>>,
    /// What there is to know of each of them.
    movable_kinds: Vec<MovableKind>,
    /// Where bodies touched, by lane.
    contacts: Vec<ContactMemory>,
    /// Where all drones are.
    team: Vec<[Column<LANES, R>; 3]>,
    targets: Vec<[Column<LANES, R>; 4]>,
    /// What the air of the others pushes each drone down with \[N\].
    pushes: Vec<Column<LANES, R>>,
}

/// What contacts have to know of a movable beside where it is.
#[derive(Clone, Copy, Debug)]
struct MovableKind {
    /// How far it reaches from its centre \[m\].
    reach: f64,
    drive: Drive,
}

impl MovableKind {
    fn of(movable: &Movable) -> Self {
        Self { reach: movable.solid.shape.reach(), drive: movable.drive }
    }
}

/// The actions of one agent of a block.
pub(crate) type Actions<const LANES: usize, R> = [Column<LANES, R>; ACTION_LIMIT];

impl<const LANES: usize, R: Real> Block<LANES, R> {
    /// Environments `first..first + LANES` at the start of their first episodes.
    pub(crate) fn new(
        scenario: &Scenario,
        arenas: Option<&Arenas>,
        source: (Seed, Purpose),
        environments: &Range<u32>,
    ) -> Self {
        let count = scenario.agents.count as usize;
        let nothing = [R::zero(); LANES];
        // Those beyond the last environment make no room of their own.
        let environment = |lane| environments.clone().nth(lane).unwrap_or(environments.start);
        let rooms: Vec<u32> = (0..LANES).map(|lane| environment(lane) % scenario.rooms()).collect();
        let movables: Vec<Vec<Motion>> = rooms.iter().map(|room| standing(scenario, *room)).collect();
        let around = Around { arenas, movables: &movables };
        let mut block = Self {
            agents: (0..count)
                .map(|index| {
                    let mut agent = Agent::new(scenario, index, source, environments.clone());
                    let lanes = rooms.iter().enumerate();
                    lanes.for_each(|(lane, room)| agent.reset(scenario, around, (lane, *room)));
                    agent
                })
                .collect(),
            movables,
            movable_kinds: scenario.aviary.world.movables.iter().map(MovableKind::of).collect(),
            contacts: vec![ContactMemory::default(); LANES],
            team: vec![[nothing; 3]; count],
            targets: vec![[nothing; 4]; count],
            pushes: vec![nothing; count],
        };
        block.update_positions();
        block.carry(scenario, 0..LANES);
        (0..LANES).for_each(|lane| block.observe_restarted(scenario, lane));
        block
    }

    /// One control period, commanded before: everything but the resets.
    #[inline(always)]
    pub(crate) fn advance(&mut self, stage: &Stage<'_, R>, actions: &[Actions<LANES, R>]) {
        let scenario = stage.scenario;
        self.hold_rates();
        self.fly(stage);
        let len = scenario.action.len();
        for (agent, actions) in self.agents.iter_mut().zip(actions) {
            agent.update_metrics(scenario);
            agent.terminate(stage, &actions[..len], &self.team);
        }
        self.succeed_together(scenario);
        self.look_ahead(scenario);
        for (agent, actions) in self.agents.iter_mut().zip(actions) {
            agent.look_around(stage);
            agent.reward(stage, &actions[..len], &self.team);
        }
        self.end_together(scenario);
        self.share_rewards(scenario);
        self.observe_neighbours(scenario, 0..LANES);
        for (agent, actions) in self.agents.iter_mut().zip(actions) {
            agent.accumulate_return();
            agent.push_history(&actions[..len]);
            agent.observe(stage, &self.movables);
            agent.draw_delays();
        }
        self.carry(scenario, 0..LANES);
    }

    /// As [`Self::advance`], without what has no derivative: contacts, endings, sensors, neighbours.
    pub(crate) fn advance_untouched(&mut self, stage: &Stage<'_, R>, actions: &[Actions<LANES, R>]) {
        let len = stage.scenario.action.len();
        self.hold_rates();
        self.fly_freely(stage, None);
        self.end_flight();
        for (agent, actions) in self.agents.iter_mut().zip(actions) {
            agent.update_metrics(stage.scenario);
            agent.reward(stage, &actions[..len], &self.team);
            agent.push_history(&actions[..len]);
            agent.observe(stage, &self.movables);
        }
    }

    /// Actions to rotor targets, held over the substeps.
    #[inline(always)]
    pub(crate) fn command(&mut self, stage: &Stage<'_, R>, actions: &[Actions<LANES, R>]) {
        for ((agent, actions), targets) in self.agents.iter_mut().zip(actions).zip(&mut self.targets) {
            if stage.scenario.clock == Clock::Reference {
                agent.update_goal(stage.scenario);
            }
            agent.command(stage, actions, targets);
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

    /// From here on targets are what the rate loops hold, where there are any.
    #[inline(always)]
    fn hold_rates(&mut self) {
        for (agent, targets) in self.agents.iter().zip(&mut self.targets) {
            agent.hold_rates(targets);
        }
    }

    /// Puts what goes with the goal where the goal has come to, with its velocity for the coming control period.
    #[inline(always)]
    fn carry(&mut self, scenario: &Scenario, lanes: Range<usize>) {
        if self.movable_kinds.iter().all(|kind| kind.drive != Drive::Carried) {
            return;
        }
        let home: Vector3<f64> = scenario.aviary.goal.cast();
        let goals = &self.agents[0];
        for lane in lanes {
            let offset = goals.goal(lane).map(Real::to_f64) - home;
            let velocity = goals.goal_velocity(lane).map(Real::to_f64);
            for (motion, movable) in self.movables[lane].iter_mut().zip(&scenario.aviary.world.movables) {
                if movable.drive == Drive::Carried {
                    let pose = movable.solid.pose;
                    let pose = Pose { position: pose.position + offset, ..pose };
                    *motion = Motion { velocity, ..Motion::at_rest(pose) };
                }
            }
        }
    }

    /// Moves what goes with the goal, or walks, by this time \[s\].
    #[inline(always)]
    fn carry_on(&mut self, scenario: &Scenario, secs: f64) {
        if self.movable_kinds.iter().all(|kind| matches!(kind.drive, Drive::Pushed { .. })) {
            return;
        }
        for (lane, movables) in self.movables.iter_mut().enumerate() {
            let kinds = &scenario.aviary_of(self.agents[0].room(lane)).world.movables;
            for (motion, kind) in movables.iter_mut().zip(kinds) {
                let ahead = motion.pose.position + motion.velocity * secs;
                match &kind.drive {
                    Drive::Pushed { .. } => {}
                    Drive::Carried => motion.pose.position = ahead,
                    Drive::Walking(walk) => {
                        (motion.pose.position, motion.velocity) = walk.turned(ahead, motion.velocity);
                    }
                }
            }
        }
    }

    /// A control period of flight, with what touches what.
    #[inline(always)]
    fn fly(&mut self, stage: &Stage<'_, R>) {
        for agent in &mut self.agents {
            agent.touches = [[R::zero(); LANES]; 2];
        }
        let lonely = self.agents.len() == 1;
        let arenas = stage.arenas.filter(|arenas| !(lonely && arenas.is_empty()));
        let solving = arenas.zip(stage.solver);
        let before = solving.map(|(arenas, _)| {
            let near = self.lanes_that_may_touch(stage.scenario, arenas);
            let drones_by_lane: Vec<LaneDrones<R>> = lanes_of(&near).map(|lane| self.drones(lane)).collect();
            (near, drones_by_lane)
        });
        self.fly_freely(stage, if solving.is_none() { arenas } else { None });
        if let (Some((arenas, solver)), Some((near, drones_by_lane))) = (solving, before) {
            for (lane, drones) in lanes_of(&near).zip(drones_by_lane) {
                // Rooms that are drawn have no solver.
                self.fly_touching(stage, (arenas.of(0), solver), lane, drones);
            }
        }
        self.end_flight();
    }

    /// Nothing is on its way any more at the end of a control period.
    #[inline(always)]
    fn end_flight(&mut self) {
        for (agent, targets) in self.agents.iter_mut().zip(&self.targets) {
            if let Some(latency) = &mut agent.latency {
                latency.end_period(targets);
            }
        }
        self.update_positions();
    }

    /// All lanes as if nothing stood in their way; what touches something in the `reporting` arenas is marked.
    #[inline(always)]
    fn fly_freely(&mut self, stage: &Stage<'_, R>, reporting: Option<&Arenas>) {
        let substeps = stage.scenario.physics.substeps;
        let report_at = substeps - u32::from(reports_early(stage.scenario));
        // Written once: the step is inlined here for every instruction set.
        for substep in 0..=substeps {
            if let (Some(arenas), true) = (reporting, substep == report_at) {
                self.carry_on(stage.scenario, f64::from(stage.scenario.physics.control_secs()));
                self.report(arenas);
            }
            if substep == substeps {
                break;
            }
            if stage.scenario.physics.has_downwash() {
                self.update_positions();
                stage.mechanics.push_down(&self.team, &mut self.pushes);
            }
            for ((agent, targets), push) in self.agents.iter_mut().zip(&self.targets).zip(&self.pushes) {
                agent.advance(stage.mechanics, substep, targets, push);
            }
        }
    }

    #[inline(always)]
    pub(crate) fn update_positions(&mut self) {
        for (place, agent) in self.team.iter_mut().zip(&self.agents) {
            *place = agent.swarm.position;
        }
    }

    /// The drones of one lane.
    fn drones(&self, lane: usize) -> LaneDrones<R> {
        let alone = |agent: &Agent<LANES, R>| LaneDrone {
            swarm: agent.swarm.alone(lane),
            rate_loops: agent.rate_loops.as_ref().map(|loops| loops.alone(lane)),
        };
        self.agents.iter().map(alone).collect()
    }

    /// Marks what touches something where it is now; nothing is pushed by it.
    #[inline(always)]
    fn report(&mut self, arenas: &Arenas) {
        let mut near = [0.0; LANES];
        // What touches at which gap is the same in all rooms.
        let reach = arenas.of(self.agents[0].room(0)).reach();
        self.mark_near(arenas, &mut near, |_, _| reach);
        self.mark_meetings(&mut near, |_, _| reach);
        self.mark_movables(&mut near, 0.0, |_, _| reach);
        for lane in lanes_of(&near) {
            let drones: Vec<Motion> = self.agents.iter().map(|agent| agent.swarm.motion(lane)).collect();
            let touches = touching(arenas.of(self.agents[0].room(lane)), &drones, &self.movables[lane]);
            self.mark_touches(lane, &touches);
        }
    }

    fn mark_touches(&mut self, lane: usize, touches: &[Touch]) {
        let mark = |touched: bool| if touched { R::one() } else { R::zero() };
        for (agent, touch) in self.agents.iter_mut().zip(touches) {
            set_row(&mut agent.touches, lane, [mark(touch.obstacle), mark(touch.landing)]);
        }
    }

    /// One in lanes in which a drone can touch something within the coming control period.
    #[inline(always)]
    fn lanes_that_may_touch(&self, scenario: &Scenario, arenas: &Arenas) -> Column<LANES> {
        let secs = scenario.physics.control_secs();
        let reach = arenas.of(0).reach() + 0.5 * greatest_acceleration(scenario) * secs * secs;
        let travels: Vec<Column<LANES>> =
            self.agents.iter().map(|agent| reaches(&agent.swarm, reach, secs)).collect();
        let travel = |agent: usize, lane: usize| travels[agent][lane];
        let mut near = [0.0; LANES];
        self.mark_near(arenas, &mut near, travel);
        self.mark_meetings(&mut near, travel);
        self.mark_movables(&mut near, f64::from(secs), travel);
        near
    }

    /// Marks lanes in which a drone is within a distance of something that never moves.
    #[inline(always)]
    fn mark_near(&self, arenas: &Arenas, near: &mut Column<LANES>, reach: impl Fn(usize, usize) -> f32) {
        for (index, agent) in self.agents.iter().enumerate() {
            let clearances = arenas
                .clearances(agent.rooms(), &agent.swarm.position.each_ref().map(|axis| axis.map(Real::to_f32)));
            for lane in 0..LANES {
                let room = clearances[lane] - reach(index, lane);
                near[lane] = if room > 0.0 { near[lane] } else { 1.0 };
            }
        }
    }

    /// Marks lanes in which two drones are within the sum of their distances.
    #[inline(always)]
    fn mark_meetings(&self, near: &mut Column<LANES>, reach: impl Fn(usize, usize) -> f32) {
        for (index, one) in self.agents.iter().enumerate() {
            for (number, other) in self.agents[..index].iter().enumerate() {
                for lane in 0..LANES {
                    let [dx, dy, dz] = difference(&one.swarm.position, &other.swarm.position, lane);
                    let travel = reach(index, lane) + reach(number, lane);
                    let close = dx * dx + dy * dy + dz * dz < travel * travel;
                    near[lane] = if close { 1.0 } else { near[lane] };
                }
            }
        }
    }

    /// Marks lanes in which a body moves that can be pushed, or one comes near a drone within some time \[s\].
    fn mark_movables(&self, near: &mut Column<LANES>, secs: f64, reach: impl Fn(usize, usize) -> f32) {
        if self.movables[0].is_empty() {
            return;
        }
        for (lane, movables) in self.movables.iter().enumerate() {
            for (movable, kind) in movables.iter().zip(&self.movable_kinds) {
                let moves = matches!(kind.drive, Drive::Pushed { .. }) && !movable.is_at_rest();
                let own_reach = kind.reach + movable.velocity.norm() * secs;
                let close = self.agents.iter().enumerate().any(|(index, agent)| {
                    let position = vector(&agent.swarm.position, lane).map(Real::to_f64);
                    (position - movable.pose.position).norm() < f64::from(reach(index, lane)) + own_reach
                });
                if moves || close {
                    near[lane] = 1.0;
                }
            }
        }
    }

    /// Redoes the control period of one lane with contacts, from where its drones were at its start.
    fn fly_touching(
        &mut self,
        stage: &Stage<'_, R>,
        (arena, solver): (&Arena, &ContactSolver),
        lane: usize,
        mut drones: LaneDrones<R>,
    ) {
        let physics = &stage.scenario.physics;
        let mut touches = Vec::new();
        let mut pushes = vec![[R::zero()]; drones.len()];
        let mut states: Vec<Vec<State<R>>> = drones.iter().map(|drone| vec![drone.swarm.state(0)]).collect();
        for substep in 0..physics.substeps {
            let before = motions(&drones);
            if substep + 1 == physics.substeps && reports_early(stage.scenario) {
                touches = touching(arena, &before, &self.movables[lane]);
            }
            if physics.has_downwash() {
                let team: Vec<[Column<1, R>; 3]> = drones.iter().map(|drone| drone.swarm.position).collect();
                stage.mechanics.push_down(&team, &mut pushes);
            }
            for (index, (drone, push)) in drones.iter_mut().zip(&pushes).enumerate() {
                let (agent, targets) = (&self.agents[index], &self.targets[index]);
                let late = agent.latency.as_ref().and_then(|latency| latency.targets(substep, targets));
                drone.advance(stage.mechanics, &one_lane(late.as_ref().unwrap_or(targets), lane), push);
            }
            let bodies = (&mut self.movables[lane], &mut self.contacts[lane]);
            resolve(solver, &before, &mut drones, bodies, physics.substep_secs());
            states.iter_mut().zip(&drones).for_each(|(states, drone)| states.push(drone.swarm.state(0)));
        }
        if !reports_early(stage.scenario) {
            touches = touching(arena, &motions(&drones), &self.movables[lane]);
        }
        for ((agent, drone), states) in self.agents.iter_mut().zip(&drones).zip(&states) {
            agent.swarm.set_drone(lane, &drone.swarm.drone(0));
            if let (Some(loops), Some(lone)) = (&mut agent.rate_loops, &drone.rate_loops) {
                loops.replace(lane, lone);
            }
            if let Some(latency) = &mut agent.latency {
                latency.replace(lane, states);
            }
        }
        self.mark_touches(lane, &touches);
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
                    agent.codes[lane] = episode_end::code_of_teammate(first);
                }
            }
        }
    }

    /// Takes the success of a drone back where not all succeed, if all have to.
    #[inline(always)]
    fn succeed_together(&mut self, scenario: &Scenario) {
        if self.agents.len() == 1 || scenario.agents.success == TeamSuccess::Own {
            return;
        }
        for lane in 0..LANES {
            let all = self.agents.iter().fold(R::one(), |all, agent| all * agent.ends.success[lane]);
            for agent in &mut self.agents {
                agent.ends.success[lane] = all;
            }
        }
    }

    /// Shows drones the nearest of their team in these lanes, where they measure them.
    fn observe_neighbours(&mut self, scenario: &Scenario, lanes: Range<usize>) {
        let Some(Told::Mates(mates)) = scenario.sensors.told() else { return };
        let mut values = vec![R::zero(); mates.len()];
        for lane in lanes {
            let course = |agent: &Agent<LANES, R>| -> Course<R> {
                (vector(&agent.swarm.position, lane), vector(&agent.swarm.velocity, lane))
            };
            let team: Vec<Course<R>> = self.agents.iter().map(course).collect();
            for (index, agent) in self.agents.iter_mut().enumerate() {
                match agent.listen(scenario, lane, &team) {
                    None => mates.read(index, &team, &mut values),
                    Some(heard) => mates.read(index, &heard, &mut values),
                }
                agent.take_neighbours(lane, &values, mates.in_body_axes);
            }
        }
    }

    /// Shows all drones of a lane where those are that began anew.
    fn observe_restarted(&mut self, scenario: &Scenario, lane: usize) {
        if matches!(scenario.sensors.told(), Some(Told::Mates(_))) {
            self.observe_neighbours(scenario, lane..lane + 1);
            self.agents.iter_mut().for_each(|agent| agent.observe_lane(scenario, lane));
        }
    }

    /// Pays every drone the sum of all, where they share.
    #[inline(always)]
    fn share_rewards(&mut self, scenario: &Scenario) {
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

    /// Finds whom each drone meets next, where a reward looks ahead.
    #[inline(always)]
    fn look_ahead(&mut self, scenario: &Scenario) {
        let Some(secs) = looks_ahead_secs(scenario) else { return };
        let radius = scenario.airframe.collision_radius;
        for lane in 0..LANES {
            let team: Vec<Motion> = self.agents.iter().map(|agent| agent.swarm.motion(lane)).collect();
            let kinds = &scenario.aviary_of(self.agents[0].room(lane)).world.movables;
            for (index, agent) in self.agents.iter_mut().enumerate() {
                let own = &team[index];
                let others = team.iter().enumerate().filter(|(other, _)| *other != index);
                let mates = others.map(|(_, mate)| Passing {
                    middle: mate.pose.position,
                    radius,
                    velocity: mate.velocity,
                });
                let bodies = kinds.iter().zip(&self.movables[lane]);
                let people = bodies.filter_map(|(kind, body)| Passing::of_person(kind, body, own));
                let met = mates.chain(people).map(|passing| (passing.least_distance(own, secs), passing));
                let next = met.min_by(|one, other| one.0.total_cmp(&other.0));
                agent.take_passing(lane, next.map(|(_, passing)| passing));
            }
        }
    }

    /// Starts the next episode of a lane, whatever became of the last.
    pub(crate) fn restart(&mut self, scenario: &Scenario, arenas: Option<&Arenas>, lane: usize) {
        self.contacts[lane] = ContactMemory::default();
        let room = self.agents[0].draw_room(scenario, lane);
        self.movables[lane] = standing(scenario, room);
        let around = Around { arenas, movables: &self.movables };
        self.agents.iter_mut().for_each(|agent| agent.reset(scenario, around, (lane, room)));
        self.update_positions();
        self.carry(scenario, lane..lane + 1);
        self.observe_restarted(scenario, lane);
    }

    /// Takes the ended episodes out and starts the next ones, by agent and lane.
    pub(crate) fn restart_ended(
        &mut self,
        scenario: &Scenario,
        arenas: Option<&Arenas>,
        first: u32,
        finished: &mut impl FnMut(usize, Finished<R>),
    ) {
        let mut rooms: [u32; LANES] = core::array::from_fn(|lane| self.agents[0].room(lane));
        for (lane, room) in rooms.iter_mut().enumerate() {
            if self.agents[0].codes[lane] > 0.0 {
                self.contacts[lane] = ContactMemory::default();
                // Who begins alone begins where the others are.
                if scenario.agents.ends == TeamEnd::Together {
                    *room = self.agents[0].draw_room(scenario, lane);
                    self.movables[lane] = standing(scenario, *room);
                }
            }
        }
        let around = Around { arenas, movables: &self.movables };
        for (index, agent) in self.agents.iter_mut().enumerate() {
            for (lane, room) in rooms.iter().enumerate() {
                if let Some(done) = agent.finished(first, lane) {
                    finished(index, done);
                    agent.reset(scenario, around, (lane, *room));
                }
            }
        }
        self.update_positions();
        self.carry(scenario, 0..LANES);
        for lane in 0..LANES {
            if self.agents.iter().any(|agent| agent.codes[lane] > 0.0) {
                self.observe_restarted(scenario, lane);
            }
        }
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
}

/// Full thrust along gravity \[m/s²\], of the lightest and strongest drone that an episode can have; what drag or
/// Bullet's damping can add is never more.
fn greatest_acceleration(scenario: &Scenario) -> f32 {
    let (airframe, spread) = (&scenario.airframe, &scenario.randomisation);
    let drawn = f64::from((1.0 + spread.thrust) / (1.0 - spread.mass));
    (drawn * airframe.thrust_limit() / airframe.mass + GRAVITY) as f32
}

/// The movable bodies of a room where episodes begin.
fn standing(scenario: &Scenario, room: u32) -> Vec<Motion> {
    let begin = |movable: &Movable| {
        let rest = Motion::at_rest(movable.solid.pose);
        match &movable.drive {
            Drive::Pushed { .. } | Drive::Carried => rest,
            Drive::Walking(walk) => Motion { velocity: walk.velocity, ..rest },
        }
    };
    scenario.aviary_of(room).world.movables.iter().map(begin).collect()
}

#[inline(always)]
fn difference<const LANES: usize, R: Real>(
    one: &[Column<LANES, R>; 3],
    other: &[Column<LANES, R>; 3],
    lane: usize,
) -> [f32; 3] {
    core::array::from_fn(|axis| (one[axis][lane] - other[axis][lane]).to_f32())
}

/// The drones of one environment, one by one.
type LaneDrones<R> = Vec<LaneDrone<R>>;

/// A drone by itself, with its rate loop where it has one.
struct LaneDrone<R: Real> {
    swarm: Swarm<1, R>,
    rate_loops: Option<RateLoops<1, R>>,
}

impl<R: Real> LaneDrone<R> {
    /// A substep under these targets, or with what its rate loop holds.
    fn advance(&mut self, mechanics: &Mechanics<R>, command: &[Column<1, R>; 4], push: &Column<1, R>) {
        let looped = self.rate_loops.as_mut().map(|loops| loops.rotor_targets(command, &self.swarm.body_rates));
        self.swarm.advance(mechanics, looped.as_ref().unwrap_or(command), push);
    }
}

/// Where they are and how they move.
fn motions<R: Real>(drones: &[LaneDrone<R>]) -> Vec<Motion> {
    drones.iter().map(|drone| drone.swarm.motion(0)).collect()
}

/// Whether contact is reported as it was at the start of the last substep: Bullet reports what its last collision
/// detection saw.
fn reports_early(scenario: &Scenario) -> bool {
    matches!(scenario.physics.preset, Preset::Bullet { .. })
}

/// The marked lanes.
fn lanes_of<const LANES: usize>(marks: &Column<LANES>) -> impl Iterator<Item = usize> {
    let any = marks.iter().fold(0.0_f32, |any, mark| any.max(*mark)) > 0.5;
    let lanes = if any { 0..LANES } else { 0..0 };
    lanes.filter(|lane| marks[*lane] > 0.5)
}

/// How far each drone comes within some time, `reach` included \[m\].
#[inline(always)]
fn reaches<const LANES: usize, R: Real>(swarm: &Swarm<LANES, R>, reach: f32, secs: f32) -> Column<LANES> {
    core::array::from_fn(|lane| {
        let [x, y, z] = row(&swarm.velocity, lane).map(Real::to_f32);
        reach + Real::sqrt(x * x + y * y + z * z) * secs
    })
}

/// What each drone touches.
fn touching(arena: &Arena, drones: &[Motion], movables: &[Motion]) -> Vec<Touch> {
    let reach = f64::from(arena.reach());
    let touch = |drone: &Motion| {
        let [x, y, z] = drone.pose.position.map(|value| value as f32).into();
        let apart = movables.is_empty() && arena.clearance(x, y, z) > arena.reach();
        if apart { Touch::default() } else { arena.touch(&drone.pose, movables) }
    };
    let mut touches: Vec<Touch> = drones.iter().map(touch).collect();
    for (index, drone) in drones.iter().enumerate() {
        for (number, other) in drones[..index].iter().enumerate() {
            let apart = (drone.pose.position - other.pose.position).norm_squared() > 4.0 * reach * reach;
            if !apart && arena.drones_touch(&drone.pose, &other.pose) {
                touches[index].obstacle = true;
                touches[number].obstacle = true;
            }
        }
    }
    touches
}

/// Lets contacts change what free flight made of the drones.
fn resolve<R: Real>(
    solver: &ContactSolver,
    before: &[Motion],
    drones: &mut LaneDrones<R>,
    (movables, memory): (&mut Vec<Motion>, &mut ContactMemory),
    secs: f64,
) {
    let free = motions(drones);
    let mut after = free.clone();
    solver.resolve(before, &mut after, movables, memory, secs);
    for ((lone, free), after) in drones.iter_mut().zip(&free).zip(&after) {
        if after != free {
            let mut drone = lone.swarm.drone(0);
            let state = &mut drone.motion;
            state.position = after.pose.position.map(R::from_f64);
            state.world_from_body = after.pose.world_from_body.map(R::from_f64);
            state.velocity = after.velocity.map(R::from_f64);
            state.body_rates = after.body_rates.map(R::from_f64);
            drone.reported_angular_velocity = state.world_from_body.rotate(state.body_rates);
            lone.swarm.set_drone(0, &drone);
        }
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
