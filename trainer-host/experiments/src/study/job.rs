//! One job: a method learns the tasks of an order, stage by stage, and flies all of them after each.

use std::mem;
use std::sync::Arc;

use kestrel_sim::gradient::LANES;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::{Purpose, Seed, philox};
use serde::{Deserialize, Serialize};

use super::procedure::{Procedure, WarmStartRule};
use super::rows::{CurveRow, EpisodeRow};
use super::sharing::{PolicySharing, SharingState};
use super::{JobId, Study};
use crate::drone_environment::TrainerState;
use crate::evaluation::{Flyer, Starts, fly_episodes};
use crate::learner::{Learner, LearnerSettings};
use kestrel_learn::actor_critic::Actor;
use kestrel_learn::analytic::{AnalyticError, AnalyticSettings};
use kestrel_learn::ppo::{CarryOver, PpoSettings, RestoreError, UpdateMetrics, WarmStart};
use kestrel_learn::ranks::{self, Ranks, UnequalShares};
use kestrel_learn::regulariser::{Learning, Regulariser, RegulariserSettings, ShippedRegulariser, distil};
use kestrel_learn::rollout::batch_rows;

/// A job between two updates.
#[derive(Clone, Debug)]
pub struct JobRun<'a> {
    study: &'a Study,
    id: JobId,
    learner: StageLearner,
    progress: JobProgress,
    ranks: Arc<dyn Ranks>,
}

/// What a job has come to, beside its learner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct JobProgress {
    /// Index of the stage in progress; as many as there are stages at the end.
    stage: usize,
    /// Steps of this stage by learners before the present one, where boundaries are found.
    earlier_steps: u64,
    /// Whether the learner has not found yet that this stage has begun.
    unaware: bool,
    /// Stages and their steps at which a boundary was found.
    boundaries: Vec<(usize, u64)>,
    /// Test flights of this stage.
    flights: u64,
    memory: ShippedRegulariser,
    warm_start: Option<WarmStart>,
    /// The policy that is taught, where fresh ones learn.
    keeper: Option<Actor>,
    /// Parameters of the policies of the stages before.
    earlier_parameters: usize,
    rows: Vec<EpisodeRow>,
    curve: Vec<CurveRow>,
}

/// Who learns in the stage in progress.
#[derive(Clone, Debug)]
enum StageLearner {
    One(Learner),
    Many(Box<PolicySharing>),
}

/// Everything that a job needs to go on to the same bits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JobState {
    learner: LearnerState,
    progress: JobProgress,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum LearnerState {
    One(Box<TrainerState>),
    Many(SharingState),
}

/// What one update of a job came to.
#[derive(Clone, Debug)]
pub struct Advance {
    /// Its figures; steps and updates are those of the stage.
    pub update: UpdateMetrics,
    /// Success rate in each task of the stage, where test flights were due: the task's index and a share in \[0, 1\].
    pub flown: Vec<(usize, f64)>,
    /// The stage that this update ended, from 0, if it did, and the policy after it.
    pub ended: Option<(usize, Actor)>,
}

/// What a finished job leaves.
#[derive(Clone, Debug, PartialEq)]
pub struct JobResult {
    /// Every flight.
    pub rows: Vec<EpisodeRow>,
    /// Progress of training.
    pub curve: Vec<CurveRow>,
    /// Bytes that the method keeps from task to task beside the policy.
    pub stored_bytes: usize,
    /// Bytes that it needs while it trains, beside the policy.
    pub training_bytes: usize,
    /// Parameters of the policy.
    pub parameters: usize,
    /// Stages, from 1, and their steps at which the method found that the task was another one.
    pub boundaries: Vec<(usize, u64)>,
}

