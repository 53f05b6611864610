//! What a drone knows late, and what its motors hear late.
//!
//! A policy acts on an estimate of the state that is some milliseconds old, and its command reaches the motors some
//! milliseconds after. Both delays are drawn for each episode, and what jitters of them for each control period.

mod delay_line;

use core::cmp::Ordering;
use core::ops::Range;

use kestrel_core::attitude::Attitude;
use kestrel_core::real::Real;
use kestrel_core::vehicle::State;

use delay_line::DelayLine;
pub use delay_line::Outages;

use crate::estimate::ErrorMemory;
use crate::scenario::Scenario;
use crate::seed::Stream;
use crate::swarm::{Column, Swarm, row, set_row, vector};

/// Delays, each uniform within its bounds and constant in an episode but for its jitter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Latency {
    /// Least and greatest age of the state that policy and rate controller see \[s\], at most a control period.
    pub state_secs: [f32; 2],
    /// Least and greatest time from a command to the motors \[s\], at most a control period.
    pub motor_secs: [f32; 2],
    /// How much older than that the state may be, drawn anew for every control period, uniformly from zero on \[s\].
    pub state_jitter_secs: f32,
    /// The same for the motors \[s\].
    pub motor_jitter_secs: f32,
    /// Least and greatest of how much older than the rest of the state position and velocity are \[s\].
    pub position_extra_secs: [f32; 2],
    /// When they are not known at all.
    pub outages: Outages,
}

impl Latency {
    /// None.
    pub const NONE: Self = Self {
        state_secs: [0.0; 2],
        motor_secs: [0.0; 2],
        state_jitter_secs: 0.0,
        motor_jitter_secs: 0.0,
        position_extra_secs: [0.0; 2],
        outages: Outages::NONE,
    };

    /// The delays of an episode \[s\]; nothing is drawn where there are none.
    pub(crate) fn draw(&self, stream: &mut Stream) -> Delays {
        let mut between = |[least, most]: [f32; 2]| if most > 0.0 { stream.between(least, most) } else { 0.0 };
        Delays {
            state: between(self.state_secs),
            motor: between(self.motor_secs),
            position_extra: between(self.position_extra_secs),
        }
    }
}

/// The delays of one drone in one episode \[s\].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Delays {
    pub(crate) state: f32,
    pub(crate) motor: f32,
    pub(crate) position_extra: f32,
}

/// The states of the drones of a block in columns: the true ones, or those that are known.
#[derive(Clone, Copy)]
pub(crate) struct States<'a, const LANES: usize, R> {
    pub(crate) position: &'a [Column<LANES, R>; 3],
    pub(crate) attitude: &'a [Column<LANES, R>; 4],
    pub(crate) velocity: &'a [Column<LANES, R>; 3],
    pub(crate) body_rates: &'a [Column<LANES, R>; 3],
    pub(crate) rotor_speeds: &'a [Column<LANES, R>; 4],
}

/// What a block remembers in order to be late, and wrong.
#[derive(Clone, Debug)]
pub(crate) struct LatencyMemory<const LANES: usize, R> {
    /// What is known of the motion. While a control period is flown nobody looks at it, and what will be known at its end
    /// is summed up here, substep by substep.
    known: Motions<LANES, R>,
    /// Delay of the state in this control period, in substeps.
    state_delay: Column<LANES, R>,
    /// Delay of the motors in this control period, in substeps.
    motor_delay: Column<LANES, R>,
    /// None where delays are the same in every control period.
    jitter: Option<Jitter<LANES, R>>,
    /// None where position and velocity are as old as the rest.
    delay_line: Option<Box<DelayLine<LANES, R>>>,
    /// None where what is known is right.
    errors: Option<Box<ErrorMemory<LANES, R>>>,
    /// What was commanded before this control period: rotor targets \[rad/s\], or what the rate loop holds.
    targets_before: [Column<LANES, R>; 4],
    /// In a control period.
    substeps: u32,
    substeps_per_sec: f64,
    /// Greatest age of a motion that anybody knows at the end of a control period, in substeps.
    oldest: u32,
    /// From this substep on, all motors follow the command of their control period.
    obeyed_from: u32,
}

/// Delays that differ from control period to control period, in substeps.
#[derive(Clone, Debug)]
struct Jitter<const LANES: usize, R> {
    /// Least delays of state and motors in an episode.
    least: [Column<LANES, R>; 2],
    /// What is added to them at most.
    most: [f32; 2],
}

/// A motion without rotor speeds: position, attitude, velocity, body rates.
pub(crate) type Motions<const LANES: usize, R> = [Column<LANES, R>; MOTION_LEN];

const MOTION_LEN: usize = 13;

/// Where the parts of a motion stand.
pub(crate) const POSITION: Range<usize> = 0..3;
pub(crate) const ATTITUDE: Range<usize> = 3..7;
pub(crate) const VELOCITY: Range<usize> = 7..10;
pub(crate) const BODY_RATES: Range<usize> = 10..13;

