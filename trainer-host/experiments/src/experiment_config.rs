//! The experiment file: a scenario, how to train on it and how to judge the result.

mod evaluation;
mod eye;
mod initial_policy;
mod memory;
mod teacher;
#[cfg(test)]
mod tests;
mod training;

use std::path::Path;

use kestrel_sim::config::{ConfigError, Document, Field, ScenarioConfig, schema_of};
use kestrel_sim::gradient::StepGradient;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub(crate) use evaluation::is_false;
pub use evaluation::{EvaluationConfig, EvaluationSettings};
pub use eye::{ConvolutionConfig, CustomEyeConfig, EyeConfig, EyeNetworkConfig, NatureConfig};
pub use initial_policy::{InitialPolicy, InitialPolicyConfig};
pub use memory::MemoryConfig;
pub use teacher::TeacherConfig;
pub use training::{AnalyticConfig, ScheduleConfig, TrainingConfig};

use crate::config_file::ConfigFile;
use crate::learner::LearnerSettings;
use kestrel_learn::rollout::batch_rows;

/// Version of the file format that this program reads; a change that breaks old files raises it.
pub const VERSION: u32 = 1;

/// Longest name; it becomes part of paths.
pub(crate) const NAME_LIMIT: usize = 64;

/// Written above every resolved configuration.
const RESOLVED_HEADER: &str =
    "# Complete configuration of a run, with overrides applied and every default filled in.\n";

/// One experiment as users write it.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExperimentConfig {
    /// Version of this file format: 1.
    pub version: u32,
    /// Short name, which run directories and policies carry: letters, digits, `-` and `_`.
    pub name: String,
    /// The task.
    pub scenario: ScenarioConfig,
    /// How the policy is trained: by PPO, or by gradients through the physics (`analytic`).
    #[serde(default)]
    pub training: TrainingConfig,
    /// How the trained policy is judged.
    #[serde(default)]
    pub evaluation: EvaluationConfig,
}

/// One experiment, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Experiment {
    /// Name for people and paths.
    pub name: String,
    /// The task.
    pub scenario: Scenario,
    /// How the policy is trained.
    pub training: LearnerSettings,
    /// What all randomness of training follows from.
    pub seed: Seed,
    /// How the trained policy is judged.
    pub evaluation: EvaluationSettings,
    /// The configuration as YAML with overrides applied and every default filled in; it loads to the same
    /// experiment.
    pub resolved_yaml: String,
}

/// The experiment in the file at `path`, after `overrides` such as `training.epochs=3`.
///
/// # Errors
/// The first thing that is wrong, with its line or override, what was found and what was expected.
pub fn load(path: &Path, overrides: &[String]) -> Result<Experiment, ConfigError> {
    from_document(Document::read(path)?, overrides)
}

/// As [`load`], for training, which not every experiment is fit for.
///
/// # Errors
/// As [`load`], and when the drones do not fill the environment batches that train.
pub fn load_to_train(path: &Path, overrides: &[String]) -> Result<Experiment, ConfigError> {
    to_train(Document::read(path)?, overrides)
}

/// The experiment in the YAML `text`, which messages call `name`; otherwise as [`load`].
///
/// # Errors
/// As [`load`].
pub fn parse(name: &str, text: &str, overrides: &[String]) -> Result<Experiment, ConfigError> {
    from_document(Document::parse(name, text)?, overrides)
}

/// As [`parse`], for training, which not every experiment is fit for.
///
/// # Errors
/// As [`load_to_train`].
pub fn parse_to_train(name: &str, text: &str, overrides: &[String]) -> Result<Experiment, ConfigError> {
    to_train(Document::parse(name, text)?, overrides)
}

/// The JSON schema of the experiment file, for editors.
pub fn schema() -> String {
    schema_of::<ExperimentConfig>()
}