impl<'a> JobRun<'a> {
    /// A job before its first update; all policies have flown all tasks once.
    pub fn begin(study: &'a Study, id: JobId) -> Self {
        let learner = learner(study, id, 0, false);
        let actor = learner.actor();
        let critic = match &learner {
            StageLearner::One(trainer) => Some(trainer.critic().clone()),
            StageLearner::Many(_) => None,
        };
        let memory = match (&study.methods[id.method].procedure, critic) {
            (Procedure::Sequential { regulariser, .. }, Some(critic)) => {
                regulariser.begin(Learning { actor: &actor, critic: &critic })
            }
            (Procedure::Distil { coreset, .. }, Some(critic)) => {
                RegulariserSettings::Coreset(*coreset).begin(Learning { actor: &actor, critic: &critic })
            }
            (Procedure::Joint | Procedure::Sharing { .. } | Procedure::Experts { .. }, _) | (_, None) => {
                ShippedRegulariser::None
            }
        };
        let progress = JobProgress {
            stage: 0,
            earlier_steps: 0,
            unaware: false,
            boundaries: Vec::new(),
            flights: 0,
            memory,
            warm_start: None,
            keeper: None,
            earlier_parameters: 0,
            rows: Vec::new(),
            curve: Vec::new(),
        };
        let mut run = Self { study, id, learner, progress, ranks: ranks::alone() };
        run.settle();
        run.judge(0, &actor);
        run
    }

    /// Goes on from a saved state.
    ///
    /// # Errors
    /// When it is of another study.
    pub fn restore(study: &'a Study, id: JobId, state: JobState) -> Result<Self, AnalyticError> {
        let JobProgress { stage, unaware, .. } = state.progress;
        let mut fresh = learner(study, id, stage, unaware);
        let tasks = stage_tasks(study, id, stage);
        let settings = settings_of(study, id, stage, unaware);
        match (&mut fresh, state.learner) {
            (StageLearner::One(trainer), LearnerState::One(saved)) => {
                *trainer = Learner::restore(&tasks, &settings, *saved)?;
            }
            (StageLearner::Many(sharing), LearnerState::Many(saved)) => {
                sharing.restore(&settings.ppo, &tasks, saved)?;
            }
            (StageLearner::One(_), LearnerState::Many(_)) | (StageLearner::Many(_), LearnerState::One(_)) => {
                return Err(RestoreError::Task { task: study.name.clone() }.into());
            }
        }
        Ok(Self { study, id, learner: fresh, progress: state.progress, ranks: ranks::alone() })
    }

    /// From now on several processes share the work of this job; each of them has it.
    ///
    /// # Errors
    /// When it cannot be dealt to so many equally.
    pub fn work_with(&mut self, ranks: &Arc<dyn Ranks>) -> Result<(), UnequalShares> {
        self.ranks = Arc::clone(ranks);
        self.learner.work_with(ranks)
    }

    /// What [`Self::restore`] goes on from; all its ranks save at once.
    pub fn save(&self) -> JobState {
        let learner = match &self.learner {
            StageLearner::One(trainer) => LearnerState::One(Box::new(trainer.save())),
            StageLearner::Many(sharing) => LearnerState::Many(sharing.save()),
        };
        JobState { learner, progress: self.progress.clone() }
    }

    /// Environment steps since the job began, as if all stages before had lasted to their end.
    pub fn steps(&self) -> u64 {
        let finished = (0..self.progress.stage).map(|stage| self.study.stage_steps(self.id, stage)).sum::<u64>();
        if self.is_finished() { finished } else { finished + self.steps_in_stage().min(self.stage_steps()) }
    }

    /// Whether all stages are over.
    pub fn is_finished(&self) -> bool {
        self.progress.stage == self.stages()
    }

    /// One update, and what is due after it; none of a stage that is over before it began (`skip_solved`).
    ///
    /// # Panics
    /// When the job is finished.
    pub fn advance(&mut self) -> Advance {
        assert!(!self.is_finished(), "a finished job has nothing left to do");
        if self.study.evaluation.skip_solved && self.steps_in_stage() == 0 {
            let flown = self.fly();
            if self.is_solved(&flown) {
                let ended = Some(self.end_stage());
                return Advance { update: UpdateMetrics::without_ppo(), flown, ended };
            }
        }
        let update = match &mut self.learner {
            StageLearner::One(trainer) => trainer.update_with(&mut self.progress.memory),
            StageLearner::Many(sharing) => UpdateMetrics::together(&sharing.update()).expect("a study has tasks"),
        };
        if update.boundary {
            self.begin_anew();
        }
        let flown = if self.flight_is_due() { self.fly() } else { Vec::new() };
        let ends = self.is_solved(&flown) || self.steps_in_stage() >= self.stage_steps();
        Advance { update, flown, ended: ends.then(|| self.end_stage()) }
    }

