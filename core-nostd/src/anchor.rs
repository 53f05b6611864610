//! The quadratic regulariser of continual learning (elastic weight consolidation and its relatives): what a policy
//! keeps of its earlier tasks in constant memory, a center and an importance for every parameter.
//!
//! A task that ended at parameters θₗ leaves a quadratic behind, `gₗᵀ(θ − θₗ) − ½ (θ − θₗ)ᵀ Hₗ (θ − θₗ)`: the gradient
//! of its objective there (ascent) and a diagonal curvature Hₗ ≥ 0, for instance the Fisher information of the policy.
//! However many there are, their sum is one quadratic `−½ (θ − c)ᵀ S (θ − c)` (and a constant), so this is exact:
//!
//! ```text
//! S' = decay · S + H       c' = c + H / S' · (θ − c) + g / S'       consolidate, newton_step
//! θ' = θ + κ (c − θ)       κ = rate · S / (1 + rate · S)            proximal_step, after each step of the optimiser
//! ```
//!
//! It is the posterior of a Kalman filter with the gain `H / S'`, and online elastic weight consolidation (Schwarz et
//! al. 2018) where each task was trained with the penalty until `g = S (θ − c)`: then `c' = θ`, which is
//! [`consolidate_at`](Anchor::consolidate_at). Without `g` it is the original one (Kirkpatrick et al. 2017), which
//! counts earlier tasks twice (Huszár 2018). The proximal step of the quadratic is stable at any rate.
//!
//! [`Anchor`] holds 8 bytes per parameter, [`MeanAnchor`] 4 where the curvature is the identity, and
//! [`fixed::FixedAnchor`] 3, in integers. The caller owns the memory; trainer and firmware call the same functions.

pub mod fixed;
mod mean;

pub use mean::MeanAnchor;

use crate::real::Real;

/// Greatest `rate · S`; beyond 2²³ the share would round to one.
const ODDS_LIMIT: f32 = (1_u32 << 23) as f32;

/// Parameters whose squares are summed before the sums are, which keeps the rounding of long sums small.
const SUM_BLOCK: usize = 256;

/// The anchor with a diagonal curvature.
#[derive(Debug)]
pub struct Anchor<'a> {
    /// What each parameter is regularised towards, `[parameters]`.
    pub center: &'a mut [f32],
    /// S, the regularisation strength of each, `[parameters]`, finite and at least 0; all zero before the first task.
    pub importance: &'a mut [f32],
}

