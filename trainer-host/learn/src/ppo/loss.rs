//! The loss of PPO on a tile of samples, and its gradient with respect to what the networks put out.

use pulp::{Simd, WithSimd};
use serde::{Deserialize, Serialize};

use crate::actor_critic::ValueScale;
use crate::gaussian::Gaussian;
use crate::network::{dispatch, dot};
use crate::rollout::{PANEL, Tile};

/// Keeps the ratio finite for actions that the new policy finds impossible; far outside any clip range.
const LOG_RATIO_LIMIT: f32 = 20.0;

/// Sums over samples of what is logged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct LossSums {
    pub(crate) samples: f64,
    pub(crate) policy_loss: f64,
    pub(crate) value_loss: f64,
    pub(crate) approx_kl: f64,
    pub(crate) clipped: f64,
}

impl LossSums {
    pub(crate) fn add(&mut self, other: &Self) {
        self.samples += other.samples;
        self.policy_loss += other.policy_loss;
        self.value_loss += other.value_loss;
        self.approx_kl += other.approx_kl;
        self.clipped += other.clipped;
    }

    /// A sum's mean per sample.
    pub(crate) fn mean(&self, sum: f64) -> f32 {
        (sum / self.samples.max(1.0)) as f32
    }
}

/// The clipped surrogate objective (Schulman et al. 2017, eq. 7) of one tile.
pub(crate) struct Surrogate<'a> {
    pub(crate) tile: Tile<'a>,
    /// The new policy's `[action length][columns]`.
    pub(crate) means: &'a [f32],
    pub(crate) gaussian: &'a Gaussian,
    pub(crate) clip_range: f32,
    /// Of the divergence from what the teacher would have done.
    pub(crate) lesson_weight: f32,
    /// Weight of one sample, the inverse of the minibatch's size.
    pub(crate) sample_weight: f32,
}

impl Surrogate<'_> {
    /// Adds the loss to `sums`, the gradient of `log_std` to `log_std`, and writes that of the means to `deltas`.
    pub(crate) fn differentiate(&self, deltas: &mut [f32], log_std: &mut [f32], sums: &mut LossSums) {
        let columns = self.tile.log_probs.len();
        let (mut log_probs, mut pulls) = ([0.0; PANEL], [0.0; PANEL]);
        let (log_probs, pulls) = (&mut log_probs[..columns], &mut pulls[..columns]);
        self.gaussian.log_probs(self.means, self.tile.actions, log_probs);
        for (index, pull) in pulls.iter_mut().enumerate() {
            let log_ratio = log_probs[index] - self.tile.log_probs[index];
            *pull = self.sample_weight * self.pull(log_ratio, self.tile.advantages[index], sums);
        }
        dispatch(ThroughDensity { surrogate: self, pulls, deltas, log_std });
        self.heed_teacher(deltas);
    }

    /// Adds the gradient of the divergence between the policy and a Gaussian as wide around what the teacher would have done.
    fn heed_teacher(&self, deltas: &mut [f32]) {
        let columns = self.tile.log_probs.len();
        let rows = self.means.chunks_exact(columns).zip(self.tile.lessons.chunks_exact(columns));
        for ((delta, (means, lessons)), std) in deltas.chunks_exact_mut(columns).zip(rows).zip(self.gaussian.std())
        {
            let weight = self.sample_weight * self.lesson_weight / (std * std);
            for ((delta, mean), lesson) in delta.iter_mut().zip(means).zip(lessons) {
                *delta += weight * (mean - lesson);
            }
        }
    }

    /// The derivative of a sample's loss with respect to the log-density of its action.
    #[inline(always)]
    fn pull(&self, log_ratio: f32, advantage: f32, sums: &mut LossSums) -> f32 {
        let log_ratio = log_ratio.clamp(-LOG_RATIO_LIMIT, LOG_RATIO_LIMIT);
        let ratio = libm::expf(log_ratio);
        let clipped = ratio.clamp(1.0 - self.clip_range, 1.0 + self.clip_range);
        let (gain, clipped_gain) = (ratio * advantage, clipped * advantage);
        sums.policy_loss -= f64::from(gain.min(clipped_gain));
        // The unbiased estimate with little variance (Schulman 2020, "k3").
        sums.approx_kl += f64::from(ratio - 1.0 - log_ratio);
        sums.clipped += f64::from(u8::from(ratio != clipped));
        if gain <= clipped_gain { -gain } else { 0.0 }
    }
}

/// The chain rule through the Gaussian log-density.
struct ThroughDensity<'a> {
    surrogate: &'a Surrogate<'a>,
    pulls: &'a [f32],
    deltas: &'a mut [f32],
    log_std: &'a mut [f32],
}

impl WithSimd for ThroughDensity<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { surrogate, pulls, deltas, log_std } = self;
        let columns = pulls.len();
        let rows = surrogate.means.chunks_exact(columns).zip(surrogate.tile.actions.chunks_exact(columns));
        for (row, (means, actions)) in rows.enumerate() {
            let inverse = 1.0 / surrogate.gaussian.std()[row];
            let deltas = &mut deltas[row * columns..(row + 1) * columns];
            let mut curvatures = [0.0; PANEL];
            let curvatures = &mut curvatures[..columns];
            for index in 0..columns {
                let deviation = (actions[index] - means[index]) * inverse;
                deltas[index] = pulls[index] * deviation * inverse;
                curvatures[index] = deviation * deviation - 1.0;
            }
            log_std[row] += dot(pulls, curvatures);
        }
    }
}

/// Mean squared error of the critic's `heads`, in units of the returns' spread: adds it to `sums`, and writes its
/// gradient, times `weight`, to `deltas`.
pub(crate) fn differentiate_value(
    heads: &[f32],
    (returns, scale): (&[f32], &ValueScale),
    weight: f32,
    deltas: &mut [f32],
    sums: &mut LossSums,
) {
    sums.samples += heads.len() as f64;
    for ((delta, head), target) in deltas.iter_mut().zip(heads).zip(returns) {
        let error = head - (target - scale.mean) / scale.std;
        sums.value_loss += f64::from(error * error);
        *delta = weight * 2.0 * error;
    }
}
