//! A study: methods × orders of tasks × seeds, run over all cores, interrupted and resumed at will, and reported.
//!
//! [`config`] reads the file, the [`runner`] hands out jobs, a [`job`] learns its tasks stage by stage and leaves the
//! [`rows`] of its flights in the study's [`directory`]; [`data`] loads what is there, and the [`report`] says what it
//! means.
//!
//! ```text
//! study.yaml                     the study, every import resolved
//! study.json                     for readers: tasks, orders, methods with their bytes, seeds, baselines
//! rows/METHOD/ORDER-SEED.csv     every test flight of a job, after each of its stages
//! curves/METHOD/ORDER-SEED.csv   success while it trained
//! boundaries/METHOD/ORDER-SEED.csv   where a method found that its task was another one, if nobody tells it
//! policies/METHOD/ORDER-SEED/    its policy, and the configuration that trains it again; of experts a folder a task
//! unfinished/METHOD-ORDER-SEED   checkpoints of jobs in progress
//! report.md, report/*.svg        what it means
//! ```

pub mod config;
pub mod data;
pub mod directory;
pub mod job;
pub mod procedure;
pub mod report;
pub mod rows;
pub mod runner;
pub mod sharing;

use kestrel_sim::seed::Seed;
use serde::{Deserialize, Serialize};

use crate::experiment_config::Experiment;
use crate::learner::LearnerSettings;
use config::claim::Claim;
use config::{PublishedTable, StudyEvaluation};
use procedure::Method;

/// A study, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// Name for people and paths.
    pub name: String,
    /// What it asks.
    pub about: String,
    /// The tasks; only their scenarios and starts of evaluation count.
    pub tasks: Vec<Experiment>,
    /// Orders, as indices of tasks.
    pub orders: Vec<Vec<usize>>,
    /// What the randomness of each repetition follows from.
    pub seeds: Vec<Seed>,
    /// How each task is trained.
    pub training: LearnerSettings,
    /// How policies are judged.
    pub evaluation: StudyEvaluation,
    /// Who learns.
    pub methods: Vec<Method>,
    /// A table from elsewhere.
    pub published: Option<PublishedTable>,
    /// What it is expected to show.
    pub claims: Vec<Claim>,
    /// The study as YAML with every import resolved and every default filled in.
    pub resolved_yaml: String,
}

/// One method learning one order from one seed; indices into the study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct JobId {
    /// Index of the seed.
    pub seed: usize,
    /// Index of the order.
    pub order: usize,
    /// Index of the method.
    pub method: usize,
}

impl Study {
    /// All jobs, seed by seed, so that an unfinished study has a little of everything.
    pub fn jobs(&self) -> Vec<JobId> {
        let mut jobs = Vec::new();
        for seed in 0..self.seeds.len() {
            for order in 0..self.orders.len() {
                // Whoever learns all tasks at once, or each on its own, knows no order.
                let learns = |method: &usize| order == 0 || self.methods[*method].procedure.knows_order();
                let methods = (0..self.methods.len()).filter(learns);
                jobs.extend(methods.map(|method| JobId { seed, order, method }));
            }
        }
        jobs
    }

    /// How a method trains each task, where it is not each as its file says.
    pub fn training_of(&self, method: usize) -> &LearnerSettings {
        self.methods[method].training.as_ref().unwrap_or(&self.training)
    }

    /// How a job trains the task at a place of its order.
    pub fn training_at(&self, job: JobId, place: usize) -> &LearnerSettings {
        let task = &self.tasks[self.orders[job.order][place]];
        let is_own = self.methods[job.method].procedure.trains_as_configured();
        if is_own { &task.training } else { self.training_of(job.method) }
    }

    /// Environment steps of a stage that lasts to its end.
    pub fn stage_steps(&self, job: JobId, stage: usize) -> u64 {
        let tasks = self.orders[job.order].len();
        let at_once = tasks / self.methods[job.method].procedure.stages(tasks);
        self.training_at(job, stage).total_steps() * at_once as u64
    }

    /// Environment steps of a job whose stages all last to their end.
    pub fn steps_of(&self, job: JobId) -> u64 {
        let stages = self.methods[job.method].procedure.stages(self.orders[job.order].len());
        (0..stages).map(|stage| self.stage_steps(job, stage)).sum()
    }

    /// Most environment steps that a task is trained for.
    pub fn most_steps(&self) -> u64 {
        let steps = |job: JobId| {
            let places = 0..self.orders[job.order].len();
            places.map(move |place| self.training_at(job, place).total_steps())
        };
        self.jobs().into_iter().filter(|job| job.seed == 0).flat_map(steps).max().unwrap_or(0)
    }
}