    /// Whether flights of the stage's tasks are successful enough.
    fn is_solved(&self, flown: &[(usize, f64)]) -> bool {
        let stop = self.study.evaluation.stop_at_success;
        !flown.is_empty() && stop.is_some_and(|stop| flown.iter().all(|(_, share)| *share >= stop))
    }

    /// The policy as it is now: what is flown and kept.
    pub fn actor(&self) -> Actor {
        self.progress.keeper.clone().unwrap_or_else(|| self.learner.actor())
    }

    /// Flights of every task before training and after each stage so far.
    pub fn rows(&self) -> &[EpisodeRow] {
        &self.progress.rows
    }

    /// What the job leaves.
    ///
    /// # Panics
    /// When it is not finished.
    pub fn into_result(self) -> JobResult {
        assert!(self.is_finished(), "the job goes on");
        let actor = self.learner.actor();
        let parameters = actor.parameters().len();
        let (stored_bytes, training_bytes) = match self.study.methods[self.id.method].procedure {
            Procedure::Sequential { .. } => {
                (self.progress.memory.stored_bytes(), self.progress.memory.training_bytes())
            }
            // The fresh policy that teaches.
            Procedure::Distil { .. } => {
                let stored = self.progress.memory.stored_bytes();
                (stored, stored + 4 * parameters)
            }
            Procedure::Joint => (0, 0),
            // One policy for each task beside the one that is flown.
            Procedure::Sharing { .. } => (0, 4 * parameters * self.study.orders[self.id.order].len()),
            Procedure::Experts { .. } => {
                let others = 4 * (self.progress.earlier_parameters - parameters);
                (others, others)
            }
        };
        let JobProgress { rows, curve, boundaries, .. } = self.progress;
        JobResult { rows, curve, stored_bytes, training_bytes, parameters, boundaries }
    }

