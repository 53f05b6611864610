//! Policies for the Python world: ONNX, which runs, and safetensors, which other programs build on. The same policy file
//! gives the same bytes.
//!
//! Both hold the float weights. What they leave out is how a firmware treats a sensor that fails: there a NaN is read as
//! zero.

mod onnx;
mod safetensors;

use kestrel_core::policy_file::{Arithmetic, PolicyError, PolicyFile};
use thiserror::Error;

pub use onnx::onnx_model;
pub use safetensors::safetensors_file;

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

/// A dense layer, `y = W x + b`.
struct Layer {
    inputs: usize,
    outputs: usize,
    /// `[outputs][inputs]`.
    weights: Vec<f32>,
    /// `[outputs]`.
    biases: Vec<f32>,
}

/// Reads a policy with `f32` weights from bytes that start on a four-byte boundary of memory.
fn float_policy(bytes: &[u8]) -> Result<PolicyFile<'_>, ExchangeError> {
    let policy = PolicyFile::parse(bytes)?;
    policy.self_test()?;
    match policy.arithmetic() {
        Arithmetic::Float32 => Ok(policy),
        Arithmetic::Fixed16 => Err(ExchangeError::Fixed),
    }
}

/// From the observation to the action; tangents stand between them.
fn layers(policy: &PolicyFile<'_>) -> Vec<Layer> {
    let layer = |(index, (inputs, outputs))| Layer {
        inputs,
        outputs,
        weights: (0..outputs)
            .flat_map(|row| (0..inputs).map(move |column| policy.weight(index, row, column)))
            .collect(),
        biases: (0..outputs).map(|row| policy.bias(index, row)).collect(),
    };
    policy.shapes().enumerate().map(layer).collect()
}

/// What a user must know of a policy, as JSON.
fn metadata(policy: &PolicyFile<'_>) -> String {
    serde_json::to_string(policy.metadata()).expect("numbers and text")
}

fn bytes_of(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

#[cfg(test)]
mod tests;
