//! Standard normal noise for many environments at once, from a counter.

use kestrel_core::seed::{Purpose, Seed, philox};
use pulp::{Simd, WithSimd};

use crate::network::dispatch;

/// Environments drawn together, the width of two AVX registers.
const LANES: usize = 16;

/// Normals from one Philox block.
const BLOCK_LEN: usize = 4;

/// sin(πx/2) by odd powers of x, Taylor: error below 1e-7 on \[-1, 1\].
const SINE: [f32; 6] =
    [std::f32::consts::FRAC_PI_2, -0.645_964_1, 0.079_692_63, -0.004_681_754, 1.604_411_8e-4, -3.598_843e-6];
/// cos(πx/2) by even powers of x, Taylor: error below 1e-7 on \[-1, 1\].
const COSINE: [f32; 7] =
    [1.0, -1.233_700_6, 0.253_669_5, -0.020_863_48, 9.192_602_7e-4, -2.520_204_2e-5, 4.710_874_8e-7];
/// 2 artanh(x) by odd powers of x, Taylor: relative error below 2e-8 for |x| < 0.172.
const LOGARITHM: [f32; 5] = [2.0, 2.0 / 3.0, 2.0 / 5.0, 2.0 / 7.0, 2.0 / 9.0];
/// Bits of √½: adding their distance from one splits a float into exponent and a mantissa in \[√½, √2).
const ROOT_HALF_BITS: u32 = 0x3f35_04f3;

/// Exploration noise of a range of environments, a function of seed, environment and step only.
///
/// One Philox block gives an environment four normals of a step by two Box–Muller transforms; longer actions take a
/// second block. The uniform
/// under the logarithm is a multiple of 2⁻²⁴, so that no normal exceeds 5.77 (a one in 10⁸ event).
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    seed: Seed,
    first_environment: u32,
    action_len: usize,
}

impl Noise {
    /// For consecutive environments from `first_environment` on and actions of `action_len` values.
    pub fn new(seed: Seed, first_environment: u32, action_len: usize) -> Self {
        Self { seed, first_environment, action_len }
    }

    /// Fills `noise [action length][environments]` with the normals of step number `step`.
    ///
    /// # Panics
    /// When the number of environments is not a multiple of 8.
    pub fn fill(&self, step: u64, noise: &mut [f32]) {
        dispatch(Fill { noise: *self, step, normals: noise });
    }
}

struct Fill<'a> {
    noise: Noise,
    step: u64,
    normals: &'a mut [f32],
}

impl WithSimd for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Noise { seed, first_environment, action_len } = self.noise;
        let environments = self.normals.len() / action_len;
        for (block, tile) in self.normals.chunks_mut(BLOCK_LEN * environments).enumerate() {
            for first in (0..environments).step_by(LANES) {
                let rows = normals(seed, first_environment + first as u32, self.step, block as u32);
                let count = LANES.min(environments - first);
                for (row, lanes) in tile.chunks_exact_mut(environments).zip(&rows) {
                    row[first..first + count].copy_from_slice(&lanes[..count]);
                }
            }
        }
    }
}

#[inline(always)]
fn normals(seed: Seed, environment: u32, step: u64, block: u32) -> [[f32; LANES]; BLOCK_LEN] {
    let key = [seed.0 as u32, (seed.0 >> 32) as u32];
    // No run makes 2⁶³ steps: the topmost bit of their number is free.
    let high = (step >> 32) as u32 | block << 31;
    let mut words = [[0; LANES]; BLOCK_LEN];
    for lane in 0..LANES {
        let counter = [step as u32, environment + lane as u32, Purpose::Actions as u32, high];
        for (words, word) in words.iter_mut().zip(philox(counter, key)) {
            words[lane] = word;
        }
    }
    let mut rows = [[0.0; LANES]; BLOCK_LEN];
    for lane in 0..LANES {
        [rows[0][lane], rows[1][lane]] = box_muller(words[0][lane], words[1][lane]);
        [rows[2][lane], rows[3][lane]] = box_muller(words[2][lane], words[3][lane]);
    }
    rows
}

/// Two independent normals from two words (Box and Muller 1958).
#[inline(always)]
fn box_muller(radius_word: u32, angle_word: u32) -> [f32; 2] {
    const UNIT: f32 = 1.0 / 16_777_216.0;
    // In (0, 1], so that the logarithm is finite.
    let uniform = ((radius_word >> 8) as i32 + 1) as f32 * UNIT;
    let radius = (-2.0 * logarithm(uniform)).sqrt();
    // Half the angle, in quarter turns: [-1, 1).
    let half_angle = ((angle_word >> 8) as i32 - 8_388_608) as f32 * (2.0 * UNIT);
    let square = half_angle * half_angle;
    let (sine, cosine) = (half_angle * polynomial(&SINE, square), polynomial(&COSINE, square));
    [radius * (1.0 - 2.0 * sine * sine), radius * (2.0 * sine * cosine)]
}

