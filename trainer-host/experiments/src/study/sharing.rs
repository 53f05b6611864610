//! Policy sharing: every task has a learner of its own, and their policies are averaged now and then.
//!
//! The thesis calls this MAPPO; it is federated averaging (McMahan et al. 2017) of PPO. Its script averaged the first
//! row of every tensor only and took all else, the optimiser included, from the first task.

use std::sync::Arc;

use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;
use serde::{Deserialize, Serialize};

use crate::drone_environment::{Trainer, TrainerState};
use kestrel_learn::actor_critic::Actor;
use kestrel_learn::ppo::{CarryOver, PpoSettings, RestoreError, UpdateMetrics};
use kestrel_learn::ranks::{Ranks, UnequalShares};

/// What an average is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Merge {
    /// Of the network.
    pub rows: Rows,
    /// Of the optimisers' state.
    pub optimiser: Optimisers,
    /// Of the logarithms of the standard deviations.
    pub log_std: LogStds,
}

/// Which weights are averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rows {
    /// All.
    All,
    /// The first row of every tensor; all else is the first task's, its optimisers included.
    First,
}

/// What becomes of the optimisers' state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Optimisers {
    /// It is averaged.
    Averaged,
    /// Each keeps its own.
    Own,
    /// It begins afresh.
    Reset,
}

/// What becomes of the standard deviations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogStds {
    /// Their logarithms are averaged.
    Averaged,
    /// Each task keeps its own.
    Own,
}

/// One learner for each task.
#[derive(Clone, Debug)]
pub struct PolicySharing {
    learners: Vec<Trainer>,
    every_updates: u64,
    merge: Merge,
}

/// Everything that it needs to go on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SharingState {
    learners: Vec<TrainerState>,
}

impl PolicySharing {
    /// All learners begin with the policy of the first: averages of unrelated networks mean nothing.
    ///
    /// # Panics
    /// As [`Trainer::new`], or when there are not as many seeds as tasks.
    pub fn new(
        tasks: &[Scenario],
        settings: &PpoSettings,
        seeds: &[Seed],
        (every_updates, merge): (u64, Merge),
    ) -> Self {
        assert_eq!(tasks.len(), seeds.len(), "every task has a seed");
        let learner = |(task, seed): (&Scenario, &Seed)| Trainer::new(std::slice::from_ref(task), settings, *seed);
        let mut learners: Vec<Trainer> = tasks.iter().zip(seeds).map(learner).collect();
        let first = learners[0].warm_start(CarryOver::CarriedOver, CarryOver::Reinitialised);
        for learner in &mut learners {
            learner.start_from(&first);
        }
        Self { learners, every_updates, merge }
    }

    /// From now on several processes share the work of every learner; each of them has all.
    ///
    /// # Errors
    /// When it cannot be dealt to so many equally.
    pub fn work_with(&mut self, ranks: &Arc<dyn Ranks>) -> Result<(), UnequalShares> {
        self.learners.iter_mut().try_for_each(|learner| learner.work_with(ranks))
    }

    /// One update of every learner; then, when it is time, the average.
    pub fn update(&mut self) -> Vec<UpdateMetrics> {
        let metrics = self.learners.iter_mut().map(Trainer::update).collect();
        if self.learners[0].updates().is_multiple_of(self.every_updates) {
            self.average();
        }
        metrics
    }

    /// Replaces every policy by the average.
    fn average(&mut self) {
        let actors: Vec<&Actor> = self.learners.iter().map(Trainer::actor).collect();
        let shared = match self.merge.rows {
            Rows::All => mean(&actors),
            Rows::First => first_rows(&actors),
        };
        let network = actors[0].mlp().parameter_count();
        let kept = match self.merge.log_std {
            LogStds::Averaged => shared.len(),
            LogStds::Own => network,
        };
        let optimisers: Vec<_> = self.learners.iter().map(|learner| learner.actor_optimiser().clone()).collect();
        for (index, learner) in self.learners.iter_mut().enumerate() {
            learner.actor_mut().parameters_mut()[..kept].copy_from_slice(&shared[..kept]);
            *learner.actor_optimiser_mut() = match (self.merge.rows, self.merge.optimiser) {
                (Rows::First, _) => optimisers[0].clone(),
                (Rows::All, Optimisers::Averaged) => kestrel_learn::adam::Adam::mean(&optimisers),
                (Rows::All, Optimisers::Own) => optimisers[index].clone(),
                (Rows::All, Optimisers::Reset) => kestrel_learn::adam::Adam::new(shared.len()),
            };
        }
    }

