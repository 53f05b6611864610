//! What an agent senses and sees, and what its critic sees beside.

use core::ops::Range;

use kestrel_core::action::ACTION_LIMIT;
use kestrel_core::instrument::specific_force;
use kestrel_core::observation::{
    BODY_MOTION_LEN, BodyLayout, OBSERVATION_LIMIT, ObservationInput, ObservationLayout, PILOT_LEN,
    PX4_NEURAL_LEN, PilotLayout, Px4NeuralLayout, REFERENCE_LEN, ReferenceLayout,
};
use kestrel_core::real::Real;
use nalgebra::Vector3;

use super::{Agent, PrivilegedScales};
use crate::contact::BANK;
use crate::contact::Motion;
use crate::latency::{States, known_states};
use crate::rooms::{Arenas, Around};
use crate::scenario::{CriticView, Preset, Scenario};
use crate::sensor::{Course, TOF_BANK_LIMIT, Told, Truth};
use crate::stage::Stage;
use crate::swarm::{Column, Swarm, row, set_row, vector};
use crate::trajectory::{PathAhead, Trajectory};

/// Where the drones of every task shall face: along the world's x axis. What is learned holds for all headings.
const FORWARD: [f32; 2] = [1.0, 0.0];

impl<const LANES: usize, R: Real> Agent<LANES, R> {
    /// Encodes every lane; the movables of each are where they are now.
    #[inline(always)]
    pub(crate) fn observe(&mut self, stage: &Stage<'_, R>, movables: &[Vec<Motion>]) {
        let scenario = stage.scenario;
        let around = Around { arenas: stage.arenas, movables };
        self.tell(scenario, 0..LANES);
        match &scenario.observation {
            ObservationLayout::Pilot(layout) => self.observe_as_pilot(*layout),
            ObservationLayout::Reference(layout) => self.observe_as_paper(scenario, *layout),
            ObservationLayout::PilotFor(_) | ObservationLayout::Kinematic(_) | ObservationLayout::Measured(_) => {
                self.sense(scenario, around);
                (0..LANES).for_each(|lane| self.observe_lane(scenario, lane));
            }
            ObservationLayout::Body(layout) => {
                self.sense(scenario, around);
                self.observe_in_body_axes(layout, stage.control_secs);
            }
            ObservationLayout::Px4Neural(layout) => self.observe_as_px4_neural(*layout),
            ObservationLayout::PilotMeasured(layout) => {
                self.sense(scenario, around);
                self.observe_as_pilot(layout.scales);
                if let Some((_, columns)) = self.observations.split_first_chunk_mut::<PILOT_LEN>() {
                    columns.copy_from_slice(&self.measurements);
                }
            }
        }
        match scenario.critic {
            CriticView::Observation => {}
            CriticView::Privileged => {
                let scales = self.scales;
                for lane in 0..LANES {
                    self.reveal_lane(&scales, lane);
                }
            }
        }
    }

    #[inline(always)]
    fn observe_as_pilot(&mut self, layout: PilotLayout) {
        let Some((columns, _)) = self.observations.split_first_chunk_mut::<PILOT_LEN>() else { return };
        let [a, b, c, d, ..] = self.history.last().expect("there is a previous action");
        let known = known_states(&self.swarm, self.latency.as_ref());
        for lane in 0..LANES {
            let (state, goal) = (known.state(lane), vector(&self.goal, lane));
            let observation = layout.encode(&state, &goal, &[a[lane], b[lane], c[lane], d[lane]]);
            set_row(columns, lane, observation);
        }
    }

    #[inline(always)]
    fn observe_as_px4_neural(&mut self, layout: Px4NeuralLayout) {
        let Some((columns, _)) = self.observations.split_first_chunk_mut::<PX4_NEURAL_LEN>() else { return };
        let known = known_states(&self.swarm, self.latency.as_ref());
        for lane in 0..LANES {
            let (state, goal) = (known.state(lane), vector(&self.goal, lane));
            set_row(columns, lane, layout.encode(&state, &goal));
        }
    }

