//! The drone and how time advances.

use kestrel_core::airframe::{Airframe, CF2P, CF2X, GRAVITY};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::ConfigError;
use super::field::{Field, Limits};

/// Lightest drone \[kg\].
const MASS_LEAST: f64 = 0.001;

/// Share of the full thrust that hovering may need, so that there is some left to steer with.
const HOVER_SHARE: f64 = 0.9;

/// The drone.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct VehicleConfig {
    /// Which drone.
    pub airframe: AirframeConfig,
    /// Take-off mass, if it is not the airframe's (a deck, another battery); the inertia stays.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass_kg: Option<f64>,
}

/// The known drones.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AirframeConfig {
    /// Crazyflie 2.x, rotors diagonal to the direction of flight.
    #[default]
    Cf2x,
    /// Crazyflie 2.x, one rotor ahead.
    Cf2p,
}

impl VehicleConfig {
    /// The airframe with its changes.
    ///
    /// # Errors
    /// When the mass is not positive or more than the rotors lift.
    pub fn check(&self, field: &Field<'_>) -> Result<Airframe, ConfigError> {
        let airframe = match self.airframe {
            AirframeConfig::Cf2x => CF2X,
            AirframeConfig::Cf2p => CF2P,
        };
        let Some(mass) = self.mass_kg else { return Ok(airframe) };
        let heaviest = HOVER_SHARE * airframe.thrust_limit() / GRAVITY;
        let liftable = (heaviest * 1e3).floor() / 1e3;
        field.at("mass_kg").number(mass, &Limits::from(MASS_LEAST, liftable, "kg, which the rotors can lift"))?;
        Ok(Airframe { mass, ..airframe })
    }
}
