//! The drone.

use kestrel_core::airframe::{Airframe, GRAVITY};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::airframe::{AirframeConfig, HOVER_SHARE, RotorOrderConfig};
use super::error::ConfigError;
use super::field::{Field, Limits};

/// Lightest drone \[kg\].
const MASS_LEAST: f64 = 0.001;

/// The drone.
#[derive(Clone, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct VehicleConfig {
    /// Which drone.
    pub airframe: AirframeConfig,
    /// Whose numbering of the rotors a known drone has; by default clockwise for both Crazyflies, and counter-clockwise
    /// for the others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotor_order: Option<RotorOrderConfig>,
    /// Take-off mass, if it is not the airframe's (a deck, another battery); the inertia stays.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass_kg: Option<f64>,
}

impl VehicleConfig {
    /// The airframe with its changes.
    ///
    /// # Errors
    /// When a number of the airframe is out of range, or the mass is not positive or more than the rotors lift.
    pub fn check(&self, field: &Field<'_>) -> Result<Airframe, ConfigError> {
        let airframe = self.airframe.check(self.rotor_order, &field.at("airframe"), &field.at("rotor_order"))?;
        let Some(mass) = self.mass_kg else { return Ok(airframe) };
        let heaviest = HOVER_SHARE * airframe.thrust_limit() / GRAVITY;
        let liftable = (heaviest * 1e3).floor() / 1e3;
        field.at("mass_kg").number(mass, &Limits::from(MASS_LEAST, liftable, "kg, which the rotors can lift"))?;
        Ok(Airframe { mass, ..airframe })
    }
}
