//! Finding out that a task has ended, from what is observed.
//!
//! Between two rollouts a policy changes a little, and so does what it meets; where the world changes, what it meets changes at once. The
//! measure is the Kullback-Leibler divergence of two rollouts, both ways together, each observed number taken to be normal, on average over
//! the numbers. Nothing is known of the worlds.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Visited;

/// Divergence \[nat\] from which on it is another world. In furnished rooms rollouts of a policy that learns are up to 0.022 apart, those of
/// one policy in two rooms hardly ever less than 0.05 (one boundary of 48 was below).
const DIVERGENCE: f64 = 0.035;

/// Variance that every number has beside its own: by less than a hundredth of their scale numbers do not differ.
const LEAST_VARIANCE: f64 = 1e-4;

/// Who says that a task has ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Boundaries {
    /// Whoever trains.
    #[default]
    Told,
    /// Nobody: it is found in what the policy observes.
    Found,
}

/// Mean and variance of each number that a policy observed in a rollout.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Observed {
    numbers: Vec<[f64; 2]>,
}

impl Observed {
    /// Of the first `inputs` numbers of every observation.
    pub(super) fn of(visited: &[Visited<'_>], inputs: usize) -> Self {
        let mut sums = vec![[0.0; 2]; inputs];
        let mut count = 0.0;
        for Visited { columns, slices } in visited {
            for slice in slices {
                count += *columns as f64;
                for ([sum, squares], row) in sums.iter_mut().zip(slice.chunks_exact(*columns)) {
                    for value in row.iter().map(|value| f64::from(*value)) {
                        *sum += value;
                        *squares += value * value;
                    }
                }
            }
        }
        let moments =
            |[sum, squares]: [f64; 2]| [sum / count, squares / count - (sum / count).powi(2) + LEAST_VARIANCE];
        Self { numbers: sums.into_iter().map(moments).collect() }
    }

    /// Whether this is another world than that of the rollout `before`.
    pub(super) fn differs_from(&self, before: &Self) -> bool {
        let divergence = |([mean, variance], [before, earlier]): (&[f64; 2], &[f64; 2])| {
            let shift = (mean - before).powi(2) * (1.0 / variance + 1.0 / earlier);
            0.5 * (shift + variance / earlier + earlier / variance - 2.0)
        };
        let sum: f64 = self.numbers.iter().zip(&before.numbers).map(divergence).sum();
        sum > DIVERGENCE * self.numbers.len() as f64
    }

    /// Bytes of it, in single precision.
    pub(super) fn bytes(&self) -> usize {
        8 * self.numbers.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kestrel_core::seed::{Purpose, Seed, Stream};

    /// Two batches of slices of three numbers, the last always the same, and a row that others read.
    fn observed(seed: u32, shift: f32) -> Observed {
        let mut stream = Stream::new(Seed(7), seed, Purpose::Weights);
        let mut slice = || -> Vec<f32> {
            let first: Vec<f32> = (0..64).map(|_| shift + 0.5 * stream.normal()).collect();
            let second: Vec<f32> = (0..64).map(|_| 40.0 + 3.0 * stream.normal()).collect();
            [first, second, vec![1.0; 64], vec![f32::NAN; 64]].concat()
        };
        let slices: Vec<Vec<f32>> = (0..40).map(|_| slice()).collect();
        let batches: Vec<Visited<'_>> = slices
            .chunks(20)
            .map(|slices| Visited { columns: 64, slices: slices.iter().map(Vec::as_slice).collect() })
            .collect();
        Observed::of(&batches, 3)
    }

    #[test]
    fn moments_are_those_of_all_batches() {
        let [[mean, variance], [other, wider], [constant, nothing]] = observed(0, 0.0).numbers[..] else {
            panic!("three numbers");
        };
        assert!(mean.abs() < 0.05 && (variance - 0.25).abs() < 0.02, "{mean} {variance}");
        assert!((other - 40.0).abs() < 0.3 && (wider - 9.0).abs() < 0.6, "{other} {wider}");
        assert!((constant - 1.0).abs() < 1e-9 && (nothing - LEAST_VARIANCE).abs() < 1e-9);
    }

    #[test]
    fn a_shift_of_one_number_is_seen_and_chance_is_not() {
        let before = observed(0, 0.0);
        assert!(!before.differs_from(&before));
        assert!((1..50).all(|seed| !observed(seed, 0.0).differs_from(&before)));
        // One of three numbers by 0.2 standard deviations: 0.013. By 0.4: 0.053.
        assert!(!observed(1, 0.1).differs_from(&before));
        assert!(observed(1, 0.2).differs_from(&before) && before.differs_from(&observed(1, 0.2)));
    }
}
