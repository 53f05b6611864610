//! Methods of a study as users write them.

use kestrel_sim::config::{ConfigError, Field, Limits};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::teams;
use crate::experiment_config::{Experiment, TrainingConfig, is_false};
use crate::study::procedure::{Method, Procedure, WarmStartRule};
use crate::study::sharing::{LogStds, Merge, Optimisers, Rows};
use kestrel_learn::ppo::CarryOver;
use kestrel_learn::regulariser::{CoresetSettings, DistillationSettings, RegulariserSettings};

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
    Experts(ExpertsConfig),
    /// One after the other, each by a fresh policy that then teaches the one that is kept.
    Distil(DistilConfig),
}

/// One after the other.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SequentialConfig {
    /// What keeps earlier tasks.
    #[serde(alias = "regulariser")]
    pub consolidator: RegulariserSettings,
    /// Whether a task begins with the policy of the one before.
    pub policy: CarryOver,
    /// Whether it begins with that one's standard deviations of the actions.
    pub log_std: CarryOver,
    /// Whether it begins with that one's critic and optimisers.
    pub learner: CarryOver,
}

impl Default for SequentialConfig {
    fn default() -> Self {
        Self {
            consolidator: RegulariserSettings::None,
            policy: CarryOver::CarriedOver,
            log_std: CarryOver::Reinitialised,
            learner: CarryOver::Reinitialised,
        }
    }
}

/// A policy of its own for each task.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ExpertsConfig {
    /// Whether each task is trained as its own file says, instead of as the study says. Where all methods are such, tasks may differ in
    /// what they see and command.
    #[serde(skip_serializing_if = "is_false")]
    pub own_training: bool,
}

/// A fresh policy for each task, which then teaches the one that is kept.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DistilConfig {
    /// Bytes of the states that are kept; left out: as many as a diagonal anchor has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<usize>,
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
    pub(super) fn check(&self, field: &Field<'_>, tasks: &[Experiment]) -> Result<Method, ConfigError> {
        let check = |training: &TrainingConfig| training.for_teams(teams(tasks)).check(&field.at("training"));
        let training = self.training.as_ref().map(check).transpose()?;
        let procedure = self.learn.check(&field.at("learn"), tasks.len())?;
        if training.is_some() && procedure.trains_as_configured() {
            return Err(field.reject("`training` beside `own_training`", "one of them"));
        }
        Ok(Method { name: self.name.clone(), about: self.about.clone(), procedure, training })
    }
}

impl ProcedureConfig {
    /// The way to learn so many tasks, checked.
    pub(super) fn check(&self, field: &Field<'_>, tasks: usize) -> Result<Procedure, ConfigError> {
        match self {
            Self::Sequential(config) => config.check(&field.at("sequential")),
            Self::Joint {} => Ok(Procedure::Joint),
            Self::Experts(ExpertsConfig { own_training }) => {
                Ok(Procedure::Experts { own_training: *own_training })
            }
            Self::Sharing(config) => config.check(&field.at("sharing"), tasks),
            Self::Distil(config) => {
                let field = field.at("distil");
                let steps = field.at("steps").whole(config.steps, 1..=1_000_000)? as u32;
                let rate = Limits::above(0.0, 1.0, "");
                let learning_rate = field.at("learning_rate").number(config.learning_rate, &rate)?;
                let coreset = CoresetSettings { bytes: config.bytes, strength: 1.0 };
                coreset.check(&field)?;
                Ok(Procedure::Distil { coreset, distillation: DistillationSettings { steps, learning_rate } })
            }
        }
    }
}

impl SequentialConfig {
    fn check(&self, field: &Field<'_>) -> Result<Procedure, ConfigError> {
        let Self { consolidator, policy, log_std, learner } = *self;
        consolidator.check(&field.at("consolidator"))?;
        // Its bytes are those beside a policy that goes on.
        if matches!(consolidator, RegulariserSettings::CompactCoreset(_)) && policy == CarryOver::Reinitialised {
            return Err(field.at("policy").reject("reset", "inherited, with the consolidator compact_coreset"));
        }
        let warm_start_rule = WarmStartRule { policy, log_std, learner };
        Ok(Procedure::Sequential { regulariser: consolidator, warm_start_rule })
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
