//! What policy and critic see, and what the policy commands.

use kestrel_core::action::{ActionSpace, RotorSpeeds, ThrustBodyRates};
use kestrel_core::airframe::{Airframe, GRAVITY};
use kestrel_core::observation::{ObservationLayout, PilotLayout};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::ConfigError;
use super::field::{Field, Limits};
use crate::scenario::CriticView;

const FRACTION: Limits = Limits::above(0.0, 1.0, "");
const BODY_RATES: Limits = Limits::above(0.0, 100.0, "rad/s");

/// What four numbers in -1 to 1 mean.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActionConfig {
    /// One speed per rotor.
    RotorSpeeds(RotorSpeedsConfig),
    /// Collective thrust and body rates, which a rate controller tracks.
    ThrustBodyRates(ThrustBodyRatesConfig),
}

/// One speed per rotor, around the one at which the drone hovers.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RotorSpeedsConfig {
    /// A full action changes the hover speed by this fraction, in (0, 1]. The Crazyflie's rotors reach 1.5 times the
    /// hover speed, so 0.5 is all they have; the reference system has 0.05.
    pub fraction_of_hover: f64,
}

/// Collective thrust and body rates.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ThrustBodyRatesConfig {
    /// A full action changes the hover thrust by this fraction; 1.25 is all that the Crazyflie has.
    pub fraction_of_hover: f64,
    /// Body rates about x, y, z that a full action asks for.
    pub body_rates_limit_rad_per_s: [f64; 3],
    /// Angular acceleration per error of the body rates. Above 10 the rotors' lag of 0.1 s makes them overshoot.
    pub rate_gains_per_s: [f64; 3],
}

/// What the policy sees.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObservationConfig {
    /// Position relative to the goal, rotation matrix, velocity, body rates, previous action: 22 values.
    Pilot(PilotConfig),
}

/// What the `pilot` observation divides by, so that all values are of order one.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PilotConfig {
    /// Distance from the goal that reads as one; of farther goals only the direction is seen.
    pub position_scale_m: f64,
    /// Speed that reads as one.
    pub velocity_scale_m_per_s: f64,
    /// Angular velocity that reads as one.
    pub body_rates_scale_rad_per_s: f64,
}

/// What the critic sees while training.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CriticConfig {
    /// What the policy sees.
    #[default]
    Observation,
    /// Also rotor speeds, wind, the episode's parameters and the time left, which only a simulator knows.
    Privileged,
}

impl Default for ActionConfig {
    fn default() -> Self {
        Self::RotorSpeeds(RotorSpeedsConfig::default())
    }
}

impl Default for RotorSpeedsConfig {
    fn default() -> Self {
        Self { fraction_of_hover: 0.5 }
    }
}

impl Default for ThrustBodyRatesConfig {
    /// With a rotor lag of about 0.09 s, a gain of 8 per second damps the rates at 0.6.
    fn default() -> Self {
        Self {
            fraction_of_hover: 1.0,
            body_rates_limit_rad_per_s: [10.0, 10.0, 5.0],
            rate_gains_per_s: [8.0, 8.0, 4.0],
        }
    }
}

impl Default for ObservationConfig {
    fn default() -> Self {
        Self::Pilot(PilotConfig::default())
    }
}

impl Default for PilotConfig {
    fn default() -> Self {
        Self { position_scale_m: 1.0, velocity_scale_m_per_s: 2.0, body_rates_scale_rad_per_s: 10.0 }
    }
}

impl ActionConfig {
    /// The action space around the hover of `airframe`.
    ///
    /// # Errors
    /// When a number is out of range.
    pub fn check(&self, airframe: &Airframe, field: &Field<'_>) -> Result<ActionSpace, ConfigError> {
        match self {
            Self::RotorSpeeds(config) => {
                let field = field.at("rotor_speeds").at("fraction_of_hover");
                let fraction = field.number(config.fraction_of_hover, &FRACTION)?;
                Ok(ActionSpace::RotorSpeeds(RotorSpeeds::new(airframe, fraction)))
            }
            Self::ThrustBodyRates(config) => {
                config.check(airframe, &field.at("thrust_body_rates")).map(ActionSpace::ThrustBodyRates)
            }
        }
    }
}

impl ThrustBodyRatesConfig {
    fn check(&self, airframe: &Airframe, field: &Field<'_>) -> Result<ThrustBodyRates, ConfigError> {
        let spare = airframe.thrust_limit() / (airframe.mass * GRAVITY) - 1.0;
        let thrust = Limits::above(0.0, (spare * 1e3).round() / 1e3, "");
        Ok(ThrustBodyRates::new(
            airframe,
            field.at("fraction_of_hover").number(self.fraction_of_hover, &thrust)?,
            field.at("body_rates_limit_rad_per_s").numbers(self.body_rates_limit_rad_per_s, &BODY_RATES)?,
            field.at("rate_gains_per_s").numbers(self.rate_gains_per_s, &Limits::above(0.0, 100.0, "1/s"))?,
        ))
    }
}

impl ObservationConfig {
    /// The layout.
    ///
    /// # Errors
    /// When a scale is out of range.
    pub fn check(&self, field: &Field<'_>) -> Result<ObservationLayout, ConfigError> {
        let Self::Pilot(config) = self;
        let field = field.at("pilot");
        let scale = |key: &str, value: f64, unit| field.at(key).number(value, &Limits::from(0.01, 1000.0, unit));
        Ok(ObservationLayout::Pilot(PilotLayout {
            position_scale_m: scale("position_scale_m", config.position_scale_m, "m")?,
            velocity_scale: scale("velocity_scale_m_per_s", config.velocity_scale_m_per_s, "m/s")?,
            body_rates_scale: scale("body_rates_scale_rad_per_s", config.body_rates_scale_rad_per_s, "rad/s")?,
        }))
    }
}

impl CriticConfig {
    /// The critic's view.
    pub fn check(self) -> CriticView {
        match self {
            Self::Observation => CriticView::Observation,
            Self::Privileged => CriticView::Privileged,
        }
    }
}