    #[inline(always)]
    fn observe_in_body_axes(&mut self, layout: &BodyLayout, control_secs: R) {
        let Some((motions, columns)) = self.observations.split_first_chunk_mut::<BODY_MOTION_LEN>() else {
            return;
        };
        let (past, columns) = columns.split_at_mut(layout.past_len());
        let Some((integrals, measured)) = columns.split_first_chunk_mut::<3>() else { return };
        let goal = &self.goal;
        // Matched here rather than in the loop: where one of two states may be read, it does not vectorise.
        match &self.latency {
            None => {
                integrate_lanes(layout, &self.swarm.states(), goal, &mut self.integral, control_secs);
                encode_body_lanes(layout, &self.swarm.states(), goal, &self.integral, (motions, integrals));
            }
            Some(latency) => {
                let known = latency.known(&self.swarm.rotor_speeds);
                integrate_lanes(layout, &known, goal, &mut self.integral, control_secs);
                encode_body_lanes(layout, &known, goal, &self.integral, (motions, integrals));
            }
        }
        let actions = self.history.iter().rev().flat_map(|action| &action[..usize::from(layout.action_len)]);
        for (column, action) in past.iter_mut().zip(actions) {
            *column = action.map(|value| value.limited(-R::one(), R::one()));
        }
        for (column, values) in measured.iter_mut().zip(&self.measurements) {
            *column = *values;
        }
    }

    #[inline(always)]
    fn observe_as_paper(&mut self, scenario: &Scenario, layout: ReferenceLayout) {
        let Some((columns, _)) = self.observations.split_first_chunk_mut::<REFERENCE_LEN>() else { return };
        let (swarm, goal) = (&self.swarm, &self.goal);
        // Matched here rather than in the loop, which then has no branch and vectorises.
        match scenario.physics.preset {
            Preset::Clean { .. } => encode_lanes(columns, layout, swarm, goal, turning),
            Preset::Bullet { .. } => encode_lanes(columns, layout, swarm, goal, Swarm::reported),
        }
    }

    pub(crate) fn observe_lane(&mut self, scenario: &Scenario, lane: usize) {
        let mut values = [R::zero(); OBSERVATION_LIMIT];
        let length = self.observations.len();
        let mut history = [[R::zero(); ACTION_LIMIT]; OBSERVATION_LIMIT];
        for (past, columns) in history.iter_mut().zip(&self.history) {
            *past = row(columns, lane);
        }
        let mut measurements = [R::zero(); OBSERVATION_LIMIT];
        for (value, column) in measurements.iter_mut().zip(&self.measurements) {
            *value = column[lane];
        }
        let (state, goal) = (self.known().state(lane), vector(&self.goal, lane));
        let seen = ObservationInput {
            state: &state,
            angular_velocity_in_world: self.angular_velocity(scenario, lane),
            goal: &goal,
            heading: FORWARD.map(R::from_f32),
            integral: &vector(&self.integral, lane),
            history: &history[..self.history.len()],
            measurements: &measurements[..self.measurements.len()],
        };
        scenario.observation.encode(&seen, &mut values[..length]);
        for (column, value) in self.observations.iter_mut().zip(values) {
            column[lane] = value;
        }
    }

    /// Reads the sensors of every lane, where there are any.
    #[inline(always)]
    fn sense(&mut self, scenario: &Scenario, around: Around<'_>) {
        let sensors = &scenario.sensors;
        if self.sensors.is_empty() && sensors.tof().is_none() && sensors.scan().is_none() {
            return;
        }
        for lane in 0..LANES {
            self.sense_lane(scenario, around.arenas, lane);
            self.range_lane(scenario, around, lane);
            self.scan_lane(scenario, around.arenas, lane);
            self.find_way(scenario, lane);
        }
    }

