//! What a run, or a stage of a study, learns with: PPO, or gradients through the physics.

use std::sync::Arc;

use kestrel_learn::actor_critic::{Actor, Critic};
use kestrel_learn::analytic::{AnalyticError, AnalyticSettings, AnalyticTrainer};
use kestrel_learn::ppo::{CarryOver, PpoSettings, UpdateMetrics, WarmStart};
use kestrel_learn::ranks::{self, Order, Ranks, UnequalShares};
use kestrel_learn::regulariser::{EndedTask, Regulariser};
use kestrel_sim::gradient::StepGradient;
use kestrel_sim::reward::RewardTerm;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;

use crate::drone_environment::{DroneEnvironment, Trainer, TrainerState};
use crate::experiment_config::{Experiment, InitialPolicy};

/// How a policy is trained.
#[derive(Clone, Debug, PartialEq)]
pub struct LearnerSettings {
    /// By PPO, unless by gradients through the physics.
    pub ppo: PpoSettings,
    /// By these, where they train.
    pub analytic: Option<AnalyticSettings>,
    /// The policy that training begins with, instead of random weights.
    pub initial_policy: Option<Arc<InitialPolicy>>,
}

/// Whoever trains a policy, in one task or in several.
#[derive(Clone, Debug)]
pub(crate) enum Learner {
    /// Proximal policy optimisation.
    Ppo(Box<Trainer>),
    /// Backpropagation through time.
    Analytic(Box<AnalyticTrainer<DroneEnvironment>>),
}

impl LearnerSettings {
    /// Environment steps after which training ends.
    pub fn total_steps(&self) -> u64 {
        self.analytic.as_ref().map_or(self.ppo.total_steps, |analytic| analytic.total_steps)
    }

    /// Environment steps of an update, in teams of so many agents.
    pub fn batch(&self, agents: usize) -> usize {
        self.analytic.as_ref().map_or(self.ppo.batch(), |analytic| analytic.batch() * agents)
    }

    /// As at the end of a training by PPO, for who does not know that another task has begun: the smallest steps, and nobody teaches.
    pub(crate) fn at_the_end(self) -> Self {
        let ppo = PpoSettings { learning_rate: self.ppo.learning_rate.last(), teacher: None, ..self.ppo };
        Self { ppo, initial_policy: None, ..self }
    }

    /// What trains, for people.
    pub fn method(&self) -> &'static str {
        if self.analytic.is_some() { "gradients through the physics" } else { "PPO" }
    }
}

impl Learner {
    /// At the beginning of a run.
    ///
    /// # Errors
    /// When a task has no derivatives that the settings ask for.
    pub(crate) fn begin(
        tasks: &[Scenario],
        settings: &LearnerSettings,
        seed: Seed,
    ) -> Result<Self, AnalyticError> {
        let mut learner = match &settings.analytic {
            None => Self::Ppo(Box::new(Trainer::new(tasks, &settings.ppo, seed))),
            Some(analytic) => Self::Analytic(Box::new(AnalyticTrainer::new(tasks, analytic, seed)?)),
        };
        if let Some(policy) = &settings.initial_policy {
            learner.start_from(&WarmStart::of_policy(policy.actor().clone()));
        }
        Ok(learner)
    }

    /// As it was saved.
    ///
    /// # Errors
    /// When the state does not fit tasks and settings.
    pub(crate) fn restore(
        tasks: &[Scenario],
        settings: &LearnerSettings,
        state: TrainerState,
    ) -> Result<Self, AnalyticError> {
        Ok(match &settings.analytic {
            None => Self::Ppo(Box::new(Trainer::restore(tasks, &settings.ppo, state)?)),
            Some(analytic) => Self::Analytic(Box::new(AnalyticTrainer::restore(tasks, analytic, state)?)),
        })
    }

    /// Shares the work with all ranks from now on.
    ///
    /// # Errors
    /// When it cannot be dealt to so many.
    pub(crate) fn work_with(&mut self, ranks: &Arc<dyn Ranks>) -> Result<(), UnequalShares> {
        match self {
            Self::Analytic(trainer) => trainer.work_with(ranks),
            Self::Ppo(trainer) => trainer.work_with(ranks),
        }
    }

    /// Lets the other ranks, if there are any, do the same.
    pub(crate) fn order(&self, order: &Order<TrainerState>) {
        match self {
            Self::Ppo(trainer) => ranks::order(trainer.ranks(), order),
            Self::Analytic(trainer) => ranks::order(trainer.ranks(), order),
        }
    }

