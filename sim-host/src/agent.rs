//! One drone of every environment of a block: the stages of a step over `LANES` lanes.

mod commanding;
mod observing;
mod passing;
mod racing;

use std::ops::Range;

use kestrel_core::action::{ACTION_LIMIT, ActionSpace, ControlMemory, Persistence};
use kestrel_core::real::Real;
use kestrel_core::reference::bullet::BulletState;
use nalgebra::Vector3;

use crate::contact::Motion;
use crate::episode_end;
use crate::latency::{LatencyMemory, States, known_states};
use crate::outcome::{Ending, Episode};
use crate::rate_loop::RateLoops;
use crate::reset::{self, Beginning};
use crate::reward::RewardTerm;
use crate::rooms::{Around, room};
use crate::scenario::{Clock, Goals, Scenario, Success};
use crate::seed::{Purpose, Seed, Stream};
use crate::sensor::{Chart, Mates, MatesMemory, SensorMemory, TofMemory, Told, WayMemory};
use crate::stage::Stage;
use crate::swarm::{Column, Mechanics, Swarm, row, set_row, vector};
use crate::term::{Ends, FlightView, Memory, StepView, contains};
use crate::termination::Termination;
use crate::trajectory::TRAJECTORY_LEN;
pub(crate) use passing::{PASSING_LEN, Passing};
use racing::Race;

/// Values a privileged critic sees beside the observation: rotor speeds relative to hover − 1 (4), wind \[m/s\] (3),
/// mass and thrust factors − 1 (2), share of the episode left (1).
pub const PRIVILEGED_LEN: usize = 10;

/// How far ahead on the shortest way the point is that rewards look at \[m\].
const SIGNPOST_M: f32 = 0.4;

/// How far rewards look around \[m\]: what is farther counts as so far away.
pub(crate) const LOOK_AROUND_M: f32 = 2.0;

/// An agent of `LANES` environments that step together.
#[derive(Clone, Debug)]
pub(crate) struct Agent<const LANES: usize, R: Real> {
    pub(crate) swarm: Swarm<LANES, R>,
    pub(crate) observations: Vec<Column<LANES, R>>,
    pub(crate) privileged: [Column<LANES, R>; PRIVILEGED_LEN],
    pub(crate) rewards: Column<LANES, R>,
    pub(crate) codes: Column<LANES>,
    /// One while touching an obstacle, the floor or a drone; one while touching the landing zone.
    pub(crate) touches: [Column<LANES, R>; 2],
    /// Each term's value in the last step.
    pub(crate) term_values: Vec<Column<LANES, R>>,
    index: usize,
    /// Lanes that are environments; what is behind them flies unseen.
    flown: usize,
    /// Numbers of the rooms of the lanes; none where no room is drawn.
    rooms: Option<Column<LANES, R>>,
    factors: [Column<LANES, R>; 2],
    /// The last actions, oldest first; the last one is the previous action.
    history: Vec<[Column<LANES, R>; ACTION_LIMIT]>,
    goal: [Column<LANES, R>; 3],
    /// Of the position error, world, where the observation shows it.
    integral: [Column<LANES, R>; 3],
    goal_velocity: [Column<LANES, R>; 3],
    /// What the goals follow; none where they follow no curve.
    trajectory: Option<Box<[Column<LANES, R>; TRAJECTORY_LEN]>>,
    /// What is left of the course; none where there is no race.
    race: Option<Box<Race<LANES, R>>>,
    distances: Column<LANES, R>,
    /// Those of the step before, along the course where a gate was passed since.
    previous_distances: Column<LANES, R>,
    steps: Column<LANES, R>,
    /// Last step at which the drone was outside the radius it must settle in.
    last_outside: Column<LANES, R>,
    /// Control periods inside the region it must visit.
    visits: Column<LANES, R>,
    /// Where an episode just ended, and how.
    pub(crate) ends: Ends<LANES, R>,
    totals: Column<LANES, R>,
    term_totals: Vec<Column<LANES, R>>,
    /// What terms and rules remember, in their order.
    term_memory: Vec<Vec<Column<LANES, R>>>,
    rule_memory: Vec<Vec<Column<LANES, R>>>,
    controls: Vec<ControlMemory<R>>,
    streams: Vec<Stream>,
    sensors: Vec<SensorMemory>,
    measurements: Vec<Column<LANES, R>>,
    /// None without a ranger of many zones.
    tof: Option<Box<TofMemory<LANES, R>>>,
    /// None where mates are seen as they are, or not at all.
    mates: Option<Box<MatesMemory<LANES, R>>>,
    /// None where drones look for no way.
    way: Option<Box<WayMemory<LANES, R>>>,
    /// Normal of the surface of the nearest obstacle at the end of the flight, and how far the origin is above the plane that
    /// touches it there \[m\]; none where no reward looks around.
    nearest: Option<Box<[Column<LANES, R>; 4]>>,
    /// The point ahead on the shortest free way; none where no reward looks along it.
    signposts: Option<Box<[Column<LANES, R>; 3]>>,
    /// The [`Passing`] whom the drone meets next; none where no reward looks ahead.
    passing: Option<Box<[Column<LANES, R>; PASSING_LEN]>>,
    /// Velocity at the last reading of the sensors.
    read_velocity: [Column<LANES, R>; 3],
    scales: PrivilegedScales<R>,
    /// None where nothing is late or wrong.
    pub(crate) latency: Option<LatencyMemory<LANES, R>>,
    /// What the velocity controller makes up for \[m/s², world\]; none where it has no integral.
    velocity_integral: Option<Box<[Column<LANES, R>; 3]>>,
    /// None where rotor targets are held over a control period.
    pub(crate) rate_loops: Option<Box<RateLoops<LANES, R>>>,
}