    /// Reads the sensors, where there are any.
    pub(super) fn sense_lane(&mut self, scenario: &Scenario, arenas: Option<&Arenas>, lane: usize) {
        let arena = arenas.map(|arenas| arenas.of(self.room(lane)));
        let Some(memory) = self.sensors.get_mut(lane) else { return };
        let state = self.swarm.state(lane).map(Real::to_f64);
        let before = vector(&self.read_velocity, lane).map(Real::to_f64);
        let secs = 1.0 / scenario.physics.control_rate_hz;
        let cast = |origin, direction, limit| arena.and_then(|arena| arena.raycast(origin, direction, limit));
        let truth = Truth {
            state: &state,
            specific_force_in_body: specific_force(&before, &state, secs),
            raycast: arena.is_some().then_some(&cast),
        };
        let mut values = [0.0; OBSERVATION_LIMIT];
        let values = &mut values[..scenario.sensors.instruments_len()];
        scenario.sensors.read(memory, &truth, &mut self.streams[lane], values);
        for (column, value) in self.measurements.iter_mut().zip(values) {
            column[lane] = R::from_f32(*value);
        }
        set_row(&mut self.read_velocity, lane, row(&self.swarm.velocity, lane));
    }

    /// Measures in the zones of a ranger, where there is one and it is time to.
    #[inline(always)]
    pub(super) fn range_lane(&mut self, scenario: &Scenario, around: Around<'_>, lane: usize) {
        let (Some(tof), Some(arenas)) = (scenario.sensors.tof(), around.arenas) else { return };
        let (reading, secs) = (self.period(lane), 1.0 / scenario.physics.control_rate_hz);
        let position = row(&self.swarm.position, lane).map(Real::to_f32);
        let axes = self.swarm.state(lane).world_from_body.rows().map(|row| row.map(Real::to_f32));
        let room = self.room(lane);
        let Some(memory) = &mut self.tof else { return };
        let measurements = &mut self.measurements[scenario.sensors.instruments_len()..];
        memory.deliver(lane, reading, measurements);
        if memory.is_due(tof, lane, reading, secs) {
            let mut rays = [[[0.0; BANK]; 3]; TOF_BANK_LIMIT];
            let mut distances = [[0.0; BANK]; TOF_BANK_LIMIT];
            let cone = tof.cone(position, &axes, &mut rays);
            arenas.of(room).distances_in(&cone, &around.movables[lane], &mut distances);
            let arrival = reading + tof.delay(reading, secs);
            memory.send(tof, lane, (&distances, arrival), &mut self.streams[lane]);
            memory.deliver(lane, reading, measurements);
            if let Some(way) = &mut self.way {
                let place = position.into();
                way.mark(lane, &place, memory.met(tof, lane, (&place, &axes)));
            }
        }
    }

    /// Casts the beams of the scan, where there is one.
    #[inline(always)]
    pub(super) fn scan_lane(&mut self, scenario: &Scenario, arenas: Option<&Arenas>, lane: usize) {
        let (Some(scan), Some(arenas)) = (scenario.sensors.scan(), arenas) else { return };
        let (position, period) = (row(&self.swarm.position, lane).map(Real::to_f32), self.period(lane));
        let nearness = arenas.of(self.room(lane)).nearness(position, period as usize);
        let columns = self.measurements.iter_mut().skip(scenario.sensors.scan_start()).take(scan.len());
        for (column, value) in columns.zip(nearness) {
            column[lane] = R::from_f32(value);
        }
        if let Some(way) = &mut self.way {
            way.look(lane, (scan, &nearness), &position.into(), period);
        }
    }

