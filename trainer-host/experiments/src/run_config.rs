//! What a run directory is about: an experiment with one task, or with several.

use std::path::Path;

use kestrel_sim::config::{ConfigError, Document};
use kestrel_sim::seed::Seed;

use crate::experiment_config::{self, Experiment};
use crate::multi_task_run::newest_policy;
use crate::run_directory::RunDirectory;
use crate::study::Study;
use crate::study::config::multi_task;
use crate::training_run::{TrainingError, best_policy};
use kestrel_learn::actor_critic::Actor;

/// The configuration of a run, checked.
#[derive(Clone, Debug, PartialEq)]
pub enum RunConfig {
    /// One task.
    One(Box<Experiment>),
    /// Several tasks and one policy.
    Several(Box<Study>),
}

/// What a policy is called, what it was trained from, and the tasks that it flies.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// Name for people and paths.
    pub name: &'a str,
    /// What all randomness of training followed from.
    pub seed: Seed,
    /// One or more, of the same observation and action.
    pub tasks: &'a [Experiment],
}

/// No such task.
#[derive(Debug, thiserror::Error)]
#[error("found the task {found:?}, expected {}", known.join(", "))]
pub struct UnknownTask {
    /// What was asked for.
    found: String,
    /// Those that there are.
    known: Vec<String>,
}

impl RunConfig {
    /// The configuration in the file at `path`, after `overrides` such as `evaluation.episodes=3`.
    ///
    /// # Errors
    /// The first thing that is wrong, with its line or override, what was found and what was expected.
    pub fn load(path: &Path, overrides: &[String]) -> Result<Self, ConfigError> {
        let document = Document::read(path)?;
        if document.holds(multi_task::TASKS) {
            return Ok(Self::Several(Box::new(multi_task::from_document(document, overrides)?)));
        }
        Ok(Self::One(Box::new(experiment_config::from_document(document, overrides)?)))
    }

    /// As [`Self::load`], for training, which not every experiment is fit for.
    ///
    /// # Errors
    /// As [`Self::load`], and when the drones do not fill the environment batches that train.
    pub fn load_to_train(path: &Path, overrides: &[String]) -> Result<Self, ConfigError> {
        let document = Document::read(path)?;
        if document.holds(multi_task::TASKS) {
            return Ok(Self::Several(Box::new(multi_task::from_document(document, overrides)?)));
        }
        Ok(Self::One(Box::new(experiment_config::to_train(document, overrides)?)))
    }

    /// What its policy is.
    pub fn subject(&self) -> Subject<'_> {
        match self {
            Self::One(experiment) => Subject::of(experiment),
            Self::Several(study) => Subject { name: &study.name, seed: study.seeds[0], tasks: &study.tasks },
        }
    }

    /// The task of this name, or the first.
    ///
    /// # Errors
    /// When there is none of this name; the message lists those that there are.
    pub fn task(&self, name: Option<&str>) -> Result<&Experiment, UnknownTask> {
        let tasks = self.subject().tasks;
        let Some(name) = name else { return Ok(&tasks[0]) };
        tasks.iter().find(|task| task.name == name).ok_or_else(|| UnknownTask {
            found: name.to_owned(),
            known: tasks.iter().map(|task| task.name.clone()).collect(),
        })
    }

    /// The configuration as YAML with overrides applied and every default filled in.
    pub fn resolved_yaml(&self) -> &str {
        match self {
            Self::One(experiment) => &experiment.resolved_yaml,
            Self::Several(study) => &study.resolved_yaml,
        }
    }
}

impl<'a> Subject<'a> {
    /// The policy of an experiment with one task.
    pub fn of(experiment: &'a Experiment) -> Self {
        Self { name: &experiment.name, seed: experiment.seed, tasks: std::slice::from_ref(experiment) }
    }
}

/// The best policy in the newest checkpoint of a run with one task, the newest of a run with several, and the steps it was
/// trained for.
///
/// # Errors
/// When there is no usable checkpoint, or it does not fit the configuration.
pub fn policy_of(config: &RunConfig, directory: &RunDirectory) -> Result<(Actor, u64), TrainingError> {
    match config {
        RunConfig::One(experiment) => best_policy(experiment, directory),
        RunConfig::Several(study) => newest_policy(study, directory),
    }
}
