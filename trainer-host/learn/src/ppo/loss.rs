//! The loss of PPO on a slice of samples, and its gradient with respect to what the networks put out.

use pulp::{Simd, WithSimd};
use serde::{Deserialize, Serialize};

use super::{Loss, clipped_surrogate, value_error};
use crate::actor_critic::ValueScale;
use crate::gaussian::Gaussian;
use crate::network::{dispatch, dot};
use crate::rollout::{ENV_BATCH, MinibatchSlice};

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

/// The clipped surrogate and the imitation loss of one slice.
pub(super) struct PolicyLoss<'a> {
    pub(super) loss: Loss<'a>,
    pub(super) slice: &'a MinibatchSlice<'a>,
    /// The new policy's `[action length][columns]`.
    pub(super) means: &'a [f32],
    pub(super) gaussian: &'a Gaussian,
}

impl PolicyLoss<'_> {
    /// Adds the loss to `sums`, the gradient of `log_std` to `log_std`, and writes that of the means to `deltas`.
    pub(super) fn differentiate(&self, deltas: &mut [f32], log_std: &mut [f32], sums: &mut LossSums) {
        let columns = self.slice.log_probs.len();
        let (mut log_probs, mut gradients) = ([0.0; ENV_BATCH], [0.0; ENV_BATCH]);
        let (log_probs, gradients) = (&mut log_probs[..columns], &mut gradients[..columns]);
        self.gaussian.log_probs(self.means, self.slice.actions, log_probs);
        for (index, gradient) in gradients.iter_mut().enumerate() {
            let log_ratio = log_probs[index] - self.slice.log_probs[index];
            let clip_range = self.loss.settings.clip_range;
            let sample = clipped_surrogate(log_ratio, self.slice.advantages[index], clip_range);
            sums.policy_loss += f64::from(sample.loss);
            sums.approx_kl += f64::from(sample.approx_kl);
            sums.clipped += f64::from(u8::from(sample.is_clipped));
            *gradient = self.loss.sample_weight * sample.gradient;
        }
        dispatch(ThroughDensity { policy: self, gradients, deltas, log_std });
        self.add_imitation_gradient(deltas);
    }

    /// Adds the gradient of the divergence between the policy and a Gaussian as wide around the teacher's action.
    fn add_imitation_gradient(&self, deltas: &mut [f32]) {
        let columns = self.slice.log_probs.len();
        let rows = self.means.chunks_exact(columns).zip(self.slice.teacher_actions.chunks_exact(columns));
        for ((delta, (means, actions)), std) in deltas.chunks_exact_mut(columns).zip(rows).zip(self.gaussian.std())
        {
            let weight = self.loss.sample_weight * self.loss.imitation_weight / (std * std);
            for ((delta, mean), action) in delta.iter_mut().zip(means).zip(actions) {
                *delta += weight * (mean - action);
            }
        }
    }
}

/// The chain rule through the Gaussian log-density.
struct ThroughDensity<'a> {
    policy: &'a PolicyLoss<'a>,
    gradients: &'a [f32],
    deltas: &'a mut [f32],
    log_std: &'a mut [f32],
}

impl WithSimd for ThroughDensity<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { policy, gradients, deltas, log_std } = self;
        let columns = gradients.len();
        let rows = policy.means.chunks_exact(columns).zip(policy.slice.actions.chunks_exact(columns));
        for (row, (means, actions)) in rows.enumerate() {
            let inverse = 1.0 / policy.gaussian.std()[row];
            let deltas = &mut deltas[row * columns..(row + 1) * columns];
            let mut curvatures = [0.0; ENV_BATCH];
            let curvatures = &mut curvatures[..columns];
            for index in 0..columns {
                let deviation = (actions[index] - means[index]) * inverse;
                deltas[index] = gradients[index] * deviation * inverse;
                curvatures[index] = deviation * deviation - 1.0;
            }
            log_std[row] += dot(gradients, curvatures);
        }
    }
}

/// The squared error of the critic's heads on one slice, in units of the returns' spread.
pub(super) struct ValueLoss<'a> {
    pub(super) loss: Loss<'a>,
    pub(super) slice: &'a MinibatchSlice<'a>,
    /// `[tasks][columns]`.
    pub(super) heads: &'a [f32],
    /// Of the returns of the slice's task.
    pub(super) scale: &'a ValueScale,
}

impl ValueLoss<'_> {
    /// Adds the loss to `sums`, and writes the gradient of the heads to `deltas`: zero but for the task's.
    pub(super) fn differentiate(&self, deltas: &mut [f32], sums: &mut LossSums) {
        let columns = self.slice.returns.len();
        let head = self.slice.task * columns..(self.slice.task + 1) * columns;
        let weight = self.loss.settings.value_weight * self.loss.sample_weight;
        sums.samples += columns as f64;
        deltas.fill(0.0);
        let samples = self.heads[head.clone()].iter().zip(self.slice.returns);
        for (delta, (value, target)) in deltas[head].iter_mut().zip(samples) {
            let sample = value_error(*value, (target - self.scale.mean) / self.scale.std);
            sums.value_loss += f64::from(sample.loss);
            *delta = weight * sample.gradient;
        }
    }
}
