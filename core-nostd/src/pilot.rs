//! A policy at the controls: the one call that a firmware makes every control period.

mod controller;
#[cfg(feature = "recurrent")]
mod recurrent;
mod state_policy;
#[cfg(feature = "encoder")]
mod vision;

use core::marker::PhantomData;

use nalgebra::Vector3;

pub use controller::PolicyController;
#[cfg(feature = "recurrent")]
pub use recurrent::RecurrentRunner;
pub use state_policy::StatePolicy;
#[cfg(feature = "encoder")]
pub use vision::VisionRunner;

use crate::limits::ACTION_LIMIT;
use crate::policy_file::{PolicyError, PolicyFile, PolicyMetadata, PolicyScratch};
use crate::setpoint::Setpoint;
use crate::vehicle::State;

/// What a [`Pilot`] flies with: a policy, and the memory that it needs beside the scratch.
pub trait PolicyRunner<'a> {
    /// What the firmware must know about the policy.
    fn metadata(&self) -> &PolicyMetadata<'a>;

    /// Forgets what it has seen, as at the start of an episode.
    fn reset(&mut self);

    /// The action in \[-1, 1\] on an encoded observation, followed by zeros.
    fn act(&mut self, observation: &[f32], scratch: &mut PolicyScratch) -> [f32; ACTION_LIMIT];

    /// Computes the golden vectors again.
    ///
    /// # Errors
    /// [`PolicyError::SelfTest`]: do not fly.
    fn self_test(&mut self, scratch: &mut PolicyScratch) -> Result<(), PolicyError>;
}

/// Flies one drone with one policy: a state-based one, with `RecurrentRunner` (feature
/// `recurrent`) a recurrent one, with [`StatePolicy`] either of them, or with `VisionRunner` (feature `encoder`) a vision
/// policy.
#[derive(Clone, Debug)]
pub struct Pilot<'a, P = PolicyFile<'a>> {
    policy: P,
    controller: PolicyController,
    scratch: PolicyScratch,
    parameters: PhantomData<&'a [u8]>,
}

impl<'a> PolicyRunner<'a> for PolicyFile<'a> {
    fn metadata(&self) -> &PolicyMetadata<'a> {
        self.metadata()
    }

    fn reset(&mut self) {}

    fn act(&mut self, observation: &[f32], scratch: &mut PolicyScratch) -> [f32; ACTION_LIMIT] {
        PolicyFile::act(self, observation, scratch)
    }

    fn self_test(&mut self, scratch: &mut PolicyScratch) -> Result<(), PolicyError> {
        self.self_test_with(scratch)
    }
}

impl<'a> Pilot<'a> {
    /// A pilot that has not acted yet: its past actions are zero.
    pub fn new(policy: PolicyFile<'a>) -> Self {
        Self::with_runner(policy)
    }

    /// The policy that flies.
    pub fn policy(&self) -> &PolicyFile<'a> {
        &self.policy
    }
}

impl<'a, P: PolicyRunner<'a>> Pilot<'a, P> {
    /// A pilot that has not acted yet: its past actions are zero.
    pub fn with_runner(policy: P) -> Self {
        let controller = PolicyController::new(policy.metadata());
        Self { controller, policy, scratch: PolicyScratch::new(), parameters: PhantomData }
    }

    /// What the firmware must know about the policy.
    pub fn metadata(&self) -> &PolicyMetadata<'a> {
        self.policy.metadata()
    }

    /// Forgets the past actions and the last image, as at the start of an episode, and what the controller behind the
    /// action space remembers, unless it was trained to persist.
    pub fn reset(&mut self) {
        self.controller.reset(self.policy.metadata());
        self.policy.reset();
    }

    /// Rotor targets \[rad/s\] on the way to `goal` \[m, world\]: encode, act, mix.
    ///
    /// Within zero and the greatest rotor speed of the action space, whatever the state (a NaN is read as zero).
    /// Call it every `control_period_secs` of the metadata. A policy that observes what sensors measure flies with
    /// [`Self::tick_measured`] instead; here it would read zeros.
    pub fn tick(&mut self, state: &State<f32>, goal: &Vector3<f32>) -> [f32; 4] {
        self.tick_measured(&[], state, goal)
    }

    /// As [`Self::tick`], for a policy that observes what sensors measure, in the order and the scales of its training.
    /// The controllers behind action spaces still read the estimated `state`: body rates, or pose and velocity.
    pub fn tick_measured(&mut self, measurements: &[f32], state: &State<f32>, goal: &Vector3<f32>) -> [f32; 4] {
        self.tick_towards(measurements, state, &Setpoint::at(*goal))
    }

    /// As [`Self::tick_measured`], facing as the set-point says where the layout shows a heading; of its other values only
    /// the position is read.
    pub fn tick_towards(
        &mut self,
        measurements: &[f32],
        state: &State<f32>,
        setpoint: &Setpoint<f32>,
    ) -> [f32; 4] {
        let observation = self.controller.observe(self.policy.metadata(), measurements, state, setpoint);
        let action = self.policy.act(observation, &mut self.scratch);
        self.controller.rotor_targets(self.policy.metadata(), action, state, setpoint)
    }

    /// Rotor targets \[rad/s\] of the last tick at the body rates \[rad/s\] of this moment, for every sample of the gyroscope
    /// between two ticks; nothing for a policy without a rate loop, whose targets are held.
    pub fn follow_rates(&self, body_rates: &Vector3<f32>) -> Option<[f32; 4]> {
        self.controller.follow_rates(self.policy.metadata(), body_rates)
    }

    /// Computes the golden vectors again, in the pilot's own memory, and forgets the last image.
    ///
    /// # Errors
    /// [`PolicyError::SelfTest`]: do not fly.
    pub fn self_test(&mut self) -> Result<(), PolicyError> {
        self.policy.self_test(&mut self.scratch)
    }

    /// What the policy acted on in the last tick.
    pub fn last_observation(&self) -> &[f32] {
        self.controller.observation(self.policy.metadata())
    }

    /// The last action, in \[-1, 1\], as many values as the action space has.
    pub fn previous_action(&self) -> &[f32] {
        self.controller.previous_action(self.policy.metadata())
    }
}
