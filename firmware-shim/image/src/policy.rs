//! The policies in the image.

use kestrel_core::activation::Activation;
use kestrel_core::fixed::{FixedFormat, FixedMlp};
use kestrel_core::policy_file::{Aligned, PolicyError};

/// A policy file in memory, on the boundary that [`PolicyFile`](kestrel_core::policy_file::PolicyFile) wants.
#[derive(Clone, Copy, Debug)]
pub struct Artifact {
    /// As in `assets/pilots`.
    pub name: &'static str,
    /// The file.
    pub bytes: &'static [u8],
}

/// A network in fixed point as a firmware may have it without a policy file.
#[derive(Clone, Copy, Debug)]
pub struct Embedded {
    /// Of the observation and of every layer.
    pub widths: [u16; 4],
    /// See [`kestrel_core::fixed::FixedFormat`].
    pub input_fraction_bits: u8,
    /// See [`kestrel_core::fixed::FixedFormat`].
    pub weight_fraction_bits: [u8; kestrel_core::mlp::LAYER_LIMIT],
    /// As in the policy file, on a four-byte boundary.
    pub parameters: &'static [u8],
}

impl Embedded {
    /// The network, read where it lies.
    ///
    /// # Errors
    /// As [`FixedMlp::from_parameters`].
    pub fn network(&self) -> Result<FixedMlp<'static>, PolicyError> {
        let (input_fraction_bits, weight_fraction_bits) = (self.input_fraction_bits, self.weight_fraction_bits);
        FixedMlp::from_parameters(
            &self.widths,
            FixedFormat { input_fraction_bits, weight_fraction_bits, activation: Activation::Tanh },
            self.parameters,
        )
    }
}

include!(concat!(env!("OUT_DIR"), "/policies.rs"));
