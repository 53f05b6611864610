//! The rate loop between two control periods: what a firmware computes at every sample of its gyroscope.
//!
//! A policy with the action space [`ActionSpace::RateLoop`] asks for body rates once a control period; in between, the rotors answer how the measured rates change:
//!
//! ```text
//! Ω²(t) = Ω² + M K (ω − ω(t)),   within zero and the greatest squared speed
//! ```
//!
//! with the rotor targets Ω and the body rates ω of the last control period, the mixer M and the gains K of
//! [`ThrustBodyRates`]. The gyroscope is filtered as Bitcraze's firmware does (`lpf2p` of `filter.c`, 80 Hz in
//! `sensors_bmi088_bmp3xx.c`): two poles, Butterworth.

use nalgebra::Vector3;

use crate::action::{ActionSpace, ThrustBodyRates};
use crate::real::Real;

/// The rate loop of an action space, ready for arithmetic; squared speeds are shares of the greatest squared rotor speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateLoop<R> {
    /// Squared speed per body rate about x, y, z, for each rotor \[s/rad\].
    gains: [[R; 3]; 4],
    /// Greatest rotor speed \[rad/s\], and its reciprocal.
    speed_limit: R,
    per_speed_limit: R,
}

/// Squared speed that no body rate lifts above zero.
const OFF: f32 = -1e6;

/// A low-pass filter of second order for a signal that is sampled evenly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LowPass<R> {
    /// What the newest sample and the one before the last are weighted with; the last counts twice.
    gain: R,
    feedback: [R; 2],
}

impl<R: Real> RateLoop<R> {
    /// That of an action space; nothing where it has none.
    #[inline(always)]
    pub fn of(action: &ActionSpace) -> Option<Self> {
        match action {
            ActionSpace::RateLoop(space) => Some(Self::new(space)),
            ActionSpace::RotorSpeeds(_)
            | ActionSpace::ThrustBodyRates(_)
            | ActionSpace::Reference(_)
            | ActionSpace::Velocities(_)
            | ActionSpace::IntegralVelocities(_)
            | ActionSpace::RotorThrusts(_)
            | ActionSpace::ThrustTorques(_) => None,
        }
    }

    /// That around these numbers.
    #[inline(always)]
    pub fn new(space: &ThrustBodyRates) -> Self {
        let ([p, q, r], per_square) = (space.rate_gains, 1.0 / space.speed_squared_limit);
        let speed_limit = R::from_f32(space.speed_squared_limit).sqrt();
        Self {
            gains: space.mixer.map(|[x, y, z]| [x * p, y * q, z * r].map(|gain| R::from_f32(gain * per_square))),
            speed_limit,
            per_speed_limit: R::one() / speed_limit,
        }
    }

    /// What is held over a control period: the squared speeds that these rotor targets \[rad/s\], commanded at these body rates
    /// \[rad/s\], would be without any body rate. Four targets of zero are motors that are off, and stay so.
    #[inline(always)]
    pub fn held(&self, targets: &[R; 4], body_rates: &Vector3<R>) -> [R; 4] {
        let ([a, b, c, d], [w, x, y, z]) = (*targets, self.damping(body_rates));
        let (sum, off) = ((a + b) + (c + d), R::from_f32(OFF));
        let held = |target: R, damping: R| {
            let share = target * self.per_speed_limit;
            R::zero().where_less(sum, share * share + damping, off)
        };
        [held(a, w), held(b, x), held(c, y), held(d, z)]
    }

    /// Rotor targets \[rad/s\] of what is held, at the body rates \[rad/s\] of this moment.
    #[inline(always)]
    pub fn rotor_targets(&self, held: &[R; 4], body_rates: &Vector3<R>) -> [R; 4] {
        let ([a, b, c, d], [w, x, y, z]) = (*held, self.damping(body_rates));
        let target = |held: R, damping: R| (held - damping).limited(R::zero(), R::one()).sqrt() * self.speed_limit;
        [target(a, w), target(b, x), target(c, y), target(d, z)]
    }

