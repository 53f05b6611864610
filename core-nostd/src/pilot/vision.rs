//! The pilot of a vision policy.

use nalgebra::Vector3;

use super::controller::PolicyController;
use crate::policy_file::{EncoderWorkspace, PolicyError, PolicyScratch, VisionPolicy};
use crate::vehicle::State;

/// Flies one drone with one vision policy.
///
/// Images come at a pace of their own: [`Self::encode`] at each, [`Self::tick`] every control period. Between images the
/// policy acts on the features of the last one.
#[derive(Debug)]
pub struct VisionPilot<'a, 'm> {
    policy: VisionPolicy<'a>,
    controller: PolicyController,
    scratch: PolicyScratch,
    memory: EncoderWorkspace<'m>,
}

impl<'a, 'm> VisionPilot<'a, 'm> {
    /// A pilot that has neither acted nor encoded an image: its past actions and its features are zero.
    ///
    /// `memory` has [`VisionPolicy::memory_len`] values of the policy's arithmetic.
    ///
    /// # Errors
    /// [`PolicyError::EncoderWorkspace`].
    pub fn new(policy: VisionPolicy<'a>, mut memory: EncoderWorkspace<'m>) -> Result<Self, PolicyError> {
        policy.check_memory(&memory)?;
        memory.clear();
        Ok(Self {
            controller: PolicyController::new(policy.metadata()),
            policy,
            scratch: PolicyScratch::new(),
            memory,
        })
    }

    /// Forgets the past actions and the last image, as at the start of an episode, and what the controller behind the
    /// action space remembers, unless it was trained to persist.
    pub fn reset(&mut self) {
        self.controller.reset(self.policy.metadata());
        self.memory.clear();
    }

    /// Encodes a new `image` `[rows][columns][channels]`; the ticks that follow act on it. Call it before the first
    /// tick of a flight, then every [`VisionPolicy::control_periods_per_image`] ticks.
    ///
    /// # Errors
    /// [`PolicyError::Encoder`] for an image of another length; the pilot keeps the features of the one before.
    pub fn encode(&mut self, image: &[u8]) -> Result<(), PolicyError> {
        self.policy.encode(image, &mut self.memory)
    }

    /// As [`super::Pilot::tick`]: rotor targets \[rad/s\] on the way to `goal` \[m, world\].
    pub fn tick(&mut self, state: &State<f32>, goal: &Vector3<f32>) -> [f32; 4] {
        self.tick_measured(&[], state, goal)
    }

    /// As [`super::Pilot::tick_measured`].
    pub fn tick_measured(&mut self, measurements: &[f32], state: &State<f32>, goal: &Vector3<f32>) -> [f32; 4] {
        let metadata = self.policy.metadata();
        let observation = self.controller.observe(metadata, measurements, state, goal);
        // The memory was checked, so there is an action.
        let action = self.policy.act(observation, &mut self.memory, &mut self.scratch).unwrap_or_default();
        self.controller.rotor_targets(metadata, action, state, goal)
    }

    /// Computes the golden vectors again, in the pilot's own memory, and forgets the last image.
    ///
    /// # Errors
    /// [`PolicyError::SelfTest`]: do not fly.
    pub fn self_test(&mut self) -> Result<(), PolicyError> {
        let result = self.policy.self_test_with(&mut self.memory, &mut self.scratch);
        self.memory.clear();
        result
    }

    /// The policy that flies.
    pub fn policy(&self) -> &VisionPolicy<'a> {
        &self.policy
    }

    /// The last action, in \[-1, 1\], as many values as the action space has.
    pub fn previous_action(&self) -> &[f32] {
        self.controller.previous_action(self.policy.metadata())
    }
}
