//! The policy that a training begins with.

use kestrel_core::policy_file::{PolicyError, PolicyFile};
use kestrel_export::layers::Layer;
use kestrel_export::policy::Policy;
use kestrel_learn::actor_critic::Actor;
use kestrel_learn::network::Mlp;
use kestrel_sim::config::{ConfigError, Field, policy_bytes};
use kestrel_sim::scenario::Scenario;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::learner::LearnerSettings;

/// The policy that training begins with, in place of random weights: `{ import: FILE.kestrel }`, of the shape that the other
/// keys give.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InitialPolicyConfig {
    /// The bytes of a policy file, as `import: FILE.kestrel` writes them.
    pub base64: String,
}

/// The policy that a training begins with.
#[derive(Clone, Debug, PartialEq)]
pub struct InitialPolicy {
    bytes: Vec<u8>,
    actor: Actor,
}

impl InitialPolicyConfig {
    /// The policy, for a training that is otherwise this.
    ///
    /// # Errors
    /// When it is damaged, sees images or has another shape.
    pub(super) fn check(
        &self,
        settings: &LearnerSettings,
        field: &Field<'_>,
    ) -> Result<InitialPolicy, ConfigError> {
        let refuse = |found: String| field.reject(found, "the bytes of a policy file (`import: FILE.kestrel`)");
        let bytes = policy_bytes(&self.base64).map_err(|error| refuse(error.to_string()))?;
        let read = |bytes| -> Result<Option<Actor>, PolicyError> {
            let policy = Policy::parse(bytes)?;
            policy.self_test()?;
            Ok(actor_of(&policy))
        };
        let actor = read(&bytes).map_err(|error| refuse(error.to_string()))?;
        let actor = actor.ok_or_else(|| field.reject("a policy with a camera", "one without"))?;
        let units = settings.ppo.memory.map_or(0, |memory| memory.units);
        if actor.units() != units {
            let found = format!("a policy with a memory of {} units", actor.units());
            return Err(field.reject(found, format!("{units}, as `memory` says")));
        }
        let mlp = actor.mlp();
        let hidden = &settings.ppo.actor_hidden;
        let wanted = Mlp::new(mlp.inputs(), hidden, mlp.outputs()).with_activation(settings.ppo.activation);
        if *mlp != wanted {
            let layers = &mlp.widths()[1..mlp.widths().len() - 1];
            let expected = format!("{hidden:?}, with the same activation, as `actor_hidden` says");
            return Err(field.reject(format!("a policy with hidden layers {layers:?}"), expected));
        }
        Ok(InitialPolicy { bytes, actor })
    }
}

impl InitialPolicy {
    /// As one that learns.
    pub fn actor(&self) -> &Actor {
        &self.actor
    }

    /// Refuses a task that it was not trained for.
    pub(super) fn refuse_other_task(&self, task: &Scenario, field: &Field<'_>) -> Result<(), ConfigError> {
        let differing = Policy::parse(&self.bytes).ok().and_then(|policy| policy.differing(task));
        match differing {
            None => Ok(()),
            Some(differing) => {
                let found = format!("a policy with another {differing}");
                Err(field.reject(found, format!("one that flies {}", task.name)))
            }
        }
    }
}

