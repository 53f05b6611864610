//! How the policy is trained.

use std::sync::Arc;

use kestrel_sim::config::{ConfigError, Field, Limits};
use kestrel_sim::gradient::LANES;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use kestrel_core::activation::Activation;
use kestrel_learn::analytic::AnalyticSettings;
use kestrel_learn::ppo::{PpoSettings, ValueScaling, fits_minibatch};
use kestrel_learn::rollout::{CriticScope, ENV_BATCH, batch_rows};
use kestrel_learn::schedule::Schedule;

use super::eye::EyeConfig;
use super::initial_policy::InitialPolicyConfig;
use super::memory::MemoryConfig;
use super::teacher::TeacherConfig;
use crate::learner::LearnerSettings;

/// Most samples of one rollout: at 60 values each they fill 4 GiB.
const ROLLOUT_LIMIT: u64 = 1 << 24;

/// Most environments, and most samples of a minibatch: every environment batch of them has a workspace of its own, about 1 MB
/// with hidden layers of 64.
const PARALLEL_LIMIT: u64 = 1 << 16;

/// Environments where a file says nothing, as far as teams allow.
const ENVIRONMENTS: u64 = 1024;

/// Widest hidden layer.
const HIDDEN_LIMIT: u64 = 1024;

const DISCOUNT: Limits = Limits::between(0.0, 1.0, "");
const UNIT: Limits = Limits::from(0.0, 1.0, "");
const RATE: Limits = Limits::above(0.0, 1.0, "");

/// Proximal policy optimisation (Schulman et al. 2017) with separate actor and critic, or gradients through the physics.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TrainingConfig {
    /// What all randomness of training follows from.
    pub seed: u64,
    /// Steps of all drones together after which training ends.
    pub total_steps: u64,
    /// Environments that fly at the same time: a multiple of 256. Where several drones share one, drones in all, and also
    /// a multiple of what divides evenly into 256 and into teams: 768 for teams of 3. Left out, 1,024 or the next such
    /// number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environments: Option<u64>,
    /// Steps of each drone between two updates.
    pub steps_per_rollout: u64,
    /// Passes over a rollout in one update.
    pub epochs: u64,
    /// Samples in one gradient step: a multiple of 256, or 32, 64 or 128, that divides `environments · steps_per_rollout`.
    pub minibatch: u64,
    /// Worth of a reward one step later; 0.99 at 100 Hz looks about a second ahead.
    pub discount: f64,
    /// Trace of the generalised advantage estimation: 0 trusts the critic, 1 trusts the returns.
    pub gae_lambda: f64,
    /// How far an update may move the probability of an action: the ratio stays within `1 ± clip_range`.
    pub clip_range: f64,
    /// Step size of Adam.
    pub learning_rate: ScheduleConfig,
    /// Weight of the entropy in the loss; above zero keeps exploring.
    pub entropy_weight: f64,
    /// Weight of the critic's loss.
    pub value_weight: f64,
    /// Longest gradient; longer ones are clipped to it.
    pub gradient_norm_limit: f64,
    /// Natural logarithm of the standard deviation of the first actions.
    pub initial_log_std: f64,
    /// Lowest natural logarithm of the standard deviation, so that exploration does not die out.
    pub lowest_log_std: f64,
    /// Highest natural logarithm of the standard deviation.
    pub highest_log_std: f64,
    /// Widths of the actor's hidden layers.
    pub actor_hidden: Vec<u64>,
    /// Widths of the critic's hidden layers.
    pub critic_hidden: Vec<u64>,
    /// What follows the hidden layers of both.
    #[serde(skip_serializing_if = "ActivationConfig::is_default")]
    pub activation: ActivationConfig,
    /// How a policy with a camera looks at its images.
    pub eye: EyeConfig,
    /// What the policy remembers from step to step; nothing where this is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory: Option<MemoryConfig>,
    /// An update stops early once its KL divergence exceeds one and a half times this.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target_kl: Option<f64>,
    /// Whose observations the critic reads, where several drones fly together.
    pub critic_scope: CriticScopeConfig,
    /// In which unit the critic learns returns.
    pub value_scale: ValueScaleConfig,
    /// Share of the training, 0 to 1, from which on the policy flies and learns with the weights of its export in fixed point
    /// (quantisation-aware training), for policies that lose by the rounding: above all those that see, whose eyes have 8 bits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quantised_from: Option<f64>,
    /// Who says what to do while the policy does not know.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub teacher: Option<TeacherConfig>,
    /// Rewards are multiplied by this before learning, so that returns are of order one.
    pub reward_scale: f64,
    /// What training begins with in place of random weights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial_policy: Option<InitialPolicyConfig>,
    /// Train by gradients through the physics instead of PPO, whose keys then wait until this one is taken away.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub analytic: Option<AnalyticConfig>,
}

