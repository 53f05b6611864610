//! Policies for the Python world, and networks from it: ONNX, which runs, and safetensors, which other programs build on. The
//! same policy file gives the same bytes.
//!
//! Both hold the float weights. What they leave out is how a firmware treats a sensor that fails: there a NaN is read as
//! zero.

pub mod import;
mod onnx;
mod onnx_schema;
mod safetensors;

use kestrel_core::policy_file::{Activation, Arithmetic, PolicyError, PolicyFile};
use thiserror::Error;

pub use onnx::onnx_model;
pub use safetensors::safetensors_file;

use crate::layers::Layer;
use crate::policy::Policy;

/// Why a policy cannot be written in another program's form.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ExchangeError {
    /// The bytes are no policy, it sees, or its golden vectors fail.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// Weights in fixed point are rounded; what is exchanged is what was trained.
    #[error("found a policy in fixed16, expected one in float32: only its weights are those that were trained")]
    Fixed,
}

/// A policy with `f32` weights.
struct Exchanged {
    name: String,
    observation_len: usize,
    action_len: usize,
    /// Gates and candidate of a recurrent policy, which [`kestrel_core::gru`] defines.
    memory: Option<[Layer; 2]>,
    /// From the observation, and the hidden state behind it, to the action.
    layers: Vec<Layer>,
    /// What stands between them.
    activation: Activation,
    /// Observations and actions of the golden vectors, which are one flight.
    golden: [Vec<f32>; 2],
    /// What a user must know of it, as JSON.
    metadata: String,
}

impl Exchanged {
    /// Reads it from bytes that start on a four-byte boundary of memory.
    fn parse(bytes: &[u8]) -> Result<Self, ExchangeError> {
        let policy = Policy::parse(bytes)?;
        policy.self_test()?;
        if policy.arithmetic() == Arithmetic::Fixed16 {
            return Err(ExchangeError::Fixed);
        }
        match &policy {
            Policy::Blind(policy) => Ok(Self::of(policy, None)),
            Policy::Recurrent(policy) => Ok(Self::of(policy.network(), Some(Layer::of_memory(policy)))),
            Policy::Seeing(_) => Err(PolicyError::Vision.into()),
        }
    }

    fn of(network: &PolicyFile<'_>, memory: Option<[Layer; 2]>) -> Self {
        let metadata = network.metadata();
        let (observation_len, action_len) = (metadata.observation.len(), metadata.action.len());
        let mut golden = [Vec::new(), Vec::new()];
        for (observation, action) in network.golden_vectors() {
            golden[0].extend_from_slice(&observation[..observation_len]);
            golden[1].extend_from_slice(&action[..action_len]);
        }
        Self {
            name: metadata.name.to_owned(),
            observation_len,
            action_len,
            memory,
            layers: Layer::of_network(network),
            activation: network.activation(),
            golden,
            metadata: about(network),
        }
    }
}

/// What a user must know of a policy, as JSON: its metadata, and its activation where that is not the tangent.
fn about(policy: &PolicyFile<'_>) -> String {
    let text = serde_json::to_string(policy.metadata()).expect("numbers and text");
    match policy.activation() {
        Activation::Tanh => text,
        Activation::Relu => text.replacen('{', "{\"activation\":\"relu\",", 1),
    }
}

fn bytes_of(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

#[cfg(test)]
mod tests;
