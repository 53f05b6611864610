//! What a pilot flies any policy with that sees no images.

use super::PolicyRunner;
#[cfg(feature = "recurrent")]
use super::RecurrentRunner;
use crate::airframe::Airframe;
use crate::limits::ACTION_LIMIT;
#[cfg(feature = "recurrent")]
use crate::policy_file::RecurrentPolicy;
use crate::policy_file::{PolicyError, PolicyFile, PolicyMetadata, PolicyScratch};

/// A policy that sees no images: a network alone or, with the feature `recurrent`, one with a memory.
#[derive(Clone, Debug)]
#[cfg_attr(
    feature = "recurrent",
    expect(clippy::large_enum_variant, reason = "there is no heap, and a firmware has one of them")
)]
pub enum StatePolicy<'a> {
    /// A network that remembers nothing.
    FeedForward(PolicyFile<'a>),
    /// A recurrent one, and what it remembers of this flight.
    #[cfg(feature = "recurrent")]
    Recurrent(RecurrentRunner<'a>),
}

impl<'a> StatePolicy<'a> {
    /// The policy in `bytes`, which are the whole file and start on a four-byte boundary of memory.
    ///
    /// # Errors
    /// As [`PolicyFile::parse`], and without the feature `recurrent` [`PolicyError::Recurrent`].
    pub fn parse(bytes: &'a [u8]) -> Result<Self, PolicyError> {
        match PolicyFile::parse(bytes) {
            Ok(policy) => Ok(Self::FeedForward(policy)),
            #[cfg(feature = "recurrent")]
            Err(PolicyError::Recurrent) => {
                Ok(Self::Recurrent(RecurrentRunner::new(RecurrentPolicy::parse(bytes)?)))
            }
            Err(error) => Err(error),
        }
    }

    /// What the firmware must know about the policy.
    pub fn metadata(&self) -> &PolicyMetadata<'a> {
        match self {
            Self::FeedForward(policy) => policy.metadata(),
            #[cfg(feature = "recurrent")]
            Self::Recurrent(policy) => policy.metadata(),
        }
    }

    /// Computes the golden vectors again.
    ///
    /// # Errors
    /// [`PolicyError::SelfTest`]: do not fly.
    pub fn self_test(&mut self) -> Result<(), PolicyError> {
        PolicyRunner::self_test(self, &mut PolicyScratch::new())
    }

    /// As [`PolicyFile::on`].
    #[must_use]
    pub fn on(self, airframe: &Airframe) -> Self {
        match self {
            Self::FeedForward(policy) => Self::FeedForward(policy.on(airframe)),
            #[cfg(feature = "recurrent")]
            Self::Recurrent(policy) => Self::Recurrent(policy.on(airframe)),
        }
    }
}

impl<'a> PolicyRunner<'a> for StatePolicy<'a> {
    fn metadata(&self) -> &PolicyMetadata<'a> {
        self.metadata()
    }

    fn reset(&mut self) {
        match self {
            Self::FeedForward(policy) => PolicyRunner::reset(policy),
            #[cfg(feature = "recurrent")]
            Self::Recurrent(policy) => policy.reset(),
        }
    }

    fn act(&mut self, observation: &[f32], scratch: &mut PolicyScratch) -> [f32; ACTION_LIMIT] {
        match self {
            Self::FeedForward(policy) => PolicyFile::act(policy, observation, scratch),
            #[cfg(feature = "recurrent")]
            Self::Recurrent(policy) => policy.act(observation, scratch),
        }
    }

    fn self_test(&mut self, scratch: &mut PolicyScratch) -> Result<(), PolicyError> {
        match self {
            Self::FeedForward(policy) => policy.self_test_with(scratch),
            #[cfg(feature = "recurrent")]
            Self::Recurrent(policy) => policy.self_test(scratch),
        }
    }
}
