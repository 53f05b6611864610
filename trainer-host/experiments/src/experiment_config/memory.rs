//! What a policy remembers from step to step.

use kestrel_core::gru::UNITS_LIMIT;
use kestrel_core::observation::OBSERVATION_LIMIT;
use kestrel_learn::ppo::{EncoderSharing, MemorySettings, PpoSettings, fits_windows};
use kestrel_learn::rollout::ENV_BATCH;
use kestrel_sim::config::{ConfigError, Field};
use kestrel_sim::scenario::Scenario;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::drone_environment::image_of;

/// A gated recurrent unit (GRU, Cho et al. 2014) between the observation and the policy, for tasks in which what has been
/// seen before matters: the layers of actor and critic read the observation and its hidden state. Beside a camera it takes in
/// the observation and what the `eye` made of the image. Truncated
/// backpropagation through time trains it, in PPO and, over the windows of `analytic`, through the physics.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MemoryConfig {
    /// Values of the hidden state: a multiple of 4, at most 64, and at most 128 with the observation and the features of an `eye`.
    pub units: u64,
    /// Steps through which gradients of PPO go back: a divisor of `steps_per_rollout`. A minibatch is made of windows of so many
    /// steps of 32, 64, 128 or a multiple of 256 drones.
    pub steps_per_window: u64,
}

impl Default for MemoryConfig {
    fn default() -> Self {
        Self { units: 32, steps_per_window: 16 }
    }
}

impl MemoryConfig {
    /// The settings, for rollouts of so many steps and minibatches of so many samples.
    pub(super) fn check(
        &self,
        (steps_per_rollout, minibatch): (u64, u64),
        training: &Field<'_>,
    ) -> Result<MemorySettings, ConfigError> {
        let field = training.at("memory");
        let units = self.units as usize;
        if !units.is_multiple_of(4) || !(4..=UNITS_LIMIT).contains(&units) {
            let expected = format!("a multiple of 4 from 4 to {UNITS_LIMIT}");
            return Err(field.at("units").refuse(self.units, expected));
        }
        let steps = field.at("steps_per_window").whole(self.steps_per_window, 1..=steps_per_rollout)?;
        if !steps_per_rollout.is_multiple_of(steps) {
            let expected = format!("a divisor of the {steps_per_rollout} of `steps_per_rollout`");
            return Err(field.at("steps_per_window").refuse(steps, expected));
        }
        if !fits_windows(minibatch as usize, steps as usize) {
            let [eighth, quarter, half, whole] = [8, 4, 2, 1].map(|part| ENV_BATCH as u64 / part * steps);
            let expected =
                format!("a multiple of {whole}, or {eighth}, {quarter} or {half}: whole windows of {steps} steps");
            return Err(training.at("minibatch").refuse(minibatch, expected));
        }
        Ok(MemorySettings { units, steps_per_window: steps as usize })
    }
}

/// Refuses a memory where it cannot be; `field` is the training's.
pub(super) fn refuse_unsuited_memory(
    ppo: &PpoSettings,
    task: &Scenario,
    field: &Field<'_>,
) -> Result<(), ConfigError> {
    let Some(memory) = ppo.memory else { return Ok(()) };
    let field = field.at("memory");
    let features = match &task.camera {
        None => 0,
        Some(camera) => {
            if ppo.encoder.sharing == EncoderSharing::Separate || !ppo.encoder.trunk.is_empty() {
                let expected = "an `eye` that actor and critic share, without a `trunk`";
                return Err(field.reject("a memory beside another `eye`", expected));
            }
            // One that does not suit the images is refused elsewhere.
            ppo.encoder.kind.cnn(image_of(camera)).map_or(0, |cnn| cnn.features())
        }
    };
    if ppo.quantised_from.is_some() {
        return Err(field.reject("a memory beside `quantised_from`", "one of both"));
    }
    let (observed, units) = (task.observation.len() + features, memory.units);
    if observed + units > OBSERVATION_LIMIT {
        let most = OBSERVATION_LIMIT.saturating_sub(observed);
        let expected = format!("at most {most} beside {observed} observed values");
        return Err(field.at("units").refuse(units, expected));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::experiment_config::load;
    use crate::golden::in_repository;

    #[test]
    fn beside_a_camera_a_memory_takes_in_what_the_eye_makes() {
        let path = in_repository("configs/aviaries/room-1-vision.yaml");
        let loaded = |sets: &[&str]| load(&path, &sets.iter().map(|set| (*set).to_owned()).collect::<Vec<_>>());
        let said = |sets: &[&str]| loaded(sets).unwrap_err().to_string();
        assert!(loaded(&["training.memory={units: 40}"]).is_ok());
        let large = said(&["training.memory={units: 44}"]);
        assert!(
            large.contains("memory.units: found 44, expected at most 42 beside 86 observed values"),
            "{large}"
        );
        let refused = "found a memory beside another `eye`, expected an `eye` that actor and critic share";
        for eye in ["training.eye.trunk=[32]", "training.eye.shared=false"] {
            let said = said(&["training.memory={}", eye]);
            assert!(said.contains(refused), "{said}");
        }
    }
}
