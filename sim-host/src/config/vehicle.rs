//! The drone and how time advances.

use kestrel_core::airframe::{Airframe, GRAVITY};
use kestrel_core::dynamics::Integrator;
use kestrel_core::vehicle::Ground;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::airframe::{AirframeConfig, HOVER_SHARE, RotorOrderConfig};
use super::error::ConfigError;
use super::field::{Field, Limits};
use crate::scenario::Physics;

/// Lightest drone \[kg\].
const MASS_LEAST: f64 = 0.001;

/// Fewest physics steps per second: rotors with a time constant of 0.07 s need them.
const STEPS_PER_SECOND_LEAST: f64 = 50.0;

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

/// How time advances.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PhysicsConfig {
    /// Integrator of each substep.
    pub integrator: IntegratorConfig,
    /// Physics steps in one control period.
    pub substeps: u64,
    /// Actions per second.
    pub control_rate_hz: f64,
    /// Whether the ground at z = 0 cushions the rotors.
    pub ground_effect: bool,
}

/// The integrators.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum IntegratorConfig {
    /// First order, one evaluation per substep: fast.
    #[default]
    SemiImplicitEuler,
    /// Fourth order, four evaluations per substep: exact to rounding at 1 kHz.
    #[serde(rename = "runge_kutta_4")]
    RungeKutta4,
}

impl Default for PhysicsConfig {
    fn default() -> Self {
        Self {
            integrator: IntegratorConfig::SemiImplicitEuler,
            substeps: 2,
            control_rate_hz: 100.0,
            ground_effect: false,
        }
    }
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

impl PhysicsConfig {
    /// The integration.
    ///
    /// # Errors
    /// When a number is out of range or the physics steps are too long to be stable.
    pub fn check(&self, field: &Field<'_>) -> Result<Physics, ConfigError> {
        let substeps = field.at("substeps").whole(self.substeps, 1..=100)?;
        field.at("control_rate_hz").number(self.control_rate_hz, &Limits::from(10.0, 1000.0, "Hz"))?;
        let least = (STEPS_PER_SECOND_LEAST / self.control_rate_hz).ceil();
        if (substeps as f64) < least {
            let expected = format!(
                "at least {least} at {} Hz, which makes 50 physics steps per second",
                self.control_rate_hz
            );
            return Err(field.at("substeps").refuse(substeps, expected));
        }
        Ok(Physics {
            integrator: match self.integrator {
                IntegratorConfig::SemiImplicitEuler => Integrator::SemiImplicitEuler,
                IntegratorConfig::RungeKutta4 => Integrator::RungeKutta4,
            },
            substeps: substeps as u32,
            control_secs: (1.0 / self.control_rate_hz) as f32,
            ground: if self.ground_effect { Ground::Near } else { Ground::Distant },
        })
    }
}
