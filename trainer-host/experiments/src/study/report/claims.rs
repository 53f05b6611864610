//! What was expected, and whether it holds.

use super::comparison::difference;
use super::findings::Findings;
use super::notation::{
    NONE, hundredths_estimate, number, number_estimate, percent, percent_estimate, ratio_estimate,
};
use super::table::Table;
use super::threshold::multiple;
use crate::statistics::bootstrap::Estimate;
use crate::study::config::claim::{Claim, Expected, Measure};

/// Headings of the table of claims.
pub(super) const HEADINGS: [&str; 4] = ["claim", "found, with its 95 % interval", "expected", "verdict"];

/// Seeds without which a claim stays open: with fewer even these intervals are too narrow too often.
const SEEDS: usize = 8;

/// A rate of 0.9 is a little more or less than 0.9.
const ROUNDING: f64 = 1e-9;

/// What the numbers say of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    /// The interval lies where the claim says.
    Holds,
    /// It lies elsewhere.
    Fails,
    /// It reaches both sides, or the claim has too few seeds behind it.
    Open,
}

impl Findings<'_> {
    /// The claims of the study, each with the number behind it; empty without claims.
    pub(super) fn claims(&self) -> String {
        let claims = &self.data.manifest.claims;
        if claims.is_empty() {
            return String::new();
        }
        let mut table = Table::new(HEADINGS);
        for claim in claims {
            let (found, expected, verdict) = self.judged(claim);
            table.row([claim.claim.clone(), found, expected, verdict.map_or(NONE, Verdict::word).to_owned()]);
        }
        format!(
            "## Claims\n\nA claim holds when the whole interval is where it says, fails when the whole interval is elsewhere, \
             and is open otherwise, and with fewer than {SEEDS} seeds.\n\n{}",
            table.text()
        )
    }

    /// What was found for a claim, what it expects, and the verdict; none while there are no rows.
    fn judged(&self, claim: &Claim) -> (String, String, Option<Verdict>) {
        match &claim.expected {
            Expected::AtLeast(least) => {
                let (estimate, of) = self.measured(claim);
                let verdict = estimate.map(|estimate| verdict(estimate, *least - ROUNDING));
                (
                    format!("`{}`{of}: {}", claim.method, percent_estimate(estimate)),
                    format!("at least {}", percent(*least)),
                    verdict,
                )
            }
            Expected::Above(other) => {
                let (found, estimate) = self.compared(&claim.method, other);
                (found, "above 0".to_owned(), estimate.map(|estimate| verdict(estimate, f64::MIN_POSITIVE)))
            }
            Expected::NotAbove(other) => {
                let (found, estimate) = self.compared(&claim.method, other);
                let verdict = estimate.map(|estimate| match verdict(estimate, f64::MIN_POSITIVE) {
                    Verdict::Open if estimate.units < SEEDS => Verdict::Open,
                    Verdict::Holds => Verdict::Fails,
                    Verdict::Fails | Verdict::Open => Verdict::Holds,
                });
                (found, "not above 0".to_owned(), verdict)
            }
            Expected::NotInferior { to, margin_points } => {
                let (found, estimate) = self.compared(&claim.method, to);
                let verdict = estimate.map(|estimate| verdict(estimate, -margin_points / 100.0));
                (found, format!("above −{margin_points}"), verdict)
            }
            Expected::FewerStepsThan(other) => {
                let cost = self.cost(&claim.method, other);
                let found =
                    format!("`{other}` takes {} times the steps of `{}`", ratio_estimate(cost), claim.method);
                (found, "above 1".to_owned(), cost.map(|cost| verdict(cost, 1.0 + ROUNDING)))
            }
            Expected::MoreThanDoingNothing => self.beside_doing_nothing(&claim.method),
        }
    }

    /// The steps of `other` as a multiple of those of `method`, over all tasks.
    fn cost(&self, method: &str, other: &str) -> Option<Estimate> {
        let learning = |name| {
            let place = self.place(name)?;
            self.learnings.iter().find(|learning| learning.method == place)
        };
        let [mine, theirs] =
            [learning(method)?, learning(other)?].map(|learning| learning.tasks.iter().collect::<Vec<_>>());
        multiple(self.summary, &theirs, &mine, self.data.manifest.steps_per_stage as f64)
    }

    fn beside_doing_nothing(&self, method: &str) -> (String, String, Option<Verdict>) {
        let found = self.place(method).and_then(|place| self.summary.methods[place].episode_return);
        let tasks = 0..self.data.manifest.tasks.len();
        let returns: Option<Vec<f64>> = tasks.map(|task| self.data.manifest.return_of_nothing(task)).collect();
        let nothing = returns.map(|returns| returns.iter().sum::<f64>() / returns.len() as f64);
        let verdict = found.zip(nothing).map(|(found, nothing)| verdict(found, nothing + ROUNDING));
        let expected = format!("above {}, doing nothing", nothing.map_or(NONE.to_owned(), number));
        (format!("return of `{method}`: {}", number_estimate(found)), expected, verdict)
    }

    /// The number of an absolute claim, and of what it is.
    fn measured(&self, claim: &Claim) -> (Option<Estimate>, String) {
        let Some(place) = self.place(&claim.method) else { return (None, String::new()) };
        let found = &self.summary.methods[place];
        match claim.measure {
            Measure::MeanSuccess => (found.mean, String::new()),
            Measure::OfJoint => (found.of_joint, " of joint training".to_owned()),
            Measure::OfExperts => (found.of_experts, " of the experts".to_owned()),
            Measure::Plasticity => (found.plasticity, " when it is a task's turn".to_owned()),
            Measure::EveryTask => {
                let tasks = found.tasks.iter().zip(&self.data.manifest.tasks);
                let known = tasks.filter_map(|(task, named)| Some((task.success?, named)));
                let lowest = known.min_by(|(one, _), (other, _)| {
                    low(one).total_cmp(&low(other)).then(one.value.total_cmp(&other.value))
                });
                let name = lowest
                    .as_ref()
                    .map_or(String::new(), |(_, task)| format!(" in {}, its worst task", task.name));
                (lowest.map(|(estimate, _)| estimate), name)
            }
        }
    }

    fn compared(&self, method: &str, other: &str) -> (String, Option<Estimate>) {
        let places = self.place(method).zip(self.place(other));
        let estimate = places.and_then(|(one, other)| difference(self.data, self.summary, one, other));
        (format!("`{method}` − `{other}`: {} points", hundredths_estimate(estimate)), estimate)
    }

    fn place(&self, method: &str) -> Option<usize> {
        self.data.manifest.methods.iter().position(|known| known.name == method)
    }
}

