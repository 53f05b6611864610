//! Methods of a study as users write them.

use kestrel_sim::config::{ConfigError, Field, Limits};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::experiment_config::TrainingConfig;
use crate::study::procedure::{Inheritance, Method, Procedure};
use crate::study::sharing::{LogStds, Merge, Optimisers, Rows};
use kestrel_learn::consolidation::{
    ActionAnchorSettings, AnchoredSettings, ConsolidatorSettings, CoresetSettings, Coupling, Curvature,
    DistillationSettings, GradientTerm, PathIntegralSettings, PublishedRule, PublishedSettings, Strength,
};
use kestrel_learn::ppo::Kept;

const STRENGTH: Limits = Limits::from(0.0, 1e6, "");

/// Who learns, and how.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MethodConfig {
    /// Short name, which files carry: letters, digits, `-` and `_`.
    pub name: String,
    /// What the report says about it.
    #[serde(default)]
    pub about: String,
    /// How it learns several tasks.
    pub learn: ProcedureConfig,
    /// How each task is trained, if not as the study says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training: Option<TrainingConfig>,
}

/// How several tasks are learned.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ProcedureConfig {
    /// One after the other, by one policy.
    Sequential(SequentialConfig),
    /// All at once, by one policy, with the samples of all tasks together.
    Joint {},
    /// Each by a policy of its own; the policies are averaged now and then (what the thesis calls MAPPO).
    Sharing(SharingConfig),
    /// Each by a fresh policy that is kept: memory grows with the number of tasks.
    Experts {},
    /// One after the other, each by a fresh policy that then teaches the one that is kept.
    Distil(DistilConfig),
}

/// One after the other.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SequentialConfig {
    /// What keeps earlier tasks.
    pub consolidator: ConsolidatorConfig,
    /// Whether a task begins with the policy of the one before.
    pub policy: KeptConfig,
    /// Whether it begins with that one's standard deviations of the actions.
    pub log_std: KeptConfig,
    /// Whether it begins with that one's critic and optimisers.
    pub learner: KeptConfig,
}

impl Default for SequentialConfig {
    fn default() -> Self {
        let (consolidator, policy) = (ConsolidatorConfig::None, KeptConfig::Inherited);
        Self { consolidator, policy, log_std: KeptConfig::Reset, learner: KeptConfig::Reset }
    }
}

/// Whether something of the task before is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum KeptConfig {
    /// It is.
    Inherited,
    /// It begins afresh.
    Reset,
}

/// What keeps earlier tasks while another is learned.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ConsolidatorConfig {
    /// Nothing: plain incremental learning.
    #[default]
    None,
    /// One running anchor: corrected IL-SOAR, online EWC, MAS, L2.
    Anchor(AnchorConfig),
    /// Corrected IL-SOAR with its second order in the actions, where it is exact, over a model of the states.
    ActionAnchor(ActionAnchorConfig),
    /// IL-SOAR as the thesis and its code wrote it.
    Published(PublishedConfig),
    /// Synaptic intelligence.
    SynapticIntelligence {
        /// Factor on the pull, with importances divided by their mean.
        strength: f64,
    },
    /// States of earlier tasks, on which the policy is asked to do what it did.
    Coreset(CoresetConfig),
}

/// One running anchor.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AnchorConfig {
    /// What stands for the curvature of a task's objective.
    #[serde(default)]
    pub curvature: CurvatureConfig,
    /// What is kept of the gradient of a task's objective at its end.
    #[serde(default)]
    pub gradient: GradientTermConfig,
    /// How the pull reaches the policy.
    #[serde(default)]
    pub coupling: CouplingConfig,
    /// How strong it is.
    pub strength: StrengthConfig,
    /// Share of the importance of earlier tasks that is kept when another is added.
    #[serde(default = "one")]
    pub decay: f64,
}

fn one() -> f64 {
    1.0
}

/// One running anchor with its second order in the actions.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ActionAnchorConfig {
    /// Normal distributions that stand for the states of earlier tasks.
    #[serde(default = "parts")]
    pub parts: u64,
    /// Factor on the mean divergence over the states of each earlier task.
    #[serde(default = "one")]
    pub strength: f64,
}

fn parts() -> u64 {
    32
}

/// What stands for the curvature of a task's objective.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CurvatureConfig {
    /// The same for all parameters.
    Identity,
    /// Diagonal of the policy's Fisher information, exact in the action.
    #[default]
    Fisher,
    /// Sensitivity of the squared length of the action (MAS).
    Sensitivity,
    /// The policy's Fisher information with what holds between the weights of a layer (K-FAC); needs `gradient: balance`
    /// and `coupling: gradient`.
    Kronecker,
}

/// What is kept of the gradient of a task's objective at its end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GradientTermConfig {
    /// Nothing: the center is the weighted mean of all policies (EWC).
    Absent,
    /// As measured on a rollout of its own.
    Measured,
    /// What balances the anchor's own pull: the center is the newest policy (online EWC).
    #[default]
    Balance,
}

