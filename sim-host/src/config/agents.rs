//! Who flies together, and where each one's goal is.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::ConfigError;
use super::field::{Field, Limits};
use crate::scenario::{Agents, Goals, TeamEnd, TeamRewards};

/// Most drones in one environment; every one is tested against every other.
const DRONES_LIMIT: u64 = 256;

const SPEED: Limits = Limits::from(-20.0, 20.0, "m/s");
const LENGTH: Limits = Limits::from(-1000.0, 1000.0, "m");

/// Who flies together in one environment.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AgentsConfig {
    /// Drones in each environment.
    pub count: u64,
    /// What becomes of the others when one's episode ends.
    pub ends: TeamEndConfig,
    /// Whose rewards a drone is paid.
    pub rewards: TeamRewardsConfig,
}

/// What becomes of the others when one drone's episode ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TeamEndConfig {
    /// Their episodes end with it.
    #[default]
    Together,
    /// They fly on; the one starts anew.
    Alone,
}

/// Whose rewards a drone is paid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TeamRewardsConfig {
    /// Its own.
    #[default]
    Own,
    /// The sum over all drones of the environment.
    Shared,
}

/// How the goal differs between drones or moves in an episode; without it, it is the aviary's `goal_m` for all.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum GoalsConfig {
    /// One for each drone.
    PerAgent {
        /// `[x, y, z]` of each.
        points_m: Vec<[f64; 3]>,
    },
    /// From the aviary's goal along a line.
    Line {
        /// Its velocity.
        velocity_m_per_s: [f64; 3],
    },
    /// The aviary's goal plus `amplitude · cos(rate · t)`.
    Wave {
        /// Along x, y, z.
        amplitude_m: [f64; 3],
        /// Angle per second.
        rate_rad_per_s: f64,
        /// When it stops.
        until_secs: f64,
    },
}

impl Default for AgentsConfig {
    fn default() -> Self {
        Self { count: 1, ends: TeamEndConfig::Together, rewards: TeamRewardsConfig::Own }
    }
}

impl AgentsConfig {
    /// The drones.
    ///
    /// # Errors
    /// When there are none or too many.
    pub fn check(&self, field: &Field<'_>) -> Result<Agents, ConfigError> {
        Ok(Agents {
            count: field.at("count").whole(self.count, 1..=DRONES_LIMIT)? as u32,
            ends: match self.ends {
                TeamEndConfig::Together => TeamEnd::Together,
                TeamEndConfig::Alone => TeamEnd::Alone,
            },
            rewards: match self.rewards {
                TeamRewardsConfig::Own => TeamRewards::Own,
                TeamRewardsConfig::Shared => TeamRewards::Shared,
            },
        })
    }
}

impl GoalsConfig {
    /// The goals of `drones` drones.
    ///
    /// # Errors
    /// When a number is out of range or there is not one point for each drone.
    pub fn check(&self, drones: u32, field: &Field<'_>) -> Result<Goals, ConfigError> {
        match self {
            Self::PerAgent { points_m } => {
                let field = field.at("per_agent").at("points_m");
                if points_m.len() != drones as usize {
                    let found = format!("{} points", points_m.len());
                    return Err(field.reject(found, format!("{drones}, one for each drone")));
                }
                let point = |(index, point): (usize, &[f64; 3])| field.at(index).point(*point);
                points_m.iter().enumerate().map(point).collect::<Result<_, _>>().map(Goals::PerAgent)
            }
            Self::Line { velocity_m_per_s } => {
                let field = field.at("line").at("velocity_m_per_s");
                field.numbers(*velocity_m_per_s, &SPEED).map(Vector3::from).map(Goals::Line)
            }
            Self::Wave { amplitude_m, rate_rad_per_s, until_secs } => {
                let field = field.at("wave");
                Ok(Goals::Wave {
                    amplitude: field.at("amplitude_m").numbers(*amplitude_m, &LENGTH).map(Vector3::from)?,
                    rate: field
                        .at("rate_rad_per_s")
                        .number(*rate_rad_per_s, &Limits::from(-100.0, 100.0, "rad/s"))?,
                    until_secs: field.at("until_secs").number(*until_secs, &Limits::from(0.0, 600.0, "s"))?,
                })
            }
        }
    }
}
