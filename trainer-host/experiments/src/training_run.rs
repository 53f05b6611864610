//! A training run: updates, measurements and checkpoints, until the budget is spent or the user stops it.

use std::collections::BTreeMap;
use std::slice;
use std::sync::Arc;
use std::time::Duration;

use kestrel_core::policy_file::PolicyError;
use kestrel_sim::seed::Purpose;
use serde::{Deserialize, Serialize};
use web_time::Instant;

use crate::atomic_file::FileError;
use crate::checkpoint::{CheckpointError, Checkpoints};
use crate::config_file::ConfigFile;
use crate::drawn_worlds::prepare;
use crate::drone_environment::TrainerState;
use crate::evaluation::{Evaluation, Flyer, Starts, evaluate};
use crate::experiment_config::{Experiment, ExperimentConfig};
use crate::interrupt::Interrupt;
use crate::learner::Learner;
use crate::progress::{Progress, ProgressReport};
use crate::run_directory::{RunDirectory, RunDirectoryError};
use crate::run_log::{MetricsRow, RunLog, TestRow};
use crate::watch::NewestPolicy;
use kestrel_learn::actor_critic::Actor;
use kestrel_learn::analytic::AnalyticError;
use kestrel_learn::ppo::{RestoreError, UpdateMetrics};
use kestrel_learn::ranks::{self, Order, Ranks, UnequalShares};

/// Starts of a test during a run: a standard error of three points at a success rate of one half, nothing near one.
const SELECTION_EPISODES: usize = 256;

/// Success rates of learners by gradients are compared in steps of this many flights of the test, less than its standard
/// error shows: their schedule ends in ever smaller steps, and a policy that had luck half-way is not the better one.
const ALIKE: usize = 4;

/// Time between checkpoints; a power cut costs no more.
const CHECKPOINT_INTERVAL: Duration = Duration::from_secs(10);

/// The best policy so far, by success rate (see `ALIKE`), then by return, on starts of its own.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct BestPolicy {
    /// The policy.
    pub actor: Actor,
    /// Environment steps it was trained for.
    pub steps: u64,
    /// How it flew.
    pub evaluation: Evaluation,
}

/// Training in memory: updates, and the selection of the best policy.
#[derive(Debug)]
pub struct Training {
    experiment: Experiment,
    learner: Learner,
    best: Option<BestPolicy>,
    /// What followed the last update, if it was a test.
    test: Option<TestRow>,
}

/// A run, open for training: the training, and what it leaves in its directory.
#[derive(Debug)]
pub struct TrainingRun {
    training: Training,
    directory: RunDirectory,
    training_secs: f64,
    log: RunLog,
    /// For who looks at it.
    newest: Option<NewestPolicy>,
}

/// What a checkpoint holds.
#[derive(Serialize, Deserialize)]
struct Checkpoint {
    trainer: TrainerState,
    best: Option<BestPolicy>,
    training_secs: f64,
    /// The resolved configuration.
    config: String,
}

/// A run between two updates.
pub(crate) trait Stepwise {
    /// Environment steps so far.
    fn steps(&self) -> u64;
    /// Environment steps after which it ends at the latest.
    fn total_steps(&self) -> u64;
    /// Whether nothing is left to do.
    fn is_finished(&self) -> bool;
    /// One update, logged.
    fn update(&mut self) -> Result<ProgressReport, TrainingError>;
    /// Leaves a checkpoint.
    fn save(&self) -> Result<(), TrainingError>;
}

/// Trains until `run` is finished or `interrupt` asks to stop, and leaves a checkpoint either way.
pub(crate) fn train(run: &mut impl Stepwise, interrupt: &Interrupt) -> Result<End, TrainingError> {
    let mut progress = Progress::new(run.total_steps(), run.steps());
    let mut saved_at = Instant::now();
    while !run.is_finished() && !interrupt.requested() {
        progress.show(&run.update()?);
        if saved_at.elapsed() > CHECKPOINT_INTERVAL {
            run.save()?;
            saved_at = Instant::now();
        }
    }
    progress.finish();
    run.save()?;
    Ok(if run.is_finished() { End::Finished } else { End::Interrupted })
}

/// Why training ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The budget is spent.
    Finished,
    /// The user asked to stop; the run can go on.
    Interrupted,
}

