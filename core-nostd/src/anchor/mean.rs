//! The anchor whose curvature is the identity: one vector and a count.

use super::{proximal_share, shifted};

/// As [`Anchor`](super::Anchor) where every task has the curvature one in every parameter: the center is the mean of
/// the tasks' ends (Welford's recursion), the importance their number.
#[derive(Debug)]
pub struct MeanAnchor<'a> {
    /// What each parameter is regularised towards, `[parameters]`.
    pub center: &'a mut [f32],
    /// Tasks so far. Exact as an importance up to 2²⁴.
    pub tasks: &'a mut u32,
}

impl MeanAnchor<'_> {
    /// Memory per parameter, for any number of tasks; the count is beside it.
    pub const BYTES_PER_PARAMETER: usize = size_of::<f32>();

    /// Memory of the count.
    pub const COUNT_BYTES: usize = size_of::<u32>();

    /// Takes in a task that ended at `parameters`.
    ///
    /// # Panics
    /// If `parameters` is not as long as the anchor.
    pub fn consolidate(&mut self, parameters: &[f32]) {
        self.check(parameters.len());
        *self.tasks = self.tasks.saturating_add(1);
        let tasks = self.importance();
        for (center, parameter) in self.center.iter_mut().zip(parameters) {
            *center += (parameter - *center) / tasks;
        }
    }

    /// As [`consolidate`](Self::consolidate), but the center becomes `parameters`.
    ///
    /// # Panics
    /// If `parameters` is not as long as the anchor.
    pub fn consolidate_at(&mut self, parameters: &[f32]) {
        self.check(parameters.len());
        *self.tasks = self.tasks.saturating_add(1);
        self.center.copy_from_slice(parameters);
    }

    /// Moves the center by `gradient` / tasks, as [`Anchor::newton_step`](super::Anchor::newton_step); nowhere before the first
    /// task.
    ///
    /// # Panics
    /// If `gradient` is not as long as the anchor.
    pub fn newton_step(&mut self, gradient: &[f32]) {
        self.check(gradient.len());
        let tasks = self.importance();
        for (center, gradient) in self.center.iter_mut().zip(gradient) {
            *center = shifted(*center, gradient / tasks);
        }
    }

    /// Moves every parameter the same [`proximal_share`] of the way to its center, at `rate` = learning rate × strength.
    ///
    /// # Panics
    /// If `parameters` is not as long as the anchor.
    pub fn proximal_step(&self, parameters: &mut [f32], rate: f32) {
        self.check(parameters.len());
        let share = proximal_share(self.importance(), rate);
        for (parameter, center) in parameters.iter_mut().zip(&*self.center) {
            *parameter += share * (center - *parameter);
        }
    }

    /// Adds the gradient of `½ strength · tasks · |θ − c|²` at `parameters` to that of a loss.
    ///
    /// # Panics
    /// If a slice is not as long as the anchor.
    pub fn add_penalty_gradient(&self, parameters: &[f32], strength: f32, gradient: &mut [f32]) {
        self.check(parameters.len());
        self.check(gradient.len());
        let stiffness = strength * self.importance();
        for ((gradient, parameter), center) in gradient.iter_mut().zip(parameters).zip(&*self.center) {
            *gradient += stiffness * (parameter - center);
        }
    }

    /// S, the same for every parameter.
    fn importance(&self) -> f32 {
        *self.tasks as f32
    }

    fn check(&self, length: usize) {
        assert_eq!(length, self.center.len(), "one value per parameter of the anchor");
    }
}
