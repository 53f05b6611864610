//! Continual learning: what keeps a policy from forgetting earlier tasks while it learns another.
//!
//! Between tasks a [`Regulariser`] takes in what must not be forgotten ([`consolidate`](Regulariser::consolidate)); during
//! the next task it adds its penalty's gradient to that of every minibatch ([`add_gradient`](Regulariser::add_gradient))
//! or moves the policy after the step ([`after_step`](Regulariser::after_step)). It says how many bytes it keeps. One that is told of
//! no end of a task looks at every rollout for it ([`watch`](Regulariser::watch)).
//!
//! Each method that ships is one file with its YAML keys, their check, its memory and its arithmetic, and one line in
//! the list at the end of this file. Any other type that implements [`Regulariser`] works as well
//! (`examples/own_regulariser.rs`): [`Trainer::update_with`](crate::ppo::Trainer::update_with) takes it.

mod boundary;
mod compact_coreset;
mod coreset;
mod curvature;
mod distillation;
mod function_space;
mod kronecker;
mod quadratic;
mod reference_soar;
mod state_model;
mod synaptic_intelligence;
#[cfg(test)]
mod tests;

use kestrel_config::{ConfigError, Field, Limits};
use kestrel_core::seed::Seed;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use boundary::Boundaries;
pub use compact_coreset::{CompactCoreset, CompactCoresetSettings};
pub use coreset::{Coreset, CoresetSettings};
pub use distillation::{DistillationSettings, distil};
pub use function_space::{FunctionSpace, FunctionSpaceSettings};
pub use quadratic::{Coupling, Curvature, GradientTerm, QuadraticPenalty, QuadraticSettings, Strength};
pub use reference_soar::{ReferenceSoar, ReferenceSoarSettings, SoarRule};
pub use synaptic_intelligence::{SynapticIntelligence, SynapticIntelligenceSettings};

use crate::actor_critic::{Actor, Critic, Gradient};

/// Standard deviation of the actions at which divergences are measured: with the policy's own, which shrinks in
/// training, the last task would always weigh most.
pub(crate) const REFERENCE_STD: f32 = 0.3;

/// Factors on penalties.
const STRENGTH: Limits = Limits::from(0.0, 1e6, "");

/// A method of continual learning, with what it remembers of earlier tasks.
pub trait Regulariser {
    /// Bytes that are kept from task to task beside the policy.
    fn stored_bytes(&self) -> usize;

    /// Bytes needed while a task is learned, the stored ones included.
    fn training_bytes(&self) -> usize {
        self.stored_bytes()
    }

    /// Adds its penalty's gradient to that of a minibatch's loss, before that is clipped.
    fn add_gradient(&mut self, networks: Learning<'_>, gradient: &mut Gradient);

    /// After Adam has moved the policy.
    fn after_step(&mut self, _actor: &mut Actor, _step: &OptimiserStep<'_>) {}

    /// Takes in what must not be forgotten of a task.
    fn consolidate(&mut self, ended: &EndedTask<'_>);

    /// Whether it finds out by itself when a task has ended.
    fn watches(&self) -> bool {
        false
    }

    /// Looks at a rollout before the policy learns from it; whether it is of another task than the one before, whose end the regulariser
    /// has then taken in.
    fn watch(&mut self, _flight: &Flight<'_>) -> bool {
        false
    }
}

/// The networks that learn.
#[derive(Clone, Copy, Debug)]
pub struct Learning<'a> {
    /// The policy.
    pub actor: &'a Actor,
    /// Its value function.
    pub critic: &'a Critic,
}

/// A step that Adam has taken, along `gradient · scale`.
#[derive(Clone, Copy, Debug)]
pub struct OptimiserStep<'a> {
    /// The minibatch's, the penalty's included.
    pub gradient: &'a Gradient,
    /// By which it was clipped, at most 1.
    pub scale: f32,
    /// Of the step.
    pub learning_rate: f32,
}

/// A rollout.
#[derive(Clone, Copy, Debug)]
pub struct Flight<'a> {
    /// The policy that flew.
    pub actor: &'a Actor,
    /// What it observed, one environment batch after the other.
    pub visited: &'a [Visited<'a>],
    /// Seed of the training.
    pub seed: Seed,
}

/// A task at its end.
#[derive(Clone, Copy, Debug)]
pub struct EndedTask<'a> {
    /// The policy that has learned it.
    pub actor: &'a Actor,
    /// Its value function.
    pub critic: &'a Critic,
    /// Gradient of the loss, laid out as the actor's parameters, on a flight of that very policy.
    pub gradient: &'a [f32],
    /// What it observed on that flight, one environment batch after the other.
    pub visited: &'a [Visited<'a>],
    /// Seed of the task's training.
    pub seed: Seed,
}

impl<'a> EndedTask<'a> {
    /// The flight on which it is shown.
    pub fn flight(&self) -> Flight<'a> {
        Flight { actor: self.actor, visited: self.visited, seed: self.seed }
    }
}

/// What a policy observed in one environment batch.
#[derive(Clone, Debug)]
pub struct Visited<'a> {
    /// Samples of a slice, the same for all batches.
    pub columns: usize,
    /// Slices `[inputs of the policy][columns]`, perhaps with rows behind these that others read: an observation, and behind it
    /// what a memory held before.
    pub slices: Vec<&'a [f32]>,
}