pub(crate) fn to_train(document: Document, overrides: &[String]) -> Result<Experiment, ConfigError> {
    let document = ExperimentConfig::overridden(document, overrides)?;
    let experiment = checked(&document)?;
    if experiment.training.analytic.is_some() {
        refuse_without_derivatives(&experiment.scenario, &document.root().at("training").at("analytic"))?;
        return Ok(experiment);
    }
    let tasks = std::slice::from_ref(&experiment.scenario);
    refuse_broken_batches(tasks, experiment.training.ppo.environments, &document.root().at("training"))?;
    Ok(experiment)
}

pub(crate) fn from_document(document: Document, overrides: &[String]) -> Result<Experiment, ConfigError> {
    checked(&ExperimentConfig::overridden(document, overrides)?)
}

fn checked(document: &Document) -> Result<Experiment, ConfigError> {
    document.decode::<ExperimentConfig>()?.check(&document.root())
}

/// Refuses a number of drones of which teams and slices do not make whole environment batches.
pub(crate) fn refuse_broken_batches(
    tasks: &[Scenario],
    environments: usize,
    training: &Field<'_>,
) -> Result<(), ConfigError> {
    let rows = batch_rows(tasks.iter().map(|task| task.agents.count as usize));
    if environments.is_multiple_of(rows) {
        return Ok(());
    }
    let teams: Vec<String> = tasks.iter().map(|task| task.agents.count.to_string()).collect();
    let expected =
        format!("a multiple of {rows}: that many drones train side by side in teams of {}", teams.join(", "));
    Err(training.at("environments").refuse(environments, expected))
}

/// Refuses a training whose eye, teacher, memory, first policy or gradients a task does not suit.
pub(crate) fn refuse_unsuited_training(
    settings: &LearnerSettings,
    task: &Scenario,
    training: &Field<'_>,
) -> Result<(), ConfigError> {
    eye::refuse_unsuited_encoder(&settings.ppo.encoder, task.camera.as_ref(), training)?;
    teacher::refuse_lost_teacher(settings.ppo.teacher, task, training)?;
    memory::refuse_unsuited_memory(&settings.ppo, task, training)?;
    match &settings.initial_policy {
        Some(policy) => policy.refuse_other_task(task, &training.at("initial_policy")),
        None => Ok(()),
    }
}

/// Refuses a task through which no gradient goes.
pub(crate) fn refuse_without_derivatives(scenario: &Scenario, analytic: &Field<'_>) -> Result<(), ConfigError> {
    let refuse = |found: String| analytic.reject(found, "a task through whose flight gradients go, or PPO");
    if scenario.camera.is_some() {
        return Err(refuse("a camera, whose images have no derivatives".to_owned()));
    }
    StepGradient::new(scenario).map(drop).map_err(|refusal| refuse(refusal.to_string()))
}

impl ConfigFile for ExperimentConfig {
    const VERSION: u32 = VERSION;
    const HEADER: &'static str = RESOLVED_HEADER;
}

impl ExperimentConfig {
    /// The experiment at `root`, checked.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn check(&self, root: &Field<'_>) -> Result<Experiment, ConfigError> {
        check_name(&self.name, &root.at("name"))?;
        let scenario = self.scenario.check(&self.name, &root.at("scenario"))?;
        let training = root.at("training");
        let filled = self.training.for_teams(std::iter::once(scenario.agents.count as usize));
        let settings = filled.check(&training)?;
        refuse_unsuited_training(&settings, &scenario, &training)?;
        Ok(Experiment {
            name: self.name.clone(),
            training: settings,
            seed: Seed(self.training.seed),
            evaluation: self.evaluation.check(&self.scenario, &scenario, root)?,
            resolved_yaml: Self { training: filled, ..self.clone() }.resolved(),
            scenario,
        })
    }
}

/// Refuses what cannot become a part of paths.
///
/// # Errors
/// When it is empty, too long or holds other letters.
pub fn check_name(name: &str, field: &Field<'_>) -> Result<(), ConfigError> {
    let allowed = |letter: char| letter.is_ascii_alphanumeric() || letter == '-' || letter == '_';
    if !name.is_empty() && name.len() <= NAME_LIMIT && name.chars().all(allowed) {
        return Ok(());
    }
    Err(field.refuse(name, format!("1 to {NAME_LIMIT} letters, digits, `-` and `_`")))
}
