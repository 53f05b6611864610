//! Times until an event, where some runs ended before it came (Kaplan and Meier 1958).

/// How long one run was watched, in any unit of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Duration {
    /// The event came after this time.
    Reached(f64),
    /// The run ended after this time without the event: it would have come later, or never.
    Censored(f64),
}

/// Durations in rising order, each with the unit (the seed) that it came from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Durations {
    sorted: Vec<(Duration, usize)>,
}

/// Share of runs that still wait for the event, over time: a falling staircase from one.
#[derive(Clone, Debug, PartialEq)]
pub struct SurvivalCurve {
    /// Time of each step and the share behind it, rising in time.
    pub steps: Vec<(f64, f64)>,
}

/// What [`log_rank`] found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogRank {
    /// χ² with one degree of freedom.
    pub statistic: f64,
    /// Chance of at least such a statistic when the event comes equally fast in both groups.
    pub p: f64,
}

impl Duration {
    /// How long the run was watched.
    pub fn time(self) -> f64 {
        match self {
            Self::Reached(time) | Self::Censored(time) => time,
        }
    }

    /// Events before the ends of watching at the same time.
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        let rank = |duration: &Self| u8::from(matches!(duration, Self::Censored(_)));
        self.time().total_cmp(&other.time()).then(rank(self).cmp(&rank(other)))
    }
}

impl Durations {
    /// From pairs of a unit and how long it was watched.
    ///
    /// # Panics
    /// When a time is negative or not finite.
    pub fn new(durations: impl IntoIterator<Item = (usize, Duration)>) -> Self {
        let mut sorted: Vec<(Duration, usize)> =
            durations.into_iter().map(|(unit, duration)| (duration, unit)).collect();
        let sound = |duration: &Duration| duration.time().is_finite() && duration.time() >= 0.0;
        assert!(sorted.iter().all(|(duration, _)| sound(duration)), "durations are finite and not negative");
        sorted.sort_by(|first, second| first.0.order(&second.0).then(first.1.cmp(&second.1)));
        Self { sorted }
    }

    /// All of several lists.
    pub fn merged(lists: &[&Self]) -> Self {
        Self::new(lists.iter().flat_map(|list| list.sorted.iter().map(|(duration, unit)| (*unit, *duration))))
    }

    /// Number of runs.
    pub fn len(&self) -> usize {
        self.sorted.len()
    }

    /// Whether there is no run.
    pub fn is_empty(&self) -> bool {
        self.sorted.is_empty()
    }

    /// Number of units that have a run.
    pub fn units(&self) -> usize {
        let mut units: Vec<usize> = self.sorted.iter().map(|(_, unit)| *unit).collect();
        units.sort_unstable();
        units.dedup();
        units.len()
    }

    /// Longest time that a run was watched.
    pub fn longest(&self) -> Option<f64> {
        self.sorted.last().map(|(duration, _)| duration.time())
    }

    /// Share of runs whose event came, with units drawn as often as `counts` say.
    pub fn share_reached(&self, counts: &[u16]) -> Option<f64> {
        let drawn: f64 = self.sorted.iter().map(|(_, unit)| f64::from(counts[*unit])).sum();
        let reached = self.sorted.iter().filter(|(duration, _)| matches!(duration, Duration::Reached(_)));
        let reached: f64 = reached.map(|(_, unit)| f64::from(counts[*unit])).sum();
        (drawn > 0.0).then(|| reached / drawn)
    }

    /// Kaplan–Meier's estimate, with units drawn as often as `counts` say; `None` when no drawn unit has a run.
    pub fn curve(&self, counts: &[u16]) -> Option<SurvivalCurve> {
        let mut at_risk: f64 = self.sorted.iter().map(|(_, unit)| f64::from(counts[*unit])).sum();
        if at_risk == 0.0 {
            return None;
        }
        let mut steps: Vec<(f64, f64)> = Vec::new();
        let mut share = 1.0;
        let same_time = |first: &(Duration, usize), second: &(Duration, usize)| first.0.time() == second.0.time();
        for group in self.sorted.chunk_by(same_time) {
            let (events, leaving) = events_and_leaving(group, counts);
            if events > 0.0 {
                share *= (at_risk - events) / at_risk;
                steps.push((group[0].0.time(), share));
            }
            at_risk -= leaving;
        }
        Some(SurvivalCurve { steps })
    }
}