/// Empty maps, if drones look for their ways.
fn way<const LANES: usize, R: Real>(scenario: &Scenario) -> Option<Box<WayMemory<LANES, R>>> {
    let Some(Told::Way(way)) = scenario.sensors.told() else { return None };
    Some(WayMemory::new(*way, &scenario.sensors, scenario.airframe.collision_radius))
}

/// Nothing heard yet, if mates talk by radio.
fn mates<const LANES: usize, R: Real>(scenario: &Scenario) -> Option<Box<MatesMemory<LANES, R>>> {
    let Some(Told::Mates(Mates { radio: Some(radio), .. })) = scenario.sensors.told() else { return None };
    Some(Box::new(MatesMemory::new(*radio, scenario.agents.count as usize)))
}

/// How far ahead rewards look for whom a drone meets \[s\], if one does.
pub(crate) fn looks_ahead_secs(scenario: &Scenario) -> Option<f64> {
    scenario.rewards.iter().filter_map(RewardTerm::looks_ahead_secs).reduce(f64::max)
}

/// An agent whose episode ended in this step.
pub(crate) struct Finished<R> {
    pub(crate) lane: usize,
    pub(crate) episode: Episode,
    pub(crate) observation: Vec<R>,
    pub(crate) privileged: [R; PRIVILEGED_LEN],
}

/// Reciprocals, computed once.
#[derive(Clone, Copy, Debug)]
struct PrivilegedScales<R> {
    per_hover_speed: R,
    per_episode_steps: R,
}

impl<R: Real> PrivilegedScales<R> {
    fn of(scenario: &Scenario) -> Self {
        Self {
            per_hover_speed: R::from_f32(1.0 / scenario.airframe.hover_rotor_speed() as f32),
            per_episode_steps: R::from_f32(1.0 / scenario.episode_steps() as f32),
        }
    }
}

