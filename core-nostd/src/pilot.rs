//! A policy at the controls: the one call that a firmware makes every control period.

use nalgebra::Vector3;

use crate::action::ACTION_LEN;
use crate::policy_file::{PolicyError, PolicyFile, Scratch};
use crate::vehicle::State;

/// Flies one drone with one policy.
#[derive(Clone, Debug)]
pub struct Pilot<'a> {
    policy: PolicyFile<'a>,
    previous_action: [f32; ACTION_LEN],
    scratch: Scratch,
}

impl<'a> Pilot<'a> {
    /// A pilot that has not acted yet: its previous action is zero.
    pub fn new(policy: PolicyFile<'a>) -> Self {
        Self { policy, previous_action: [0.0; ACTION_LEN], scratch: Scratch::new() }
    }

    /// Forgets the previous action, as at the start of an episode.
    pub fn reset(&mut self) {
        self.previous_action = [0.0; ACTION_LEN];
    }

    /// Rotor targets \[rad/s\] on the way to `goal` \[m, world\]: encode, act, mix.
    ///
    /// Within zero and the greatest rotor speed of the action space, whatever the state (a NaN is read as zero).
    /// Call it every `control_period_secs` of the metadata.
    pub fn tick(&mut self, state: &State<f32>, goal: &Vector3<f32>) -> [f32; 4] {
        let metadata = self.policy.metadata();
        let observation = metadata.observation.encode(state, goal, &self.previous_action);
        self.previous_action = self.policy.act(&observation, &mut self.scratch);
        metadata.action.rotor_targets(&self.previous_action, &state.body_rates)
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

    /// The last action, in \[-1, 1\].
    pub fn previous_action(&self) -> [f32; ACTION_LEN] {
        self.previous_action
    }
}