    fn procedure(&self) -> &'a Procedure {
        &self.study.methods[self.id.method].procedure
    }

    fn stages(&self) -> usize {
        self.procedure().stages(self.study.orders[self.id.order].len())
    }

    fn stage_steps(&self) -> u64 {
        self.study.stage_steps(self.id, self.progress.stage)
    }

    fn steps_in_stage(&self) -> u64 {
        self.progress.earlier_steps + self.learner.steps()
    }

    fn flight_is_due(&self) -> bool {
        let due = (self.progress.flights + 1) * self.stage_steps() / self.study.evaluation.flights_per_stage;
        self.steps_in_stage() >= due
    }

    /// Flies the tasks of the stage for the curve; the success rate in each.
    fn fly(&mut self) -> Vec<(usize, f64)> {
        let steps = self.steps_in_stage();
        let evaluation = &self.study.evaluation;
        self.progress.flights = steps * evaluation.flights_per_stage / self.stage_steps();
        let actor = self.learner.actor();
        let starts =
            Starts { seed: evaluation.seed, purpose: Purpose::Selection, episodes: evaluation.flight_episodes };
        let (mut successes, mut total, mut count, mut shares) = (0, 0.0, 0, Vec::new());
        for task in stage_indices(self.study, self.id, self.progress.stage) {
            let scenario = &self.study.tasks[task].evaluation.scenario;
            let flights = fly_episodes(scenario, Flyer::Actor(&actor), starts);
            let good = flights.iter().filter(|flight| flight.success).count();
            shares.push((task, good as f64 / flights.len() as f64));
            successes += good;
            count += flights.len();
            total += flights.iter().map(|flight| f64::from(flight.total_reward)).sum::<f64>();
        }
        self.progress.curve.push(CurveRow {
            stage: self.progress.stage + 1,
            steps,
            success_rate: (successes as f64 / count as f64) as f32,
            episode_return: (total / count as f64) as f32,
        });
        shares
    }

    fn end_stage(&mut self) -> (usize, Actor) {
        let study = self.study;
        match (&mut self.learner, &study.methods[self.id.method].procedure) {
            (StageLearner::One(trainer), Procedure::Sequential { warm_start_rule, .. }) => {
                let WarmStartRule { log_std, learner, .. } = *warm_start_rule;
                self.progress.warm_start = if self.study.methods[self.id.method].procedure.finds_boundaries() {
                    Some(trainer.warm_start(CarryOver::CarriedOver, CarryOver::CarriedOver))
                } else {
                    trainer.consolidate(&mut self.progress.memory);
                    Some(trainer.warm_start(log_std, learner))
                };
            }
            (StageLearner::One(trainer), Procedure::Distil { distillation, .. }) => {
                let keeper = self.progress.keeper.get_or_insert_with(|| trainer.actor().clone());
                if let ShippedRegulariser::Coreset(coreset) = &self.progress.memory {
                    // The first task's policy is the keeper itself.
                    if self.progress.stage > 0 {
                        trainer.ended(|ended| distil(keeper, ended, coreset, distillation));
                    }
                }
                trainer.consolidate(&mut self.progress.memory);
            }
            (
                StageLearner::One(_) | StageLearner::Many(_),
                Procedure::Sequential { .. }
                | Procedure::Distil { .. }
                | Procedure::Joint
                | Procedure::Sharing { .. }
                | Procedure::Experts { .. },
            ) => {}
        }
        let (ended, actor) = (self.progress.stage, self.actor());
        self.progress.earlier_parameters += actor.parameters().len();
        self.progress.stage += 1;
        self.progress.earlier_steps = 0;
        self.progress.unaware = self.procedure().finds_boundaries();
        self.progress.flights = 0;
        self.judge(self.progress.stage, &actor);
        if !self.is_finished() {
            self.begin_stage();
        }
        (ended, actor)
    }

    fn begin_stage(&mut self) {
        self.learner = learner(self.study, self.id, self.progress.stage, self.progress.unaware);
        self.learner.work_with(&self.ranks).expect("stages differ in their tasks, not in what is dealt");
        let Procedure::Sequential { warm_start_rule, .. } = self.procedure() else { return };
        if let (StageLearner::One(trainer), Some(warm_start), CarryOver::CarriedOver) =
            (&mut self.learner, &self.progress.warm_start, warm_start_rule.policy)
        {
            trainer.start_from(warm_start);
        }
        self.settle();
    }

    /// Where nobody tells that a task begins, its drones are on their way already: that they all begin at once would tell.
    fn settle(&mut self) {
        if let (true, StageLearner::One(trainer)) = (self.procedure().finds_boundaries(), &mut self.learner) {
            let task = &stage_tasks(self.study, self.id, self.progress.stage)[0];
            trainer.settle(u64::from(task.episode_steps()));
        }
    }

    /// Learns a task that was found to be another one as the first was learned.
    fn begin_anew(&mut self) {
        let steps = self.steps_in_stage();
        self.progress.boundaries.push((self.progress.stage + 1, steps));
        if let (StageLearner::One(trainer), Procedure::Sequential { warm_start_rule, .. }) =
            (&self.learner, self.procedure())
        {
            self.progress.warm_start = Some(trainer.warm_start(warm_start_rule.log_std, warm_start_rule.learner));
        }
        (self.progress.earlier_steps, self.progress.unaware) = (steps, false);
        self.begin_stage();
    }

    /// Flies every task of the study, or, where each has a training of its own and perhaps other eyes, that of the stage before, and
    /// notes every flight.
    fn judge(&mut self, stage: usize, actor: &Actor) {
        let evaluation = &self.study.evaluation;
        let starts = Starts { seed: evaluation.seed, purpose: Purpose::Evaluation, episodes: evaluation.episodes };
        let mut rows = mem::take(&mut self.progress.rows);
        let own = self.study.orders[self.id.order][stage.saturating_sub(1)];
        let all = 0..self.study.tasks.len();
        let flown = if self.procedure().trains_as_configured() { own..own + 1 } else { all };
        for task in flown {
            let scenario = &self.study.tasks[task].evaluation.scenario;
            let flights = fly_episodes(scenario, Flyer::Actor(actor), starts);
            rows.extend(flights.iter().enumerate().map(|(episode, flight)| EpisodeRow {
                stage,
                task,
                episode: episode as u32,
                success: flight.success,
                episode_return: flight.total_reward,
                length_secs: flight.steps as f32 * scenario.physics.control_secs(),
            }));
        }
        self.progress.rows = rows;
    }
}

