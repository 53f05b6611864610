//! The policy's distribution: independent Gaussians around the network's mean.

mod noise;

use kestrel_core::action::ACTION_LIMIT;
use pulp::{Simd, WithSimd};

use crate::network::dispatch;

pub use noise::Noise;

/// ln √(2π).
const LOG_NORMALISER: f32 = 0.918_938_5;

/// Standard deviations of the actions; their logarithms do not depend on the state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian {
    len: usize,
    /// Zero beyond the length.
    log_std: [f32; ACTION_LIMIT],
    std: [f32; ACTION_LIMIT],
}

impl Gaussian {
    /// From the logarithms of the standard deviations, one per value of an action, [`ACTION_LIMIT`] at most.
    ///
    /// # Panics
    /// When there are more.
    pub fn new(log_std: &[f32]) -> Self {
        let mut padded = [0.0; ACTION_LIMIT];
        padded[..log_std.len()].copy_from_slice(log_std);
        Self { len: log_std.len(), log_std: padded, std: padded.map(libm::expf) }
    }

    /// Standard deviation per value of an action.
    pub fn std(&self) -> &[f32] {
        &self.std[..self.len]
    }

    fn log_std(&self) -> &[f32] {
        &self.log_std[..self.len]
    }

    /// Differential entropy \[nat\].
    pub fn entropy(&self) -> f32 {
        self.log_std().iter().map(|log_std| 0.5 + LOG_NORMALISER + log_std).sum()
    }

    /// `actions = means + std * noise`, all `[action length][columns]`; the result is not limited to any range.
    pub fn sample(&self, means: &[f32], noise: &[f32], actions: &mut [f32]) {
        let columns = means.len() / self.len;
        dispatch(Sample { gaussian: self, means, noise, columns, actions });
    }

    /// Log-density of `actions` around `means`, both `[action length][columns]`, into `log_probs [columns]`.
    pub fn log_probs(&self, means: &[f32], actions: &[f32], log_probs: &mut [f32]) {
        dispatch(Density { gaussian: self, means, actions, log_probs });
    }
}

struct Sample<'a> {
    gaussian: &'a Gaussian,
    means: &'a [f32],
    noise: &'a [f32],
    columns: usize,
    actions: &'a mut [f32],
}

impl WithSimd for Sample<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let inputs = self.means.chunks_exact(self.columns).zip(self.noise.chunks_exact(self.columns));
        for ((row, inputs), std) in self.actions.chunks_exact_mut(self.columns).zip(inputs).zip(self.gaussian.std)
        {
            for ((action, mean), noise) in row.iter_mut().zip(inputs.0).zip(inputs.1) {
                *action = mean + std * noise;
            }
        }
    }
}

struct Density<'a> {
    gaussian: &'a Gaussian,
    means: &'a [f32],
    actions: &'a [f32],
    log_probs: &'a mut [f32],
}

impl WithSimd for Density<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let columns = self.log_probs.len();
        self.log_probs.fill(-self.gaussian.log_std().iter().map(|log_std| log_std + LOG_NORMALISER).sum::<f32>());
        let rows = self.means.chunks_exact(columns).zip(self.actions.chunks_exact(columns));
        for ((means, actions), std) in rows.zip(self.gaussian.std) {
            let inverse = 1.0 / std;
            for ((log_prob, mean), action) in self.log_probs.iter_mut().zip(means).zip(actions) {
                let deviation = (action - mean) * inverse;
                *log_prob -= 0.5 * deviation * deviation;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOG_STD: [f32; 4] = [-1.0, 0.0, 0.5, -0.3];

    #[test]
    fn the_log_density_is_the_closed_form() {
        let means: Vec<f32> = (0..32).map(|i| libm::sinf(i as f32)).collect();
        let actions: Vec<f32> = (0..32).map(|i| libm::cosf(i as f32 * 1.7)).collect();
        let mut log_probs = [0.0; 8];
        Gaussian::new(&LOG_STD).log_probs(&means, &actions, &mut log_probs);
        for (column, log_prob) in log_probs.iter().enumerate() {
            let density = |row: usize| {
                let std = libm::exp(f64::from(LOG_STD[row]));
                let deviation = f64::from(actions[row * 8 + column] - means[row * 8 + column]) / std;
                libm::exp(-0.5 * deviation * deviation) / (std * (2.0 * std::f64::consts::PI).sqrt())
            };
            let expected = libm::log((0..4).map(density).product::<f64>());
            assert!((f64::from(*log_prob) - expected).abs() < 1e-5 * expected.abs().max(1.0));
        }
    }

    #[test]
    fn the_entropy_is_the_closed_form() {
        // ln(std √(2πe)) per action.
        let expected: f64 = LOG_STD
            .iter()
            .map(|log_std| f64::from(*log_std) + 0.5 * libm::log(2.0 * std::f64::consts::PI * std::f64::consts::E))
            .sum();
        assert!((f64::from(Gaussian::new(&LOG_STD).entropy()) - expected).abs() < 1e-6);
    }

    #[test]
    fn a_sample_is_the_mean_plus_scaled_noise() {
        let mut actions = [0.0; 32];
        let gaussian = Gaussian::new(&LOG_STD);
        gaussian.sample(&[0.25; 32], &[2.0; 32], &mut actions);
        assert_eq!(actions[8], 0.25 + 2.0);
        assert_eq!(actions[31], 0.25 + 2.0 * gaussian.std()[3]);
    }
}
