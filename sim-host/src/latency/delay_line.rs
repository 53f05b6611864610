//! Position and velocity that are known later than the rest of the state, and now and then not at all.
//!
//! Attitude and body rates follow from the gyroscope at once; where a drone is, and how fast, comes by radio, by a camera
//! or by a sensor that needs time. The line remembers what was known at the end of each control period; between two of
//! them what is known is linear in time.

use kestrel_core::real::Real;
use kestrel_core::vehicle::State;

use super::{Latency, Motions, POSITION, VELOCITY, share};
use crate::physics::Physics;
use crate::seed::Stream;
use crate::swarm::{Column, set_row};

/// Times in which position and velocity are not measured: what is known of them stays what it was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outages {
    /// How many begin in a second \[1/s\].
    pub per_sec: f32,
    /// Least and greatest length \[s\].
    pub secs: [f32; 2],
}

impl Outages {
    /// None.
    pub const NONE: Self = Self { per_sec: 0.0, secs: [0.0; 2] };
}

/// Position, then velocity.
type Sample<const LANES: usize, R> = [Column<LANES, R>; 6];

/// What a block remembers of earlier positions and velocities.
#[derive(Clone, Debug)]
pub(super) struct DelayLine<const LANES: usize, R> {
    /// As known at the ends of control periods, the newest first.
    past: Vec<Sample<LANES, R>>,
    /// How much older than the rest what is known is, in control periods.
    age: Column<LANES, R>,
    /// The same outside outages.
    least_age: Column<LANES, R>,
    /// What is left of an outage, in control periods.
    left: Column<LANES, R>,
    outages: Outages,
    control_rate_hz: f32,
}

impl<const LANES: usize, R: Real> DelayLine<LANES, R> {
    /// Nothing where position and velocity are known with the rest.
    pub(super) fn new(latency: &Latency, physics: &Physics) -> Option<Self> {
        let Latency { position_extra_secs: [_, extra], outages, .. } = *latency;
        if extra == 0.0 && outages == Outages::NONE {
            return None;
        }
        let control_rate_hz = physics.control_rate_hz as f32;
        let periods = |secs: f32| (secs * control_rate_hz).ceil() as usize;
        let nothing = [R::zero(); LANES];
        Some(Self {
            past: vec![[nothing; 6]; 1 + periods(extra) + periods(outages.secs[1])],
            age: nothing,
            least_age: nothing,
            left: nothing,
            outages,
            control_rate_hz,
        })
    }

    /// A lane begins an episode with so much delay \[s\].
    pub(super) fn begin(&mut self, lane: usize, extra_secs: f32) {
        self.least_age[lane] = R::from_f32(extra_secs * self.control_rate_hz);
        self.age[lane] = self.least_age[lane];
        self.left[lane] = R::zero();
    }

    /// A lane was in this state for ever.
    pub(super) fn know(&mut self, lane: usize, state: &State<R>) {
        let ([x, y, z], [u, v, w]): ([R; 3], [R; 3]) = (state.position.into(), state.velocity.into());
        for sample in &mut self.past {
            set_row(sample, lane, [x, y, z, u, v, w]);
        }
    }

    /// How old what is known will be at the end of the next control period.
    pub(super) fn draw(&mut self, streams: &mut [Stream]) {
        let Outages { per_sec, secs: [least, most] } = self.outages;
        if per_sec == 0.0 {
            return;
        }
        for (lane, stream) in streams.iter_mut().enumerate() {
            let left = self.left[lane].to_f32() - 1.0;
            if left > 0.0 {
                self.age[lane] += R::one();
                self.left[lane] = R::from_f32(left);
                continue;
            }
            (self.age[lane], self.left[lane]) = (self.least_age[lane], R::zero());
            if stream.uniform() < per_sec / self.control_rate_hz {
                self.age[lane] += R::one();
                self.left[lane] = R::from_f32(stream.between(least, most) * self.control_rate_hz);
            }
        }
    }

    /// Takes in what is known without this delay, and puts what is known with it in its place.
    #[inline(always)]
    pub(super) fn delay(&mut self, known: &mut Motions<LANES, R>) {
        self.past.rotate_right(1);
        let places = POSITION.chain(VELOCITY);
        for (newest, place) in self.past[0].iter_mut().zip(places.clone()) {
            *newest = known[place];
        }
        for (value, place) in places.enumerate() {
            known[place] = [R::zero(); LANES];
            for (periods, sample) in self.past.iter().enumerate() {
                let periods = R::from_f64(periods as f64);
                for lane in 0..LANES {
                    known[place][lane] += share(self.age[lane], periods) * sample[value][lane];
                }
            }
        }
    }

    /// Every column, for saving and restoring.
    pub(super) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Column<LANES, R>> {
        let counts = [&mut self.age, &mut self.least_age, &mut self.left];
        self.past.iter_mut().flatten().chain(counts)
    }
}