    pub(crate) fn update(&mut self) -> UpdateMetrics {
        match self {
            Self::Ppo(trainer) => trainer.update(),
            Self::Analytic(trainer) => trainer.update(),
        }
    }

    pub(crate) fn update_with(&mut self, regulariser: &mut impl Regulariser) -> UpdateMetrics {
        match self {
            Self::Ppo(trainer) => trainer.update_with(regulariser),
            Self::Analytic(trainer) => trainer.update_with(regulariser),
        }
    }

    /// Lets `regulariser` take in what must not be forgotten of the task that ends.
    pub(crate) fn consolidate(&mut self, regulariser: &mut impl Regulariser) {
        self.ended(|ended| regulariser.consolidate(ended));
    }

    /// Flies the policy once more and shows the task at its end.
    pub(crate) fn ended<T>(&mut self, show: impl FnOnce(&EndedTask<'_>) -> T) -> T {
        match self {
            Self::Ppo(trainer) => trainer.ended(show),
            Self::Analytic(trainer) => trainer.ended(show),
        }
    }

    /// Flies for so many steps without learning, so that environments are at different moments of their episodes.
    pub(crate) fn settle(&mut self, steps: u64) {
        match self {
            Self::Ppo(trainer) => trainer.settle(steps),
            Self::Analytic(trainer) => trainer.settle(steps),
        }
    }

    /// Begins with what an earlier task has learned.
    pub(crate) fn start_from(&mut self, earlier: &WarmStart) {
        match self {
            Self::Ppo(trainer) => trainer.start_from(earlier),
            Self::Analytic(trainer) => trainer.start_from(earlier),
        }
    }

    /// What a later task may begin with.
    pub(crate) fn warm_start(&self, log_std: CarryOver, learner: CarryOver) -> WarmStart {
        match self {
            Self::Ppo(trainer) => trainer.warm_start(log_std, learner),
            Self::Analytic(trainer) => trainer.warm_start(log_std, learner),
        }
    }

    pub(crate) fn save(&self) -> TrainerState {
        match self {
            Self::Ppo(trainer) => trainer.save(),
            Self::Analytic(trainer) => trainer.save(),
        }
    }

    /// Environment steps so far.
    pub(crate) fn steps(&self) -> u64 {
        match self {
            Self::Ppo(trainer) => trainer.steps(),
            Self::Analytic(trainer) => trainer.steps(),
        }
    }

    pub(crate) fn updates(&self) -> u64 {
        match self {
            Self::Ppo(trainer) => trainer.updates(),
            Self::Analytic(trainer) => trainer.updates(),
        }
    }

    pub(crate) fn actor(&self) -> &Actor {
        match self {
            Self::Ppo(trainer) => trainer.actor(),
            Self::Analytic(trainer) => trainer.actor(),
        }
    }

    pub(crate) fn critic(&self) -> &Critic {
        match self {
            Self::Ppo(trainer) => trainer.critic(),
            Self::Analytic(trainer) => trainer.critic(),
        }
    }
}

impl Experiment {
    /// Environment steps after which training ends.
    pub fn total_steps(&self) -> u64 {
        self.training.total_steps()
    }

    /// Environment steps of an update.
    pub fn batch(&self) -> usize {
        self.training.batch(self.scenario.agents.count as usize)
    }

    /// Names of the rewards, in the order of the configuration; the second `proximity` is `proximity_2`.
    pub fn reward_names(&self) -> Vec<String> {
        let names: Vec<&str> = self.scenario.rewards.iter().map(RewardTerm::name).collect();
        let numbered = names.iter().enumerate().map(|(index, name)| {
            let earlier = names[..index].iter().filter(|other| *other == name).count();
            if earlier == 0 { (*name).to_owned() } else { format!("{name}_{}", earlier + 1) }
        });
        numbered.collect()
    }

    /// Names of the rewards that teach nothing, because no gradient goes through them: none where PPO trains.
    pub fn silent_rewards(&self) -> Vec<&str> {
        let traced = self.training.analytic.as_ref().and_then(|_| StepGradient::new(&self.scenario).ok());
        let silent = traced.iter().flat_map(StepGradient::silent_terms);
        silent.map(|term| self.scenario.rewards[*term].name()).collect()
    }
}
