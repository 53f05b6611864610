//! What a policy with an encoder works in.

use super::super::{Arithmetic, PolicyError};

/// Working memory of a policy with an encoder, [`super::VisionPolicy::memory_len`] values: the features of the last image,
/// then what changes with every call.
#[derive(Debug)]
pub enum EncoderWorkspace<'m> {
    /// For [`Arithmetic::Float32`].
    Float32(&'m mut [f32]),
    /// For [`Arithmetic::Fixed16`].
    Fixed16(&'m mut [i16]),
}

impl EncoderWorkspace<'_> {
    /// As before the first image: all features are zero.
    pub fn clear(&mut self) {
        match self {
            Self::Float32(values) => values.fill(0.0),
            Self::Fixed16(values) => values.fill(0),
        }
    }

    pub(super) fn check(&self, expected: usize, expected_arithmetic: Arithmetic) -> Result<(), PolicyError> {
        let (found, found_arithmetic) = match self {
            Self::Float32(values) => (values.len(), Arithmetic::Float32),
            Self::Fixed16(values) => (values.len(), Arithmetic::Fixed16),
        };
        if found_arithmetic == expected_arithmetic && found >= expected {
            return Ok(());
        }
        Err(PolicyError::EncoderWorkspace { found, found_arithmetic, expected, expected_arithmetic })
    }
}
