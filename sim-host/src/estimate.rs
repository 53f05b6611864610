//! What a drone is wrong about: errors of the estimate that policy and rate controller see in place of the state.
//!
//! Each number of the estimate has noise, drawn anew in every control period, and a drift, a first-order Gauss–Markov
//! process that wanders about zero as slowly as is said. Rewards, terminations and the judgement of an episode know the
//! truth.

use kestrel_core::attitude::Attitude;
use kestrel_core::real::Real;

use crate::latency::{ATTITUDE, BODY_RATES, Motions, POSITION, VELOCITY};
use crate::physics::Physics;
use crate::seed::Stream;
use crate::swarm::{Column, row, set_row};

/// How wrong each number of a quantity is: standard deviations, the same for each axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    /// Of what is drawn anew in every control period.
    pub noise: f32,
    /// Of what wanders.
    pub drift: f32,
}

/// Errors of the estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateErrors {
    /// Of the position \[m\].
    pub position: Deviation,
    /// Of the velocity \[m/s\].
    pub velocity: Deviation,
    /// Of where up is, about the two horizontal axes \[rad\].
    pub tilt: Deviation,
    /// Of where north is, about the vertical \[rad\].
    pub heading: Deviation,
    /// Of the body rates \[rad/s\].
    pub body_rates: Deviation,
    /// Time in which drifts forget all but a share of 1/e \[s\].
    pub drift_secs: f32,
}

impl EstimateErrors {
    /// None.
    pub const NONE: Self = {
        let none = Deviation { noise: 0.0, drift: 0.0 };
        Self { position: none, velocity: none, tilt: none, heading: none, body_rates: none, drift_secs: 1.0 }
    };

    /// Whether nothing is wrong.
    pub(crate) fn is_none(&self) -> bool {
        self.deviations().iter().all(|deviation| *deviation == Deviation::default())
    }

    /// Of each number: position, velocity, rotation vector in the world, body rates.
    fn deviations(&self) -> [Deviation; ERROR_LEN] {
        let Self { position: p, velocity: v, tilt: t, heading: h, body_rates: r, drift_secs: _ } = *self;
        [p, p, p, v, v, v, t, t, h, r, r, r]
    }
}

const ERROR_LEN: usize = 12;

/// The errors of the drones of a block.
#[derive(Clone, Debug)]
pub(crate) struct ErrorMemory<const LANES: usize, R> {
    /// At the end of this control period.
    errors: [Column<LANES, R>; ERROR_LEN],
    /// What of them wanders.
    drifts: [Column<LANES, R>; ERROR_LEN],
    deviations: [Deviation; ERROR_LEN],
    /// Share of a drift that is left after a control period.
    kept: f32,
}

impl<const LANES: usize, R: Real> ErrorMemory<LANES, R> {
    /// Nothing where nothing is wrong.
    pub(crate) fn new(errors: &EstimateErrors, physics: &Physics) -> Option<Self> {
        if errors.is_none() {
            return None;
        }
        Some(Self {
            errors: [[R::zero(); LANES]; ERROR_LEN],
            drifts: [[R::zero(); LANES]; ERROR_LEN],
            deviations: errors.deviations(),
            kept: libm::expf(-physics.control_secs() / errors.drift_secs),
        })
    }

    /// The errors that a lane begins an episode with: anywhere in its drifts.
    pub(crate) fn begin(&mut self, lane: usize, stream: &mut Stream) {
        self.draw_lane(lane, [0.0, 1.0], stream);
    }

    /// The errors at the end of the next control period.
    pub(crate) fn draw(&mut self, streams: &mut [Stream]) {
        let fresh = (1.0 - self.kept * self.kept).sqrt();
        for (lane, stream) in streams.iter_mut().enumerate() {
            self.draw_lane(lane, [self.kept, fresh], stream);
        }
    }

    /// The errors of a lane, whose drifts keep a share of what they are and become anew with another.
    fn draw_lane(&mut self, lane: usize, [kept, fresh]: [f32; 2], stream: &mut Stream) {
        let numbers = self.errors.iter_mut().zip(&mut self.drifts).zip(&self.deviations);
        for ((error, drift), Deviation { noise, drift: wandering }) in numbers {
            if *noise > 0.0 || *wandering > 0.0 {
                let [slow, fast] = stream.normals();
                drift[lane] = R::from_f32(kept * drift[lane].to_f32() + fresh * wandering * slow);
                error[lane] = drift[lane] + R::from_f32(noise * fast);
            }
        }
    }

    /// Makes what all lanes know wrong.
    #[inline(always)]
    pub(crate) fn mislead(&self, known: &mut Motions<LANES, R>) {
        for lane in 0..LANES {
            self.mislead_lane(lane, known);
        }
    }

    /// Makes what a lane knows wrong.
    #[inline(always)]
    pub(crate) fn mislead_lane(&self, lane: usize, known: &mut Motions<LANES, R>) {
        let [x, y, z, u, v, w, roll, pitch, heading, p, q, r] = row(&self.errors, lane);
        let places = POSITION.chain(VELOCITY).chain(BODY_RATES);
        for (place, error) in places.zip([x, y, z, u, v, w, p, q, r]) {
            known[place][lane] += error;
        }
        let attitude: &mut [Column<LANES, R>; 4] =
            (&mut known[ATTITUDE]).try_into().expect("a quaternion has four values");
        let [a, b, c, d] = row(attitude, lane);
        // Small enough for the first order; world axes stand on the left.
        let half = R::from_f64(0.5);
        let [i, j, k] = [roll, pitch, heading].map(|angle| angle * half);
        let turned = Attitude {
            w: a - (i * b + j * c + k * d),
            x: b + (i * a + j * d - k * c),
            y: c + (j * a + k * b - i * d),
            z: d + (k * a + i * c - j * b),
        };
        let Attitude { w, x, y, z } = turned.normalized();
        set_row(attitude, lane, [w, x, y, z]);
    }

    /// Every column, for saving and restoring.
    pub(crate) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Column<LANES, R>> {
        self.errors.iter_mut().chain(&mut self.drifts)
    }
}
