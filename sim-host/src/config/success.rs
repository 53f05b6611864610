//! What counts as success, and how an episode's time is counted.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::area::BoxConfig;
use super::error::ConfigError;
use super::field::{Field, Limits};
use super::geometry::contains;
use crate::scenario::{Aviary, Clock, Success, TimeLimit};
use crate::termination::Termination;

const LENGTH: Limits = Limits::above(0.0, 1000.0, "m");
const SPEED: Limits = Limits::above(0.0, 20.0, "m/s");

/// What counts as success.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SuccessConfig {
    /// Near the goal in time, and staying there to the end of the episode.
    Settle {
        /// How near.
        radius_m: f64,
        /// How soon.
        within_secs: f64,
    },
    /// Inside a region and slow; this ends the episode.
    Reach {
        /// Where the centre of mass must be.
        region: BoxConfig,
        /// Greatest speed that counts.
        speed_limit_m_per_s: f64,
    },
    /// Inside a region for some control periods of an episode that does not fail.
    Visit {
        /// Where the centre of mass must be.
        region: BoxConfig,
        /// How many.
        #[serde(default = "one_period")]
        periods: u64,
    },
    /// One of the terminations that are successes.
    Ending,
}

/// How an episode's time is counted and what its end means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ClockConfig {
    /// Whether to count as the reference does: two control periods more, and moving goals one period late.
    pub as_published: bool,
    /// Whether running out of time is terminal, as in those aviaries of the reference that do not say otherwise; the
    /// default cuts the episode off, and its future still has worth.
    pub terminal: bool,
}

fn one_period() -> u64 {
    1
}

impl ClockConfig {
    /// How time is counted, and what its end means.
    pub fn check(self) -> (Clock, TimeLimit) {
        let clock = if self.as_published { Clock::Reference } else { Clock::Elapsed };
        (clock, if self.terminal { TimeLimit::Terminates } else { TimeLimit::Truncates })
    }
}

impl SuccessConfig {
    /// What counts as success in episodes of `episode_secs` with these terminations.
    ///
    /// # Errors
    /// When a number is out of range, the time is longer than the episode, the region lacks the goal, or nothing can
    /// be a success.
    pub fn check(
        &self,
        aviary: &Aviary,
        episode_secs: f64,
        terminations: &[Termination],
        field: &Field<'_>,
    ) -> Result<Success, ConfigError> {
        Ok(match self {
            Self::Settle { radius_m, within_secs } => {
                let field = field.at("settle");
                let time = Limits::above(0.0, episode_secs, "s, the episode");
                Success::Settle {
                    radius_m: field.at("radius_m").number(*radius_m, &LENGTH)?,
                    within_secs: field.at("within_secs").number(*within_secs, &time)?,
                }
            }
            Self::Reach { region, speed_limit_m_per_s } => {
                let field = field.at("reach");
                let checked = region.check(&field.at("region"))?;
                if !contains(&checked, &aviary.goal) {
                    return Err(field
                        .at("region")
                        .reject("a region without the goal", "one with `goal_m` inside"));
                }
                Success::Reach {
                    region: checked,
                    speed_limit: field.at("speed_limit_m_per_s").number(*speed_limit_m_per_s, &SPEED)?,
                }
            }
            Self::Visit { region, periods } => {
                let field = field.at("visit");
                Success::Visit {
                    region: region.check(&field.at("region"))?,
                    periods: field.at("periods").whole(*periods, 1..=100_000)? as u32,
                }
            }
            Self::Ending => {
                if !terminations.iter().any(Termination::is_success) {
                    let expected = "a termination that is a success, such as `landing`";
                    return Err(field.reject("`ending` without one", expected));
                }
                Success::Ending
            }
        })
    }
}
