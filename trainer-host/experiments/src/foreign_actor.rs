//! Networks that other programs trained, as actors of our tasks.

use std::path::PathBuf;

use kestrel_core::policy_file::Activation;

use crate::run_config::Subject;
use kestrel_export::exchange::import::{
    ImportError, ImportSettings, ImportedNetwork, OutputActivation, StateDict, import_network,
};
use kestrel_learn::actor_critic::Actor;

/// Where a network is.
#[derive(Clone, Debug)]
pub enum NetworkSource {
    /// In an ONNX or safetensors file.
    File(PathBuf),
    /// In memory.
    Tensors(StateDict),
}

/// What its user knows of a network of which only the weights are given.
#[derive(Clone, Copy, Debug, Default)]
pub struct AssumedActivations {
    /// Between the layers.
    pub hidden: Option<Activation>,
    /// Behind the last one.
    pub output: Option<OutputActivation>,
}

/// Why a network does not become an actor.
#[derive(Debug, thiserror::Error)]
pub enum ForeignActorError {
    /// Perceptrons see no images.
    #[error("found the task {task}, which shows images, expected one that a perceptron can fly")]
    Images {
        /// Its name.
        task: String,
    },
    /// The network in a file is not one that a policy file can hold, or not one for the task.
    #[error("{}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: ImportError,
    },
    /// The network in memory is none.
    #[error(transparent)]
    Tensors(#[from] ImportError),
}

/// An actor with the numbers of a network that others trained, for the tasks of `subject`; and what the network is.
///
/// # Errors
/// When the network is damaged, or reads or writes other values than the tasks, or holds what a policy file cannot.
pub fn foreign_actor(
    network: NetworkSource,
    subject: &Subject<'_>,
    assumed: AssumedActivations,
) -> Result<(Actor, ImportedNetwork), ForeignActorError> {
    let task = &subject.tasks[0];
    if task.scenario.camera.is_some() {
        return Err(ForeignActorError::Images { task: task.name.clone() });
    }
    let settings = ImportSettings {
        observation: &task.scenario.observation,
        action: &task.scenario.action,
        activation: assumed.hidden,
        output: assumed.output,
    };
    let network = match network {
        NetworkSource::File(path) => {
            import_network(&path, &settings).map_err(|source| ForeignActorError::File { path, source })?
        }
        NetworkSource::Tensors(tensors) => tensors.network(&settings)?,
    };
    Ok((Actor::of_layers(&network.layers()), network))
}
