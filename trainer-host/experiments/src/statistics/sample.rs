//! Values and the seeds they came from.

use std::collections::BTreeMap;

/// Values in rising order, each with the unit (the seed) that it came from.
///
/// Every statistic takes `counts`, how often each unit is drawn, and treats a value as if it were there that often. It
/// is `None` when no drawn unit has a value.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sample {
    sorted: Vec<(f64, usize)>,
    /// Each unit that has values, their sum and their number: a mean need not visit the values.
    totals: Vec<(usize, f64, f64)>,
}

impl Sample {
    /// From pairs of a unit and a finite value.
    ///
    /// # Panics
    /// When a value is not finite.
    pub fn new(values: impl IntoIterator<Item = (usize, f64)>) -> Self {
        let mut sorted: Vec<(f64, usize)> = values.into_iter().map(|(unit, value)| (value, unit)).collect();
        assert!(sorted.iter().all(|(value, _)| value.is_finite()), "values of a sample are finite");
        sorted.sort_by(|first, second| first.0.total_cmp(&second.0).then(first.1.cmp(&second.1)));
        let mut totals: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
        for (value, unit) in &sorted {
            let (sum, count) = totals.entry(*unit).or_default();
            *sum += value;
            *count += 1.0;
        }
        let totals = totals.into_iter().map(|(unit, (sum, count))| (unit, sum, count)).collect();
        Self { sorted, totals }
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.sorted.len()
    }

    /// Whether there is no value.
    pub fn is_empty(&self) -> bool {
        self.sorted.is_empty()
    }

    /// Number of units that have a value.
    pub fn units(&self) -> usize {
        self.totals.len()
    }

    /// Arithmetic mean.
    pub fn mean(&self, counts: &[u16]) -> Option<f64> {
        let (mut sum, mut drawn) = (0.0, 0.0);
        for (unit, total, values) in &self.totals {
            let count = f64::from(counts[*unit]);
            sum += count * total;
            drawn += count * values;
        }
        (drawn > 0.0).then(|| sum / drawn)
    }

    /// Interquartile mean: the mean without the lowest and the highest quarter of the values, each rounded down, as
    /// `scipy.stats.trim_mean(values, 0.25)`.
    pub fn interquartile_mean(&self, counts: &[u16]) -> Option<f64> {
        let drawn: usize = self.sorted.iter().map(|(_, unit)| usize::from(counts[*unit])).sum();
        let cut = drawn / 4;
        let kept = cut..drawn - cut;
        let (mut sum, mut passed) = (0.0, 0);
        for (value, unit) in &self.sorted {
            let next = passed + usize::from(counts[*unit]);
            let inside = next.min(kept.end).saturating_sub(passed.max(kept.start));
            sum += inside as f64 * value;
            passed = next;
        }
        (drawn > 0).then(|| sum / kept.len() as f64)
    }

    /// Quantile at `share` in \[0, 1\]: the least value that at least this share of the values does not exceed.
    pub fn quantile(&self, counts: &[u16], share: f64) -> Option<f64> {
        let drawn: usize = self.sorted.iter().map(|(_, unit)| usize::from(counts[*unit])).sum();
        let mut passed = 0;
        self.sorted.iter().find_map(|(value, unit)| {
            passed += usize::from(counts[*unit]);
            (passed > 0 && passed as f64 >= share * drawn as f64).then_some(*value)
        })
    }

    /// Mean shortfall below `target`: values above it count as reaching it (Agarwal et al. 2021, optimality gap).
    pub fn optimality_gap(&self, counts: &[u16], target: f64) -> Option<f64> {
        let (mut sum, mut drawn) = (0.0, 0.0);
        for (value, unit) in &self.sorted {
            let count = f64::from(counts[*unit]);
            sum += count * (target - value).max(0.0);
            drawn += count;
        }
        (drawn > 0.0).then(|| sum / drawn)
    }