impl<const LANES: usize, R: Real> Agent<LANES, R> {
    /// Agent `index` of `environments`, at most `LANES`, before the [reset](Self::reset) of each lane.
    pub(crate) fn new(
        scenario: &Scenario,
        index: usize,
        (seed, purpose): (Seed, Purpose),
        environments: Range<u32>,
    ) -> Self {
        let first = environments.start;
        let nothing = [R::zero(); LANES];
        let stream = |lane| Stream::of_agent(seed, first + lane, index as u32, purpose);
        let columns = |count: usize| vec![nothing; count];
        let mut agent = Self {
            swarm: Swarm::new(&scenario.airframe),
            observations: columns(scenario.observation.len()),
            privileged: [nothing; PRIVILEGED_LEN],
            rewards: nothing,
            codes: [0.0; LANES],
            touches: [nothing; 2],
            term_values: columns(scenario.rewards.len()),
            index,
            flown: environments.len(),
            rooms: scenario.drawn.as_ref().map(|_| nothing),
            factors: [[R::one(); LANES]; 2],
            history: vec![[nothing; ACTION_LIMIT]; scenario.observation.history_len().max(1)],
            goal: [nothing; 3],
            integral: [nothing; 3],
            goal_velocity: [nothing; 3],
            trajectory: scenario.goals.trajectories().map(|_| Box::new([nothing; TRAJECTORY_LEN])),
            race: (scenario.goals == Goals::Gates).then(|| Box::new(Race::new())),
            distances: nothing,
            previous_distances: nothing,
            steps: nothing,
            last_outside: nothing,
            visits: nothing,
            ends: Ends { success: nothing, failure: nothing, time_up: nothing },
            totals: nothing,
            term_totals: columns(scenario.rewards.len()),
            term_memory: scenario.rewards.iter().map(|term| columns(term.memory().columns)).collect(),
            rule_memory: scenario.terminations.iter().map(|rule| columns(rule.memory().columns)).collect(),
            controls: vec![ControlMemory::new(); LANES],
            streams: (0..LANES as u32).map(stream).collect(),
            sensors: Vec::new(),
            measurements: columns(scenario.sensors.len()),
            tof: scenario.sensors.tof().map(|tof| Box::new(TofMemory::new(tof))),
            nearest: scenario
                .rewards
                .iter()
                .any(|term| term.looks_around_secs().is_some())
                .then(|| Box::new([nothing; 4])),
            signposts: scenario.rewards.iter().any(RewardTerm::looks_along_ways).then(|| Box::new([nothing; 3])),
            passing: looks_ahead_secs(scenario).map(|_| Box::new([nothing; PASSING_LEN])),
            mates: mates(scenario),
            way: way(scenario),
            read_velocity: [nothing; 3],
            scales: PrivilegedScales::of(scenario),
            latency: LatencyMemory::new(scenario),
            velocity_integral: matches!(scenario.action, ActionSpace::IntegralVelocities(_))
                .then(|| Box::new([nothing; 3])),
            rate_loops: RateLoops::new(scenario),
        };
        if !scenario.sensors.instruments().is_empty() {
            agent.sensors = agent.streams.iter_mut().map(|stream| scenario.sensors.begin(stream)).collect();
        }
        agent
    }

    /// Distance to the goal, and whether the drone has settled or visited.
    #[inline(always)]
    pub(crate) fn update_metrics(&mut self, scenario: &Scenario) {
        for lane in 0..LANES {
            self.steps[lane] += R::one();
        }
        if scenario.clock == Clock::Elapsed {
            self.update_goal(scenario);
        }
        self.previous_distances = self.distances;
        self.pass_gates(scenario);
        let [x, y, z] = &self.swarm.position;
        let [gx, gy, gz] = &self.goal;
        for lane in 0..LANES {
            let (dx, dy, dz) = (x[lane] - gx[lane], y[lane] - gy[lane], z[lane] - gz[lane]);
            self.distances[lane] = (dx * dx + dy * dy + dz * dz).sqrt();
        }
        match scenario.success {
            Success::Settle { radius_m, .. } => {
                let radius = R::from_f32(radius_m);
                for lane in 0..LANES {
                    let (last, now) = (self.last_outside[lane], self.steps[lane]);
                    self.last_outside[lane] = self.distances[lane].where_less(radius, last, now);
                }
            }
            Success::Visit { region, .. } => {
                for lane in 0..LANES {
                    let inside = contains(&region, &self.swarm, lane);
                    self.visits[lane] += if inside { R::one() } else { R::zero() };
                }
            }
            Success::Reach { .. } | Success::Ending => {}
        }
    }