    #[inline(always)]
    fn damping(&self, body_rates: &Vector3<R>) -> [R; 4] {
        self.gains.map(|[x, y, z]| (x * body_rates.x + y * body_rates.y) + z * body_rates.z)
    }
}

impl<R: Real> LowPass<R> {
    /// With this cut-off frequency \[Hz\], below half of the `sampling` rate \[Hz\].
    pub fn new(cutoff: f64, sampling: f64) -> Self {
        let warped = libm::tan(core::f64::consts::PI * cutoff / sampling);
        let (square, damping) = (warped * warped, core::f64::consts::SQRT_2 * warped);
        let scale = 1.0 + damping + square;
        Self {
            gain: R::from_f64(square / scale),
            feedback: [R::from_f64(2.0 * (square - 1.0) / scale), R::from_f64((1.0 - damping + square) / scale)],
        }
    }

    /// The memory of a signal that was always this.
    #[inline(always)]
    pub fn settled(&self, value: R) -> [R; 2] {
        let [last, before] = self.feedback;
        [value / (R::one() + last + before); 2]
    }

    /// The filtered signal after one more sample.
    #[inline(always)]
    pub fn filter(&self, memory: &mut [R; 2], sample: R) -> R {
        let [last, before] = *memory;
        let newest = sample - last * self.feedback[0] - before * self.feedback[1];
        *memory = [newest, last];
        (newest + (last + last) + before) * self.gain
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airframe::CF2X;

    fn space() -> ThrustBodyRates {
        ThrustBodyRates::new(&CF2X, 1.0, [8.0, 8.0, 3.0], [10.0, 12.0, 4.0])
    }

    #[test]
    fn at_other_rates_the_targets_are_those_that_would_be_commanded_there() {
        let (space, looped) = (space(), RateLoop::<f64>::new(&space()));
        let (then, now) = (Vector3::new(0.5, -1.0, 0.2), Vector3::new(-0.3, 0.4, 0.1));
        let action = [0.1, 0.2, -0.1, 0.3];
        let held = looped.held(&space.rotor_targets(&action, &then), &then);
        let expected = space.rotor_targets(&action, &now);
        for (found, expected) in looped.rotor_targets(&held, &now).into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-3 * expected, "{found} {expected}");
        }
    }

    #[test]
    fn targets_stay_within_the_limits_of_the_rotors() {
        let looped = RateLoop::<f64>::new(&space());
        let limit = space().speed_squared_limit;
        for targets in [[0.0; 4], [f64::from(limit).sqrt(); 4]] {
            let held = looped.held(&targets, &Vector3::zeros());
            for rate in [-100.0, 100.0, f64::NAN] {
                for target in looped.rotor_targets(&held, &Vector3::new(rate, rate, rate)) {
                    assert!((0.0..=f64::from(limit.sqrt()) + 1e-3).contains(&target), "{target}");
                }
            }
        }
    }

    #[test]
    fn motors_that_are_off_stay_off() {
        let looped = RateLoop::<f32>::new(&space());
        let held = looped.held(&[0.0; 4], &Vector3::new(1.0, 2.0, 3.0));
        assert_eq!(looped.rotor_targets(&held, &Vector3::new(-90.0, 50.0, 20.0)), [0.0; 4]);
    }

    #[test]
    fn the_filter_halves_the_power_at_its_cutoff_and_keeps_what_is_constant() {
        let filter = LowPass::<f64>::new(80.0, 1000.0);
        let mut memory = filter.settled(2.5);
        for _ in 0..100 {
            assert!((filter.filter(&mut memory, 2.5) - 2.5).abs() < 1e-12);
        }
        let mut memory = filter.settled(0.0);
        let filtered: Vec<f64> = (0..2000)
            .map(|step| {
                filter.filter(&mut memory, (core::f64::consts::TAU * 80.0 * f64::from(step) / 1000.0).sin())
            })
            .collect();
        let power = filtered[1000..].iter().map(|value| value * value).sum::<f64>() / 1000.0;
        assert!((power - 0.25).abs() < 1e-3, "{power}");
    }
}