/// As an actor, in either number format.
fn actor_of(policy: &Policy<'_>) -> Option<Actor> {
    let of_network = |network: &PolicyFile<'_>| {
        let layers = Layer::of_network(network);
        Actor::of_layers(&layers.iter().map(|layer| layer.dense(network.activation())).collect::<Vec<_>>())
    };
    match policy {
        Policy::Blind(network) => Some(of_network(network)),
        Policy::Recurrent(policy) => {
            let (memory, network) = (Layer::of_memory(policy), policy.network());
            let layers = memory.each_ref().map(|layer| layer.dense(network.activation()));
            Some(of_network(network).behind_memory(policy.metadata().observation.len(), layers))
        }
        Policy::Seeing(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use kestrel_core::observation::OBSERVATION_LIMIT;
    use kestrel_learn::network::InputBatch;

    use super::*;
    use crate::experiment_config::{Experiment, load};
    use crate::golden::in_repository;

    /// A shipped task that begins with a shipped pilot, after other changes.
    fn begun(task: &str, pilot: &str, sets: &[&str]) -> Result<Experiment, ConfigError> {
        let import = in_repository(&format!("assets/pilots/{pilot}"));
        let first = format!("training.initial_policy={{import: {}}}", import.display());
        let sets: Vec<String> =
            std::iter::once(first.as_str()).chain(sets.iter().copied()).map(str::to_owned).collect();
        load(&in_repository(&format!("configs/{task}.yaml")), &sets)
    }

    fn refusal(task: &str, pilot: &str, sets: &[&str]) -> String {
        let message = begun(task, pilot, sets).unwrap_err().to_string();
        message.split_once(": found ").map_or(message.clone(), |(_, found)| found.to_owned())
    }

    #[test]
    fn a_pilot_goes_on_as_it_flies() {
        for (task, pilot) in [("aviaries/room-0", "room-0.kestrel"), ("any", "any.kestrel")] {
            let experiment = begun(task, pilot, &[]).unwrap();
            let again = crate::experiment_config::parse("again", &experiment.resolved_yaml, &[]).unwrap();
            assert_eq!(again.training, experiment.training, "a resolved configuration holds the policy itself");
            let actor = experiment.training.initial_policy.as_ref().unwrap().actor();
            // Whoever trains begins with it, but for the spread of the actions.
            let untrained = crate::training_run::untrained_actor(&experiment).unwrap();
            let network = actor.mlp().parameter_count();
            assert_eq!(untrained.parameters()[..network], actor.parameters()[..network], "{pilot}");
            assert_eq!(untrained.front_parameters(), actor.front_parameters(), "{pilot}");
            let bytes = std::fs::read(in_repository(&format!("assets/pilots/{pilot}"))).unwrap();
            let Ok(Policy::Blind(policy)) = Policy::parse(&bytes) else {
                assert!(actor.units() > 0, "a recurrent one");
                continue;
            };
            for (observation, expected) in policy.golden_vectors() {
                let mut actions = vec![0.0; actor.action_len()];
                let len = actor.mlp().inputs();
                assert!(len <= OBSERVATION_LIMIT);
                actor.act_mean(InputBatch::without_images(&observation[..len]), &mut actions);
                let off = actions
                    .iter()
                    .zip(expected)
                    .map(|(found, expected)| (found.clamp(-1.0, 1.0) - expected).abs());
                assert!(off.fold(0.0, f32::max) < 0.02, "{pilot}: but for the rounding of fixed point");
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_said() {
        let widths = refusal("aviaries/room-0", "room-0.kestrel", &["training.actor_hidden=[32, 32]"]);
        assert_eq!(
            widths,
            "a policy with hidden layers [64, 64], expected [32, 32], with the same activation, as `actor_hidden` says"
        );
        let task = refusal("aviaries/room-0", "hover.kestrel", &["training.actor_hidden=[64, 64]"]);
        assert!(task.starts_with("a policy with another "), "{task}");
        let memory =
            refusal("aviaries/unseen-rooms-tof", "unseen-rooms-tof.kestrel", &["training.memory.units=16"]);
        assert_eq!(memory, "a policy with a memory of 28 units, expected 16, as `memory` says");
        let camera = refusal("aviaries/room-0-vision", "room-0-vision.kestrel", &[]);
        assert_eq!(camera, "a policy with a camera, expected one without");
        let file = refusal("aviaries/room-0", "../pictures/hover.gif", &[]);
        assert!(file.contains("expected a policy: a file `.kestrel`"), "{file}");
        let missing = refusal("aviaries/room-0", "none.kestrel", &[]);
        assert!(missing.starts_with("no such file ("), "{missing}");
        let path = in_repository("configs/aviaries/room-0.yaml");
        for text in ["training.initial_policy={base64: '!'}", "training.initial_policy={base64: 'AAAA'}"] {
            let message = load(&path, &[text.to_owned()]).unwrap_err().to_string();
            assert!(
                message.ends_with("expected the bytes of a policy file (`import: FILE.kestrel`)"),
                "{message}"
            );
        }
        let elsewhere = format!("scenario.import={}", in_repository("assets/pilots/hover.kestrel").display());
        let message = load(&path, &[elsewhere]).unwrap_err().to_string();
        assert!(message.contains("expected policies only in a key `initial_policy`"), "{message}");
    }
}
