//! What an export measured.

use core::fmt;

use serde::{Deserialize, Serialize};

/// Size and accuracy of an exported policy; its text is what `kestrel export` prints.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExportReport {
    /// Name of the policy.
    pub name: String,
    /// Observations on which the two files were compared.
    pub calibration_observations: usize,
    /// Largest magnitude among them.
    pub largest_observation: f32,
    /// Values among them beyond the range of the fixed-point input format.
    pub saturations: usize,
    /// Largest difference between a fixed-point and a float action, in the unit of actions (\[-1, 1\]).
    pub largest_action_error: f32,
    /// Mean absolute difference.
    pub mean_action_error: f64,
    /// Multiplications per step, padding not counted.
    pub multiply_accumulates: usize,
    /// Of the float file.
    pub float: FileSize,
    /// Of the fixed-point file.
    pub fixed: FileSize,
    /// From the observation to the action.
    pub layers: Vec<LayerReport>,
}

/// What a policy file takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileSize {
    /// Bytes of weights and biases, padding included.
    pub weight_bytes: usize,
    /// Bytes of the whole file.
    pub file_bytes: usize,
}

/// Shape and Q formats of a fixed-point layer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LayerReport {
    /// Columns.
    pub inputs: usize,
    /// Rows.
    pub outputs: usize,
    /// Fraction bits of the inputs.
    pub input_fraction_bits: u32,
    /// Fraction bits of the weights.
    pub weight_fraction_bits: u32,
    /// Largest magnitude of a weight.
    pub largest_weight: f32,
}

impl fmt::Display for ExportReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "policy \"{}\": {} multiply-accumulates per step", self.name, self.multiply_accumulates)?;
        writeln!(f, "  float32: {}", self.float)?;
        writeln!(f, "  fixed16: {}", self.fixed)?;
        writeln!(
            f,
            "  fixed16 against float32 on {} observations: largest action error {:.2e}, mean {:.2e}",
            self.calibration_observations, self.largest_action_error, self.mean_action_error
        )?;
        write!(f, "  saturated inputs: {} (largest observation {})", self.saturations, self.largest_observation)?;
        self.layers.iter().try_for_each(|layer| write!(f, "\n  {layer}"))
    }
}

impl fmt::Display for FileSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bytes of weights, {} bytes in all", self.weight_bytes, self.file_bytes)
    }
}

impl fmt::Display for LayerReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} -> {}: inputs Q{}, weights Q{}, largest weight {:.3}",
            self.inputs, self.outputs, self.input_fraction_bits, self.weight_fraction_bits, self.largest_weight
        )
    }
}