/// Natural logarithm of a positive normal number, relative error below 1e-6 (absolute near one).
#[inline(always)]
fn logarithm(x: f32) -> f32 {
    let shifted = x.to_bits().wrapping_add(0x3f80_0000 - ROOT_HALF_BITS);
    let exponent = (shifted >> 23) as i32 - 127;
    let mantissa = f32::from_bits((shifted & 0x007f_ffff) + ROOT_HALF_BITS);
    let ratio = (mantissa - 1.0) / (mantissa + 1.0);
    exponent as f32 * std::f32::consts::LN_2 + ratio * polynomial(&LOGARITHM, ratio * ratio)
}

#[inline(always)]
fn polynomial<const N: usize>(coefficients: &[f32; N], x: f32) -> f32 {
    let mut value = coefficients[N - 1];
    for coefficient in coefficients[..N - 1].iter().rev() {
        value = value * x + coefficient;
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    fn draw(action_len: usize, environments: usize, steps: u64) -> Vec<f32> {
        let noise = Noise::new(Seed(11), 64, action_len);
        let mut all = vec![0.0; environments * action_len * steps as usize];
        for (step, tile) in all.chunks_exact_mut(environments * action_len).enumerate() {
            noise.fill(step as u64, tile);
        }
        all
    }

    #[test]
    fn the_logarithm_is_that_of_libm() {
        for word in (0..16_777_216_u32).step_by(997) {
            let x = (word + 1) as f32 / 16_777_216.0;
            let expected = libm::log(f64::from(x));
            assert!((f64::from(logarithm(x)) - expected).abs() <= 1e-6 * expected.abs().max(1e-2), "{x}");
        }
        assert_eq!(logarithm(1.0), 0.0);
    }

    #[test]
    fn box_muller_turns_a_radius_by_an_angle() {
        for (radius_word, angle_word) in
            [(u32::MAX / 2, 0), (123_456_789, 3_333_333_333), (0, u32::MAX), (7, 1 << 31)]
        {
            let uniform = (f64::from(radius_word >> 8) + 1.0) / 16_777_216.0;
            let radius = (-2.0 * libm::log(uniform)).sqrt();
            let angle = (f64::from(angle_word >> 8) / 8_388_608.0 - 1.0) * std::f64::consts::PI;
            let [cosine, sine] = box_muller(radius_word, angle_word).map(f64::from);
            assert!(
                (cosine - radius * libm::cos(angle)).abs() < 3e-6
                    && (sine - radius * libm::sin(angle)).abs() < 3e-6
            );
        }
    }

    #[test]
    fn the_moments_are_those_of_a_normal() {
        let values: Vec<f64> = draw(4, 256, 1000).into_iter().map(f64::from).collect();
        let moment = |power: i32| values.iter().map(|value| value.powi(power)).sum::<f64>() / values.len() as f64;
        // Five standard errors of each estimate, n = 1 024 000.
        assert!(moment(1).abs() < 0.005, "mean {}", moment(1));
        assert!((moment(2) - 1.0).abs() < 0.007, "variance {}", moment(2));
        assert!(moment(3).abs() < 0.02, "skewness {}", moment(3));
        assert!((moment(4) - 3.0).abs() < 0.05, "kurtosis {}", moment(4));
    }

    #[test]
    fn the_tails_are_those_of_a_normal() {
        let values = draw(4, 256, 1000);
        for (bound, probability) in [(1.0, 0.317_310_5), (2.0, 0.045_500_3), (3.0, 0.002_699_8), (4.0, 6.334e-5)] {
            let expected = probability * values.len() as f64;
            let beyond = values.iter().filter(|value| value.abs() > bound).count() as f64;
            assert!((beyond - expected).abs() < 5.0 * expected.sqrt(), "beyond {bound}: {beyond}, not {expected}");
        }
        assert!(values.iter().all(|value| value.abs() < 5.78));
    }

    #[test]
    fn actions_steps_and_environments_are_uncorrelated() {
        let (environments, steps) = (256, 400);
        for action_len in [4, 6] {
            let values = draw(action_len, environments, steps);
            let count = values.len() as f64;
            for lag in [1, environments, 2 * environments, 4 * environments, 6 * environments] {
                let product = |(a, b): (&f32, &f32)| f64::from(*a) * f64::from(*b);
                let correlation = values.iter().zip(&values[lag..]).map(product).sum::<f64>() / count;
                assert!(correlation.abs() < 5.0 / count.sqrt(), "lag {lag}: {correlation}");
            }
        }
    }

    #[test]
    fn an_environment_keeps_its_noise_in_any_batch() {
        let (mut wide, mut narrow) = ([0.0; 4 * 256], [0.0; 4 * 8]);
        Noise::new(Seed(5), 0, 4).fill(9, &mut wide);
        Noise::new(Seed(5), 40, 4).fill(9, &mut narrow);
        for row in 0..4 {
            assert_eq!(narrow[row * 8..row * 8 + 8], wide[row * 256 + 40..row * 256 + 48]);
        }
    }

    #[test]
    fn a_value_of_an_action_keeps_its_noise_in_actions_of_any_length() {
        let longest = draw(6, 16, 1);
        for action_len in 1..6 {
            assert_eq!(draw(action_len, 16, 1)[..], longest[..16 * action_len]);
        }
    }
}
