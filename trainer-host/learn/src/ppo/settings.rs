//! What a PPO run is made with.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use kestrel_core::activation::Activation;
use kestrel_core::encoder::{Convolution, EncoderError, EncoderShape, Volume};

pub use crate::actor_critic::EncoderSharing;
use crate::network::cnn::Cnn;
use crate::rollout::{CriticScope, ENV_BATCH, SMALLEST_MINIBATCH};
use crate::schedule::Schedule;

/// The hyperparameters of PPO, under the names of the field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PpoSettings {
    /// Environments in parallel, a multiple of [`ENV_BATCH`]; where several agents share one, agents, which must fill
    /// environment batches of [`batch_rows`](crate::rollout::batch_rows).
    pub environments: usize,
    /// Steps of every agent between updates.
    pub steps_per_rollout: usize,
    /// Environment steps of the whole training; a linear schedule ends there.
    pub total_steps: u64,
    /// Passes over each rollout.
    pub epochs: u32,
    /// Samples per gradient step, a multiple of [`ENV_BATCH`], or 32, 64 or 128; the last of an epoch may be smaller.
    pub minibatch: usize,
    /// Discount per step, in \[0, 1\].
    pub discount: f32,
    /// Trace decay of the advantage estimate, in \[0, 1\].
    pub gae_lambda: f32,
    /// How far the probability ratio may leave one before its gain stops counting.
    pub clip_range: f32,
    /// Step size of Adam.
    pub learning_rate: Schedule,
    /// Weight of the entropy bonus.
    pub entropy_weight: f32,
    /// Weight of the mean squared error of the critic.
    pub value_weight: f32,
    /// Longest gradient of both networks together; longer ones are scaled down.
    pub gradient_norm_limit: f32,
    /// Logarithm of the actions' standard deviation at the start.
    pub initial_log_std: f32,
    /// Lowest logarithm of the standard deviation.
    pub lowest_log_std: f32,
    /// Highest logarithm of the standard deviation.
    pub highest_log_std: f32,
    /// Widths of the actor's hidden layers.
    pub actor_hidden: Vec<usize>,
    /// Widths of the critic's hidden layers.
    pub critic_hidden: Vec<usize>,
    /// What follows the hidden layers of both.
    pub activation: Activation,
    /// How a policy with a camera looks at its images.
    pub encoder: EncoderSettings,
    /// What the policy remembers from step to step; nothing as a rule.
    pub memory: Option<MemorySettings>,
    /// An update stops once a minibatch's `approx_kl` exceeds one and a half times this, as Stable-Baselines3.
    pub target_kl: Option<f32>,
    /// Whose observations the critic reads.
    pub critic_scope: CriticScope,
    /// In which unit the critic learns returns.
    pub value_scale: ValueScaling,
    /// From this share of the training on, in \[0, 1\], the policy flies and learns with the weights of its export.
    pub quantised_from: Option<f32>,
    /// A teacher that says what to do while the policy does not know; none as a rule.
    pub teacher: Option<TeacherSettings>,
    /// Fixed factor on rewards before the critic sees them; the logged returns are unscaled.
    pub reward_scale: f32,
}

impl Default for PpoSettings {
    fn default() -> Self {
        Self {
            environments: 1024,
            steps_per_rollout: 32,
            total_steps: 10_000_000,
            epochs: 4,
            minibatch: 4096,
            discount: 0.99,
            gae_lambda: 0.95,
            clip_range: 0.2,
            learning_rate: Schedule::Linear { from: 1e-3, to: 1e-4 },
            entropy_weight: 0.0,
            value_weight: 0.5,
            gradient_norm_limit: 0.5,
            initial_log_std: -0.5,
            lowest_log_std: -3.0,
            highest_log_std: 0.5,
            actor_hidden: vec![64, 64],
            critic_hidden: vec![64, 64],
            activation: Activation::Tanh,
            encoder: EncoderSettings::default(),
            memory: None,
            target_kl: None,
            critic_scope: CriticScope::Own,
            value_scale: ValueScaling::Fixed,
            quantised_from: None,
            teacher: None,
            reward_scale: 1.0,
        }
    }
}

/// A gated recurrent unit in front of the policy, and how far gradients go back through it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MemorySettings {
    /// Values of its hidden state: a multiple of 4.
    pub units: usize,
    /// Steps that are differentiated together, a divisor of those of a rollout. A minibatch is made of such windows.
    pub steps_per_window: usize,
}