impl Anchor<'_> {
    /// Memory of the anchor, for any number of tasks.
    pub const BYTES_PER_PARAMETER: usize = 2 * size_of::<f32>();

    /// Takes in a task that ended at `parameters` with the diagonal `curvature` H ≥ 0 of its objective there, after
    /// the importance of earlier tasks has faded by `decay` in \[0, 1\].
    ///
    /// The center becomes the mean of all tasks' ends, weighted by their curvature; that of a parameter which no task
    /// needs stays. With the task's gradient, [`newton_step`](Self::newton_step) next.
    ///
    /// # Panics
    /// If a slice is not as long as the anchor.
    #[inline(always)]
    pub fn consolidate(&mut self, parameters: &[f32], curvature: &[f32], decay: f32) {
        self.check(parameters.len());
        self.check(curvature.len());
        let state = self.center.iter_mut().zip(self.importance.iter_mut());
        for ((center, importance), (parameter, curvature)) in state.zip(parameters.iter().zip(curvature)) {
            *importance = accumulated(*importance, *curvature, decay);
            let gain = if *importance > 0.0 { curvature / *importance } else { 0.0 };
            *center += gain * (parameter - *center);
        }
    }

    /// As [`consolidate`](Self::consolidate), but the center becomes `parameters`: what [`newton_step`](Self::newton_step) would
    /// make of it with the gradient of a task that was trained to its end with this penalty.
    ///
    /// # Panics
    /// If a slice is not as long as the anchor.
    pub fn consolidate_at(&mut self, parameters: &[f32], curvature: &[f32], decay: f32) {
        self.check(parameters.len());
        self.check(curvature.len());
        self.center.copy_from_slice(parameters);
        for (importance, curvature) in self.importance.iter_mut().zip(curvature) {
            *importance = accumulated(*importance, *curvature, decay);
        }
    }

    /// Moves the center by `gradient / S`: what the ascent gradient of the objective of the task consolidated last,
    /// at its end, says about where its optimum lies.
    ///
    /// A center that has no importance, or too little for the step to be finite, stays. Curvature that is damped
    /// (some ε added to H) bounds the step.
    ///
    /// # Panics
    /// If `gradient` is not as long as the anchor.
    pub fn newton_step(&mut self, gradient: &[f32]) {
        self.check(gradient.len());
        for ((center, importance), gradient) in self.center.iter_mut().zip(&*self.importance).zip(gradient) {
            *center = shifted(*center, gradient / importance);
        }
    }

    /// Moves each parameter its [`proximal_share`] of the way to its center: the implicit step of the quadratic, at
    /// `rate` = learning rate × strength, finite and at least 0.
    ///
    /// # Panics
    /// If `parameters` is not as long as the anchor.
    #[inline(always)]
    pub fn proximal_step(&self, parameters: &mut [f32], rate: f32) {
        self.check(parameters.len());
        for ((parameter, center), importance) in parameters.iter_mut().zip(&*self.center).zip(&*self.importance) {
            *parameter += proximal_share(*importance, rate) * (center - *parameter);
        }
    }

    /// Adds the penalty gradient, that of `½ strength (θ − c)ᵀ S (θ − c)` at `parameters` to that of a loss.
    ///
    /// # Panics
    /// If a slice is not as long as the anchor.
    pub fn add_penalty_gradient(&self, parameters: &[f32], strength: f32, gradient: &mut [f32]) {
        self.check(parameters.len());
        self.check(gradient.len());
        let state = self.center.iter().zip(&*self.importance);
        for ((gradient, parameter), (center, importance)) in gradient.iter_mut().zip(parameters).zip(state) {
            *gradient += strength * importance * (parameter - center);
        }
    }

    /// `½ (θ − c)ᵀ S (θ − c)`: where S is a sum of Fisher informations, the divergence \[nat\] from the behaviour at
    /// the center, per step and summed over the tasks, to second order.
    ///
    /// # Panics
    /// If `parameters` is not as long as the anchor.
    pub fn divergence(&self, parameters: &[f32]) -> f32 {
        self.check(parameters.len());
        let state = self.center.chunks(SUM_BLOCK).zip(self.importance.chunks(SUM_BLOCK));
        let blocks = state.zip(parameters.chunks(SUM_BLOCK));
        0.5 * blocks
            .map(|((center, importance), parameters)| weighted(center, importance, parameters))
            .sum::<f32>()
    }

    // Inlined with its callers, so that where lengths are known a firmware has no panic.
    #[inline(always)]
    fn check(&self, length: usize) {
        assert_eq!(self.center.len(), self.importance.len(), "a center and an importance per parameter");
        assert_eq!(length, self.center.len(), "one value per parameter of the anchor");
    }
}

/// κ = `rate · importance / (1 + rate · importance)` in \[0, 1): the share of the way to the center that a
/// [`proximal_step`](Anchor::proximal_step) goes. Both are finite and at least 0.
#[inline(always)]
pub fn proximal_share(importance: f32, rate: f32) -> f32 {
    let odds = (rate * importance).at_most(ODDS_LIMIT);
    odds / (1.0 + odds)
}

/// Limited to what is finite, so that no sum of tasks makes a center that is not a number.
#[inline(always)]
fn accumulated(importance: f32, curvature: f32, decay: f32) -> f32 {
    (decay * importance + curvature).at_most(f32::MAX)
}

#[inline(always)]
fn shifted(center: f32, step: f32) -> f32 {
    let shifted = center + step;
    if shifted.is_finite() { shifted } else { center }
}

/// `(θ − c)ᵀ S (θ − c)` of one block.
fn weighted(center: &[f32], importance: &[f32], parameters: &[f32]) -> f32 {
    let state = center.iter().zip(importance);
    state.zip(parameters).map(|((center, importance), parameter)| squared(parameter - center) * importance).sum()
}

#[inline(always)]
fn squared(value: f32) -> f32 {
    value * value
}
