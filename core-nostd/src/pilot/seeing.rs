//! The pilot whose policy has an eye.

use nalgebra::Vector3;

use super::helm::Helm;
use crate::policy_file::{EyeMemory, PolicyError, Scratch, SeeingPolicy};
use crate::vehicle::State;

/// Flies one drone with one policy that sees images.
///
/// Images come at a pace of their own: [`Self::look`] at each, [`Self::tick`] every control period. Between images the
/// policy acts on what it saw last.
#[derive(Debug)]
pub struct SeeingPilot<'a, 'm> {
    policy: SeeingPolicy<'a>,
    helm: Helm,
    scratch: Scratch,
    memory: EyeMemory<'m>,
}

impl<'a, 'm> SeeingPilot<'a, 'm> {
    /// A pilot that has neither acted nor seen: its past actions and its features are zero.
    ///
    /// `memory` has [`SeeingPolicy::memory_len`] values of the policy's arithmetic.
    ///
    /// # Errors
    /// [`PolicyError::EyeMemory`].
    pub fn new(policy: SeeingPolicy<'a>, mut memory: EyeMemory<'m>) -> Result<Self, PolicyError> {
        policy.check_memory(&memory)?;
        memory.clear();
        Ok(Self { helm: Helm::new(policy.metadata()), policy, scratch: Scratch::new(), memory })
    }

    /// Forgets the past actions and the last image, as at the start of an episode, and what the controller behind the
    /// action space remembers, unless it was trained to persist.
    pub fn reset(&mut self) {
        self.helm.reset(self.policy.metadata());
        self.memory.clear();
    }

    /// Looks at a new `image` `[rows][columns][channels]`; the ticks that follow act on it. Call it before the first
    /// tick of a flight, then every [`SeeingPolicy::control_periods_per_image`] ticks.
    ///
    /// # Errors
    /// [`PolicyError::Eye`] for an image of another length; the pilot goes on with what it saw before.
    pub fn look(&mut self, image: &[u8]) -> Result<(), PolicyError> {
        self.policy.see(image, &mut self.memory)
    }

    /// As [`super::Pilot::tick`]: rotor targets \[rad/s\] on the way to `goal` \[m, world\].
    pub fn tick(&mut self, state: &State<f32>, goal: &Vector3<f32>) -> [f32; 4] {
        self.tick_measured(&[], state, goal)
    }

    /// As [`super::Pilot::tick_measured`].
    pub fn tick_measured(&mut self, measurements: &[f32], state: &State<f32>, goal: &Vector3<f32>) -> [f32; 4] {
        let metadata = self.policy.metadata();
        let observation = self.helm.observe(metadata, measurements, state, goal);
        // The memory was checked, so there is an action.
        let action = self.policy.act(observation, &mut self.memory, &mut self.scratch).unwrap_or_default();
        self.helm.steer(metadata, action, state, goal)
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
    pub fn policy(&self) -> &SeeingPolicy<'a> {
        &self.policy
    }

    /// The last action, in \[-1, 1\], as many values as the action space has.
    pub fn previous_action(&self) -> &[f32] {
        self.helm.previous_action(self.policy.metadata())
    }
}
