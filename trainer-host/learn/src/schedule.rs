//! How a learning rate moves during training.

use serde::{Deserialize, Serialize};

/// The KL divergence may be this many times off its target before the learning rate moves (Rudin et al. 2022).
const KL_BAND: f32 = 2.0;
/// Factor by which the learning rate then moves (Rudin et al. 2022).
const KL_STEP: f32 = 1.5;

/// A learning rate over the course of training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Schedule {
    /// The same throughout.
    Constant(f32),
    /// Linear in the environment steps done, from the first to the last.
    Linear {
        /// At the start.
        from: f32,
        /// At the end of training and after.
        to: f32,
    },
    /// Lowered when an update moved the policy too far, raised when it hardly moved it (Rudin et al. 2022).
    KlAdaptive {
        /// For the first update.
        initial: f32,
        /// Wanted `approx_kl` of an update.
        target: f32,
        /// Lowest learning rate.
        low: f32,
        /// Highest learning rate.
        high: f32,
    },
}

impl Schedule {
    /// The learning rate of the first update.
    pub fn initial(&self) -> f32 {
        match *self {
            Self::Constant(rate) => rate,
            Self::Linear { from, .. } => from,
            Self::KlAdaptive { initial, .. } => initial,
        }
    }

    /// The schedule that stays where this one ends; one that follows the divergence has no end.
    #[must_use]
    pub fn last(&self) -> Self {
        match *self {
            Self::Linear { to, .. } => Self::Constant(to),
            Self::Constant(_) | Self::KlAdaptive { .. } => *self,
        }
    }

    /// The learning rate of the next update, from the `current` one, the fraction of training done and the
    /// `approx_kl` of the update just made.
    pub fn next(&self, current: f32, progress: f64, approx_kl: f32) -> f32 {
        match *self {
            Self::Constant(rate) => rate,
            Self::Linear { from, to } => from + (to - from) * progress.min(1.0) as f32,
            Self::KlAdaptive { target, low, .. } if approx_kl > KL_BAND * target => (current / KL_STEP).max(low),
            Self::KlAdaptive { target, high, .. } if KL_BAND * approx_kl < target => (current * KL_STEP).min(high),
            Self::KlAdaptive { .. } => current,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_schedule_ends_where_it_says() {
        assert_eq!(Schedule::Linear { from: 1e-3, to: 1e-4 }.last(), Schedule::Constant(1e-4));
        let schedule = Schedule::Linear { from: 1e-3, to: 1e-4 };
        assert_eq!(schedule.initial(), 1e-3);
        assert!((schedule.next(1e-3, 0.5, 0.0) - 5.5e-4).abs() < 1e-9);
        assert!((schedule.next(1e-3, 7.0, 0.0) - 1e-4).abs() < 1e-9);
    }

    #[test]
    fn an_adaptive_schedule_keeps_the_divergence_near_its_target() {
        let schedule = Schedule::KlAdaptive { initial: 1e-3, target: 0.01, low: 9e-4, high: 1.1e-3 };
        assert_eq!(schedule.next(1e-3, 0.0, 0.05), 9e-4);
        assert_eq!(schedule.next(1e-3, 0.0, 0.001), 1.1e-3);
        assert_eq!(schedule.next(1e-3, 0.0, 0.012), 1e-3);
    }

    #[test]
    fn a_constant_schedule_is_constant() {
        assert_eq!(Schedule::Constant(3e-4).next(1.0, 0.5, 9.0), 3e-4);
    }
}