    /// Ends episodes by the rules of the task.
    #[inline(always)]
    pub(crate) fn terminate(
        &mut self,
        stage: &Stage<'_, R>,
        actions: &[Column<LANES, R>],
        team: &[[Column<LANES, R>; 3]],
    ) {
        let (mut memory, mut codes) = (core::mem::take(&mut self.rule_memory), self.codes);
        episode_end::find_endings(&self.view(stage, actions, team), stage.scenario, &mut memory, &mut codes);
        (self.rule_memory, self.codes) = (memory, codes);
        self.ends = self.find_ends(stage.scenario);
    }

    /// Finds what is nearest and where the way leads, where a reward looks for it.
    #[inline(always)]
    pub(crate) fn look_around(&mut self, stage: &Stage<'_, R>) {
        if let Some(signposts) = &mut self.signposts {
            let term = stage.scenario.rewards.iter().find(|term| term.looks_along_ways());
            if let Some(ways) = term.and_then(RewardTerm::ways) {
                for lane in 0..LANES {
                    let place = row(&self.swarm.position, lane).map(Real::to_f32);
                    let ahead = ways.of(room(self.rooms.as_ref(), lane)).ahead(place, SIGNPOST_M);
                    set_row(signposts, lane, [ahead.x, ahead.y, ahead.z].map(R::from_f32));
                }
            }
        }
        let (Some(plane), Some(arenas)) = (&mut self.nearest, stage.arenas) else { return };
        let secs = stage.scenario.rewards.iter().find_map(RewardTerm::looks_around_secs).unwrap_or_default();
        for lane in 0..LANES {
            let (place, velocity) = (row(&self.swarm.position, lane), row(&self.swarm.velocity, lane));
            let place: [f32; 3] =
                core::array::from_fn(|axis| place[axis].to_f32() + velocity[axis].to_f32() * secs);
            let found = arenas.of(room(self.rooms.as_ref(), lane)).nearest_plane(place, LOOK_AROUND_M);
            let (normal, distance) = found.unwrap_or((Vector3::zeros(), LOOK_AROUND_M));
            let offset = distance - normal.dot(&Vector3::from(place));
            set_row(plane, lane, [normal.x, normal.y, normal.z, offset].map(R::from_f32));
        }
    }

    /// Takes in whom the drone of a lane meets next.
    pub(crate) fn take_passing(&mut self, lane: usize, passing: Option<Passing>) {
        let Some(columns) = &mut self.passing else { return };
        set_row(columns, lane, passing.unwrap_or(Passing::NOBODY).to_array().map(R::from_f64));
    }

    /// Sums the terms of the reward.
    #[inline(always)]
    pub(crate) fn reward(
        &mut self,
        stage: &Stage<'_, R>,
        actions: &[Column<LANES, R>],
        team: &[[Column<LANES, R>; 3]],
    ) {
        let (mut memory, mut term_values) =
            (core::mem::take(&mut self.term_memory), core::mem::take(&mut self.term_values));
        let view = StepView { flight: self.view(stage, actions, team), ends: &self.ends };
        for ((term, memory), values) in stage.scenario.rewards.iter().zip(&mut memory).zip(&mut term_values) {
            term.evaluate(&view, memory, values);
        }
        self.rewards = [R::zero(); LANES];
        for (values, totals) in term_values.iter().zip(&mut self.term_totals) {
            add(&mut self.rewards, values);
            add(totals, values);
        }
        (self.term_memory, self.term_values) = (memory, term_values);
    }