/// Why a run cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    /// The run directory refuses.
    #[error(transparent)]
    Directory(#[from] RunDirectoryError),
    /// No usable checkpoint, or none could be written.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The checkpoint does not fit the configuration beside it.
    #[error("the checkpoint of the run does not fit its config.yaml")]
    Restore(#[from] RestoreError),
    /// The run began with another seed.
    #[error(
        "the run began with seed {found}, but its config.yaml says {expected}: restore it, or begin a new run"
    )]
    Seed {
        /// In the checkpoint.
        found: u64,
        /// In the configuration.
        expected: u64,
    },
    /// The configuration is another than the run's, beside the budget.
    #[error(
        "line {line} of config.yaml, defaults filled in, says `{found}`, but the run was trained with `{expected}`: \
         change it back, or begin a new run"
    )]
    Changed {
        /// In the complete configuration.
        line: usize,
        /// Now.
        found: String,
        /// In the checkpoint.
        expected: String,
    },
    /// Several processes.
    #[error(transparent)]
    Ranks(#[from] UnequalShares),
    /// The task has no derivatives, or the checkpoint does not fit it.
    #[error(transparent)]
    Analytic(#[from] AnalyticError),
    /// The policy file cannot be written.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// The system refused a file operation.
    #[error(transparent)]
    File(#[from] FileError),
}

impl Training {
    /// At its beginning.
    ///
    /// # Errors
    /// When the task has no derivatives that the experiment asks for.
    pub fn begin(experiment: Experiment) -> Result<Self, TrainingError> {
        prepare(&experiment.scenario, experiment.training.ppo.environments);
        let learner = begin(&experiment)?;
        Ok(Self { experiment, learner, best: None, test: None })
    }

    /// One update; now and then a test flight. The bits do not depend on the number of threads of the current rayon pool.
    pub fn update(&mut self) -> UpdateMetrics {
        self.learner.order(&Order::Update);
        let update = self.learner.update();
        self.test = self.selection_is_due().then(|| self.select());
        update
    }

    /// Whether the budget is spent.
    pub fn is_finished(&self) -> bool {
        self.steps() >= self.experiment.total_steps()
    }

    /// Whether this update is one of those after which the policy is tested; the last always is.
    fn selection_is_due(&self) -> bool {
        let updates = self.experiment.total_steps().div_ceil(self.experiment.batch() as u64);
        let done = self.learner.updates();
        done >= updates || done.is_multiple_of((updates / self.experiment.evaluation.tests).max(1))
    }

    fn select(&mut self) -> TestRow {
        let evaluation = &self.experiment.evaluation;
        let starts = Starts { seed: evaluation.seed, purpose: Purpose::Selection, episodes: SELECTION_EPISODES };
        let found = evaluate(evaluation.selection(), Flyer::Actor(self.learner.actor()), starts);
        let alike = if self.experiment.training.analytic.is_some() { ALIKE } else { 1 };
        // Ties go to the later policy, which has been trained for longer.
        let is_best = self.best.as_ref().is_none_or(|best| rank(&best.evaluation, alike) <= rank(&found, alike));
        let row = TestRow::of(&found, is_best);
        if is_best {
            let actor = self.learner.actor().clone();
            self.best = Some(BestPolicy { actor, steps: self.learner.steps(), evaluation: found });
        }
        row
    }

    /// The experiment that is trained on.
    pub fn experiment(&self) -> &Experiment {
        &self.experiment
    }

    /// Environment steps so far.
    pub fn steps(&self) -> u64 {
        self.learner.steps()
    }

    /// How the best policy so far flew in its test; nothing before the first.
    pub fn tested(&self) -> Option<&Evaluation> {
        self.best.as_ref().map(|best| &best.evaluation)
    }

    /// The best policy so far; the newest before the first test.
    pub fn best(&self) -> (&Actor, u64) {
        match &self.best {
            Some(best) => (&best.actor, best.steps),
            None => (self.learner.actor(), self.learner.steps()),
        }
    }
}

impl TrainingRun {
    /// A new run in a fresh directory.
    ///
    /// # Errors
    /// When files cannot be created.
    pub fn begin(experiment: Experiment, directory: RunDirectory) -> Result<Self, TrainingError> {
        let run = Self::open(Training::begin(experiment)?, directory, 0.0)?;
        // A run that is killed in its first seconds can then go on as any other.
        run.save()?;
        Ok(run)
    }

    /// The run of `directory` from its newest checkpoint that is whole.
    ///
    /// # Errors
    /// When there is no usable checkpoint, or it does not fit the configuration.
    pub fn resume(experiment: Experiment, directory: RunDirectory) -> Result<Self, TrainingError> {
        let restored = Checkpoints::in_directory(&directory.checkpoints()).load_newest::<Checkpoint>()?;
        let Checkpoint { trainer, best, training_secs, config } = restored.state;
        let (found, expected) = (trainer.seed(), experiment.seed);
        if found != expected {
            return Err(TrainingError::Seed { found: found.0, expected: expected.0 });
        }
        let learner = Learner::restore(slice::from_ref(&experiment.scenario), &experiment.training, trainer)?;
        refuse_changes(&ExperimentConfig::resolved_again(&config), &experiment.resolved_yaml)?;
        Self::open(Training { experiment, learner, best, test: None }, directory, training_secs)
    }

    fn open(training: Training, directory: RunDirectory, training_secs: f64) -> Result<Self, TrainingError> {
        let log = RunLog::continue_after(&directory, training.learner.updates(), training.steps())?;
        Ok(Self { training, directory, training_secs, log, newest: None })
    }

    /// From now on shares the work with all ranks, of which this is the first; the others [`follow`].
    ///
    /// # Errors
    /// When the work cannot be dealt to so many.
    pub fn work_with(&mut self, ranks: &Arc<dyn Ranks>) -> Result<(), TrainingError> {
        let learner = &mut self.training.learner;
        let state = learner.save();
        learner.work_with(ranks)?;
        learner.order(&Order::Begin(Box::new(state)));
        Ok(())
    }

    /// Shows the policy to somebody, from now on after every update.
    pub fn show_to(&mut self, newest: NewestPolicy) {
        newest.offer(self.training.learner.actor(), self.steps());
        self.newest = Some(newest);
    }

    /// Trains until the budget is spent or `interrupt` asks to stop, and leaves a checkpoint either way.
    ///
    /// # Errors
    /// When a file cannot be written; earlier checkpoints are then still whole.
    pub fn train(&mut self, interrupt: &Interrupt) -> Result<End, TrainingError> {
        train(self, interrupt)
    }

    fn log(&mut self, update: &UpdateMetrics, steps: u64) -> Result<(), TrainingError> {
        let steps_per_second = update.steps_per_second(steps as usize);
        let (training_secs, test) = (self.training_secs, self.training.test);
        let row = MetricsRow { update, steps_per_second, training_secs, test, flights: BTreeMap::new() };
        let names = self.experiment().reward_names().into_iter();
        let terms = names.zip(&update.episode_terms).map(|(name, value)| (format!("reward/{name}"), *value));
        let terms = terms.collect();
        Ok(self.log.append(&row, terms)?)
    }

    /// The experiment that is run.
    pub fn experiment(&self) -> &Experiment {
        self.training.experiment()
    }

    /// Where everything is written.
    pub fn directory(&self) -> &RunDirectory {
        &self.directory
    }

    /// Environment steps so far.
    pub fn steps(&self) -> u64 {
        self.training.steps()
    }

    /// Time spent in training, selection included \[s\].
    pub fn training_secs(&self) -> f64 {
        self.training_secs
    }

    /// The best policy so far; the newest before the first test.
    pub fn best(&self) -> (&Actor, u64) {
        self.training.best()
    }
}

impl Stepwise for TrainingRun {
    fn steps(&self) -> u64 {
        self.training.steps()
    }

    fn total_steps(&self) -> u64 {
        self.experiment().total_steps()
    }

    fn is_finished(&self) -> bool {
        self.training.is_finished()
    }

    /// One update, logged; now and then a test flight.
    fn update(&mut self) -> Result<ProgressReport, TrainingError> {
        let start = Instant::now();
        let steps_before = self.steps();
        let update = self.training.update();
        self.training_secs += start.elapsed().as_secs_f64();
        if let Some(newest) = &self.newest {
            newest.offer(self.training.learner.actor(), self.steps());
        }
        self.log(&update, self.steps() - steps_before)?;
        Ok(report(&update))
    }

    fn save(&self) -> Result<(), TrainingError> {
        let Training { experiment, learner, best, .. } = &self.training;
        learner.order(&Order::Save);
        let checkpoint = Checkpoint {
            trainer: learner.save(),
            best: best.clone(),
            training_secs: self.training_secs,
            config: experiment.resolved_yaml.clone(),
        };
        Checkpoints::in_directory(&self.directory.checkpoints()).save(learner.updates(), &checkpoint)?;
        Ok(())
    }
}

/// Does what the first rank says, until that ends the run.
///
/// # Errors
/// When the experiment is not that of the first rank.
pub fn follow(experiment: &Experiment, ranks: &Arc<dyn Ranks>) -> Result<(), TrainingError> {
    let mut trainer = None;
    loop {
        match (ranks::hear::<TrainerState>(ranks), &mut trainer) {
            (Order::Begin(state), begun) => {
                let tasks = slice::from_ref(&experiment.scenario);
                begun.insert(Learner::restore(tasks, &experiment.training, *state)?).work_with(ranks)?;
            }
            (Order::Update, Some(trainer)) => drop(trainer.update()),
            (Order::Save, Some(trainer)) => drop(trainer.save()),
            (Order::Update | Order::Save, None) | (Order::End, _) => return Ok(()),
        }
    }
}

/// Who learns in an experiment.
fn begin(experiment: &Experiment) -> Result<Learner, AnalyticError> {
    Learner::begin(slice::from_ref(&experiment.scenario), &experiment.training, experiment.seed)
}

/// The policy with which training of `experiment` begins.
///
/// # Errors
/// When the task has no derivatives that the experiment asks for.
pub fn untrained_actor(experiment: &Experiment) -> Result<Actor, TrainingError> {
    Ok(begin(experiment)?.actor().clone())
}

/// The best policy in the newest checkpoint of a run, and the steps it was trained for.
///
/// # Errors
/// When there is no usable checkpoint.
pub fn best_policy(experiment: &Experiment, directory: &RunDirectory) -> Result<(Actor, u64), TrainingError> {
    let restored = Checkpoints::in_directory(&directory.checkpoints()).load_newest::<Checkpoint>()?;
    if let Some(best) = restored.state.best {
        return Ok((best.actor, best.steps));
    }
    let steps = restored.updates * experiment.batch() as u64;
    Ok((restored.state.trainer.actor().clone(), steps))
}

/// Refuses a configuration that differs in more than the budget, which may be raised.
pub(crate) fn refuse_changes(saved: &str, now: &str) -> Result<(), TrainingError> {
    let lines = saved.lines().count().max(now.lines().count());
    let padded = |text: &'static str| std::iter::repeat(text);
    let pairs = now.lines().chain(padded("")).zip(saved.lines().chain(padded("")));
    let is_budget = |line: &str| line.trim_start().starts_with("total_steps:");
    let change = pairs.take(lines).enumerate().find(|(_, (now, saved))| now != saved && !is_budget(saved));
    change.map_or(Ok(()), |(index, (found, expected))| {
        let [found, expected] = [found, expected].map(|line| line.trim().to_owned());
        Err(TrainingError::Changed { line: index + 1, found, expected })
    })
}

/// What the user sees of an update.
pub(crate) fn report(update: &UpdateMetrics) -> ProgressReport {
    ProgressReport {
        steps: update.steps,
        episode_return: update.episode_return,
        success_rate: update.success_rate,
    }
}

/// Of a test: its successes in steps of `alike` flights, then its return; one that is NaN ranks last.
fn rank(test: &Evaluation, alike: usize) -> (f64, f64) {
    let steps = test.success_rate * (SELECTION_EPISODES / alike) as f64;
    (steps.round(), test.episode_return.max(f64::MIN))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment_config::load_to_train;
    use crate::golden::in_repository;

    fn test(successes: u32, episode_return: f64) -> Evaluation {
        Evaluation {
            pilot: "policy".to_owned(),
            episodes: SELECTION_EPISODES,
            success_rate: f64::from(successes) / SELECTION_EPISODES as f64,
            success_interval: [0.0, 1.0],
            episode_return,
            return_interval: [episode_return; 2],
            length_secs: 8.0,
            steps: 400.0,
            endings: Vec::new(),
            hits: Vec::new(),
            terms: Vec::new(),
        }
    }

    #[test]
    fn a_run_is_tested_as_often_as_it_is_told_and_at_its_end() {
        let changes = [
            "training.environments=256",
            "training.steps_per_rollout=8",
            "training.minibatch=512",
            "training.total_steps=22528",
            "training.actor_hidden=[16]",
            "training.critic_hidden=[16]",
            "evaluation.tests=3",
        ];
        let path = in_repository("configs/hover-cf2x.yaml");
        let mut training = Training::begin(load_to_train(&path, &changes.map(str::to_owned)).unwrap()).unwrap();
        let mut tested = Vec::new();
        while !training.is_finished() {
            training.update();
            if training.test.is_some() {
                tested.push(training.learner.updates());
            }
        }
        assert_eq!(tested, [3, 6, 9, 11]);
    }

    #[test]
    fn a_few_lucky_flights_do_not_outweigh_the_return() {
        let (lucky, better, worse) = (test(256, 11.0), test(254, 12.0), test(250, 13.0));
        assert!(rank(&lucky, ALIKE) < rank(&better, ALIKE));
        assert!(rank(&worse, ALIKE) < rank(&lucky, ALIKE));
        assert!(rank(&better, 1) < rank(&lucky, 1), "flight by flight without gradients");
        assert!(rank(&test(256, f64::NAN), 1) < rank(&lucky, 1));
    }
}
