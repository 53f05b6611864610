//! Percentile intervals by drawing seeds again (Efron 1979), within strata.

use kestrel_sim::seed::philox;

/// Repetitions of an interval that is printed; Agarwal et al. 2021 use as many.
pub const REPETITIONS: usize = 50_000;

/// A statistic of a sample and how far it can be trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The statistic of the sample itself.
    pub value: f64,
    /// Percentile interval at 95 %; none when fewer than two units carry the value.
    pub interval: Option<[f64; 2]>,
    /// Number of units.
    pub units: usize,
}

/// How often each unit is drawn, in every repetition: drawn once, shared by all statistics, so that intervals of
/// differences are paired.
#[derive(Clone, Debug, PartialEq)]
pub struct Resamples {
    units: usize,
    /// `[repetitions][units]`.
    counts: Vec<u16>,
}

impl Resamples {
    /// Draws from strata of the given numbers of units as many units as each has, with replacement; units are numbered
    /// stratum by stratum. A repetition's draws depend on `seed` and its own number alone.
    ///
    /// # Panics
    /// When a stratum has 2¹⁶ units or more.
    pub fn new(strata: &[usize], repetitions: usize, seed: u64) -> Self {
        assert!(strata.iter().all(|&units| units < 1 << 16), "counts of draws have sixteen bits");
        let units: usize = strata.iter().sum();
        let mut counts = vec![0; repetitions * units];
        for (repetition, counts) in counts.chunks_exact_mut(units.max(1)).enumerate() {
            let mut draws = Draws::new(seed, repetition as u32);
            let mut first = 0;
            for &stratum in strata {
                for _ in 0..stratum {
                    counts[first + draws.below(stratum)] += 1;
                }
                first += stratum;
            }
        }
        Self { units, counts }
    }

    /// The first `repetitions` of them, for statistics that cost more.
    #[must_use]
    pub fn first(&self, repetitions: usize) -> Self {
        let counts = self.counts.len().min(repetitions * self.units);
        Self { units: self.units, counts: self.counts[..counts].to_vec() }
    }

    /// Every unit once: the sample itself.
    pub fn once(&self) -> Vec<u16> {
        vec![1; self.units]
    }

    /// How often each unit is drawn, repetition by repetition.
    pub fn iter(&self) -> impl Iterator<Item = &[u16]> {
        self.counts.chunks_exact(self.units.max(1))
    }

    /// The statistic of each repetition in rising order, without those in which it does not exist.
    pub fn distribution(&self, statistic: impl Fn(&[u16]) -> Option<f64>) -> Vec<f64> {
        let mut values: Vec<f64> = self.iter().filter_map(statistic).collect();
        values.sort_by(f64::total_cmp);
        values
    }

    /// The statistic of the sample with its interval, carried by `units` units; `None` when it does not exist.
    pub fn estimate(&self, units: usize, statistic: impl Fn(&[u16]) -> Option<f64>) -> Option<Estimate> {
        let value = statistic(&self.once())?;
        let interval =
            if units < 2 { None } else { percentile_interval(self.iter().filter_map(statistic).collect()) };
        Some(Estimate { value, interval, units })
    }
}

/// The values at 2.5 % and 97.5 % of a distribution in any order; `None` when it is empty.
pub fn percentile_interval(mut values: Vec<f64>) -> Option<[f64; 2]> {
    let last = values.len().checked_sub(1)? as f64;
    let mut at = |share: f64| {
        let place = share * last;
        let (_, below, above) = values.select_nth_unstable_by(place.floor() as usize, f64::total_cmp);
        let below = *below;
        let next = above.iter().copied().fold(f64::INFINITY, f64::min);
        if place.fract() > 0.0 { below + (next - below) * place.fract() } else { below }
    };
    Some([at(0.025), at(0.975)])
}

/// Random choices of one repetition.
struct Draws {
    key: [u32; 2],
    repetition: u32,
    block: u32,
    words: [u32; 4],
    used: usize,
}

impl Draws {
    fn new(seed: u64, repetition: u32) -> Self {
        Self { key: [seed as u32, (seed >> 32) as u32], repetition, block: 0, words: [0; 4], used: 4 }
    }

