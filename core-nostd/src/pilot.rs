//! A policy at the controls: the one call that a firmware makes every control period.

mod controller;
#[cfg(feature = "encoder")]
mod vision;

use nalgebra::Vector3;

#[cfg(feature = "encoder")]
pub use vision::VisionPilot;

use crate::policy_file::{PolicyError, PolicyFile, PolicyScratch};
use crate::vehicle::State;
use controller::PolicyController;

/// Flies one drone with one policy.
#[derive(Clone, Debug)]
pub struct Pilot<'a> {
    policy: PolicyFile<'a>,
    controller: PolicyController,
    scratch: PolicyScratch,
}

impl<'a> Pilot<'a> {
    /// A pilot that has not acted yet: its past actions are zero.
    pub fn new(policy: PolicyFile<'a>) -> Self {
        Self { controller: PolicyController::new(policy.metadata()), policy, scratch: PolicyScratch::new() }
    }

    /// Forgets the past actions, as at the start of an episode, and what the controller behind the action space
    /// remembers, unless it was trained to persist.
    pub fn reset(&mut self) {
        self.controller.reset(self.policy.metadata());
    }

    /// Rotor targets \[rad/s\] on the way to `goal` \[m, world\]: encode, act, mix.
    ///
    /// Within zero and the greatest rotor speed of the action space, whatever the state (a NaN is read as zero).
    /// Call it every `control_period_secs` of the metadata. A policy that observes what sensors measure flies with
    /// [`Self::tick_measured`] instead; here it would read zeros.
    pub fn tick(&mut self, state: &State<f32>, goal: &Vector3<f32>) -> [f32; 4] {
        self.tick_measured(&[], state, goal)
    }

    /// As [`Self::tick`], for a policy that sees what sensors measure, in the order and the scales of its training.
    /// The controllers behind action spaces still read the estimated `state`: body rates, or pose and velocity.
    pub fn tick_measured(&mut self, measurements: &[f32], state: &State<f32>, goal: &Vector3<f32>) -> [f32; 4] {
        let metadata = self.policy.metadata();
        let observation = self.controller.observe(metadata, measurements, state, goal);
        let action = self.policy.act(observation, &mut self.scratch);
        self.controller.rotor_targets(metadata, action, state, goal)
    }

    /// Computes the golden vectors again, in the pilot's own scratch.
    ///
    /// # Errors
    /// [`PolicyError::SelfTest`]: do not fly.
    pub fn self_test(&mut self) -> Result<(), PolicyError> {
        self.policy.self_test_with(&mut self.scratch)
    }

    /// The policy that flies.
    pub fn policy(&self) -> &PolicyFile<'a> {
        &self.policy
    }

    /// The last action, in \[-1, 1\], as many values as the action space has.
    pub fn previous_action(&self) -> &[f32] {
        self.controller.previous_action(self.policy.metadata())
    }
}