/// How many of a group have the event, and how many leave with or without it.
fn events_and_leaving(group: &[(Duration, usize)], counts: &[u16]) -> (f64, f64) {
    group.iter().fold((0.0, 0.0), |(events, leaving), (duration, unit)| {
        let count = f64::from(counts[*unit]);
        match duration {
            Duration::Reached(_) => (events + count, leaving + count),
            Duration::Censored(_) => (events, leaving + count),
        }
    })
}

impl SurvivalCurve {
    /// Share that still waits just after `time`.
    pub fn share_at(&self, time: f64) -> f64 {
        let passed = self.steps.partition_point(|(step, _)| *step <= time);
        if passed == 0 { 1.0 } else { self.steps[passed - 1].1 }
    }

    /// First time at which no more than half still waits; `None` when it never comes to that.
    pub fn median(&self) -> Option<f64> {
        // A share is a product of fractions: half may come out an ulp above it.
        self.steps.iter().find(|(_, share)| *share <= 0.5 + 1e-12).map(|(time, _)| *time)
    }

    /// Mean time that a run waits within the first `limit`: the area under the curve (Irwin 1949).
    pub fn restricted_mean(&self, limit: f64) -> f64 {
        let (mut area, mut from, mut share) = (0.0, 0.0, 1.0);
        for &(time, next) in self.steps.iter().take_while(|(time, _)| *time < limit) {
            area += share * (time - from);
            (from, share) = (time, next);
        }
        area + share * (limit - from)
    }
}

/// Log-rank test (Mantel 1966) of two groups, stratified: each pair is compared on its own, and the differences are
/// summed. `None` when no stratum holds an event while both groups are watched.
pub fn log_rank<'a>(strata: impl IntoIterator<Item = (&'a Durations, &'a Durations)>) -> Option<LogRank> {
    let (mut excess, mut variance) = (0.0, 0.0);
    for (first, second) in strata {
        let (more, spread) = excess_events(first, second);
        excess += more;
        variance += spread;
    }
    (variance > 0.0).then(|| {
        let statistic = excess * excess / variance;
        LogRank { statistic, p: libm::erfc((0.5 * statistic).sqrt()) }
    })
}

/// Events of `first` beyond those expected if both groups were one, and their variance (hypergeometric).
fn excess_events(first: &Durations, second: &Durations) -> (f64, f64) {
    let mut all: Vec<(Duration, usize)> = first.sorted.iter().map(|(duration, _)| (*duration, 0)).collect();
    all.extend(second.sorted.iter().map(|(duration, _)| (*duration, 1)));
    all.sort_by(|first, second| first.0.order(&second.0));
    let mut at_risk = [first.len() as f64, second.len() as f64];
    let (mut excess, mut variance) = (0.0, 0.0);
    for group in all.chunk_by(|first, second| first.0.time() == second.0.time()) {
        let [mine, theirs] = [[1, 0], [0, 1]].map(|counts| events_and_leaving(group, &counts));
        let (events, total) = (mine.0 + theirs.0, at_risk[0] + at_risk[1]);
        excess += mine.0 - events * at_risk[0] / total;
        if total > 1.0 {
            variance += events * at_risk[0] * at_risk[1] * (total - events) / (total * total * (total - 1.0));
        }
        at_risk = [at_risk[0] - mine.1, at_risk[1] - theirs.1];
    }
    (excess, variance)
}

#[cfg(test)]
mod tests {
    use super::Duration::{Censored, Reached};
    use super::*;

    fn of(durations: &[Duration]) -> Durations {
        Durations::new(durations.iter().copied().enumerate())
    }

    /// Weeks in remission on 6-MP (Freireich et al. 1963).
    fn treated() -> Durations {
        let reached = [6.0, 6.0, 6.0, 7.0, 10.0, 13.0, 16.0, 22.0, 23.0].map(Reached);
        let censored = [6.0, 9.0, 10.0, 11.0, 17.0, 19.0, 20.0, 25.0, 32.0, 32.0, 34.0, 35.0].map(Censored);
        of(&[&reached[..], &censored[..]].concat())
    }

    /// Weeks in remission on placebo.
    fn untreated() -> Durations {
        let weeks = [1, 1, 2, 2, 3, 4, 4, 5, 5, 8, 8, 8, 8, 11, 11, 12, 12, 15, 17, 22, 23];
        of(&weeks.map(|weeks| Reached(f64::from(weeks))))
    }