    /// Finds the way through what has been met so far, where drones look for theirs.
    #[inline(always)]
    pub(super) fn find_way(&mut self, scenario: &Scenario, lane: usize) {
        let reading = self.period(lane);
        let Some(way) = self.way.as_mut().filter(|way| way.has_maps()) else { return };
        let position = row(&self.swarm.position, lane).map(Real::to_f32).into();
        way.search(lane, reading, [&position, &vector(&self.goal, lane).map(Real::to_f32)]);
        let known = known_states(&self.swarm, self.latency.as_ref()).state(lane);
        let direction = way.reading(lane, &known.position, &vector(&self.goal, lane));
        let away = way.away_from_nearest(lane, &known.position.map(Real::to_f32));
        let in_body_axes = matches!(scenario.observation, ObservationLayout::Body(_));
        let turned = |vector: [R; 3]| known.world_from_body.rotate_inverse(vector.into()).into();
        let seen = |vector: [R; 3]| if in_body_axes { turned(vector) } else { vector };
        let first = self.measurements.len() - way.len();
        let columns = self.measurements[first..].as_chunks_mut::<3>().0;
        for (columns, vector) in columns.iter_mut().zip([Some(direction), away].into_iter().flatten()) {
            set_row(columns, lane, seen(vector));
        }
    }

    /// Tells drones what concerns them alone: the way ahead of their goals, the next gates, or what they have visited.
    #[inline(always)]
    pub(super) fn tell(&mut self, scenario: &Scenario, lanes: Range<usize>) {
        match scenario.sensors.told() {
            Some(Told::Path(path)) => self.look_ahead(path, scenario, lanes),
            Some(Told::Coverage(coverage)) => {
                let first = self.measurements.len() - coverage.len();
                for lane in lanes {
                    coverage.tell(&self.swarm, lane, &mut self.measurements[first..]);
                }
            }
            Some(Told::Gates(gates)) => self.look_at_gates(gates, scenario, lanes),
            Some(Told::Mates(_) | Told::Way(_)) | None => {}
        }
    }

    /// Forgets what the drone of a lane has measured and was told.
    pub(super) fn forget_measurements(&mut self, lane: usize) {
        for column in &mut self.measurements {
            column[lane] = R::zero();
        }
    }

    /// Shows drones the way ahead of their goals.
    #[inline(always)]
    fn look_ahead(&mut self, path: &PathAhead, scenario: &Scenario, lanes: Range<usize>) {
        let Some(trajectory) = &self.trajectory else { return };
        let known = known_states(&self.swarm, self.latency.as_ref());
        let control_secs = R::from_f32(scenario.physics.control_secs());
        let per_metre = R::one() / R::from_f32(path.position_scale_m);
        let first = self.measurements.len() - path.len();
        for lane in lanes {
            let (curve, state) = (Trajectory::from_array(&row(trajectory, lane)), known.state(lane));
            let from_centre = state.position - scenario.aviary_of(self.room(lane)).goal.map(R::from_f32);
            let now = self.steps[lane] * control_secs;
            let points = self.measurements[first..].as_chunks_mut::<{ PathAhead::PATH_POINT_LEN }>().0;
            for (number, columns) in points.iter_mut().enumerate() {
                let (place, _) = curve.at(now + R::from_f32((number + 1) as f32 * path.spacing_secs));
                let seen = state.world_from_body.rotate_inverse(place - from_centre);
                set_row(columns, lane, [seen.x * per_metre, seen.y * per_metre, seen.z * per_metre]);
            }
        }
    }

    /// \[rad/s\], world, as the preset reports it.
    #[inline(always)]
    pub(crate) fn angular_velocity(&self, scenario: &Scenario, lane: usize) -> Vector3<R> {
        match scenario.physics.preset {
            Preset::Clean { .. } => turning(&self.swarm, lane),
            Preset::Bullet { .. } => self.swarm.reported(lane),
        }
    }

    #[inline(always)]
    pub(super) fn reveal_lane(&mut self, scales: &PrivilegedScales<R>, lane: usize) {
        let one = R::one();
        let [a, b, c, d] = row(&self.swarm.rotor_speeds, lane).map(|speed| speed * scales.per_hover_speed - one);
        let [x, y, z] = row(&self.swarm.wind, lane);
        let [mass, thrust] = row(&self.factors, lane);
        let left = one - self.steps[lane] * scales.per_episode_steps;
        set_row(&mut self.privileged, lane, [a, b, c, d, x, y, z, mass - one, thrust - one, left]);
    }