/// How images are encoded.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct EncoderSettings {
    /// The convolutions.
    pub kind: EncoderKind,
    /// Whether actor and critic have the same.
    pub sharing: EncoderSharing,
    /// Widths of layers that read the observation and the features for both networks, or for each if they do not share;
    /// none where each reads both itself.
    pub trunk: Vec<usize>,
}

/// Convolutions and a dense layer.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum EncoderKind {
    /// [`Cnn::small`].
    #[default]
    Small,
    /// [`Cnn::nature`], with so many features.
    Nature {
        /// At least one; 512 in Stable-Baselines3, 256 with several inputs.
        features: u16,
    },
    /// Others.
    Custom {
        /// One after the other.
        convolutions: Vec<Convolution>,
        /// What the dense layer behind them makes.
        features: u16,
    },
}

impl EncoderKind {
    /// The network for images of a shape.
    ///
    /// # Errors
    /// When they are too small or too large for it.
    pub fn cnn(&self, image: Volume) -> Result<Cnn, EncoderError> {
        match self {
            Self::Small => Cnn::small(image),
            Self::Nature { features } => Cnn::nature(image, *features),
            Self::Custom { convolutions, features } => {
                EncoderShape::new(image, convolutions, *features).map(Cnn::new)
            }
        }
    }
}

/// How much a teacher counts (kickstarting, Schmitt et al. 2018): the policy acts by itself, the teacher says in every
/// state what it would do there, and the loss has the divergence from that beside the surrogate, with an annealed weight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TeacherSettings {
    /// Weight of the imitation loss in the first update; above zero.
    pub weight: f32,
    /// Share of the training, above 0 to 1, over which it falls to zero in a straight line.
    pub until: f32,
}

impl TeacherSettings {
    /// The weight once such a share of the training is done.
    pub(super) fn weight_at(&self, progress: f64) -> f32 {
        self.weight * (1.0 - progress as f32 / self.until).max(0.0)
    }
}

/// In which unit the critic learns returns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ValueScaling {
    /// That of the rewards.
    #[default]
    Fixed,
    /// The spread of each task's returns, tracked (`PopArt`, van Hasselt et al. 2016).
    PopArt,
}

/// Settings that no training can be made with.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SettingsError {
    /// Environments and minibatches come in environment batches.
    #[error("{name} is {found}, expected a positive multiple of {ENV_BATCH}{or}")]
    NotBatches {
        /// Which setting.
        name: &'static str,
        /// Its value.
        found: usize,
        /// What else it may be.
        or: &'static str,
    },
    /// Steps and minibatches of a policy with memory come in windows.
    #[error("{name} is {found}, expected a multiple of {of}{or}: whole windows of a memory")]
    NotWindows {
        /// Which setting.
        name: &'static str,
        /// Its value.
        found: usize,
        /// Of a window.
        of: usize,
        /// What else it may be.
        or: &'static str,
    },
    /// A count that must not be zero.
    #[error("{name} is 0, expected at least 1")]
    Zero {
        /// Which setting.
        name: &'static str,
    },
    /// A number outside its range (or not a number).
    #[error("{name} is {found}, expected {expected}")]
    OutOfRange {
        /// Which setting.
        name: &'static str,
        /// Its value.
        found: f32,
        /// Its range in words.
        expected: &'static str,
    },
}

impl PpoSettings {
    /// Samples of one rollout.
    pub fn batch(&self) -> usize {
        self.environments * self.steps_per_rollout
    }

    /// Whether a [`Trainer`](super::Trainer) can be made with these settings.
    ///
    /// # Errors
    /// The first setting that is out of its range, with what was expected.
    pub fn check(&self) -> Result<(), SettingsError> {
        self.check_counts()?;
        self.check_numbers()?;
        self.check_learning_rate()
    }

    /// Steps that are differentiated together.
    pub fn steps_per_window(&self) -> usize {
        self.memory.map_or(1, |memory| memory.steps_per_window)
    }

