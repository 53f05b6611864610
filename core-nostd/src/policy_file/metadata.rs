//! What a firmware must know about a policy besides its weights.

use serde::{Deserialize, Serialize};

use super::airframe::PolicyAirframe;
use crate::action::{ActionSpace, ThrustBodyRates, Velocities};
use crate::limits::ACTION_LEN;
use crate::observation::{ObservationLayout, PilotLayout};
use crate::policy_error::{PolicyError, finite, holds, positive};

/// Most bytes of a name.
pub const NAME_LIMIT: usize = 64;

/// Layouts are numbered from one to this.
pub(crate) const LAYOUT_COUNT: u16 = PX4_NEURAL;

/// Number of the layout `px4_neural`.
pub(crate) const PX4_NEURAL: u16 = 8;

/// Action spaces are numbered from one to this.
pub(crate) const SPACE_COUNT: u16 = THRUST_TORQUES;

/// Number of the action space `rotor_thrusts`.
pub(crate) const ROTOR_THRUSTS: u16 = 5;

/// Number of the action space `thrust_body_rates` with a rate loop.
const RATE_LOOP: u16 = 6;

/// Number of the action space `velocity` with an integral.
const INTEGRAL_VELOCITIES: u16 = 7;

/// Number of the action space `thrust_torques`.
const THRUST_TORQUES: u16 = 8;

/// The metadata of a policy, in postcard encoding inside the file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PolicyMetadata<'a> {
    /// What the policy does, in UTF-8, at most [`NAME_LIMIT`] bytes; the scenario's name by default.
    pub name: &'a str,
    /// What it observes.
    pub observation: ObservationLayout,
    /// What it commands.
    pub action: ActionSpace,
    /// Time between two calls in training \[s\]; call it at this pace.
    pub control_period_secs: f32,
    /// Seed of the training run.
    pub seed: u64,
    /// Environment steps it was trained for.
    pub training_steps: u64,
    /// The drone that it learned to fly; `None` in files of before this was written.
    #[serde(skip)]
    pub airframe: Option<PolicyAirframe>,
}

/// Number of `layout` in the header of a policy file.
pub(crate) const fn layout_identifier(layout: &ObservationLayout) -> u16 {
    match layout {
        ObservationLayout::Pilot(_) => 1,
        ObservationLayout::Reference(_) => 2,
        ObservationLayout::Kinematic(_) => 3,
        ObservationLayout::Measured(_) => 4,
        ObservationLayout::PilotFor(_) => 5,
        ObservationLayout::PilotMeasured(_) => 6,
        ObservationLayout::Body(_) => 7,
        ObservationLayout::Px4Neural(_) => PX4_NEURAL,
    }
}

/// Number of `space` in the header of a policy file.
pub(crate) const fn action_identifier(space: &ActionSpace) -> u16 {
    match space {
        ActionSpace::RotorSpeeds(_) => 1,
        ActionSpace::ThrustBodyRates(_) => 2,
        ActionSpace::Reference(_) => 3,
        ActionSpace::Velocities(_) => 4,
        ActionSpace::RotorThrusts(_) => ROTOR_THRUSTS,
        ActionSpace::RateLoop(_) => RATE_LOOP,
        ActionSpace::IntegralVelocities(_) => INTEGRAL_VELOCITIES,
        ActionSpace::ThrustTorques(_) => THRUST_TORQUES,
    }
}

impl PolicyMetadata<'_> {
    /// Refuses numbers with which a flight would compute nonsense.
    pub(crate) fn check(&self) -> Result<(), PolicyError> {
        if self.name.len() > NAME_LIMIT {
            return Err(PolicyError::Name { found: self.name.len(), expected: NAME_LIMIT });
        }
        positive("control_period_secs", self.control_period_secs)?;
        check_observation(&self.observation, self.action.len())?;
        check_action(&self.action)?;
        self.airframe.map_or(Ok(()), |airframe| airframe.check())
    }
}

fn check_observation(layout: &ObservationLayout, action_len: usize) -> Result<(), PolicyError> {
    match layout {
        ObservationLayout::Pilot(pilot) => {
            check_scales(pilot)?;
            let expected = "four, as many as the layout shows";
            holds(action_len == ACTION_LEN, "values of an action", action_len, expected)
        }
        ObservationLayout::PilotFor(pilot) => {
            check_scales(&pilot.scales)?;
            let found = usize::from(pilot.action_len);
            holds(found == action_len && found != ACTION_LEN, "action_len", found, "that of the action, and not 4")
        }
        ObservationLayout::PilotMeasured(pilot) => {
            check_scales(&pilot.scales)?;
            let expected = "four, as many as the layout shows";
            holds(action_len == ACTION_LEN, "values of an action", action_len, expected)?;
            holds(pilot.measured_len > 0, "measured_len", usize::from(pilot.measured_len), "at least 1")
        }
        ObservationLayout::Body(body) => {
            check_scales(&body.scales)?;
            let found = usize::from(body.action_len);
            holds(found == action_len, "action_len", found, "that of the action")
        }
        ObservationLayout::Reference(layout) => layout.check(action_len),
        ObservationLayout::Kinematic(layout) => layout.check(action_len),
        ObservationLayout::Measured(measured) => {
            holds(measured.len > 0, "len", usize::from(measured.len), "at least 1")
        }
        ObservationLayout::Px4Neural(_) => Ok(()),
    }
}

fn check_scales(pilot: &PilotLayout) -> Result<(), PolicyError> {
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
        ActionSpace::ThrustBodyRates(space) | ActionSpace::RateLoop(space) => check_rates(space),
        ActionSpace::Velocities(space) => check_velocities(space),
        ActionSpace::IntegralVelocities(space) => {
            check_velocities(&space.velocities)?;
            positive("integral_gain", space.integral_gain)
        }
        ActionSpace::Reference(space) => space.check(),
        ActionSpace::RotorThrusts(space) => space.check(),
        ActionSpace::ThrustTorques(space) => space.check(),
    }
}

fn check_velocities(space: &Velocities) -> Result<(), PolicyError> {
    check_rates(&space.rates)?;
    space.rates.body_rates_limit.into_iter().try_for_each(|limit| positive("body_rates_limit", limit))?;
    positive("speed_limit", space.speed_limit)?;
    positive("velocity_gain", space.velocity_gain)?;
    positive("attitude_gain", space.attitude_gain)
}

fn check_rates(space: &ThrustBodyRates) -> Result<(), PolicyError> {
    positive("hover_speed_squared", space.hover_speed_squared)?;
    positive("speed_squared_limit", space.speed_squared_limit)?;
    positive("thrust_fraction", space.thrust_fraction)?;
    let numbers = space.body_rates_limit.iter().chain(&space.rate_gains).chain(space.mixer.as_flattened());
    numbers.copied().try_for_each(|number| finite("a controller gain", number))
}
