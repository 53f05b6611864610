//! What a study is expected to show, so that its report can say whether it does.

use kestrel_sim::config::{ConfigError, Field, Limits};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One expectation.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Claim {
    /// In words.
    pub claim: String,
    /// Name of the method that it is about.
    pub method: String,
    /// Which of its numbers.
    #[serde(default)]
    pub measure: Measure,
    /// What is expected of it.
    pub expected: Expected,
}

/// A number of a method.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Measure {
    /// Success after the last task, averaged over tasks.
    #[default]
    MeanSuccess,
    /// The lowest success of all tasks, each averaged over seeds.
    EveryTask,
    /// Mean success divided by that of joint training.
    OfJoint,
    /// Mean success divided by that of the experts.
    OfExperts,
    /// Success of each task right after it was trained, averaged.
    Plasticity,
}

/// What is expected of a number.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Expected {
    /// Its whole 95 % interval lies at or above this.
    AtLeast(f64),
    /// The mean success is above that of this method: the interval of their difference, seed by seed, is above zero.
    Above(String),
    /// The mean success is not shown to be above that of this method: the interval of their difference reaches zero or
    /// lies below it.
    NotAbove(String),
    /// The mean success is not inferior to that of a method: the interval of their difference lies above minus the margin.
    NotInferior {
        /// Name of the method.
        to: String,
        /// By how many points it may be lower.
        margin_points: f64,
    },
    /// Its stages take fewer steps until the threshold than those of this method, all tasks together, a stage that never
    /// gets there counted with its whole budget: the interval of their ratio is above one.
    FewerStepsThan(String),
    /// The mean return after the last task is above that of doing nothing, averaged over tasks.
    MoreThanDoingNothing,
}

impl Claim {
    /// Names of the methods that it is about.
    pub fn methods(&self) -> impl Iterator<Item = &str> {
        let other = match &self.expected {
            Expected::AtLeast(_) | Expected::MoreThanDoingNothing => None,
            Expected::Above(other)
            | Expected::NotAbove(other)
            | Expected::FewerStepsThan(other)
            | Expected::NotInferior { to: other, .. } => Some(other.as_str()),
        };
        [self.method.as_str()].into_iter().chain(other)
    }

    pub(super) fn check(&self, methods: &[&str], field: &Field<'_>) -> Result<(), ConfigError> {
        let known = |name: &str, field: &Field<'_>| {
            let listed = || format!("one of the methods: {}", methods.join(", "));
            if methods.contains(&name) { Ok(()) } else { Err(field.refuse(name, listed())) }
        };
        known(&self.method, &field.at("method"))?;
        let expected = field.at("expected");
        match &self.expected {
            Expected::AtLeast(least) => {
                expected.at("at_least").number(*least, &Limits::from(0.0, 1.0, "")).map(drop)
            }
            Expected::Above(other) => known(other, &expected.at("above")),
            Expected::NotAbove(other) => known(other, &expected.at("not_above")),
            Expected::NotInferior { to, margin_points } => {
                let field = expected.at("not_inferior");
                known(to, &field.at("to"))?;
                field.at("margin_points").number(*margin_points, &Limits::above(0.0, 100.0, "")).map(drop)
            }
            Expected::FewerStepsThan(other) => known(other, &expected.at("fewer_steps_than")),
            Expected::MoreThanDoingNothing => Ok(()),
        }?;
        if self.measure == Measure::MeanSuccess || matches!(self.expected, Expected::AtLeast(_)) {
            return Ok(());
        }
        Err(field.at("measure").reject("another measure", "none but with `at_least`"))
    }
}