    /// Uniform among `0..count`, to within 2⁻¹⁶ for the strata that are allowed.
    fn below(&mut self, count: usize) -> usize {
        if self.used == 4 {
            self.words = philox([self.block, self.repetition, 0, 0], self.key);
            self.block += 1;
            self.used = 0;
        }
        let word = self.words[self.used];
        self.used += 1;
        ((u64::from(word) * count as u64) >> 32) as usize
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;
    use crate::statistics::sample::Sample;

    /// Survival times of treated mice \[days\] (Efron and Tibshirani 1993, table 2.1).
    const TREATED: [f64; 7] = [94.0, 197.0, 16.0, 38.0, 99.0, 141.0, 23.0];

    fn of(values: &[f64]) -> Sample {
        Sample::new(values.iter().copied().enumerate())
    }

    fn deviation(values: &[f64]) -> f64 {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
    }

    #[test]
    fn standard_errors_match_the_published_ones_of_the_mouse_data() {
        // Efron and Tibshirani 1993, table 2.2, B = ∞: 23.36 for the mean, 37.83 for the median.
        let resamples = Resamples::new(&[7], REPETITIONS, 1);
        let sample = of(&TREATED);
        let mean = deviation(&resamples.distribution(|counts| sample.mean(counts)));
        assert!((mean - 23.36).abs() < 0.25, "{mean}");
        let median = deviation(&resamples.distribution(|counts| sample.quantile(counts, 0.5)));
        assert!((median - 37.83).abs() < 0.4, "{median}");
    }

    #[test]
    fn quantiles_match_the_exact_bootstrap_of_three_values() {
        // All 27 draws of 0, 1, 10: their means' distribution is known.
        let mut exact = Vec::new();
        let values = [0.0, 1.0, 10.0];
        for first in values {
            for second in values {
                exact.extend(values.map(|third| (first + second + third) / 3.0));
            }
        }
        let sample = of(&values);
        let drawn = Resamples::new(&[3], REPETITIONS, 5).distribution(|counts| sample.mean(counts));
        for limit in [0.2, 0.5, 3.0, 4.0, 5.0, 8.0] {
            let share = |values: &[f64]| {
                values.iter().filter(|value| **value < limit).count() as f64 / values.len() as f64
            };
            assert!((share(&exact) - share(&drawn)).abs() < 0.01, "{limit}");
        }
    }

    #[test]
    fn a_stratified_interval_matches_a_routine_that_sorts_and_slices() {
        let tasks: Vec<Vec<f64>> = (0..3)
            .map(|task| (0..32).map(|seed| f64::from((seed * 37 + task * 11) % 64) / 64.0).collect())
            .collect();
        let sample = of(&tasks.concat());
        let found =
            Resamples::new(&[32; 3], 20_000, 3).estimate(32, |counts| sample.interquartile_mean(counts)).unwrap();
        let (value, expected) = plainly(&tasks);
        assert!((found.value - value).abs() < 1e-12, "{} {value}", found.value);
        let interval = found.interval.unwrap();
        for side in 0..2 {
            assert!((interval[side] - expected[side]).abs() < 0.006, "{interval:?} {expected:?}");
        }
    }

    /// Interquartile mean and interval with another generator (xorshift), by copying and sorting.
    fn plainly(tasks: &[Vec<f64>]) -> (f64, [f64; 2]) {
        let mut state = 0x9E37_79B9_7F4A_7C15_u64;
        let mut below = |count: usize| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 33) as usize % count
        };
        let trimmed = |mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            let middle = &values[values.len() / 4..values.len() - values.len() / 4];
            middle.iter().sum::<f64>() / middle.len() as f64
        };
        let mut draws: Vec<f64> = (0..20_000)
            .map(|_| {
                let drawn = tasks.iter().flat_map(|task| (0..32).map(|_| task[below(32)]).collect::<Vec<_>>());
                trimmed(drawn.collect())
            })
            .collect();
        draws.sort_by(f64::total_cmp);
        (trimmed(tasks.concat()), [draws[500], draws[19_500]])
    }

    #[test]
    fn a_paired_difference_is_sharper_than_its_parts() {
        let noise = |unit: usize| (unit * 29 % 32) as f64;
        let (first, second) = (
            Sample::new((0..32).map(|unit| (unit, noise(unit) + 1.0))),
            Sample::new((0..32).map(|unit| (unit, noise(unit)))),
        );
        let resamples = Resamples::new(&[32], 2_000, 9);
        let difference = |counts: &[u16]| Some(first.mean(counts)? - second.mean(counts)?);
        let estimate = resamples.estimate(32, difference).unwrap();
        assert!((estimate.value - 1.0).abs() < 1e-12);
        let [low, high] = estimate.interval.unwrap();
        assert!(high - low < 1e-12);
    }

    #[test]
    fn values_of_a_seed_stay_together() {
        // Each seed has a zero and a one: drawn together their mean cannot vary, drawn apart it would.
        let sample = Sample::new((0..16).flat_map(|unit| [(unit, 0.0), (unit, 1.0)]));
        let estimate = Resamples::new(&[16], 500, 0).estimate(sample.units(), |counts| sample.mean(counts));
        assert_eq!(estimate, Some(Estimate { value: 0.5, interval: Some([0.5, 0.5]), units: 16 }));
    }

    #[test]
    fn a_repetition_does_not_depend_on_how_many_there_are() {
        let many = Resamples::new(&[4, 6], 100, 2);
        assert_eq!(many.first(10), Resamples::new(&[4, 6], 10, 2));
        assert!(
            many.iter().all(|counts| counts[..4].iter().sum::<u16>() == 4 && counts[4..].iter().sum::<u16>() == 6)
        );
        assert_ne!(many, Resamples::new(&[4, 6], 100, 3));
    }

    #[test]
    fn an_interval_lies_between_the_order_statistics() {
        let interval = percentile_interval((0..=100).rev().map(f64::from).collect()).unwrap();
        assert!((interval[0] - 2.5).abs() < 1e-9 && (interval[1] - 97.5).abs() < 1e-9);
        assert_eq!(percentile_interval(vec![3.0]), Some([3.0, 3.0]));
        assert_eq!(percentile_interval(Vec::new()), None);
    }

    #[test]
    fn one_unit_has_a_value_and_no_interval() {
        let estimate = Resamples::new(&[1], 100, 0).estimate(1, |counts| of(&[0.5]).mean(counts));
        assert_eq!(estimate, Some(Estimate { value: 0.5, interval: None, units: 1 }));
        assert_eq!(Resamples::new(&[], 100, 0).estimate(0, |counts| Sample::default().mean(counts)), None);
    }

    #[test]
    fn fifty_thousand_repetitions_take_about_a_second_or_less() {
        let started = Instant::now();
        let sample = Sample::new((0..96).map(|index| (index / 3, f64::from(index as u32 % 17))));
        let estimate =
            Resamples::new(&[32], REPETITIONS, 0).estimate(32, |counts| sample.interquartile_mean(counts));
        assert!(estimate.is_some());
        // Usually 0.02 s; the limit leaves room for a busy machine.
        assert!(started.elapsed().as_secs_f64() < 5.0, "{:?}", started.elapsed());
    }
}
