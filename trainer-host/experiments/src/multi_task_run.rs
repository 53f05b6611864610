//! A training run of several tasks: one job of a study in a run directory of its own.

use std::sync::Arc;

use kestrel_learn::actor_critic::Actor;
use kestrel_learn::ppo::UpdateMetrics;
use kestrel_learn::ranks::{self, Order, Ranks};
use serde::{Deserialize, Serialize};
use web_time::Instant;

use crate::checkpoint::Checkpoints;
use crate::config_file::ConfigFile;
use crate::interrupt::Interrupt;
use crate::progress::ProgressReport;
use crate::run_directory::RunDirectory;
use crate::run_log::{MetricsRow, RunLog};
use crate::study::config::multi_task::MultiTaskConfig;
use crate::study::job::{Advance, JobRun, JobState};
use crate::study::rows::EpisodeRow;
use crate::study::{JobId, Study};
use crate::training_run::{End, Stepwise, TrainingError, refuse_changes, report, train};
use crate::watch::NewestPolicy;

/// The only job of a study of one.
const JOB: JobId = JobId { seed: 0, order: 0, method: 0 };

/// A run of several tasks, open for training.
#[derive(Debug)]
pub struct MultiTaskRun<'a> {
    study: &'a Study,
    directory: RunDirectory,
    job: JobRun<'a>,
    updates: u64,
    training_secs: f64,
    log: RunLog,
    ranks: Arc<dyn Ranks>,
    /// For who looks at it.
    newest: Option<NewestPolicy>,
}

/// What a checkpoint holds.
#[derive(Serialize, Deserialize)]
struct Checkpoint {
    job: JobState,
    updates: u64,
    training_secs: f64,
    seed: u64,
    /// The resolved configuration.
    config: String,
}

impl<'a> MultiTaskRun<'a> {
    /// A new run in a fresh directory.
    ///
    /// # Errors
    /// When files cannot be created.
    pub fn begin(study: &'a Study, directory: RunDirectory) -> Result<Self, TrainingError> {
        let log = RunLog::continue_after(&directory, 0, 0)?;
        let job = JobRun::begin(study, JOB);
        let ranks = ranks::alone();
        let run = Self { study, directory, job, updates: 0, training_secs: 0.0, log, ranks, newest: None };
        run.save()?;
        Ok(run)
    }

    /// The run of `directory` from its newest checkpoint that is whole.
    ///
    /// # Errors
    /// When there is no usable checkpoint, or it does not fit the configuration.
    pub fn resume(study: &'a Study, directory: RunDirectory) -> Result<Self, TrainingError> {
        let restored = Checkpoints::in_directory(&directory.checkpoints()).load_newest::<Checkpoint>()?;
        let Checkpoint { job, updates, training_secs, seed, config } = restored.state;
        let expected = study.seeds[0].0;
        if seed != expected {
            return Err(TrainingError::Seed { found: seed, expected });
        }
        refuse_changes(&MultiTaskConfig::resolved_again(&config), &study.resolved_yaml)?;
        let job = JobRun::restore(study, JOB, job)?;
        let log = RunLog::continue_after(&directory, updates, job.steps())?;
        Ok(Self { study, directory, job, updates, training_secs, log, ranks: ranks::alone(), newest: None })
    }

    /// From now on shares the work with all ranks, of which this is the first; the others
    /// [`follow`](crate::study::runner::follow).
    ///
    /// # Errors
    /// When the work cannot be dealt to so many.
    pub fn work_with(&mut self, ranks: &Arc<dyn Ranks>) -> Result<(), TrainingError> {
        self.ranks = Arc::clone(ranks);
        ranks::order(ranks, &Order::Begin(Box::new((JOB, self.job.save()))));
        Ok(self.job.work_with(ranks)?)
    }

    /// Shows the policy to somebody, from now on after every update.
    pub fn show_to(&mut self, newest: NewestPolicy) {
        newest.offer(&self.job.actor(), self.job.steps());
        self.newest = Some(newest);
    }

    /// Trains until all tasks are learned or `interrupt` asks to stop, and leaves a checkpoint either way.
    ///
    /// # Errors
    /// When a file cannot be written; earlier checkpoints are then still whole.
    pub fn train(&mut self, interrupt: &Interrupt) -> Result<End, TrainingError> {
        train(self, interrupt)
    }

    /// Where everything is written.
    pub fn directory(&self) -> &RunDirectory {
        &self.directory
    }

    /// Environment steps so far.
    pub fn steps(&self) -> u64 {
        self.job.steps()
    }

    /// Environment steps of all tasks together after which training ends.
    pub fn total_steps(&self) -> u64 {
        self.study.steps_of(JOB)
    }

    /// Time spent in training, test flights included \[s\].
    pub fn training_secs(&self) -> f64 {
        self.training_secs
    }

    /// The policy as it is now.
    pub fn actor(&self) -> Actor {
        self.job.actor()
    }

    /// Flights of every task before training and after each of its stages.
    pub fn flights(&self) -> &[EpisodeRow] {
        self.job.rows()
    }

    fn log(&mut self, advance: &Advance, steps: u64) -> Result<ProgressReport, TrainingError> {
        let steps_per_second = advance.update.steps_per_second(steps as usize);
        let (updates, steps) = (self.updates, self.job.steps());
        let update = UpdateMetrics { updates, steps, ..advance.update.clone() };
        let named = |(task, share): &(usize, f64)| (self.study.tasks[*task].name.as_str(), *share as f32);
        let flights = advance.flown.iter().map(named).collect();
        let training_secs = self.training_secs;
        let row = MetricsRow { update: &update, steps_per_second, training_secs, test: None, flights };
        self.log.append(&row, Vec::new())?;
        Ok(report(&update))
    }
}

impl Stepwise for MultiTaskRun<'_> {
    fn steps(&self) -> u64 {
        self.job.steps()
    }

    fn total_steps(&self) -> u64 {
        self.study.steps_of(JOB)
    }

    fn is_finished(&self) -> bool {
        self.job.is_finished()
    }

    fn update(&mut self) -> Result<ProgressReport, TrainingError> {
        let start = Instant::now();
        let before = self.job.steps();
        ranks::order::<()>(&self.ranks, &Order::Update);
        let advance = self.job.advance();
        self.updates += 1;
        self.training_secs += start.elapsed().as_secs_f64();
        if let Some(newest) = &self.newest {
            newest.offer(&self.job.actor(), self.job.steps());
        }
        self.log(&advance, self.job.steps() - before)
    }

    fn save(&self) -> Result<(), TrainingError> {
        ranks::order::<()>(&self.ranks, &Order::Save);
        let checkpoint = Checkpoint {
            job: self.job.save(),
            updates: self.updates,
            training_secs: self.training_secs,
            seed: self.study.seeds[0].0,
            config: self.study.resolved_yaml.clone(),
        };
        Checkpoints::in_directory(&self.directory.checkpoints()).save(self.updates, &checkpoint)?;
        Ok(())
    }
}

/// The policy in the newest checkpoint of a run of several tasks, and the steps it was trained for.
///
/// # Errors
/// When there is no usable checkpoint, or it does not fit the configuration.
pub fn newest_policy(study: &Study, directory: &RunDirectory) -> Result<(Actor, u64), TrainingError> {
    let restored = Checkpoints::in_directory(&directory.checkpoints()).load_newest::<Checkpoint>()?;
    let job = JobRun::restore(study, JOB, restored.state.job)?;
    Ok((job.actor(), job.steps()))
}

#[cfg(test)]
mod tests;