impl<'a, const LANES: usize, R: Real> States<'a, LANES, R> {
    /// The state in a lane.
    #[inline(always)]
    pub(crate) fn state(&self, lane: usize) -> State<R> {
        let [w, x, y, z] = row(self.attitude, lane);
        State {
            position: vector(self.position, lane),
            world_from_body: Attitude { w, x, y, z },
            velocity: vector(self.velocity, lane),
            body_rates: vector(self.body_rates, lane),
            rotor_speeds: row(self.rotor_speeds, lane),
        }
    }

    /// All columns but the rotors'.
    #[inline(always)]
    fn motion(&self) -> [&'a Column<LANES, R>; MOTION_LEN] {
        let ([x, y, z], [a, b, c, d]) = (self.position, self.attitude);
        let ([u, v, w], [p, q, r]) = (self.velocity, self.body_rates);
        [x, y, z, a, b, c, d, u, v, w, p, q, r]
    }
}

impl<const LANES: usize, R: Real> LatencyMemory<LANES, R> {
    /// Nothing where nothing is late or wrong.
    pub(crate) fn new(scenario: &Scenario) -> Option<Self> {
        let Scenario { latency, physics, estimate, .. } = scenario;
        if *latency == Latency::NONE && estimate.is_none() {
            return None;
        }
        let nothing = [R::zero(); LANES];
        let substeps_per_sec = 1.0 / physics.substep_secs();
        let greatest =
            |[_, most]: [f32; 2], jitter: f32| (f64::from(most + jitter) * substeps_per_sec).ceil() as u32;
        let most = [latency.state_jitter_secs, latency.motor_jitter_secs]
            .map(|secs| (f64::from(secs) * substeps_per_sec) as f32);
        Some(Self {
            known: [nothing; MOTION_LEN],
            state_delay: nothing,
            motor_delay: nothing,
            jitter: (most != [0.0; 2]).then_some(Jitter { least: [nothing; 2], most }),
            delay_line: DelayLine::new(latency, physics).map(Box::new),
            errors: ErrorMemory::new(estimate, physics).map(Box::new),
            targets_before: [nothing; 4],
            substeps: physics.substeps,
            substeps_per_sec,
            oldest: greatest(latency.state_secs, latency.state_jitter_secs).min(physics.substeps),
            obeyed_from: greatest(latency.motor_secs, latency.motor_jitter_secs),
        })
    }

    /// A lane begins an episode with these delays, in a state that it knows, after this command.
    pub(crate) fn begin(
        &mut self,
        lane: usize,
        (state, command): (&State<R>, [R; 4]),
        delays: Delays,
        stream: &mut Stream,
    ) {
        self.set_delays(lane, delays, stream);
        if let Some(errors) = &mut self.errors {
            errors.begin(lane, stream);
        }
        self.know(lane, state);
        set_row(&mut self.targets_before, lane, command);
    }

    /// The delays of a lane's episode.
    fn set_delays(&mut self, lane: usize, delays: Delays, stream: &mut Stream) {
        let substeps = |secs: f32| R::from_f64(f64::from(secs) * self.substeps_per_sec);
        if let Some(line) = &mut self.delay_line {
            line.begin(lane, delays.position_extra);
        }
        let delays = [substeps(delays.state), substeps(delays.motor)];
        [self.state_delay[lane], self.motor_delay[lane]] = delays;
        if let Some(jitter) = &mut self.jitter {
            set_row(&mut jitter.least, lane, delays);
            [self.state_delay[lane], self.motor_delay[lane]] = jitter.draw(lane, stream);
        }
    }

    /// What differs in the next control period: delays that jitter, outages, errors.
    pub(crate) fn draw(&mut self, streams: &mut [Stream]) {
        if let Some(jitter) = &self.jitter {
            for (lane, stream) in streams.iter_mut().enumerate() {
                [self.state_delay[lane], self.motor_delay[lane]] = jitter.draw(lane, stream);
            }
        }
        if let Some(line) = &mut self.delay_line {
            line.draw(streams);
        }
        if let Some(errors) = &mut self.errors {
            errors.draw(streams);
        }
    }

    /// A lane knows this state from now on, as well as it can.
    pub(crate) fn know(&mut self, lane: usize, state: &State<R>) {
        set_row(&mut self.known, lane, motion_of(state));
        if let Some(line) = &mut self.delay_line {
            line.know(lane, state);
        }
        if let Some(errors) = &self.errors {
            errors.mislead_lane(lane, &mut self.known);
        }
    }

    /// What the motors follow in a substep of the control period whose command is `targets`, if it is not that: until the
    /// delay is over, the command before.
    #[inline(always)]
    pub(crate) fn targets(&self, substep: u32, targets: &[Column<LANES, R>; 4]) -> Option<[Column<LANES, R>; 4]> {
        if substep >= self.obeyed_from {
            return None;
        }
        let passed = R::from_f64(f64::from(substep));
        let mut late = *targets;
        for (late, before) in late.iter_mut().zip(&self.targets_before) {
            for lane in 0..LANES {
                let share = (self.motor_delay[lane] - passed).limited(R::zero(), R::one());
                late[lane] += (before[lane] - late[lane]) * share;
            }
        }
        Some(late)
    }