/// Backpropagation through time: the derivative of the rewards of a window of flight goes back through physics, policy
/// and observation to the policy's parameters. For tasks in free air whose rewards have derivatives (`distance`,
/// `proximity`, `velocity`, …); those that have none (`failure`, `success`) teach nothing.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AnalyticConfig {
    /// Steps of all drones together after which training ends.
    pub total_steps: u64,
    /// Environments that fly at the same time: a multiple of 64.
    pub environments: u64,
    /// Steps of a window, through which derivatives go back.
    pub steps_per_window: u64,
    /// Step size of Adam.
    pub learning_rate: ScheduleConfig,
    /// Longest gradient of the mean reward of a step; longer ones are scaled down to it.
    pub gradient_norm_limit: f64,
    /// Share of the episodes that are ended before a window, so that drones are at different moments of theirs.
    pub restart_share: f64,
    /// Longest derivative by the state of a drone on the way back; longer ones are scaled down to it.
    pub adjoint_limit: f64,
}

impl Default for AnalyticConfig {
    fn default() -> Self {
        let AnalyticSettings { environments, steps_per_window, total_steps, .. } = AnalyticSettings::default();
        Self {
            total_steps,
            environments: environments as u64,
            steps_per_window: steps_per_window as u64,
            learning_rate: ScheduleConfig::Linear { from: 12e-3, to: 6e-4 },
            gradient_norm_limit: 1.0,
            restart_share: 0.3,
            adjoint_limit: 100.0,
        }
    }
}

impl AnalyticConfig {
    fn check(
        &self,
        (actor_hidden, activation): (Vec<usize>, Activation),
        field: &Field<'_>,
    ) -> Result<AnalyticSettings, ConfigError> {
        let environments = field.at("environments");
        if self.environments == 0
            || self.environments > PARALLEL_LIMIT
            || !self.environments.is_multiple_of(LANES as u64)
        {
            let expected = format!("a multiple of {LANES}, at most {PARALLEL_LIMIT}");
            return Err(environments.refuse(self.environments, expected));
        }
        let number = |key: &str, value: f64, limits: Limits| field.at(key).number(value, &limits);
        let steps_per_window = field.at("steps_per_window").whole(self.steps_per_window, 1..=4096)?;
        let window = self.environments * steps_per_window;
        if self.total_steps < window {
            let expected = format!("at least {window}, one window (environments · steps_per_window)");
            return Err(field.at("total_steps").refuse(self.total_steps, expected));
        }
        Ok(AnalyticSettings {
            environments: self.environments as usize,
            steps_per_window: steps_per_window as usize,
            total_steps: self.total_steps,
            learning_rate: self.learning_rate.check(&field.at("learning_rate"))?,
            gradient_norm_limit: number(
                "gradient_norm_limit",
                self.gradient_norm_limit,
                Limits::above(0.0, 1e6, ""),
            )?,
            restart_share: number("restart_share", self.restart_share, UNIT)?,
            adjoint_limit: number("adjoint_limit", self.adjoint_limit, Limits::above(0.0, 1e9, ""))?,
            actor_hidden,
            activation,
            memory_units: 0,
        })
    }
}

/// What follows a hidden layer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActivationConfig {
    /// The hyperbolic tangent.
    #[default]
    Tanh,
    /// The rectifier: what PX4's neural control computes.
    Relu,
}

impl ActivationConfig {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }

    fn activation(self) -> Activation {
        match self {
            Self::Tanh => Activation::Tanh,
            Self::Relu => Activation::Relu,
        }
    }
}

/// Whose observations the critic reads. The policy reads the drone's own in any case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CriticScopeConfig {
    /// The drone's own (IPPO).
    #[default]
    Own,
    /// Its own, then those of its team mates (MAPPO's centralised critic).
    Team,
}

/// In which unit the critic learns returns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ValueScaleConfig {
    /// That of the scaled rewards.
    Fixed,
    /// The spread of each task's returns, tracked (`PopArt`): for tasks whose returns differ in size.
    Popart,
}

/// A learning rate over the course of training.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ScheduleConfig {
    /// The same throughout.
    Constant(f64),
    /// Linear in the steps done.
    Linear {
        /// At the start.
        from: f64,
        /// At the end.
        to: f64,
    },
    /// Lowered when an update moved the policy too far, raised when it hardly moved it (Rudin et al. 2022).
    KlAdaptive {
        /// Of the first update.
        initial: f64,
        /// Wanted KL divergence of an update.
        target: f64,
        /// Lowest learning rate.
        low: f64,
        /// Highest learning rate.
        high: f64,
    },
}

