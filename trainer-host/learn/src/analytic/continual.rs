//! The end of a task, and what the next one begins with: as `ppo::continual`, for gradients through the environment.

use rayon::prelude::*;

use super::{AnalyticTrainer, Differentiable};
use crate::adam::Adam;
use crate::ppo::{CarryOver, WarmStart};
use crate::regulariser::{EndedTask, Flight, Regulariser, Visited};

impl<E: Differentiable> AnalyticTrainer<E> {
    /// Flies the policy once more and lets `regulariser` take in what must not be forgotten of the task that ends.
    pub fn consolidate(&mut self, regulariser: &mut impl Regulariser) {
        self.ended(|ended| regulariser.consolidate(ended));
    }

    /// Flies the policy for another window and shows the task at its end.
    pub fn ended<T>(&mut self, show: impl FnOnce(&EndedTask<'_>) -> T) -> T {
        let (mine, actor) = (self.mine(), &self.actor);
        self.batches[mine].par_iter_mut().for_each(|batch| batch.fly(actor));
        self.differentiate();
        self.share_visited();
        self.sum_gradients();
        let samples = (self.steps_in_update() as f32).max(1.0);
        let gradient: Vec<f32> = self.gradient.iter().map(|sum| -sum / samples).collect();
        let visited: Vec<Visited<'_>> = self.batches.iter().map(super::Batch::visited).collect();
        show(&EndedTask {
            actor: &self.actor,
            critic: &self.critic,
            gradient: &gradient,
            visited: &visited,
            seed: self.seed,
        })
    }

    fn share_visited(&mut self) {
        for step in 0..self.settings.steps_per_window {
            self.share(|batch| batch.visited_mut(step));
        }
    }

    /// Shows a regulariser the window, where it looks for the end of a task; whether it has found one.
    pub(super) fn show(&mut self, regulariser: &mut impl Regulariser) -> bool {
        if !regulariser.watches() {
            return false;
        }
        self.share_visited();
        let visited: Vec<Visited<'_>> = self.batches.iter().map(super::Batch::visited).collect();
        regulariser.watch(&Flight { actor: &self.actor, visited: &visited, seed: self.seed })
    }

    /// Flies for so many steps without learning, so that environments are at different moments of their episodes; of episodes that end
    /// nothing is reported.
    pub fn settle(&mut self, steps: u64) {
        for _ in 0..steps.div_ceil(self.settings.steps_per_window as u64) {
            self.fly();
        }
        self.take_episodes();
    }

    /// Begins with a policy, and what else is kept, of an earlier task.
    ///
    /// # Panics
    /// When it is of another shape.
    pub fn start_from(&mut self, earlier: &WarmStart) {
        earlier.place(&mut self.actor);
        if let Some((_, optimiser, _)) = &earlier.learner {
            self.optimiser.clone_from(optimiser);
        }
    }

    /// What a later task may begin with.
    pub fn warm_start(&self, log_std: CarryOver, learner: CarryOver) -> WarmStart {
        let state = || (self.critic.clone(), self.optimiser.clone(), Adam::new(self.critic.parameters().len()));
        WarmStart::new(&self.actor, log_std, learner, state)
    }
}