    /// The average of the policies as they are now: what is judged.
    pub fn actor(&self) -> Actor {
        let actors: Vec<&Actor> = self.learners.iter().map(Trainer::actor).collect();
        let mut actor = actors[0].clone();
        let shared = match self.merge.rows {
            Rows::All => mean(&actors),
            Rows::First => first_rows(&actors),
        };
        actor.parameters_mut().copy_from_slice(&shared);
        actor
    }

    /// Environment steps of all learners since their start.
    pub fn steps(&self) -> u64 {
        self.learners.iter().map(Trainer::steps).sum()
    }

    /// What [`Self::restore`] goes on from.
    pub fn save(&self) -> SharingState {
        SharingState { learners: self.learners.iter().map(Trainer::save).collect() }
    }

    /// Goes on to the same bits.
    ///
    /// # Errors
    /// When a learner's state is of another task or of settings of another shape.
    pub fn restore(
        &mut self,
        settings: &PpoSettings,
        tasks: &[Scenario],
        state: SharingState,
    ) -> Result<(), RestoreError> {
        for ((learner, task), state) in self.learners.iter_mut().zip(tasks).zip(state.learners) {
            *learner = Trainer::restore(std::slice::from_ref(task), settings, state)?;
        }
        Ok(())
    }
}

fn mean(actors: &[&Actor]) -> Vec<f32> {
    let share = 1.0 / actors.len() as f32;
    let mut sum = vec![0.0; actors[0].parameters().len()];
    for actor in actors {
        for (sum, value) in sum.iter_mut().zip(actor.parameters()) {
            *sum += value * share;
        }
    }
    sum
}

/// The first task's policy with the mean of all first rows: of each weight matrix, of each bias and of the standard
/// deviations, whose first row is one number.
fn first_rows(actors: &[&Actor]) -> Vec<f32> {
    let (mut shared, average) = (actors[0].parameters().to_vec(), mean(actors));
    let mut start = 0;
    let mut take = |length: usize, first: usize| {
        shared[start..start + first].copy_from_slice(&average[start..start + first]);
        start += length;
    };
    for pair in actors[0].mlp().widths().windows(2) {
        take(pair[0] * pair[1], pair[0]);
        take(pair[1], 1);
    }
    take(actors[0].action_len(), 1);
    shared
}

#[cfg(test)]
mod tests {
    use super::*;
    use kestrel_learn::actor_critic::ActorLengths;
    use kestrel_sim::seed::{Purpose, Stream};

    fn actors() -> Vec<Actor> {
        (0..2)
            .map(|seed| {
                Actor::state_based(
                    ActorLengths { observation: 3, action: 2 },
                    &[4],
                    seed as f32,
                    &mut Stream::new(Seed(seed), 0, Purpose::Weights),
                )
            })
            .collect()
    }

    #[test]
    fn the_mean_of_whole_policies_is_that_of_every_weight() {
        let actors = actors();
        let shared = mean(&actors.iter().collect::<Vec<_>>());
        for (index, value) in shared.iter().enumerate() {
            let expected = 0.5 * (actors[0].parameters()[index] + actors[1].parameters()[index]);
            assert!((value - expected).abs() < 1e-7);
        }
    }

    #[test]
    fn the_script_of_the_thesis_shares_first_rows_only() {
        let actors = actors();
        let shared = first_rows(&actors.iter().collect::<Vec<_>>());
        let average = mean(&actors.iter().collect::<Vec<_>>());
        // Weights [4][3], biases [4], weights [2][4], biases [2], logarithms of standard deviations [2].
        let first = [0..3, 12..13, 16..20, 24..25, 26..27];
        for index in 0..shared.len() {
            let expected =
                if first.iter().any(|row| row.contains(&index)) { &average } else { actors[0].parameters() };
            assert_eq!(shared[index], expected[index], "{index}");
        }
    }
}