    /// What the drone of a lane hears of its team, if they talk by radio.
    pub(crate) fn listen(
        &mut self,
        scenario: &Scenario,
        lane: usize,
        team: &[Course<R>],
    ) -> Option<Vec<Course<R>>> {
        let (reading, secs) = (self.period(lane), 1.0 / scenario.physics.control_rate_hz);
        let stream = &mut self.streams[lane];
        let mates = self.mates.as_mut()?;
        Some(mates.listen((self.index, lane), (reading, secs), team, stream))
    }

    /// Takes in what it measures of its team mates in a lane, vectors in the world's axes one behind the other.
    pub(crate) fn take_neighbours(&mut self, lane: usize, values: &[R], in_body_axes: bool) {
        let first = self.measurements.len() - values.len();
        let known = known_states(&self.swarm, self.latency.as_ref()).state(lane);
        let vectors = values.as_chunks::<3>().0;
        for (columns, vector) in self.measurements[first..].as_chunks_mut::<3>().0.iter_mut().zip(vectors) {
            let turned = || known.world_from_body.rotate_inverse((*vector).into()).into();
            set_row(columns, lane, if in_body_axes { turned() } else { *vector });
        }
    }
}

/// Angular velocity \[rad/s\], world.
#[inline(always)]
fn turning<const LANES: usize, R: Real>(swarm: &Swarm<LANES, R>, lane: usize) -> Vector3<R> {
    let state = swarm.state(lane);
    state.world_from_body.rotate(state.body_rates)
}

/// The integral of the position error after a control period of `secs`, in every lane.
#[inline(always)]
fn integrate_lanes<const LANES: usize, R: Real>(
    layout: &BodyLayout,
    known: &States<'_, LANES, R>,
    goal: &[Column<LANES, R>; 3],
    integral: &mut [Column<LANES, R>; 3],
    secs: R,
) {
    for lane in 0..LANES {
        let (state, goal) = (known.state(lane), vector(goal, lane));
        let next = layout.integrate(&vector(integral, lane), &state, &goal, secs);
        set_row(integral, lane, next.into());
    }
}

/// Encodes every lane in the `body` layout: what stands before the past actions, and the integral behind them.
#[inline(always)]
fn encode_body_lanes<const LANES: usize, R: Real>(
    layout: &BodyLayout,
    known: &States<'_, LANES, R>,
    goal: &[Column<LANES, R>; 3],
    integral: &[Column<LANES, R>; 3],
    (motions, integrals): (&mut [Column<LANES, R>; BODY_MOTION_LEN], &mut [Column<LANES, R>; 3]),
) {
    for lane in 0..LANES {
        let (state, goal) = (known.state(lane), vector(goal, lane));
        let (motion, integral) = layout.motion(&state, &goal, FORWARD.map(R::from_f32), &vector(integral, lane));
        set_row(motions, lane, motion);
        set_row(integrals, lane, integral);
    }
}

/// Encodes every lane in the `paper` layout.
#[inline(always)]
fn encode_lanes<const LANES: usize, R: Real>(
    columns: &mut [Column<LANES, R>; REFERENCE_LEN],
    layout: ReferenceLayout,
    swarm: &Swarm<LANES, R>,
    goal: &[Column<LANES, R>; 3],
    turning: impl Fn(&Swarm<LANES, R>, usize) -> Vector3<R>,
) {
    for lane in 0..LANES {
        let (state, goal) = (swarm.state(lane), vector(goal, lane));
        let seen = ObservationInput {
            state: &state,
            angular_velocity_in_world: turning(swarm, lane),
            goal: &goal,
            heading: FORWARD.map(R::from_f32),
            integral: &Vector3::new(R::zero(), R::zero(), R::zero()),
            history: &[],
            measurements: &[],
        };
        set_row(columns, lane, layout.encode(&seen));
    }
}