    fn check_counts(&self) -> Result<(), SettingsError> {
        let env_batches = |found: usize| found != 0 && found.is_multiple_of(ENV_BATCH);
        if !env_batches(self.environments) {
            return Err(SettingsError::NotBatches { name: "environments", found: self.environments, or: "" });
        }
        let steps = self.steps_per_window();
        if self.memory.is_none() && !fits_minibatch(self.minibatch) {
            let or = ", or 32, 64 or 128";
            return Err(SettingsError::NotBatches { name: "minibatch", found: self.minibatch, or });
        }
        if self.memory.is_some() && steps != 0 {
            if !self.steps_per_rollout.is_multiple_of(steps) {
                let found = self.steps_per_rollout;
                return Err(SettingsError::NotWindows { name: "steps_per_rollout", found, of: steps, or: "" });
            }
            if !fits_windows(self.minibatch, steps) {
                let (found, of, or) =
                    (self.minibatch, ENV_BATCH * steps, ", or an eighth, a quarter or half of it");
                return Err(SettingsError::NotWindows { name: "minibatch", found, of, or });
            }
        }
        let narrowest = |hidden: &[usize]| hidden.iter().copied().min().unwrap_or(1);
        let counts = [
            ("steps_per_rollout", self.steps_per_rollout),
            ("epochs", self.epochs as usize),
            ("actor_hidden", narrowest(&self.actor_hidden)),
            ("critic_hidden", narrowest(&self.critic_hidden)),
            ("memory.units", self.memory.map_or(1, |memory| memory.units)),
            ("memory.steps_per_window", self.steps_per_window()),
        ];
        match counts.into_iter().find(|(_, count)| *count == 0) {
            Some((name, _)) => Err(SettingsError::Zero { name }),
            None => Ok(()),
        }
    }

    fn check_numbers(&self) -> Result<(), SettingsError> {
        within("discount", self.discount, 0.0..=1.0, "0 to 1")?;
        within("gae_lambda", self.gae_lambda, 0.0..=1.0, "0 to 1")?;
        positive("clip_range", self.clip_range)?;
        positive("gradient_norm_limit", self.gradient_norm_limit)?;
        positive("reward_scale", self.reward_scale)?;
        not_negative("entropy_weight", self.entropy_weight)?;
        not_negative("value_weight", self.value_weight)?;
        // Beyond e^±10 the density of an action leaves the range of f32.
        within("lowest_log_std", self.lowest_log_std, -10.0..=self.highest_log_std, "-10 to highest_log_std")?;
        within("highest_log_std", self.highest_log_std, self.lowest_log_std..=10.0, "lowest_log_std to 10")?;
        let range = self.lowest_log_std..=self.highest_log_std;
        within("initial_log_std", self.initial_log_std, range, "lowest_log_std to highest_log_std")?;
        if let Some(share) = self.quantised_from {
            within("quantised_from", share, 0.0..=1.0, "0 to 1")?;
        }
        if let Some(teacher) = self.teacher {
            positive("teacher.weight", teacher.weight)?;
            within("teacher.until", teacher.until, f32::MIN_POSITIVE..=1.0, "above 0 to 1")?;
        }
        self.target_kl.map_or(Ok(()), |target| positive("target_kl", target))
    }

    fn check_learning_rate(&self) -> Result<(), SettingsError> {
        match self.learning_rate {
            Schedule::Constant(rate) => positive("learning_rate", rate),
            Schedule::Linear { from, to } => {
                positive("learning_rate.from", from)?;
                not_negative("learning_rate.to", to)
            }
            Schedule::KlAdaptive { initial, target, low, high } => {
                positive("learning_rate.low", low)?;
                positive("learning_rate.target", target)?;
                within("learning_rate.initial", initial, low..=high, "low to high")
            }
        }
    }
}

/// Whether slices can make a minibatch of so many samples.
pub fn fits_minibatch(samples: usize) -> bool {
    let small = (SMALLEST_MINIBATCH..ENV_BATCH).contains(&samples) && samples.is_power_of_two();
    small || (samples != 0 && samples.is_multiple_of(ENV_BATCH))
}

/// Whether windows of so many steps, not zero, can make a minibatch of so many samples.
pub fn fits_windows(samples: usize, steps: usize) -> bool {
    samples.is_multiple_of(steps) && fits_minibatch(samples / steps)
}

type Checked = Result<(), SettingsError>;

fn within(
    name: &'static str,
    found: f32,
    range: std::ops::RangeInclusive<f32>,
    expected: &'static str,
) -> Checked {
    if found.is_finite() && range.contains(&found) {
        return Ok(());
    }
    Err(SettingsError::OutOfRange { name, found, expected })
}

fn positive(name: &'static str, found: f32) -> Checked {
    within(name, found, f32::MIN_POSITIVE..=f32::MAX, "a positive number")
}

fn not_negative(name: &'static str, found: f32) -> Checked {
    within(name, found, 0.0..=f32::MAX, "a number of at least 0")
}