    #[test]
    fn the_estimate_matches_kaplan_and_meiers_own_example() {
        // Kaplan and Meier 1958, section 2: deaths at 0.8, 3.1, 5.4, 9.2, losses at 1.0, 2.7, 7.0, 12.1 months.
        let deaths = [0.8, 3.1, 5.4, 9.2].map(Reached);
        let losses = [1.0, 2.7, 7.0, 12.1].map(Censored);
        let curve = of(&[deaths, losses].concat()).curve(&[1; 8]).unwrap();
        let expected = [(0.8, 0.875), (3.1, 0.7), (5.4, 0.525), (9.2, 0.2625)];
        for ((time, share), expected) in curve.steps.iter().zip(expected) {
            assert!(*time == expected.0 && (share - expected.1).abs() < 1e-12, "{time} {share}");
        }
        assert_eq!(curve.median(), Some(9.2));
        assert!((curve.restricted_mean(12.1) - 7.178_75).abs() < 1e-12);
    }

    #[test]
    fn remissions_of_leukaemia_match_the_textbook() {
        // Kleinbaum and Klein 2012, table 2.1 and section IV: shares, medians 23 and 8, log-rank 16.79.
        let curve = treated().curve(&[1; 21]).unwrap();
        let shares = [0.8571, 0.8067, 0.7529, 0.6902, 0.6275, 0.5378, 0.4482];
        assert_eq!(curve.steps.len(), shares.len());
        for ((_, share), expected) in curve.steps.iter().zip(shares) {
            assert!((share - expected).abs() < 5e-5, "{share} {expected}");
        }
        let untreated_curve = untreated().curve(&[1; 21]).unwrap();
        assert_eq!((curve.median(), untreated_curve.median()), (Some(23.0), Some(8.0)));
        let test = log_rank([(&treated(), &untreated())]).unwrap();
        assert!((test.statistic - 16.79).abs() < 5e-3, "{test:?}");
        assert!((test.p - 4.17e-5).abs() < 1e-7, "{test:?}");
        // R's survfit prints the restricted means 23.29 (to week 35) and 8.67.
        assert!((curve.restricted_mean(35.0) - 23.29).abs() < 5e-3);
        assert!((untreated_curve.restricted_mean(35.0) - 182.0 / 21.0).abs() < 1e-12);
    }

    #[test]
    fn without_censoring_the_curve_is_the_share_and_its_area_the_mean() {
        let durations = of(&[4.0, 1.0, 3.0, 2.0].map(Reached));
        let curve = durations.curve(&[1; 4]).unwrap();
        let shares = [0.0, 1.0, 1.5, 2.0, 4.0].map(|time| curve.share_at(time));
        for (share, expected) in shares.into_iter().zip([1.0, 0.75, 0.75, 0.5, 0.0]) {
            assert!((share - expected).abs() < 1e-12);
        }
        assert!((curve.restricted_mean(10.0) - 2.5).abs() < 1e-12);
        assert!((curve.restricted_mean(1.5) - (1.0 + 0.75 * 0.5)).abs() < 1e-12);
        assert_eq!(curve.median(), Some(2.0));
        assert_eq!(durations.longest(), Some(4.0));
    }

    #[test]
    fn runs_that_never_reach_leave_no_median() {
        let never = of(&[Censored(5.0); 3]);
        let curve = never.curve(&[1; 3]).unwrap();
        assert_eq!((curve.median(), curve.restricted_mean(5.0)), (None, 5.0));
        assert_eq!(never.share_reached(&[1; 3]), Some(0.0));
        assert_eq!(log_rank([(&never, &never)]), None);
        assert_eq!(Durations::default().curve(&[]), None);
    }

    #[test]
    fn a_unit_drawn_twice_counts_twice() {
        let durations = of(&[Reached(1.0), Censored(2.0), Reached(3.0)]);
        let twice = of(&[Reached(1.0), Reached(1.0), Reached(3.0)]);
        assert_eq!(durations.curve(&[2, 0, 1]), twice.curve(&[1; 3]));
        assert_eq!(durations.share_reached(&[1, 1, 2]), Some(0.75));
    }

    #[test]
    fn equal_groups_do_not_differ_and_strata_do_not_mix() {
        assert!((log_rank([(&treated(), &treated())]).unwrap().p - 1.0).abs() < 1e-12);
        // Every stratum alone is balanced, although together the first group would look faster.
        let (quick, slow) = (of(&[Reached(1.0), Reached(2.0)]), of(&[Reached(10.0), Reached(20.0)]));
        let test = log_rank([(&quick, &quick), (&slow, &slow)]).unwrap();
        assert!(test.statistic < 1e-12);
    }
}
