//! One signal of a log with its own time stamps, and how it is read at others.

/// `N` values at each time stamp, in the order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track<const N: usize> {
    times_secs: Vec<f64>,
    values: Vec<[f64; N]>,
}

impl<const N: usize> Track<N> {
    /// Without samples.
    pub const fn new() -> Self {
        Self { times_secs: Vec::new(), values: Vec::new() }
    }

    /// Appends a sample; one that is not finite, or not later than the last, is dropped, as loggers repeat and
    /// reorder some.
    pub fn push(&mut self, time_secs: f64, value: [f64; N]) {
        let later = self.times_secs.last().is_none_or(|last| time_secs > *last);
        if later && time_secs.is_finite() && value.iter().all(|part| part.is_finite()) {
            self.times_secs.push(time_secs);
            self.values.push(value);
        }
    }

    /// Time stamps \[s\] and values.
    pub fn samples(&self) -> impl Iterator<Item = (f64, [f64; N])> {
        self.times_secs.iter().copied().zip(self.values.iter().copied())
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// First and last time stamp \[s\].
    pub fn span_secs(&self) -> Option<[f64; 2]> {
        Some([*self.times_secs.first()?, *self.times_secs.last()?])
    }

    /// Median time between samples \[s\].
    pub fn period_secs(&self) -> Option<f64> {
        let mut steps: Vec<f64> = self.times_secs.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).copied()
    }

    /// The same signal, each sample `secs` later.
    #[must_use]
    pub fn delayed(mut self, secs: f64) -> Self {
        for time in &mut self.times_secs {
            *time += secs;
        }
        self
    }

    /// Index of the last sample that is not later than `time_secs`.
    fn before(&self, time_secs: f64) -> Option<usize> {
        // Time stamps of a grid and of a log that share a clock differ by rounding alone.
        self.times_secs.partition_point(|time| *time <= time_secs + 1e-9).checked_sub(1)
    }

    /// The last sample at `time_secs`: commands hold until the next one.
    pub fn held(&self, time_secs: f64) -> Option<[f64; N]> {
        Some(self.values[self.before(time_secs)?])
    }

    /// On the straight line between the samples around `time_secs`, if they are at most `gap_secs` apart.
    pub fn interpolated(&self, time_secs: f64, gap_secs: f64) -> Option<[f64; N]> {
        let index = self.before(time_secs)?;
        let (time, value) = (self.times_secs[index], self.values[index]);
        let Some(next_time) = self.times_secs.get(index + 1) else {
            return (time_secs - time < 1e-6).then_some(value);
        };
        let (step, next) = (next_time - time, self.values[index + 1]);
        let share = ((time_secs - time) / step).clamp(0.0, 1.0);
        let between = std::array::from_fn(|part| value[part] + (next[part] - value[part]) * share);
        (step <= gap_secs || share < 1e-6).then_some(between)
    }

    /// Whether a sample lies within `gap_secs` before `time_secs`.
    pub fn covers(&self, time_secs: f64, gap_secs: f64) -> bool {
        self.before(time_secs).is_some_and(|index| time_secs - self.times_secs[index] <= gap_secs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Track<1> {
        let mut track = Track::new();
        for time in [0.0, 0.1, 0.2, 0.2, 0.1, f64::NAN, 1.0] {
            track.push(time, [10.0 * time]);
        }
        track.push(1.1, [f64::INFINITY]);
        track
    }

    #[test]
    fn repeated_reordered_and_infinite_samples_are_dropped() {
        assert_eq!((ramp().len(), ramp().span_secs()), (4, Some([0.0, 1.0])));
    }

    #[test]
    fn a_line_joins_samples_but_no_gap() {
        assert!((ramp().interpolated(0.15, 0.1001).unwrap()[0] - 1.5).abs() < 1e-12);
        assert_eq!(ramp().interpolated(0.5, 0.1), None);
        assert_eq!(ramp().interpolated(1.5, 0.1), None);
        assert_eq!(ramp().held(0.5), Some([2.0]));
        assert_eq!(ramp().held(-0.5), None);
        assert!(ramp().covers(0.25, 0.1) && !ramp().covers(0.5, 0.1));
    }

    #[test]
    fn a_delayed_track_says_the_same_later() {
        assert_eq!(ramp().delayed(2.0).held(2.05), Some([0.0]));
    }
}