    /// Share of values above each of the rising `thresholds` (Agarwal et al. 2021, performance profile).
    pub fn shares_above(&self, counts: &[u16], thresholds: &[f64]) -> Option<Vec<f64>> {
        let drawn: f64 = self.sorted.iter().map(|(_, unit)| f64::from(counts[*unit])).sum();
        let mut values = self.sorted.iter().peekable();
        let mut above = drawn;
        let share = |threshold: &f64| {
            while let Some((_, unit)) = values.next_if(|(value, _)| value <= threshold) {
                above -= f64::from(counts[*unit]);
            }
            above / drawn
        };
        (drawn > 0.0).then(|| thresholds.iter().map(share).collect())
    }

    /// The values in rising order with their units.
    pub(super) fn sorted(&self) -> &[(f64, usize)] {
        &self.sorted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: &[f64]) -> Sample {
        Sample::new(values.iter().copied().enumerate())
    }

    #[test]
    fn the_interquartile_mean_matches_published_examples() {
        // Wikipedia, "Interquartile mean": twelve values, the middle six average 6.5.
        let values = [5.0, 8.0, 4.0, 38.0, 8.0, 6.0, 9.0, 7.0, 7.0, 3.0, 1.0, 6.0];
        assert_eq!(of(&values).interquartile_mean(&[1; 12]), Some(6.5));
        // SciPy's manual: trim_mean(arange(20), 0.1) is 9.5; any symmetric cut gives the same.
        let twenty: Vec<f64> = (0..20).map(f64::from).collect();
        assert_eq!(of(&twenty).interquartile_mean(&[1; 20]), Some(9.5));
        assert_eq!(of(&[1.0, 2.0, 6.0]).interquartile_mean(&[1; 3]), Some(3.0));
    }

    #[test]
    fn a_unit_drawn_twice_counts_as_if_its_values_were_there_twice() {
        let sample = of(&[3.0, 1.0, 4.0, 1.5, 9.0]);
        let twice = of(&[3.0, 3.0, 4.0, 9.0, 9.0, 9.0]);
        let counts = [2, 0, 1, 0, 3];
        assert_eq!(sample.mean(&counts), twice.mean(&[1; 6]));
        assert_eq!(sample.interquartile_mean(&counts), twice.interquartile_mean(&[1; 6]));
        assert_eq!(sample.optimality_gap(&counts, 4.0), twice.optimality_gap(&[1; 6], 4.0));
        assert_eq!(sample.shares_above(&counts, &[3.0, 5.0]), twice.shares_above(&[1; 6], &[3.0, 5.0]));
        assert_eq!(sample.quantile(&counts, 0.5), twice.quantile(&[1; 6], 0.5));
    }

    #[test]
    fn a_profile_falls_from_one_to_zero() {
        let profile = of(&[0.2, 0.4, 0.4, 1.0]).shares_above(&[1; 4], &[0.0, 0.2, 0.4, 0.9, 1.0]);
        assert_eq!(profile, Some(vec![1.0, 0.75, 0.25, 0.25, 0.0]));
    }

    #[test]
    fn the_optimality_gap_ignores_what_lies_above_the_target() {
        assert_eq!(of(&[0.5, 1.5]).optimality_gap(&[1; 2], 1.0), Some(0.25));
    }

    #[test]
    fn quantiles_are_values_of_the_sample() {
        let sample = of(&[4.0, 1.0, 3.0, 2.0]);
        let quantiles = [0.0, 0.25, 0.5, 0.75, 1.0].map(|share| sample.quantile(&[1; 4], share));
        assert_eq!(quantiles, [1.0, 1.0, 2.0, 3.0, 4.0].map(Some));
    }

    #[test]
    fn without_values_there_is_no_statistic() {
        let empty = Sample::default();
        assert!(empty.is_empty() && empty.units() == 0);
        assert_eq!((empty.mean(&[]), empty.interquartile_mean(&[]), empty.quantile(&[], 0.5)), (None, None, None));
        assert_eq!(of(&[1.0]).mean(&[0]), None);
        assert_eq!(of(&[1.0]).shares_above(&[0], &[0.0]), None);
    }
}