/// Fine-tuning: nothing keeps earlier tasks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FineTuning;

impl Regulariser for FineTuning {
    fn stored_bytes(&self) -> usize {
        0
    }

    fn add_gradient(&mut self, _networks: Learning<'_>, _gradient: &mut Gradient) {}

    fn consolidate(&mut self, _ended: &EndedTask<'_>) {}
}

/// The regularisers that ship, from a list of them: for each its name, its state, its settings and its YAML key.
macro_rules! regularisers {
    ($($(#[doc = $doc:literal])* $name:ident($state:ident, $settings:ident, $key:literal);)*) => {
        /// A regulariser that ships, with what it remembers.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        pub enum ShippedRegulariser {
            /// Fine-tuning: nothing is remembered.
            None,
            $($(#[doc = $doc])* $name($state),)*
        }

        /// What keeps earlier tasks while another is learned.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        pub enum RegulariserSettings {
            /// Nothing: fine-tuning.
            #[default]
            #[serde(rename = "none")]
            None,
            $($(#[doc = $doc])* #[serde(rename = $key)] $name($settings),)*
        }

        impl RegulariserSettings {
            /// A regulariser that has seen nothing yet, for networks of these shapes.
            pub fn begin(&self, networks: Learning<'_>) -> ShippedRegulariser {
                match self {
                    Self::None => ShippedRegulariser::None,
                    $(Self::$name(settings) => ShippedRegulariser::$name($state::new(settings, networks)),)*
                }
            }

            /// Whether it finds out by itself when a task has ended.
            pub fn finds_boundaries(&self) -> bool {
                match self {
                    Self::CompactCoreset(settings) => settings.boundaries == Boundaries::Found,
                    Self::None
                    | Self::Quadratic(_)
                    | Self::FunctionSpace(_)
                    | Self::ReferenceSoar(_)
                    | Self::SynapticIntelligence(_)
                    | Self::Coreset(_) => false,
                }
            }

            /// Whether all numbers are in their range.
            ///
            /// # Errors
            /// The first that is not.
            pub fn check(&self, field: &Field<'_>) -> Result<(), ConfigError> {
                match self {
                    Self::None => Ok(()),
                    $(Self::$name(settings) => settings.check(&field.at($key)),)*
                }
            }
        }

        impl Regulariser for ShippedRegulariser {
            fn stored_bytes(&self) -> usize {
                match self {
                    Self::None => 0,
                    $(Self::$name(state) => state.stored_bytes(),)*
                }
            }

            fn training_bytes(&self) -> usize {
                match self {
                    Self::None => 0,
                    $(Self::$name(state) => state.training_bytes(),)*
                }
            }

            fn add_gradient(&mut self, networks: Learning<'_>, gradient: &mut Gradient) {
                match self {
                    Self::None => {}
                    $(Self::$name(state) => state.add_gradient(networks, gradient),)*
                }
            }

            fn after_step(&mut self, actor: &mut Actor, step: &OptimiserStep<'_>) {
                match self {
                    Self::None => {}
                    $(Self::$name(state) => state.after_step(actor, step),)*
                }
            }

            fn consolidate(&mut self, ended: &EndedTask<'_>) {
                match self {
                    Self::None => {}
                    $(Self::$name(state) => state.consolidate(ended),)*
                }
            }

            fn watches(&self) -> bool {
                match self {
                    Self::None => false,
                    $(Self::$name(state) => state.watches(),)*
                }
            }

            fn watch(&mut self, flight: &Flight<'_>) -> bool {
                match self {
                    Self::None => false,
                    $(Self::$name(state) => state.watch(flight),)*
                }
            }
        }
    };
}

// Checkpoints hold the place of a regulariser in this list: new ones come last.
regularisers! {
    /// One running anchor: corrected IL-SOAR, online EWC, MAS, L2.
    Quadratic(QuadraticPenalty, QuadraticSettings, "anchor");
    /// Corrected IL-SOAR with its second order in the actions, where it is exact, over a model of the states.
    FunctionSpace(FunctionSpace, FunctionSpaceSettings, "action_anchor");
    /// IL-SOAR as the thesis and its code wrote it.
    ReferenceSoar(ReferenceSoar, ReferenceSoarSettings, "published");
    /// Synaptic intelligence (Zenke et al. 2017).
    SynapticIntelligence(SynapticIntelligence, SynapticIntelligenceSettings, "synaptic_intelligence");
    /// States of earlier tasks, on which the policy is asked to do what it did.
    Coreset(Coreset, CoresetSettings, "coreset");
    /// Function-space rehearsal on a few kilobytes of states, with a strength that a budget of divergence sets.
    CompactCoreset(CompactCoreset, CompactCoresetSettings, "compact_coreset");
}

/// Whether a number of settings is within its limits.
fn check_number(field: &Field<'_>, key: &str, value: f32, limits: &Limits) -> Result<(), ConfigError> {
    field.at(key).number(f64::from(value), limits).map(drop)
}

const fn one() -> f32 {
    1.0
}
