//! What a training run learns with: PPO, or gradients through the physics.

use std::sync::Arc;

use kestrel_learn::actor_critic::Actor;
use kestrel_learn::analytic::AnalyticTrainer;
use kestrel_learn::ppo::UpdateMetrics;
use kestrel_learn::ranks::{self, Order, Ranks};
use kestrel_sim::gradient::StepGradient;
use kestrel_sim::reward::RewardTerm;

use crate::drone_environment::{DroneEnvironment, Trainer, TrainerState};
use crate::experiment_config::Experiment;
use crate::training_run::TrainingError;

/// The trainer of an experiment.
#[derive(Debug)]
pub(crate) enum Learner {
    /// Proximal policy optimisation.
    Ppo(Box<Trainer>),
    /// Backpropagation through time.
    Analytic(Box<AnalyticTrainer<DroneEnvironment>>),
}

impl Learner {
    /// At the beginning of a run.
    ///
    /// # Errors
    /// When the task has no derivatives that the experiment asks for.
    pub(crate) fn begin(experiment: &Experiment) -> Result<Self, TrainingError> {
        let Experiment { scenario, ppo, analytic, seed, .. } = experiment;
        Ok(match analytic {
            None => Self::Ppo(Box::new(Trainer::new(std::slice::from_ref(scenario), ppo, *seed))),
            Some(settings) => Self::Analytic(Box::new(AnalyticTrainer::new(scenario, settings, *seed)?)),
        })
    }

    /// As it was saved.
    ///
    /// # Errors
    /// When the state does not fit the experiment.
    pub(crate) fn restore(experiment: &Experiment, state: TrainerState) -> Result<Self, TrainingError> {
        let Experiment { scenario, ppo, analytic, .. } = experiment;
        Ok(match analytic {
            None => Self::Ppo(Box::new(Trainer::restore(std::slice::from_ref(scenario), ppo, state)?)),
            Some(settings) => Self::Analytic(Box::new(AnalyticTrainer::restore(scenario, settings, state)?)),
        })
    }

    /// Shares the work with all ranks from now on.
    ///
    /// # Errors
    /// When it cannot be dealt to so many.
    pub(crate) fn work_with(&mut self, ranks: &Arc<dyn Ranks>) -> Result<(), TrainingError> {
        let alone = |what| TrainingError::Alone { what, found: ranks.size() };
        match self {
            Self::Analytic(_) if ranks.size() == 1 => Ok(()),
            Self::Analytic(_) => Err(alone("gradients through the physics are computed")),
            Self::Ppo(trainer) if ranks.size() > 1 && trainer.actor().memory().is_some() => {
                Err(alone("policies that remember are trained"))
            }
            Self::Ppo(trainer) => Ok(trainer.work_with(ranks)?),
        }
    }

    /// Lets the other ranks, if there are any, do the same.
    pub(crate) fn order(&self, order: &Order<TrainerState>) {
        match self {
            Self::Ppo(trainer) => ranks::order(trainer.ranks(), order),
            Self::Analytic(_) => {}
        }
    }

    pub(crate) fn update(&mut self) -> UpdateMetrics {
        match self {
            Self::Ppo(trainer) => trainer.update(),
            Self::Analytic(trainer) => trainer.update(),
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
}

impl Experiment {
    /// Environment steps after which training ends.
    pub fn total_steps(&self) -> u64 {
        self.analytic.as_ref().map_or(self.ppo.total_steps, |analytic| analytic.total_steps)
    }

    /// Environment steps of an update.
    pub fn batch(&self) -> usize {
        let agents = self.scenario.agents.count as usize;
        self.analytic.as_ref().map_or(self.ppo.batch(), |analytic| analytic.batch() * agents)
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
        let traced = self.analytic.as_ref().and_then(|_| StepGradient::new(&self.scenario).ok());
        let silent = traced.iter().flat_map(StepGradient::silent_terms);
        silent.map(|term| self.scenario.rewards[*term].name()).collect()
    }

    /// What trains it, for people.
    pub fn method(&self) -> &'static str {
        if self.analytic.is_some() { "gradients through the physics" } else { "PPO" }
    }
}
