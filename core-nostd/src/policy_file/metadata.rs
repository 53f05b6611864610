//! What a firmware must know about a policy besides its weights.

use serde::{Deserialize, Serialize};

use super::PolicyError;
use crate::action::ActionSpace;
use crate::observation::ObservationLayout;

/// Most bytes of a name.
pub const NAME_LIMIT: usize = 64;

/// The metadata of a policy, in postcard encoding inside the file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PolicyMetadata<'a> {
    /// What the policy does, in UTF-8, at most [`NAME_LIMIT`] bytes; the scenario's name by default.
    pub name: &'a str,
    /// What it sees.
    pub observation: ObservationLayout,
    /// What it commands.
    pub action: ActionSpace,
    /// Time between two calls in training \[s\]; call it at this pace.
    pub control_period_secs: f32,
    /// Seed of the training run.
    pub seed: u64,
    /// Environment steps it was trained for.
    pub training_steps: u64,
}

/// Number of `layout` in the header of a policy file.
pub(crate) const fn layout_identifier(layout: &ObservationLayout) -> u16 {
    match layout {
        ObservationLayout::Pilot(_) => 1,
    }
}

/// Number of `space` in the header of a policy file.
pub(crate) const fn action_identifier(space: &ActionSpace) -> u16 {
    match space {
        ActionSpace::RotorSpeeds(_) => 1,
        ActionSpace::ThrustBodyRates(_) => 2,
    }
}

impl PolicyMetadata<'_> {
    /// Refuses numbers with which a flight would compute nonsense.
    pub(crate) fn check(&self) -> Result<(), PolicyError> {
        if self.name.len() > NAME_LIMIT {
            return Err(PolicyError::Name { found: self.name.len(), expected: NAME_LIMIT });
        }
        positive("control_period_secs", self.control_period_secs)?;
        check_observation(&self.observation)?;
        check_action(&self.action)
    }
}

fn check_observation(layout: &ObservationLayout) -> Result<(), PolicyError> {
    let ObservationLayout::Pilot(pilot) = layout;
    positive("position_scale_m", pilot.position_scale_m)?;
    positive("velocity_scale", pilot.velocity_scale)?;
    positive("body_rates_scale", pilot.body_rates_scale)
}

fn check_action(space: &ActionSpace) -> Result<(), PolicyError> {
    match space {
        ActionSpace::RotorSpeeds(space) => {
            positive("hover_rotor_speed", space.hover_rotor_speed)?;
            positive("rotor_speed_limit", space.rotor_speed_limit)?;
            positive("fraction", space.fraction)
        }
        ActionSpace::ThrustBodyRates(space) => {
            positive("hover_speed_squared", space.hover_speed_squared)?;
            positive("speed_squared_limit", space.speed_squared_limit)?;
            positive("thrust_fraction", space.thrust_fraction)?;
            let numbers = space.body_rates_limit.iter().chain(&space.rate_gains).chain(space.mixer.as_flattened());
            numbers.copied().try_for_each(|number| finite("a controller gain", number))
        }
    }
}

fn positive(field: &'static str, found: f32) -> Result<(), PolicyError> {
    // Subnormal scales would turn into infinite factors.
    let valid = found.is_normal() && found > 0.0;
    valid.then_some(()).ok_or(PolicyError::MetadataValue { field, found, expected: "a positive number" })
}

fn finite(field: &'static str, found: f32) -> Result<(), PolicyError> {
    found.is_finite().then_some(()).ok_or(PolicyError::MetadataValue { field, found, expected: "a finite number" })
}
