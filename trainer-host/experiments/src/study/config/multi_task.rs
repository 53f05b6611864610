//! An experiment with several tasks that one policy learns: a study of one job, whose policy is what counts.

#[cfg(test)]
pub(crate) mod tests;

use std::path::Path;

use kestrel_sim::config::{ConfigError, Document, Field, schema_of};
use kestrel_sim::seed::Seed;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    ExperimentConfig, MethodConfig, ProcedureConfig, StudyConfig, StudyEvaluationConfig, TrainingConfig, VERSION,
    check_name, check_tasks, refuse_few_drones, refuse_lost_images, refuse_lost_memory, refuse_other_layouts,
    refuse_unfit, refuse_unshared, teams,
};
use crate::config_file::ConfigFile;
use crate::experiment_config::NAME_LIMIT;
use crate::run_config::RunConfig;
use crate::study::data::MethodKind;
use crate::study::job::stage_seed;
use crate::study::procedure::Method;
use crate::study::{JobId, Study};

/// Name of the only method.
const METHOD: &str = "policy";

/// The key that tells such a file from an experiment with one task.
pub const TASKS: &str = "tasks";

/// One policy and the tasks that it learns, as users write it.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MultiTaskConfig {
    /// Version of this file format: 1.
    pub version: u32,
    /// Short name, which run directories and policies carry: letters, digits, `-` and `_`.
    pub name: String,
    /// The tasks: experiments with the same observation, action and control rate, usually imported. Their `training` is
    /// not used, nor are the number and the seed of the starts that judge them.
    pub tasks: Vec<ExperimentConfig>,
    /// How they are learned.
    #[serde(default = "joint")]
    pub learn: ProcedureConfig,
    /// How each task is trained (PPO); `total_steps` is for one task.
    #[serde(default)]
    pub training: TrainingConfig,
    /// How the policy is judged, in each task.
    #[serde(default)]
    pub evaluation: StudyEvaluationConfig,
}

fn joint() -> ProcedureConfig {
    ProcedureConfig::Joint {}
}

impl ConfigFile for MultiTaskConfig {
    const VERSION: u32 = VERSION;
    const HEADER: &'static str = "# Complete configuration of a run of several tasks, with overrides applied and every default filled in.\n";
}

/// The JSON schema of the file, for editors.
pub fn schema() -> String {
    schema_of::<MultiTaskConfig>()
}

/// The experiment with several tasks in the file at `path`, after `overrides` such as `training.seed=3`.
///
/// # Errors
/// The first thing that is wrong, with its line or override, what was found and what was expected.
pub fn load(path: &Path, overrides: &[String]) -> Result<Study, ConfigError> {
    from_document(Document::read(path)?, overrides)
}

/// As [`load`], of a document that has been read.
pub(crate) fn from_document(document: Document, overrides: &[String]) -> Result<Study, ConfigError> {
    let document = MultiTaskConfig::overridden(document, overrides)?;
    document.decode::<MultiTaskConfig>()?.check(&document.root())
}

/// What a job of a study has trained its policy by: the same training makes the same bits again.
///
/// # Errors
/// None, for a study that was checked.
pub(crate) fn of_job(study: &Study, id: JobId) -> Result<RunConfig, ConfigError> {
    let config = written(study)?;
    let method = &config.methods[id.method];
    let training = method.training.as_ref().unwrap_or(&config.training);
    let tasks = study.orders[id.order].iter().map(|task| config.tasks[*task].clone());
    let sole = MultiTaskConfig {
        version: VERSION,
        name: name(&config, method),
        tasks: tasks.collect(),
        learn: method.learn,
        training: TrainingConfig { seed: study.seeds[id.seed].0, ..training.clone() },
        evaluation: config.evaluation,
    };
    let document = Document::parse("config.yaml", &sole.resolved())?;
    Ok(RunConfig::Several(Box::new(sole.check(&document.root())?)))
}

/// As [`of_job`], where the stage's task has a policy of its own.
///
/// # Errors
/// As there.
pub(crate) fn expert_of_job(study: &Study, id: JobId, stage: usize) -> Result<RunConfig, ConfigError> {
    let config = written(study)?;
    let method = &config.methods[id.method];
    let task = &config.tasks[study.orders[id.order][stage]];
    let of_study = method.training.as_ref().unwrap_or(&config.training);
    let is_own = study.methods[id.method].procedure.trains_as_configured();
    let training = if is_own { &task.training } else { of_study };
    let expert = ExperimentConfig {
        training: TrainingConfig { seed: stage_seed(study.seeds[id.seed], stage).0, ..training.clone() },
        ..task.clone()
    };
    let document = Document::parse("config.yaml", &expert.resolved())?;
    Ok(RunConfig::One(Box::new(expert.check(&document.root())?)))
}

/// The study as its user wrote it, resolved.
fn written(study: &Study) -> Result<StudyConfig, ConfigError> {
    Document::parse("study.yaml", &study.resolved_yaml)?.decode()
}

fn name(study: &StudyConfig, method: &MethodConfig) -> String {
    format!("{}-{}", study.name, method.name).chars().take(NAME_LIMIT).collect()
}

impl MultiTaskConfig {
    fn check(&self, root: &Field<'_>) -> Result<Study, ConfigError> {
        check_name(&self.name, &root.at("name"))?;
        let evaluation = self.evaluation.check(&root.at("evaluation"))?;
        let judged = self.judged_alike();
        let tasks = check_tasks(&judged.tasks, &root.at(TASKS))?;
        refuse_other_layouts(&tasks, &root.at(TASKS))?;
        let field = root.at("training");
        let filled = self.training.for_teams(teams(&tasks));
        let training = filled.check(&field)?;
        refuse_unfit(&tasks, &training, &field)?;
        let learn = root.at("learn");
        let procedure = self.learn.check(&learn, tasks.len())?;
        refuse_lost_images(&tasks, &procedure, &learn)?;
        refuse_lost_memory(&training, &procedure, &learn)?;
        refuse_unshared(&training, &procedure, &learn)?;
        refuse_few_drones(&training, &procedure, &learn)?;
        if procedure.kind() == MethodKind::Experts {
            let expected = "a way to one policy; `kestrel train` each of the tasks, or run a study";
            return Err(learn.refuse("experts", expected));
        }
        let method = Method { name: METHOD.to_owned(), about: String::new(), procedure, training: None };
        Ok(Study {
            name: self.name.clone(),
            about: String::new(),
            orders: vec![(0..tasks.len()).collect()],
            tasks,
            seeds: vec![Seed(self.training.seed)],
            training,
            evaluation,
            methods: vec![method],
            published: None,
            claims: Vec::new(),
            resolved_yaml: Self { training: filled, ..judged }.resolved(),
        })
    }

    /// The same with as many starts of the same seed in each task.
    fn judged_alike(&self) -> Self {
        let mut judged = self.clone();
        for task in &mut judged.tasks {
            task.evaluation.episodes = self.evaluation.episodes;
            task.evaluation.seed = self.evaluation.seed;
        }
        judged
    }
}