/// How the pull reaches the policy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CouplingConfig {
    /// Added to the gradient, before that is shortened and Adam scales it.
    #[default]
    Gradient,
    /// As an implicit step after Adam's.
    Proximal,
}

/// How strong a pull is.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum StrengthConfig {
    /// This factor, on curvatures whose mean is one.
    Fixed(f64),
    /// The square of the share used of this much predicted divergence per earlier task \[nat\].
    BudgetNats(f64),
}

/// IL-SOAR as published.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PublishedConfig {
    /// Which of its forms.
    pub rule: PublishedRuleConfig,
    /// Weight of the old gradient.
    pub gradient_weight: f64,
    /// `L`.
    pub curvature: f64,
}

/// Forms of IL-SOAR as published.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PublishedRuleConfig {
    /// Equation 3.8.
    Literal,
    /// The code of October 2022.
    Absolute,
    /// The code's last version.
    Head,
}

/// States of earlier tasks.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CoresetConfig {
    /// Bytes of the whole set; left out: as many as a diagonal anchor has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// Factor on the mean divergence over the states.
    #[serde(default = "one")]
    pub strength: f64,
}

/// A fresh policy for each task, which then teaches the one that is kept.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DistilConfig {
    /// Bytes of the states that are kept; left out: as many as a diagonal anchor has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// Gradient steps of teaching.
    #[serde(default = "distillation_steps")]
    pub steps: u64,
    /// Step size of Adam.
    #[serde(default = "distillation_rate")]
    pub learning_rate: f64,
}

fn distillation_steps() -> u64 {
    2000
}

fn distillation_rate() -> f64 {
    1e-3
}

/// Policies that are averaged now and then.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SharingConfig {
    /// Updates between two averages.
    pub every_updates: u64,
    /// What is averaged.
    #[serde(default)]
    pub merge: MergeConfig,
    /// What becomes of the optimisers' state.
    #[serde(default)]
    pub optimiser: OptimiserConfig,
    /// Whether the standard deviations are averaged too.
    #[serde(default)]
    pub log_std: LogStdConfig,
}

/// What is averaged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MergeConfig {
    /// Whole policies.
    #[default]
    Whole,
    /// The first row of every tensor; all else is the first task's, as in the thesis's script.
    FirstRow,
}

/// What becomes of the optimisers' state when policies are averaged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OptimiserConfig {
    /// It is averaged as well.
    #[default]
    Averaged,
    /// Each keeps its own.
    Own,
    /// It begins afresh.
    Reset,
}

/// What becomes of the standard deviations when policies are averaged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LogStdConfig {
    /// Their logarithms are averaged.
    #[default]
    Averaged,
    /// Each task keeps its own.
    Own,
}

impl MethodConfig {
    /// The method, checked.
    ///
    /// # Errors
    /// When a number is out of range, or training settings do not fit together.
    pub(super) fn check(&self, field: &Field<'_>, tasks: usize) -> Result<Method, ConfigError> {
        let training = self.training.as_ref().map(|training| training.check(&field.at("training")));
        Ok(Method {
            name: self.name.clone(),
            about: self.about.clone(),
            procedure: self.learn.check(&field.at("learn"), tasks)?,
            training: training.transpose()?,
        })
    }
}

impl ProcedureConfig {
    fn check(&self, field: &Field<'_>, tasks: usize) -> Result<Procedure, ConfigError> {
        match self {
            Self::Sequential(config) => config.check(&field.at("sequential")),
            Self::Joint {} => Ok(Procedure::Joint),
            Self::Experts {} => Ok(Procedure::Experts),
            Self::Sharing(config) => config.check(&field.at("sharing"), tasks),
            Self::Distil(config) => {
                let field = field.at("distil");
                let steps = field.at("steps").whole(config.steps, 1..=1_000_000)? as u32;
                let rate = Limits::above(0.0, 1.0, "");
                let learning_rate = field.at("learning_rate").number(config.learning_rate, &rate)?;
                let coreset = CoresetSettings { bytes: bytes(config.bytes, &field)?, strength: 1.0 };
                Ok(Procedure::Distil { coreset, distillation: DistillationSettings { steps, learning_rate } })
            }
        }
    }
}

impl SequentialConfig {
    fn check(&self, field: &Field<'_>) -> Result<Procedure, ConfigError> {
        let consolidator = self.consolidator.check(&field.at("consolidator"))?;
        let kept = |config: KeptConfig| match config {
            KeptConfig::Inherited => Kept::Inherited,
            KeptConfig::Reset => Kept::Reset,
        };
        let inheritance =
            Inheritance { policy: kept(self.policy), log_std: kept(self.log_std), learner: kept(self.learner) };
        Ok(Procedure::Sequential { consolidator, inheritance })
    }
}

