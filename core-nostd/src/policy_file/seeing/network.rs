//! An eye and the network behind it.

use super::super::{Arithmetic, Network, ParameterFormat, PolicyError, Scratch};
use super::EyeMemory;
use super::header::SeeingHeader;
use crate::action::ACTION_LIMIT;
use crate::eye::{Eye, EyeShape, FixedEye};
use crate::fixed::FixedMlp;
use crate::mlp::{Mlp, WIDTH_LIMIT};

/// The eye of a policy, in its arithmetic.
#[derive(Clone, Debug)]
pub enum PolicyEye<'a> {
    /// In `f32`.
    Float32(Eye<'a>),
    /// In 8-bit weights.
    Fixed16(FixedEye<'a>),
}

/// Both networks in the same arithmetic.
#[derive(Clone, Debug)]
pub(super) struct SeeingNetwork<'a> {
    eye: PolicyEye<'a>,
    network: Network<'a>,
}

impl PolicyEye<'_> {
    /// What it looks at and what it makes of it.
    pub fn shape(&self) -> &EyeShape {
        match self {
            Self::Float32(eye) => eye.shape(),
            Self::Fixed16(eye) => eye.shape(),
        }
    }
}

impl<'a> SeeingNetwork<'a> {
    pub(super) fn from_parameters(
        header: &SeeingHeader,
        parameters: &'a [u8],
        eye_parameters: &'a [u8],
    ) -> Result<Self, PolicyError> {
        let shape = header.eye.shape;
        let network = Network::from_parameters(&header.policy, shape.features() as u16, parameters)?;
        let eye = match header.policy.parameters {
            ParameterFormat::Float32 => PolicyEye::Float32(Eye::from_parameters(shape, eye_parameters)?),
            ParameterFormat::Fixed16(_) => {
                PolicyEye::Fixed16(FixedEye::from_parameters(shape, &header.eye.code_bits, eye_parameters)?)
            }
        };
        Ok(Self { eye, network })
    }

    pub(super) fn eye(&self) -> &PolicyEye<'a> {
        &self.eye
    }

    /// The eye's work and the network's are never done at the same time, so they share what is behind the features.
    pub(super) fn memory_len(&self) -> usize {
        let inputs = match &self.network {
            Network::Float32(network) => network.inputs(),
            Network::Fixed16(network) => network.inputs().next_multiple_of(2),
        };
        let shape = self.eye.shape();
        shape.features() + shape.scratch_len().max(inputs).max(WIDTH_LIMIT)
    }

    pub(super) fn see(&self, image: &[u8], memory: &mut EyeMemory<'_>) -> Result<(), PolicyError> {
        memory.check(self.memory_len(), self.arithmetic())?;
        let features = self.eye.shape().features();
        match (&self.eye, memory) {
            (PolicyEye::Float32(eye), EyeMemory::Float32(values)) => {
                let (features, scratch) = values.split_at_mut_checked(features).unwrap_or_default();
                Ok(eye.see(image, scratch, features)?)
            }
            (PolicyEye::Fixed16(eye), EyeMemory::Fixed16(values)) => {
                let (features, scratch) = values.split_at_mut_checked(features).unwrap_or_default();
                Ok(eye.see(image, scratch, features)?)
            }
            // Excluded by the check.
            (PolicyEye::Float32(_), EyeMemory::Fixed16(_)) | (PolicyEye::Fixed16(_), EyeMemory::Float32(_)) => {
                Ok(())
            }
        }
    }

    pub(super) fn act(
        &self,
        observation: &[f32],
        memory: &mut EyeMemory<'_>,
        scratch: &mut Scratch,
    ) -> Result<[f32; ACTION_LIMIT], PolicyError> {
        memory.check(self.memory_len(), self.arithmetic())?;
        Ok(match (&self.network, memory) {
            (Network::Float32(network), EyeMemory::Float32(values)) => {
                self.act_in_float(network, observation, values, scratch)
            }
            (Network::Fixed16(network), EyeMemory::Fixed16(values)) => {
                self.act_in_fixed(network, observation, values, scratch)
            }
            // Excluded by the check.
            (Network::Float32(_), EyeMemory::Fixed16(_)) | (Network::Fixed16(_), EyeMemory::Float32(_)) => {
                [0.0; ACTION_LIMIT]
            }
        })
    }

    fn act_in_float(
        &self,
        network: &Mlp<'a>,
        observation: &[f32],
        memory: &mut [f32],
        scratch: &mut Scratch,
    ) -> [f32; ACTION_LIMIT] {
        let split = memory.split_at_mut_checked(self.eye.shape().features());
        let (features, inputs) = split.unwrap_or_default();
        network.act_on_features(observation, features, inputs, &mut scratch.float)
    }

    fn act_in_fixed(
        &self,
        network: &FixedMlp<'a>,
        observation: &[f32],
        memory: &mut [i16],
        scratch: &mut Scratch,
    ) -> [f32; ACTION_LIMIT] {
        let split = memory.split_at_mut_checked(self.eye.shape().features());
        let (features, inputs) = split.unwrap_or_default();
        network.act_on_features(observation, features, inputs, &mut scratch.fixed)
    }

    fn arithmetic(&self) -> Arithmetic {
        match self.eye {
            PolicyEye::Float32(_) => Arithmetic::Float32,
            PolicyEye::Fixed16(_) => Arithmetic::Fixed16,
        }
    }
}
