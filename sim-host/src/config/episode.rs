//! What is rewarded, what ends an episode, what counts as success.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::aviary::BoxConfig;
use super::error::ConfigError;
use super::field::{Field, Limits};
use super::geometry::contains;
use crate::scenario::{Aviary, RewardTerm, Success, Termination, WeightedTerm};

/// Most reward terms; every one is a column of the log.
const REWARDS_LIMIT: usize = 16;

const WEIGHT: Limits = Limits::from(-10_000.0, 10_000.0, "");
const LENGTH: Limits = Limits::above(0.0, 1000.0, "m");

/// One reward term. All but `progress`, `success` and `failure` are paid per second; a penalty has a negative weight.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum RewardConfig {
    /// One for being in the air.
    Alive {
        /// What one unit is worth.
        weight: f64,
    },
    /// `1 / (1 + (d / scale)²)` of the distance d to the goal.
    Proximity {
        /// What one unit is worth.
        weight: f64,
        /// Distance at which it is one half.
        scale_m: f64,
    },
    /// Distance to the goal in metres.
    Distance {
        /// What one unit is worth.
        weight: f64,
    },
    /// Squared speed in m²/s².
    Velocity {
        /// What one unit is worth.
        weight: f64,
    },
    /// Squared angular velocity in rad²/s².
    BodyRates {
        /// What one unit is worth.
        weight: f64,
    },
    /// One minus the cosine of the tilt.
    Tilt {
        /// What one unit is worth.
        weight: f64,
    },
    /// Squared action.
    Action {
        /// What one unit is worth.
        weight: f64,
    },
    /// Squared change of the action since the last step.
    ActionChange {
        /// What one unit is worth.
        weight: f64,
    },
    /// Metres that the drone came closer to the goal in this step.
    Progress {
        /// What one unit is worth.
        weight: f64,
    },
    /// One, once, when the episode ends in success.
    Success {
        /// What one unit is worth.
        weight: f64,
    },
    /// One, once, when a termination ends the episode.
    Failure {
        /// What one unit is worth.
        weight: f64,
    },
}

/// What ends an episode in failure.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum TerminationConfig {
    /// The drone touches a solid or the floor.
    Collision,
    /// The centre of mass leaves the box.
    OutOfBounds(BoxConfig),
    /// The tilt exceeds the limit.
    Tilt {
        /// Greatest tilt.
        limit_deg: f64,
    },
    /// The drone is too far from the goal.
    Distance {
        /// Greatest distance.
        limit_m: f64,
    },
}

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
}

impl RewardConfig {
    /// The reward terms, at least one.
    ///
    /// # Errors
    /// When the list is empty or too long, or a number is out of range.
    pub fn check_all(rewards: &[Self], field: &Field<'_>) -> Result<Vec<WeightedTerm>, ConfigError> {
        if rewards.is_empty() || rewards.len() > REWARDS_LIMIT {
            return Err(field.refuse("", format!("a list of 1 to {REWARDS_LIMIT}")));
        }
        rewards.iter().enumerate().map(|(index, reward)| reward.check(&field.at(index))).collect()
    }

    fn check(&self, field: &Field<'_>) -> Result<WeightedTerm, ConfigError> {
        let (term, weight) = match *self {
            Self::Alive { weight } => (RewardTerm::Alive, weight),
            Self::Proximity { weight, scale_m } => {
                let scale_m = field.at("proximity").at("scale_m").number(scale_m, &LENGTH)?;
                (RewardTerm::Proximity { scale_m }, weight)
            }
            Self::Distance { weight } => (RewardTerm::Distance, weight),
            Self::Velocity { weight } => (RewardTerm::Velocity, weight),
            Self::BodyRates { weight } => (RewardTerm::BodyRates, weight),
            Self::Tilt { weight } => (RewardTerm::Tilt, weight),
            Self::Action { weight } => (RewardTerm::Action, weight),
            Self::ActionChange { weight } => (RewardTerm::ActionChange, weight),
            Self::Progress { weight } => (RewardTerm::Progress, weight),
            Self::Success { weight } => (RewardTerm::Success, weight),
            Self::Failure { weight } => (RewardTerm::Failure, weight),
        };
        Ok(WeightedTerm { weight: field.at(term.name()).at("weight").number(weight, &WEIGHT)?, term })
    }
}

impl TerminationConfig {
    /// The terminations.
    ///
    /// # Errors
    /// When a number is out of range or the goal itself ends the episode.
    pub fn check_all(
        terminations: &[Self],
        aviary: &Aviary,
        field: &Field<'_>,
    ) -> Result<Vec<Termination>, ConfigError> {
        terminations.iter().enumerate().map(|(index, each)| each.check(aviary, &field.at(index))).collect()
    }

    fn check(&self, aviary: &Aviary, field: &Field<'_>) -> Result<Termination, ConfigError> {
        match self {
            Self::Collision => Ok(Termination::Collision),
            Self::OutOfBounds(bounds) => {
                let field = field.at("out_of_bounds");
                let bounds = bounds.check(&field)?;
                if !contains(&bounds, &aviary.goal) {
                    return Err(field.reject("bounds without the goal", "bounds with `goal_m` inside"));
                }
                Ok(Termination::OutOfBounds(bounds))
            }
            Self::Tilt { limit_deg } => {
                let limits = Limits::above(0.0, 180.0, "degrees");
                let limit = field.at("tilt").at("limit_deg").number(*limit_deg, &limits)?;
                Ok(Termination::Tilt { limit: limit.to_radians() })
            }
            Self::Distance { limit_m } => Ok(Termination::Distance {
                limit_m: field.at("distance").at("limit_m").number(*limit_m, &LENGTH)?,
            }),
        }
    }
}

impl SuccessConfig {
    /// What counts as success in episodes of `episode_secs`.
    ///
    /// # Errors
    /// When a number is out of range, the time is longer than the episode, or the region lacks the goal.
    pub fn check(&self, aviary: &Aviary, episode_secs: f64, field: &Field<'_>) -> Result<Success, ConfigError> {
        match self {
            Self::Settle { radius_m, within_secs } => {
                let field = field.at("settle");
                let time = Limits::above(0.0, episode_secs, "s, the episode");
                Ok(Success::Settle {
                    radius_m: field.at("radius_m").number(*radius_m, &LENGTH)?,
                    within_secs: field.at("within_secs").number(*within_secs, &time)?,
                })
            }
            Self::Reach { region, speed_limit_m_per_s } => {
                let field = field.at("reach");
                let speed = Limits::above(0.0, 20.0, "m/s");
                let checked = region.check(&field.at("region"))?;
                if !contains(&checked, &aviary.goal) {
                    return Err(field
                        .at("region")
                        .reject("a region without the goal", "one with `goal_m` inside"));
                }
                Ok(Success::Reach {
                    region: checked,
                    speed_limit: field.at("speed_limit_m_per_s").number(*speed_limit_m_per_s, &speed)?,
                })
            }
        }
    }
}
