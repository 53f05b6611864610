//! What a drone knows of its state: how late, and how wrongly.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::ConfigError;
use super::field::{Field, Limits};
use super::start::{is_zero, range};
use crate::estimate::{Deviation, EstimateErrors};
use crate::latency::{Latency, Outages};

/// Longest delay of position and velocity, and longest outage: the simulation remembers every control period of it.
const LONGEST: Limits = Limits::from(0.0, 1.0, "s");

/// How late things are; each delay is uniform within its bounds and constant in an episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LatencyConfig {
    /// Least and greatest age of the state that policy and rate controller see, at most a control period.
    pub state_secs: [f64; 2],
    /// Least and greatest time from a command to the motors, at most a control period.
    pub motor_secs: [f64; 2],
    /// How much older than that the state may be: drawn anew for every control period, from zero to this.
    #[serde(skip_serializing_if = "is_zero")]
    pub state_jitter_secs: f64,
    /// How much later than that a command may reach the motors: drawn anew for every control period, from zero to this.
    #[serde(skip_serializing_if = "is_zero")]
    pub motor_jitter_secs: f64,
    /// How much older than `state_secs` position and velocity are, which come by radio or from a slower sensor: least and
    /// greatest, at most a second.
    #[serde(skip_serializing_if = "is_nothing")]
    pub position_extra_secs: [f64; 2],
    /// Times in which position and velocity stay what they were.
    #[serde(skip_serializing_if = "OutagesConfig::is_none")]
    pub outages: OutagesConfig,
}

/// Times in which position and velocity are not measured: the estimate holds what it had.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct OutagesConfig {
    /// How many begin in a second.
    pub per_sec: f64,
    /// Least and greatest length, at most a second.
    pub secs: [f64; 2],
}

/// How wrong the estimate is that policy and rate controller see in place of the state. Rewards, terminations and success
/// know the truth.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct EstimateConfig {
    /// Of the position, each axis \[m\].
    pub position_m: DeviationConfig,
    /// Of the velocity, each axis \[m/s\].
    pub velocity_m_per_s: DeviationConfig,
    /// Of where up is, about each horizontal axis \[degrees\].
    pub tilt_deg: DeviationConfig,
    /// Of the heading \[degrees\].
    pub heading_deg: DeviationConfig,
    /// Of the body rates, each axis \[rad/s\].
    pub body_rates_rad_per_s: DeviationConfig,
    /// Time in which a drift forgets all but a share of 1/e of itself.
    pub drift_secs: f64,
}

/// Standard deviations of an error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DeviationConfig {
    /// Of what is drawn anew for every control period.
    pub noise: f64,
    /// Of what wanders slowly, as a first-order Gauss–Markov process; episodes begin anywhere in it.
    pub drift: f64,
}

impl Default for EstimateConfig {
    fn default() -> Self {
        let none = DeviationConfig::default();
        Self {
            position_m: none,
            velocity_m_per_s: none,
            tilt_deg: none,
            heading_deg: none,
            body_rates_rad_per_s: none,
            drift_secs: 5.0,
        }
    }
}

fn is_nothing(bounds: &[f64; 2]) -> bool {
    *bounds == [0.0; 2]
}

impl LatencyConfig {
    pub(super) fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// The delays; those of the whole state and of motors are no longer than a control period \[s\].
    ///
    /// # Errors
    /// When a number is out of range.
    pub fn check(&self, control_secs: f64, field: &Field<'_>) -> Result<Latency, ConfigError> {
        let longest = Limits::from(0.0, control_secs, "s, the control period");
        let delay = |key: &str, bounds| range(&field.at(key), bounds, &longest);
        let jitter = |key: &str, secs: f64, [_, most]: [f64; 2]| {
            let left = Limits::from(0.0, control_secs - most, "s, what the delay leaves of the control period");
            field.at(key).number(secs, &left)
        };
        Ok(Latency {
            state_secs: delay("state_secs", self.state_secs)?,
            motor_secs: delay("motor_secs", self.motor_secs)?,
            state_jitter_secs: jitter("state_jitter_secs", self.state_jitter_secs, self.state_secs)?,
            motor_jitter_secs: jitter("motor_jitter_secs", self.motor_jitter_secs, self.motor_secs)?,
            position_extra_secs: range(&field.at("position_extra_secs"), self.position_extra_secs, &LONGEST)?,
            outages: self.outages.check(control_secs, &field.at("outages"))?,
        })
    }
}

impl OutagesConfig {
    fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// The outages, at most one in a control period.
    fn check(&self, control_secs: f64, field: &Field<'_>) -> Result<Outages, ConfigError> {
        let per_sec = field.at("per_sec").number(self.per_sec, &Limits::from(0.0, 1.0 / control_secs, "per s"))?;
        let secs = range(&field.at("secs"), self.secs, &LONGEST)?;
        Ok(if per_sec == 0.0 { Outages::NONE } else { Outages { per_sec, secs } })
    }
}

impl EstimateConfig {
    pub(super) fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// The errors.
    ///
    /// # Errors
    /// When a number is out of range.
    pub fn check(&self, field: &Field<'_>) -> Result<EstimateErrors, ConfigError> {
        let deviation = |key: &str, of: DeviationConfig, most: f64, unit| -> Result<Deviation, ConfigError> {
            let (field, limits) = (field.at(key), Limits::from(0.0, most, unit));
            Ok(Deviation {
                noise: field.at("noise").number(of.noise, &limits)?,
                drift: field.at("drift").number(of.drift, &limits)?,
            })
        };
        let angle = |key: &str, of: DeviationConfig| -> Result<Deviation, ConfigError> {
            let Deviation { noise, drift } = deviation(key, of, 30.0, "degrees")?;
            Ok(Deviation { noise: noise.to_radians(), drift: drift.to_radians() })
        };
        Ok(EstimateErrors {
            position: deviation("position_m", self.position_m, 10.0, "m")?,
            velocity: deviation("velocity_m_per_s", self.velocity_m_per_s, 10.0, "m/s")?,
            tilt: angle("tilt_deg", self.tilt_deg)?,
            heading: angle("heading_deg", self.heading_deg)?,
            body_rates: deviation("body_rates_rad_per_s", self.body_rates_rad_per_s, 10.0, "rad/s")?,
            drift_secs: field.at("drift_secs").number(self.drift_secs, &Limits::from(0.01, 1e4, "s"))?,
        })
    }
}