impl SharingConfig {
    fn check(&self, field: &Field<'_>, tasks: usize) -> Result<Procedure, ConfigError> {
        if tasks < 2 {
            return Err(field.reject(format!("a study of {tasks} task"), "at least two tasks to share a policy"));
        }
        Ok(Procedure::Sharing {
            every_updates: field.at("every_updates").whole(self.every_updates, 1..=1_000_000)?,
            merge: Merge {
                rows: match self.merge {
                    MergeConfig::Whole => Rows::All,
                    MergeConfig::FirstRow => Rows::First,
                },
                optimiser: match self.optimiser {
                    OptimiserConfig::Averaged => Optimisers::Averaged,
                    OptimiserConfig::Own => Optimisers::Own,
                    OptimiserConfig::Reset => Optimisers::Reset,
                },
                log_std: match self.log_std {
                    LogStdConfig::Averaged => LogStds::Averaged,
                    LogStdConfig::Own => LogStds::Own,
                },
            },
        })
    }
}

impl ConsolidatorConfig {
    fn check(&self, field: &Field<'_>) -> Result<ConsolidatorSettings, ConfigError> {
        match self {
            Self::None => Ok(ConsolidatorSettings::None),
            Self::Anchor(config) => Ok(ConsolidatorSettings::Anchored(config.check(&field.at("anchor"))?)),
            Self::ActionAnchor(config) => {
                let field = field.at("action_anchor");
                let parts = field.at("parts").whole(config.parts, 1..=256)? as usize;
                let strength = field.at("strength").number(config.strength, &STRENGTH)?;
                Ok(ConsolidatorSettings::ActionAnchor(ActionAnchorSettings { parts, strength }))
            }
            Self::Published(config) => Ok(ConsolidatorSettings::Published(config.check(&field.at("published"))?)),
            Self::SynapticIntelligence { strength } => {
                let field = field.at("synaptic_intelligence").at("strength");
                let strength = field.number(*strength, &STRENGTH)?;
                Ok(ConsolidatorSettings::PathIntegral(PathIntegralSettings { strength }))
            }
            Self::Coreset(config) => {
                let field = field.at("coreset");
                let strength = field.at("strength").number(config.strength, &STRENGTH)?;
                let bytes = bytes(config.bytes, &field)?;
                Ok(ConsolidatorSettings::Coreset(CoresetSettings { bytes, strength }))
            }
        }
    }
}

/// Bytes of a set of states, where they are given.
fn bytes(config: Option<u64>, field: &Field<'_>) -> Result<Option<usize>, ConfigError> {
    let bytes = config.map(|bytes| field.at("bytes").whole(bytes, 1024..=1 << 30));
    Ok(bytes.transpose()?.map(|bytes| bytes as usize))
}

impl AnchorConfig {
    fn check(&self, field: &Field<'_>) -> Result<AnchoredSettings, ConfigError> {
        if self.curvature == CurvatureConfig::Kronecker {
            if self.gradient != GradientTermConfig::Balance {
                return Err(field.at("gradient").reject("another term", "balance, with the curvature kronecker"));
            }
            if self.coupling != CouplingConfig::Gradient {
                return Err(field.at("coupling").reject("proximal", "gradient, with the curvature kronecker"));
            }
        }
        Ok(AnchoredSettings {
            curvature: match self.curvature {
                CurvatureConfig::Identity => Curvature::Identity,
                CurvatureConfig::Fisher => Curvature::Fisher,
                CurvatureConfig::Sensitivity => Curvature::Sensitivity,
                CurvatureConfig::Kronecker => Curvature::Kronecker,
            },
            gradient: match self.gradient {
                GradientTermConfig::Absent => GradientTerm::Absent,
                GradientTermConfig::Measured => GradientTerm::Measured,
                GradientTermConfig::Balance => GradientTerm::Balance,
            },
            coupling: match self.coupling {
                CouplingConfig::Gradient => Coupling::Gradient,
                CouplingConfig::Proximal => Coupling::Proximal,
            },
            strength: self.strength.check(&field.at("strength"))?,
            decay: field.at("decay").number(self.decay, &Limits::from(0.0, 1.0, ""))?,
        })
    }
}

impl StrengthConfig {
    fn check(&self, field: &Field<'_>) -> Result<Strength, ConfigError> {
        let positive = Limits::above(0.0, 1e6, "");
        match self {
            Self::Fixed(strength) => Ok(Strength::Fixed(field.at("fixed").number(*strength, &positive)?)),
            Self::BudgetNats(nats) => Ok(Strength::Budget(field.at("budget_nats").number(*nats, &positive)?)),
        }
    }
}

impl PublishedConfig {
    fn check(&self, field: &Field<'_>) -> Result<PublishedSettings, ConfigError> {
        Ok(PublishedSettings {
            rule: match self.rule {
                PublishedRuleConfig::Literal => PublishedRule::Literal,
                PublishedRuleConfig::Absolute => PublishedRule::Absolute,
                PublishedRuleConfig::Head => PublishedRule::Head,
            },
            gradient_weight: field.at("gradient_weight").number(self.gradient_weight, &STRENGTH)?,
            curvature: field.at("curvature").number(self.curvature, &STRENGTH)?,
        })
    }
}