    /// Takes in the motion of all lanes after so many substeps of the control period, from zero on.
    #[inline(always)]
    pub(crate) fn add(&mut self, substeps: u32, states: &States<'_, LANES, R>) {
        let age = self.substeps - substeps;
        match age.cmp(&self.oldest) {
            Ordering::Greater => {}
            Ordering::Equal => self.sum(age, states, |_, motion| motion),
            Ordering::Less => self.sum(age, states, |sum, motion| sum + motion),
        }
    }

    #[inline(always)]
    fn sum(&mut self, age: u32, states: &States<'_, LANES, R>, sum_of: impl Fn(R, R) -> R) {
        let age = R::from_f64(f64::from(age));
        let shares = self.state_delay.map(|delay| share(delay, age));
        for (sum, motion) in self.known.iter_mut().zip(states.motion()) {
            for lane in 0..LANES {
                sum[lane] = sum_of(sum[lane], shares[lane] * motion[lane]);
            }
        }
    }

    /// The same for a lane that went another way in this control period: its states from the start on.
    pub(crate) fn replace(&mut self, lane: usize, states: &[State<R>]) {
        let mut sum = [R::zero(); MOTION_LEN];
        for (age, state) in (0..states.len()).rev().zip(states) {
            let share = share(self.state_delay[lane], R::from_f64(age as f64));
            for (sum, value) in sum.iter_mut().zip(motion_of(state)) {
                *sum += share * value;
            }
        }
        set_row(&mut self.known, lane, sum);
    }

    /// Ends a control period, whose command was `targets`.
    #[inline(always)]
    pub(crate) fn end_period(&mut self, targets: &[Column<LANES, R>; 4]) {
        if self.obeyed_from > 0 {
            self.targets_before = *targets;
        }
        let [_, _, _, attitude @ .., _, _, _, _, _, _] = &mut self.known;
        for lane in 0..LANES {
            let [w, x, y, z] = row(attitude, lane);
            let between = Attitude { w, x, y, z }.normalized();
            set_row(attitude, lane, [between.w, between.x, between.y, between.z]);
        }
        if let Some(line) = &mut self.delay_line {
            line.delay(&mut self.known);
        }
        if let Some(errors) = &self.errors {
            errors.mislead(&mut self.known);
        }
    }

    /// What is known; the speeds of the rotors are nobody's to know.
    #[inline(always)]
    pub(crate) fn known<'a>(&'a self, rotor_speeds: &'a [Column<LANES, R>; 4]) -> States<'a, LANES, R> {
        let (position, rest) = self.known.split_first_chunk().expect("a motion has 13 values");
        let (attitude, rest) = rest.split_first_chunk().expect("a motion has 13 values");
        let (velocity, rest) = rest.split_first_chunk().expect("a motion has 13 values");
        let (body_rates, _) = rest.split_first_chunk().expect("a motion has 13 values");
        States { position, attitude, velocity, body_rates, rotor_speeds }
    }

    /// Every column, for saving and restoring.
    pub(crate) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Column<LANES, R>> {
        let delays = [&mut self.state_delay, &mut self.motor_delay];
        let least = self.jitter.iter_mut().flat_map(|jitter| &mut jitter.least);
        let line = self.delay_line.iter_mut().flat_map(|line| line.columns_mut());
        let errors = self.errors.iter_mut().flat_map(|errors| errors.columns_mut());
        let own = self.known.iter_mut().chain(delays).chain(&mut self.targets_before);
        own.chain(least).chain(line).chain(errors)
    }
}

impl<const LANES: usize, R: Real> Jitter<LANES, R> {
    fn draw(&self, lane: usize, stream: &mut Stream) -> [R; 2] {
        let [state, motor] = self.most.map(|most| if most > 0.0 { stream.between(0.0, most) } else { 0.0 });
        [self.least[0][lane] + R::from_f32(state), self.least[1][lane] + R::from_f32(motor)]
    }
}

/// The states that drones know: the true ones where nothing is late.
#[inline(always)]
pub(crate) fn known_states<'a, const LANES: usize, R: Real>(
    swarm: &'a Swarm<LANES, R>,
    latency: Option<&'a LatencyMemory<LANES, R>>,
) -> States<'a, LANES, R> {
    latency.map_or_else(|| swarm.states(), |latency| latency.known(&swarm.rotor_speeds))
}

/// Share of a motion of some age in what is known with a delay, both in substeps: linear between two ages.
#[inline(always)]
fn share<R: Real>(delay: R, age: R) -> R {
    (R::one() - (delay - age).abs()).at_least(R::zero())
}

#[inline(always)]
fn motion_of<R: Real>(state: &State<R>) -> [R; MOTION_LEN] {
    let ([x, y, z], [u, v, w], [p, q, r]): ([R; 3], [R; 3], [R; 3]) =
        (state.position.into(), state.velocity.into(), state.body_rates.into());
    let Attitude { w: a, x: b, y: c, z: d } = state.world_from_body;
    [x, y, z, a, b, c, d, u, v, w, p, q, r]
}