impl Verdict {
    fn word(self) -> &'static str {
        match self {
            Self::Holds => "**holds**",
            Self::Fails => "**fails**",
            Self::Open => "open",
        }
    }
}

fn low(estimate: &Estimate) -> f64 {
    estimate.interval.map_or(estimate.value, |[low, _]| low)
}

/// Where an estimate lies beside a bound from below.
fn verdict(estimate: Estimate, least: f64) -> Verdict {
    match estimate.interval {
        Some([low, _]) if low >= least && estimate.units >= SEEDS => Verdict::Holds,
        Some([_, high]) if high < least && estimate.units >= SEEDS => Verdict::Fails,
        Some(_) | None => Verdict::Open,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(interval: Option<[f64; 2]>) -> Estimate {
        Estimate { value: 0.5, interval, units: 8 }
    }

    #[test]
    fn only_whole_intervals_decide() {
        assert_eq!(verdict(estimate(Some([0.9, 0.95])), 0.9), Verdict::Holds);
        assert_eq!(verdict(estimate(Some([0.85, 0.95])), 0.9), Verdict::Open);
        assert_eq!(verdict(estimate(Some([0.7, 0.89])), 0.9), Verdict::Fails);
        assert_eq!(verdict(estimate(None), 0.1), Verdict::Open);
        assert_eq!(verdict(Estimate { units: SEEDS - 1, ..estimate(Some([0.9, 0.95])) }, 0.9), Verdict::Open);
        assert_eq!(verdict(Estimate { units: SEEDS - 1, ..estimate(Some([0.7, 0.8])) }, 0.9), Verdict::Open);
        assert_eq!(verdict(estimate(Some([0.0, 0.0])), f64::MIN_POSITIVE), Verdict::Fails);
    }
}
