//! What a pilot flies a recurrent policy with.

use super::{Pilot, PolicyRunner};
use crate::airframe::Airframe;
use crate::gru::HiddenState;
use crate::limits::ACTION_LIMIT;
use crate::policy_file::{PolicyError, PolicyMetadata, PolicyScratch, RecurrentPolicy};

/// A recurrent policy and what it remembers of this flight.
#[derive(Clone, Debug)]
pub struct RecurrentRunner<'a> {
    policy: RecurrentPolicy<'a>,
    hidden: HiddenState,
}

impl<'a> RecurrentRunner<'a> {
    /// The policy, which remembers nothing yet.
    pub fn new(policy: RecurrentPolicy<'a>) -> Self {
        Self { policy, hidden: HiddenState::new() }
    }

    /// As [`RecurrentPolicy::on`].
    #[must_use]
    pub fn on(self, airframe: &Airframe) -> Self {
        Self { policy: self.policy.on(airframe), ..self }
    }
}

impl<'a> PolicyRunner<'a> for RecurrentRunner<'a> {
    fn metadata(&self) -> &PolicyMetadata<'a> {
        self.policy.metadata()
    }

    fn reset(&mut self) {
        self.hidden.clear();
    }

    fn act(&mut self, observation: &[f32], scratch: &mut PolicyScratch) -> [f32; ACTION_LIMIT] {
        self.policy.act(observation, &mut self.hidden, scratch)
    }

    fn self_test(&mut self, scratch: &mut PolicyScratch) -> Result<(), PolicyError> {
        self.policy.self_test_with(&mut self.hidden, scratch)
    }
}

impl<'a> Pilot<'a, RecurrentRunner<'a>> {
    /// A pilot that has not acted yet: its past actions and its hidden state are zero.
    pub fn with_memory(policy: RecurrentPolicy<'a>) -> Self {
        Self::with_runner(RecurrentRunner::new(policy))
    }

    /// The policy that flies.
    pub fn policy(&self) -> &RecurrentPolicy<'a> {
        &self.policy.policy
    }
}
