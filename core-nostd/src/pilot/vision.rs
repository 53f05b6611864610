//! What a pilot flies a vision policy with.

use super::{Pilot, PolicyRunner};
use crate::limits::ACTION_LIMIT;
use crate::policy_file::{EncoderWorkspace, PolicyError, PolicyMetadata, PolicyScratch, VisionPolicy};

/// A vision policy and the features of its last image.
#[derive(Debug)]
pub struct VisionRunner<'a, 'm> {
    policy: VisionPolicy<'a>,
    memory: EncoderWorkspace<'m>,
}

impl<'a> PolicyRunner<'a> for VisionRunner<'a, '_> {
    fn metadata(&self) -> &PolicyMetadata<'a> {
        self.policy.metadata()
    }

    fn reset(&mut self) {
        self.memory.clear();
    }

    fn act(&mut self, observation: &[f32], scratch: &mut PolicyScratch) -> [f32; ACTION_LIMIT] {
        // The memory was checked, so there is an action.
        self.policy.act(observation, &mut self.memory, scratch).unwrap_or_default()
    }

    fn self_test(&mut self, scratch: &mut PolicyScratch) -> Result<(), PolicyError> {
        let result = self.policy.self_test_with(&mut self.memory, scratch);
        self.memory.clear();
        result
    }
}

/// A vision policy's images come at a pace of their own: [`Self::encode`] at each, [`Self::tick`] every control period.
/// Between images the policy acts on the features of the last one.
impl<'a, 'm> Pilot<'a, VisionRunner<'a, 'm>> {
    /// A pilot that has neither acted nor encoded an image: its past actions and its features are zero.
    ///
    /// `memory` has [`VisionPolicy::memory_len`] values of the policy's arithmetic.
    ///
    /// # Errors
    /// [`PolicyError::EncoderWorkspace`].
    pub fn with_encoder(policy: VisionPolicy<'a>, mut memory: EncoderWorkspace<'m>) -> Result<Self, PolicyError> {
        policy.check_memory(&memory)?;
        memory.clear();
        Ok(Self::with_runner(VisionRunner { policy, memory }))
    }

    /// Encodes a new `image` `[rows][columns][channels]`; the ticks that follow act on it. Call it before the first
    /// tick of a flight, then every [`VisionPolicy::control_periods_per_image`] ticks.
    ///
    /// # Errors
    /// [`PolicyError::Encoder`] for an image of another length; the pilot keeps the features of the one before.
    pub fn encode(&mut self, image: &[u8]) -> Result<(), PolicyError> {
        self.policy.policy.encode(image, &mut self.policy.memory)
    }

    /// The policy that flies.
    pub fn policy(&self) -> &VisionPolicy<'a> {
        &self.policy.policy
    }
}