impl Default for TrainingConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            total_steps: 10_000_000,
            environments: None,
            steps_per_rollout: 32,
            epochs: 4,
            minibatch: 4096,
            discount: 0.99,
            gae_lambda: 0.95,
            clip_range: 0.2,
            learning_rate: ScheduleConfig::Linear { from: 1e-3, to: 1e-4 },
            entropy_weight: 0.0,
            value_weight: 0.5,
            gradient_norm_limit: 0.5,
            initial_log_std: -0.5,
            lowest_log_std: -3.0,
            highest_log_std: 0.5,
            actor_hidden: vec![64, 64],
            critic_hidden: vec![64, 64],
            activation: ActivationConfig::Tanh,
            eye: EyeConfig::default(),
            memory: None,
            target_kl: None,
            critic_scope: CriticScopeConfig::Own,
            value_scale: ValueScaleConfig::Fixed,
            quantised_from: None,
            teacher: None,
            reward_scale: 1.0,
            initial_policy: None,
            analytic: None,
        }
    }
}

impl TrainingConfig {
    /// The same, with whole teams of so many drones where it does not say how many drones.
    #[must_use]
    pub fn for_teams(&self, teams: impl Iterator<Item = usize>) -> Self {
        let fitting = ENVIRONMENTS.next_multiple_of(batch_rows(teams) as u64);
        Self { environments: Some(self.environments.unwrap_or(fitting)), ..self.clone() }
    }

    fn environments(&self) -> u64 {
        self.environments.unwrap_or(ENVIRONMENTS)
    }

    /// The settings of whoever trains.
    ///
    /// # Errors
    /// When a number is out of range, sizes do not fit together, or the initial policy has another shape.
    pub fn check(&self, field: &Field<'_>) -> Result<LearnerSettings, ConfigError> {
        let (ppo, analytic) = (self.check_ppo(field)?, self.check_analytic(field)?);
        let settings = LearnerSettings { ppo, analytic, initial_policy: None };
        let Some(policy) = &self.initial_policy else { return Ok(settings) };
        let policy = policy.check(&settings, &field.at("initial_policy"))?;
        Ok(LearnerSettings { initial_policy: Some(Arc::new(policy)), ..settings })
    }

    /// The settings of PPO.
    fn check_ppo(&self, field: &Field<'_>) -> Result<PpoSettings, ConfigError> {
        self.check_sizes(field)?;
        let number = |key: &str, value: f64, limits: Limits| field.at(key).number(value, &limits);
        let log_std = Limits::from(self.lowest_log_std, self.highest_log_std, "");
        let lowest_log_std = number("lowest_log_std", self.lowest_log_std, Limits::from(-10.0, 10.0, ""))?;
        let highest_log_std =
            number("highest_log_std", self.highest_log_std, Limits::from(self.lowest_log_std, 10.0, ""))?;
        let quantised_from = self.quantised_from.map(|share| number("quantised_from", share, UNIT)).transpose()?;
        let teacher = self.teacher.map(|teacher| teacher.check(&field.at("teacher"))).transpose()?;
        let encoder = self.eye.check(&field.at("eye"))?;
        if self.activation == ActivationConfig::Relu && !encoder.trunk.is_empty() {
            return Err(field
                .at("activation")
                .refuse("relu", "tanh beside `eye.trunk`, whose layers have tangents"));
        }
        let sizes = (self.steps_per_rollout, self.minibatch);
        let memory = self.memory.map(|memory| memory.check(sizes, field)).transpose()?;
        let target_kl = self.target_kl.map(|target| number("target_kl", target, RATE)).transpose()?;
        Ok(PpoSettings {
            environments: self.environments() as usize,
            steps_per_rollout: self.steps_per_rollout as usize,
            total_steps: self.total_steps,
            epochs: field.at("epochs").whole(self.epochs, 1..=100)? as u32,
            minibatch: self.minibatch as usize,
            discount: number("discount", self.discount, DISCOUNT)?,
            gae_lambda: number("gae_lambda", self.gae_lambda, UNIT)?,
            clip_range: number("clip_range", self.clip_range, RATE)?,
            learning_rate: self.learning_rate.check(&field.at("learning_rate"))?,
            entropy_weight: number("entropy_weight", self.entropy_weight, UNIT)?,
            value_weight: number("value_weight", self.value_weight, Limits::above(0.0, 100.0, ""))?,
            gradient_norm_limit: number(
                "gradient_norm_limit",
                self.gradient_norm_limit,
                Limits::above(0.0, 1e6, ""),
            )?,
            initial_log_std: number("initial_log_std", self.initial_log_std, log_std)?,
            lowest_log_std,
            highest_log_std,
            actor_hidden: hidden(&self.actor_hidden, &field.at("actor_hidden"))?,
            critic_hidden: hidden(&self.critic_hidden, &field.at("critic_hidden"))?,
            activation: self.activation.activation(),
            encoder,
            memory,
            target_kl,
            critic_scope: match self.critic_scope {
                CriticScopeConfig::Own => CriticScope::Own,
                CriticScopeConfig::Team => CriticScope::Team,
            },
            value_scale: match self.value_scale {
                ValueScaleConfig::Fixed => ValueScaling::Fixed,
                ValueScaleConfig::Popart => ValueScaling::PopArt,
            },
            quantised_from,
            teacher,
            reward_scale: number("reward_scale", self.reward_scale, Limits::above(0.0, 1e6, ""))?,
        })
    }