impl StageLearner {
    fn actor(&self) -> Actor {
        match self {
            Self::One(trainer) => trainer.actor().clone(),
            Self::Many(sharing) => sharing.actor(),
        }
    }

    fn work_with(&mut self, ranks: &Arc<dyn Ranks>) -> Result<(), UnequalShares> {
        match self {
            Self::One(trainer) => trainer.work_with(ranks),
            Self::Many(sharing) => Ok(sharing.work_with(ranks)?),
        }
    }

    fn steps(&self) -> u64 {
        match self {
            Self::One(trainer) => trainer.steps(),
            Self::Many(sharing) => sharing.steps(),
        }
    }
}

/// Who learns in a stage, without what it inherits; `unaware` as in [`JobProgress`].
fn learner(study: &Study, id: JobId, stage: usize, unaware: bool) -> StageLearner {
    let (tasks, settings) = (stage_tasks(study, id, stage), settings_of(study, id, stage, unaware));
    let seed = study.seeds[id.seed];
    match study.methods[id.method].procedure {
        Procedure::Sharing { every_updates, merge } => {
            let seeds: Vec<Seed> = (0..tasks.len()).map(|task| stage_seed(seed, task)).collect();
            StageLearner::Many(Box::new(PolicySharing::new(&tasks, &settings.ppo, &seeds, (every_updates, merge))))
        }
        Procedure::Sequential { .. } | Procedure::Joint | Procedure::Experts { .. } | Procedure::Distil { .. } => {
            let learner = Learner::begin(&tasks, &settings, stage_seed(seed, stage));
            StageLearner::One(learner.expect("tasks are checked to have the derivatives that are asked for"))
        }
    }
}

/// Tasks of a stage.
fn stage_indices(study: &Study, id: JobId, stage: usize) -> Vec<usize> {
    let order = &study.orders[id.order];
    match study.methods[id.method].procedure.stages(order.len()) {
        stages if stages == order.len() && stages > 1 => vec![order[stage.min(stages - 1)]],
        _ => order.clone(),
    }
}

fn stage_tasks(study: &Study, id: JobId, stage: usize) -> Vec<Scenario> {
    stage_indices(study, id, stage).into_iter().map(|task| study.tasks[task].scenario.clone()).collect()
}

/// Settings of the learner of a stage.
fn settings_of(study: &Study, id: JobId, stage: usize, unaware: bool) -> LearnerSettings {
    let settings = stage_settings(study, id, stage);
    if unaware { settings.at_the_end() } else { settings }
}

/// Settings of a stage: where one learner has several tasks, it has a multiple of environment batches and the steps of all.
fn stage_settings(study: &Study, id: JobId, stage: usize) -> LearnerSettings {
    let tasks = study.orders[id.order].len();
    let settings = study.training_at(id, stage.min(tasks - 1)).clone();
    match study.methods[id.method].procedure {
        Procedure::Joint => {
            let rows = batch_rows(stage_tasks(study, id, 0).iter().map(|task| task.agents.count as usize));
            let for_all =
                |environments: usize, rows: usize| (environments / rows).div_ceil(tasks).max(1) * tasks * rows;
            let ppo = PpoSettings {
                environments: for_all(settings.ppo.environments, rows),
                total_steps: settings.ppo.total_steps * tasks as u64,
                ..settings.ppo
            };
            let analytic = settings.analytic.map(|analytic| AnalyticSettings {
                environments: for_all(analytic.environments, LANES),
                total_steps: analytic.total_steps * tasks as u64,
                ..analytic
            });
            LearnerSettings { ppo, analytic, ..settings }
        }
        Procedure::Sequential { .. }
        | Procedure::Sharing { .. }
        | Procedure::Experts { .. }
        | Procedure::Distil { .. } => settings,
    }
}

/// Seed of a stage: the same for all methods, so that they begin alike and can be compared in pairs.
pub(super) fn stage_seed(seed: Seed, stage: usize) -> Seed {
    if stage == 0 {
        return seed;
    }
    let [low, high, ..] = philox([stage as u32, 0, 0, 0], [seed.0 as u32, (seed.0 >> 32) as u32]);
    Seed(u64::from(high) << 32 | u64::from(low))
}

#[cfg(test)]
mod tests;