    /// What terms and rules look at.
    #[inline(always)]
    fn view<'a>(
        &'a self,
        stage: &Stage<'a, R>,
        actions: &'a [Column<LANES, R>],
        team: &'a [[Column<LANES, R>; 3]],
    ) -> FlightView<'a, LANES, R> {
        FlightView {
            swarm: &self.swarm,
            goal: &self.goal,
            distances: &self.distances,
            previous_distances: &self.previous_distances,
            actions,
            previous_actions: self.history.last().expect("there is a previous action"),
            touches: &self.touches,
            nearest: self.nearest.as_deref(),
            passing: self.passing.as_deref(),
            signposts: self.signposts.as_deref(),
            ahead: self.way.as_ref().map(|way| way.points_ahead()),
            steps: &self.steps,
            gates_left: self.race.as_ref().map(|race| race.left()),
            agent: self.index,
            team,
            arenas: stage.arenas,
            rooms: self.rooms(),
            control_rate_hz: stage.scenario.physics.control_rate_hz,
        }
    }

    /// Adds the rewards of the step to the episode.
    #[inline(always)]
    pub(crate) fn accumulate_return(&mut self) {
        add(&mut self.totals, &self.rewards);
    }

    /// Which lanes ended in success and which in failure.
    #[inline(always)]
    fn find_ends(&self, scenario: &Scenario) -> Ends<LANES, R> {
        let codes = &self.codes;
        let mark = |marked: bool| if marked { R::one() } else { R::zero() };
        let success = episode_end::code(Ending::Success);
        let lost = |lane: usize| (codes[lane] == 0.0) | episode_end::is_failure(codes[lane]);
        Ends {
            success: match scenario.success {
                Success::Reach { .. } | Success::Ending => {
                    core::array::from_fn(|lane| mark(codes[lane] == success))
                }
                Success::Settle { within_secs, .. } => {
                    let limit = R::from_f64(f64::from(within_secs) * scenario.physics.control_rate_hz + 1e-3);
                    let settled = |lane: usize| self.last_outside[lane] <= limit;
                    core::array::from_fn(|lane| mark(episode_end::is_time_limit(codes[lane]) & settled(lane)))
                }
                Success::Visit { periods, .. } => {
                    let least = R::from_f64(f64::from(periods));
                    core::array::from_fn(|lane| mark(!lost(lane) & (self.visits[lane] >= least)))
                }
            },
            failure: core::array::from_fn(|lane| mark(episode_end::is_failure(codes[lane]))),
            time_up: core::array::from_fn(|lane| mark(episode_end::is_time_limit(codes[lane]))),
        }
    }

    /// The episode of a lane, if it has just ended.
    pub(crate) fn finished(&self, first: u32, lane: usize) -> Option<Finished<R>> {
        let ending = episode_end::decode(self.codes[lane])?;
        Some(Finished {
            lane,
            episode: self.episode(first, lane, ending),
            observation: self.observations.iter().map(|column| column[lane]).collect(),
            privileged: row(&self.privileged, lane),
        })
    }

    fn episode(&self, first: u32, lane: usize, ending: Ending) -> Episode {
        Episode {
            environment: first + lane as u32,
            agent: self.index as u32,
            steps: self.steps[lane].to_f64() as u32,
            total_reward: self.totals[lane].to_f64() as f32,
            success: self.ends.success[lane].to_f64() > 0.5,
            ending,
            terms: self.term_totals.iter().map(|totals| totals[lane].to_f64() as f32).collect(),
        }
    }

    /// The room of the lane's next episode.
    pub(crate) fn draw_room(&mut self, scenario: &Scenario, lane: usize) -> u32 {
        // Nothing is drawn where there is one place only.
        match &scenario.drawn {
            Some(rooms) if lane < self.flown => self.streams[lane].below(rooms.range().count),
            Some(_) | None => self.room(lane),
        }
    }

    /// Begins the lane's next episode in this room; its last reward and code stay readable.
    pub(crate) fn reset(&mut self, scenario: &Scenario, around: Around<'_>, (lane, room): (usize, u32)) {
        if let Some(rooms) = &mut self.rooms {
            rooms[lane] = R::from_f64(f64::from(room));
        }
        let beginning = reset::begin(scenario, (self.index, room), &mut self.streams[lane]);
        self.place(scenario, lane, &beginning);
        self.forget_measurements(lane);
        if let Some(memory) = self.sensors.get_mut(lane) {
            *memory = scenario.sensors.begin(&mut self.streams[lane]);
            set_row(&mut self.read_velocity, lane, row(&self.swarm.velocity, lane));
            self.sense_lane(scenario, around.arenas, lane);
        }
        if let Some(tof) = &mut self.tof {
            tof.begin(lane, &mut self.streams[lane]);
        }
        if let Some(mates) = &mut self.mates {
            mates.begin(lane, &mut self.streams[lane]);
        }
        if let Some(way) = &mut self.way {
            way.begin(lane);
        }
        self.range_lane(scenario, around, lane);
        self.scan_lane(scenario, around.arenas, lane);
        self.find_way(scenario, lane);
        self.tell(scenario, lane..lane + 1);
        self.begin_integral(scenario, lane);
        self.observe_lane(scenario, lane);
        let scales = self.scales;
        self.reveal_lane(&scales, lane);
    }

    fn place(&mut self, scenario: &Scenario, lane: usize, beginning: &Beginning<R>) {
        self.swarm.set_drone(lane, &beginning.drone);
        self.swarm.set_vehicle(lane, &beginning.vehicle);
        set_row(&mut self.swarm.wind, lane, beginning.wind.into());
        set_row(&mut self.factors, lane, beginning.factors);
        let motion = &beginning.drone.motion;
        let command = match &mut self.rate_loops {
            None => motion.rotor_speeds,
            Some(loops) => loops.begin(lane, motion),
        };
        if let Some(latency) = &mut self.latency {
            latency.begin(lane, (motion, command), beginning.delays, &mut self.streams[lane]);
        }
        for past in &mut self.history {
            set_row(past, lane, [R::zero(); ACTION_LIMIT]);
        }
        let counts = [&mut self.steps, &mut self.last_outside, &mut self.visits, &mut self.totals];
        for column in counts.into_iter().chain(&mut self.touches).chain(&mut self.term_totals) {
            column[lane] = R::zero();
        }
        self.reset_memory(scenario, lane);
        if let (Some(columns), Some(trajectory)) = (&mut self.trajectory, beginning.trajectory) {
            set_row(columns, lane, trajectory.to_array());
        }
        self.update_goal_of(scenario, lane);
        self.line_up(scenario, lane);
        self.distances[lane] = length(&(beginning.drone.motion.position - vector(&self.goal, lane)));
    }

    /// The integral of the position error after the first look.
    fn begin_integral(&mut self, scenario: &Scenario, lane: usize) {
        let (state, goal) = (self.known().state(lane), vector(&self.goal, lane));
        let nothing = Vector3::new(R::zero(), R::zero(), R::zero());
        let secs = R::from_f32(scenario.physics.control_secs());
        let integral = scenario.observation.integrate(&nothing, &state, &goal, secs);
        set_row(&mut self.integral, lane, integral.into());
    }

    /// What terms, rules and controllers remember of an episode is gone with it.
    fn reset_memory(&mut self, scenario: &Scenario, lane: usize) {
        let terms = scenario.rewards.iter().map(RewardTerm::memory).zip(&mut self.term_memory);
        let rules = scenario.terminations.iter().map(Termination::memory).zip(&mut self.rule_memory);
        for (Memory { start, lasts, .. }, columns) in terms.chain(rules) {
            for column in columns {
                column[lane] = if lasts { column[lane] } else { R::from_f64(start) };
            }
        }
        if scenario.action.persistence() == Persistence::ResetEachEpisode {
            self.controls[lane] = ControlMemory::new();
        }
        if let Some(integrals) = &mut self.velocity_integral {
            set_row(integrals, lane, [R::zero(); 3]);
        }
    }

    /// Adds the actions of the step to the history; an action space always fills the same columns.
    #[inline(always)]
    pub(crate) fn push_history(&mut self, actions: &[Column<LANES, R>]) {
        if self.history.len() > 1 {
            self.history.rotate_left(1);
        }
        if let Some(last) = self.history.last_mut() {
            last[..actions.len()].copy_from_slice(actions);
        }
    }

    /// Whether no lane's episode just ended.
    pub(crate) fn is_running(&self) -> bool {
        self.codes.iter().fold(true, |running, code| running & (*code == 0.0))
    }

    /// The rooms of the lanes, where rooms are drawn.
    #[inline(always)]
    pub(crate) fn rooms(&self) -> Option<&Column<LANES, R>> {
        self.rooms.as_ref()
    }

    /// The room of a lane, zero where none is drawn.
    #[inline(always)]
    pub(crate) fn room(&self, lane: usize) -> u32 {
        room(self.rooms(), lane)
    }

    /// Where the drone is and how it moves.
    pub(crate) fn motion(&self, lane: usize) -> Motion {
        self.swarm.motion(lane)
    }

    /// Control periods of its episode that have passed.
    pub(crate) fn period(&self, lane: usize) -> u32 {
        self.steps[lane].to_f64() as u32
    }

    pub(crate) fn goal(&self, lane: usize) -> Vector3<R> {
        vector(&self.goal, lane)
    }

    pub(crate) fn goal_velocity(&self, lane: usize) -> Vector3<R> {
        vector(&self.goal_velocity, lane)
    }

    /// Every column that the next step depends on, for saving and restoring.
    pub(crate) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Column<LANES, R>> {
        self.swarm
            .columns_mut()
            .chain(&mut self.observations)
            .chain(&mut self.privileged)
            .chain([&mut self.rewards])
            .chain(&mut self.touches)
            .chain(&mut self.factors)
            .chain(self.history.iter_mut().flatten())
            .chain(&mut self.goal)
            .chain(&mut self.integral)
            .chain(&mut self.goal_velocity)
            .chain([
                &mut self.distances,
                &mut self.steps,
                &mut self.last_outside,
                &mut self.visits,
                &mut self.totals,
            ])
            .chain(&mut self.term_totals)
            .chain(&mut self.measurements)
            .chain(&mut self.read_velocity)
            .chain(self.term_memory.iter_mut().flatten())
            .chain(self.rule_memory.iter_mut().flatten())
            .chain(self.latency.iter_mut().flat_map(LatencyMemory::columns_mut))
            .chain(self.rate_loops.iter_mut().flat_map(|loops| loops.columns_mut()))
            .chain(&mut self.rooms)
            .chain(self.trajectory.iter_mut().flat_map(|columns| columns.iter_mut()))
            .chain(self.velocity_integral.iter_mut().flat_map(|columns| columns.iter_mut()))
            .chain(self.race.iter_mut().flat_map(|race| race.columns_mut()))
            .chain(self.way.iter_mut().flat_map(|way| way.columns_mut()))
            .chain(self.tof.iter_mut().flat_map(|tof| tof.columns_mut()))
            .chain(self.mates.iter_mut().flat_map(|mates| mates.columns_mut()))
            .chain(self.nearest.iter_mut().flat_map(|plane| plane.iter_mut()))
            .chain(self.passing.iter_mut().flat_map(|plane| plane.iter_mut()))
            .chain(self.signposts.iter_mut().flat_map(|place| place.iter_mut()))
    }

    /// How many columns, the last of [`Self::columns_mut`], are found only once a flight is over.
    pub(crate) fn late_columns(&self) -> usize {
        let (nearest, passing) = (self.nearest.as_ref(), self.passing.as_ref());
        let signposts = self.signposts.as_ref().map_or(0, |place| place.len());
        nearest.map_or(0, |plane| plane.len()) + passing.map_or(0, |plane| plane.len()) + signposts
    }

    /// What drones have met on their ways, for saving and restoring.
    pub(crate) fn charts_mut(&mut self) -> &mut [Chart] {
        self.way.as_mut().map(|way| way.charts_mut()).unwrap_or_default()
    }

    /// The point ahead on the way that a drone looks for by itself \[m, world\].
    pub(crate) fn ahead(&self, lane: usize) -> Option<Vector3<f32>> {
        self.way.as_ref().map(|way| way.ahead(lane))
    }

    /// The states that policy and rate controller see.
    #[inline(always)]
    pub(crate) fn known(&self) -> States<'_, LANES, R> {
        known_states(&self.swarm, self.latency.as_ref())
    }

    /// Puts the drone of a lane elsewhere; it knows at once.
    pub(crate) fn put(&mut self, lane: usize, drone: &BulletState<R>) {
        self.swarm.set_drone(lane, drone);
        if let Some(latency) = &mut self.latency {
            latency.know(lane, &drone.motion);
        }
        if let Some(loops) = &mut self.rate_loops {
            loops.settle(lane, &drone.motion.body_rates);
        }
    }

    /// Turns rotor targets into what the rate loop holds over the control period, where there is one.
    #[inline(always)]
    pub(crate) fn hold_rates(&self, targets: &mut [Column<LANES, R>; 4]) {
        if let Some(loops) = &self.rate_loops {
            loops.hold(targets, self.known().body_rates);
        }
    }

    /// Draws delays and errors of the next control period, where they differ from one to the next.
    #[inline(always)]
    pub(crate) fn draw_delays(&mut self) {
        if let Some(latency) = &mut self.latency {
            latency.draw(&mut self.streams);
        }
    }

    /// A substep of all lanes, the first of the control period being number zero.
    #[inline(always)]
    pub(crate) fn advance(
        &mut self,
        mechanics: &Mechanics<R>,
        substep: u32,
        targets: &[Column<LANES, R>; 4],
        push: &Column<LANES, R>,
    ) {
        let late = match &mut self.latency {
            None => None,
            Some(latency) => {
                if substep == 0 {
                    latency.add(0, &self.swarm.states());
                }
                latency.targets(substep, targets)
            }
        };
        let command = late.as_ref().unwrap_or(targets);
        let looped = self.rate_loops.as_mut().map(|loops| loops.rotor_targets(command, &self.swarm.body_rates));
        self.swarm.advance(mechanics, looped.as_ref().unwrap_or(command), push);
        if let Some(latency) = &mut self.latency {
            latency.add(substep + 1, &self.swarm.states());
        }
    }

    /// From now on reads no sensor: what it measured last stays.
    pub(crate) fn forget_sensors(&mut self) {
        self.sensors.clear();
        if let Some(way) = &mut self.way {
            way.forget_maps();
        }
    }

    pub(crate) fn streams_mut(&mut self) -> &mut [Stream] {
        &mut self.streams
    }

    pub(crate) fn sensors_mut(&mut self) -> &mut [SensorMemory] {
        &mut self.sensors
    }

    pub(crate) fn controls_mut(&mut self) -> &mut [ControlMemory<R>] {
        &mut self.controls
    }
}

fn length<R: Real>(vector: &Vector3<R>) -> R {
    ((vector.x * vector.x + vector.y * vector.y) + vector.z * vector.z).sqrt()
}

#[inline(always)]
fn add<R: Real, const LANES: usize>(sum: &mut Column<LANES, R>, values: &Column<LANES, R>) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum += *value;
    }
}