    /// The settings of training by gradients through the physics, where it is asked for.
    fn check_analytic(&self, field: &Field<'_>) -> Result<Option<AnalyticSettings>, ConfigError> {
        let Some(analytic) = &self.analytic else { return Ok(None) };
        let actor_hidden = hidden(&self.actor_hidden, &field.at("actor_hidden"))?;
        let settings = analytic.check((actor_hidden, self.activation.activation()), &field.at("analytic"))?;
        let memory_units = self.memory.map_or(0, |memory| memory.units as usize);
        Ok(Some(AnalyticSettings { memory_units, ..settings }))
    }

    /// Environments, rollout, minibatch and total divide each other.
    fn check_sizes(&self, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("steps_per_rollout").whole(self.steps_per_rollout, 1..=65_536)?;
        check_panels(self.environments(), &field.at("environments"))?;
        // Those of a memory are checked with it.
        let fits = self.memory.is_some() || fits_minibatch(self.minibatch as usize);
        if !fits || self.minibatch > PARALLEL_LIMIT {
            let expected = format!("a multiple of {ENV_BATCH}, at most {PARALLEL_LIMIT}, or 32, 64 or 128");
            return Err(field.at("minibatch").refuse(self.minibatch, expected));
        }
        let rollout = self.environments().saturating_mul(self.steps_per_rollout);
        if rollout > ROLLOUT_LIMIT {
            let found = format!("a rollout of {rollout} samples (environments · steps_per_rollout)");
            return Err(field.reject(found, format!("at most {ROLLOUT_LIMIT}")));
        }
        if !rollout.is_multiple_of(self.minibatch) {
            let expected = format!("a divisor of {rollout}, which is environments · steps_per_rollout");
            return Err(field.at("minibatch").refuse(self.minibatch, expected));
        }
        if self.total_steps < rollout {
            let expected = format!("at least {rollout}, one rollout (environments · steps_per_rollout)");
            return Err(field.at("total_steps").refuse(self.total_steps, expected));
        }
        Ok(())
    }
}

fn check_panels(value: u64, field: &Field<'_>) -> Result<(), ConfigError> {
    if value > 0 && value <= PARALLEL_LIMIT && value.is_multiple_of(ENV_BATCH as u64) {
        return Ok(());
    }
    Err(field.refuse(value, format!("a multiple of {ENV_BATCH}, at most {PARALLEL_LIMIT}")))
}

pub(super) fn hidden(widths: &[u64], field: &Field<'_>) -> Result<Vec<usize>, ConfigError> {
    if !(1..=4).contains(&widths.len()) {
        return Err(field.refuse("", "a list of 1 to 4 widths"));
    }
    let width = |(index, width): (usize, &u64)| field.at(index).whole(*width, 1..=HIDDEN_LIMIT);
    widths.iter().enumerate().map(width).map(|checked| checked.map(|value| value as usize)).collect()
}

impl ScheduleConfig {
    fn check(&self, field: &Field<'_>) -> Result<Schedule, ConfigError> {
        let rate = |field: &Field<'_>, key: &str, value: f64| field.at(key).number(value, &RATE);
        match *self {
            Self::Constant(value) => Ok(Schedule::Constant(rate(field, "constant", value)?)),
            Self::Linear { from, to } => {
                let field = field.at("linear");
                Ok(Schedule::Linear { from: rate(&field, "from", from)?, to: rate(&field, "to", to)? })
            }
            Self::KlAdaptive { initial, target, low, high } => {
                let field = field.at("kl_adaptive");
                let low_rate = rate(&field, "low", low)?;
                let range = Limits::from(low, 1.0, "");
                let high_rate = field.at("high").number(high, &range)?;
                let initial = field.at("initial").number(initial, &Limits::from(low, high, ""))?;
                let target = rate(&field, "target", target)?;
                Ok(Schedule::KlAdaptive { initial, target, low: low_rate, high: high_rate })
            }
        }
    }
}
