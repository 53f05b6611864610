//! Scenarios as users write them in YAML, and their conversion to the checked [`Scenario`].
//!
//! Each type whose name ends in `Config` mirrors a part of the file: degrees, hertz, units in the keys. Its `check`
//! returns what the program runs, or says what is wrong on which line. A [`Document`] is the file itself.

mod aviary;
mod decode;
mod document;
mod episode;
mod error;
mod field;
mod geometry;
mod node;
mod pilot;
mod sensor;
mod start;
#[cfg(test)]
mod tests;
mod vehicle;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use aviary::{AviaryConfig, BoxConfig, RoomConfig};
pub use document::Document;
pub use episode::{RewardConfig, SuccessConfig, TerminationConfig};
pub use error::ConfigError;
pub use field::{Field, Limits};
pub use pilot::{
    ActionConfig, CriticConfig, ObservationConfig, PilotConfig, RotorSpeedsConfig, ThrustBodyRatesConfig,
};
pub use sensor::{
    AccelerometerConfig, BarometerConfig, BeamConfig, DirectionConfig, FlowConfig, GyroscopeConfig, ImuConfig,
    RangeConfig, SensorConfig,
};
pub use start::{RandomisationConfig, StartConfig, StartPositionConfig};
pub use vehicle::{AirframeConfig, IntegratorConfig, PhysicsConfig, VehicleConfig};

use crate::scenario::Scenario;

/// Default of [`ScenarioConfig::episode_secs`].
const EPISODE_SECS: f64 = 8.0;

/// Shorter episodes teach nothing, longer ones are several tasks.
pub const EPISODE_LIMITS: Limits = Limits::from(0.1, 600.0, "s");

/// One task: where, with what, from where, for what, until when.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScenarioConfig {
    /// The place: the goal, the floor, walls and obstacles.
    pub aviary: AviaryConfig,
    /// The drone.
    #[serde(default)]
    pub vehicle: VehicleConfig,
    /// How time advances.
    #[serde(default)]
    pub physics: PhysicsConfig,
    /// What the policy commands.
    #[serde(default)]
    pub action: ActionConfig,
    /// What the policy sees.
    #[serde(default)]
    pub observation: ObservationConfig,
    /// What the critic sees while training.
    #[serde(default)]
    pub critic: CriticConfig,
    /// How episodes begin.
    pub start: StartConfig,
    /// What differs from episode to episode.
    #[serde(default)]
    pub randomisation: RandomisationConfig,
    /// What is rewarded: a sum of weighted terms.
    pub rewards: Vec<RewardConfig>,
    /// What ends an episode in failure.
    #[serde(default)]
    pub terminations: Vec<TerminationConfig>,
    /// Time after which an episode is cut off, which is no failure.
    #[serde(default = "episode_secs")]
    pub episode_secs: f64,
    /// What counts as success.
    pub success: SuccessConfig,
}

fn episode_secs() -> f64 {
    EPISODE_SECS
}

impl ScenarioConfig {
    /// The scenario called `name`; `field` is the place of this configuration in its document.
    ///
    /// # Errors
    /// The first value that is out of range or contradicts another.
    pub fn check(&self, name: &str, field: &Field<'_>) -> Result<Scenario, ConfigError> {
        let airframe = self.vehicle.check(&field.at("vehicle"))?;
        let physics = self.physics.check(&field.at("physics"))?;
        let action = self.action.check(&airframe, &field.at("action"))?;
        let observation = self.observation.check(&field.at("observation"))?;
        let aviary = self.aviary.check(&airframe, &field.at("aviary"))?;
        let terminations = TerminationConfig::check_all(&self.terminations, &aviary, &field.at("terminations"))?;
        let start = self.start.check(&aviary, &airframe, &terminations, &field.at("start"))?;
        Ok(Scenario {
            name: name.to_owned(),
            critic: self.critic.check(),
            randomisation: self.randomisation.check(&field.at("randomisation"))?,
            rewards: RewardConfig::check_all(&self.rewards, &field.at("rewards"))?,
            episode_secs: field.at("episode_secs").number(self.episode_secs, &EPISODE_LIMITS)?,
            success: self.success.check(&aviary, self.episode_secs, &field.at("success"))?,
            aviary,
            airframe,
            physics,
            action,
            observation,
            start,
            terminations,
        })
    }
}
