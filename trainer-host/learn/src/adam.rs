//! The Adam optimiser.

use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::network::{PIECE, dispatch};

/// Decay of the mean gradient (Kingma and Ba 2015).
const FIRST_DECAY: f32 = 0.9;
/// Decay of the mean squared gradient (Kingma and Ba 2015).
const SECOND_DECAY: f32 = 0.999;
/// The same for gradients that are nearly exact: a hundred steps are remembered, not a thousand.
const SHORT_SECOND_DECAY: f32 = 0.99;
/// Added to the root, as in `CleanRL` and Stable-Baselines3: large enough to keep rare gradients from exploding.
const EPSILON: f32 = 1e-5;
/// The paper's own, for gradients without noise, however small they are.
const SMALL_EPSILON: f32 = 1e-8;

/// Adam with bias correction (Kingma and Ba 2015, algorithm 1) for one slice of parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Adam {
    first: Vec<f32>,
    second: Vec<f32>,
    steps: u32,
}

/// How long Adam remembers the size of gradients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Remembering {
    /// A thousand steps, as everywhere.
    Long,
    /// A hundred.
    Short,
}

impl Adam {
    /// For `parameters` values.
    pub fn new(parameters: usize) -> Self {
        Self { first: vec![0.0; parameters], second: vec![0.0; parameters], steps: 0 }
    }

    /// The mean of several states of the same age and size; the steps of the first.
    ///
    /// # Panics
    /// When there is none, or sizes differ.
    pub fn mean(states: &[Self]) -> Self {
        let mean = |moment: fn(&Self) -> &Vec<f32>| {
            let mut sum = vec![0.0; states[0].first.len()];
            for state in states {
                assert_eq!(moment(state).len(), sum.len(), "optimisers of one shape have a mean");
                for (sum, value) in sum.iter_mut().zip(moment(state)) {
                    *sum += value / states.len() as f32;
                }
            }
            sum
        };
        Self { first: mean(|state| &state.first), second: mean(|state| &state.second), steps: states[0].steps }
    }

    /// Number of values it optimises; zero when its own state is inconsistent.
    pub fn parameter_count(&self) -> usize {
        if self.first.len() == self.second.len() { self.first.len() } else { 0 }
    }

    /// One descent step along `gradient * gradient_scale`.
    ///
    /// # Panics
    /// When the slices are not as long as the optimiser's state.
    pub fn step(&mut self, parameters: &mut [f32], gradient: &[f32], gradient_scale: f32, learning_rate: f32) {
        self.step_remembering(Remembering::Long, parameters, (gradient, gradient_scale), learning_rate);
    }

    /// As [`Self::step`], along a gradient times a scale.
    pub(crate) fn step_remembering(
        &mut self,
        remembering: Remembering,
        parameters: &mut [f32],
        (gradient, gradient_scale): (&[f32], f32),
        learning_rate: f32,
    ) {
        let (second_decay, smallest) = match remembering {
            Remembering::Long => (SECOND_DECAY, EPSILON),
            Remembering::Short => (SHORT_SECOND_DECAY, SMALL_EPSILON),
        };
        assert!(parameters.len() == self.first.len() && gradient.len() == self.first.len(), "one slice, one Adam");
        self.steps += 1;
        let correction = |decay: f32| 1.0 - libm::pow(f64::from(decay), f64::from(self.steps));
        let second_correction = correction(second_decay).sqrt();
        // The corrections of both moments moved into the step size and the epsilon (ibid., section 2).
        let step_size = (f64::from(learning_rate) * second_correction / correction(FIRST_DECAY)) as f32;
        let epsilon = (f64::from(smallest) * second_correction) as f32;
        let moments = self.first.par_chunks_mut(PIECE).zip(self.second.par_chunks_mut(PIECE));
        let pieces = parameters.par_chunks_mut(PIECE).zip(gradient.par_chunks(PIECE)).zip(moments);
        pieces.for_each(|((parameters, gradient), (first, second))| {
            let slices = Moments { first, second, second_decay };
            dispatch(Descend { parameters, gradient, slices, gradient_scale, step_size, epsilon });
        });
    }
}

struct Moments<'a> {
    first: &'a mut [f32],
    second: &'a mut [f32],
    second_decay: f32,
}

struct Descend<'a> {
    parameters: &'a mut [f32],
    gradient: &'a [f32],
    slices: Moments<'a>,
    gradient_scale: f32,
    step_size: f32,
    epsilon: f32,
}

impl WithSimd for Descend<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Moments { first, second, second_decay } = self.slices;
        let moments = first.iter_mut().zip(second);
        for ((parameter, gradient), (first, second)) in self.parameters.iter_mut().zip(self.gradient).zip(moments)
        {
            let gradient = gradient * self.gradient_scale;
            *first = FIRST_DECAY * *first + (1.0 - FIRST_DECAY) * gradient;
            *second = second_decay * *second + (1.0 - second_decay) * gradient * gradient;
            *parameter -= self.step_size * *first / (second.sqrt() + self.epsilon);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_is_the_learning_rate_against_the_sign() {
        let mut parameters = [1.0, -2.0, 3.0];
        Adam::new(3).step(&mut parameters, &[10.0, -0.1, 0.0], 1.0, 0.01);
        assert!((parameters[0] - 0.99).abs() < 1e-6);
        assert!((parameters[1] + 1.99).abs() < 2e-6);
        assert_eq!(parameters[2], 3.0);
    }

    #[test]
    fn many_steps_follow_the_closed_form_in_f64() {
        let gradient = |step: u32, index: usize| libm::sin(f64::from(step) * (index as f64 + 0.3));
        let mut parameters = [0.5_f32; 20];
        let mut adam = Adam::new(20);
        for step in 0..100 {
            let gradients: Vec<f32> = (0..20).map(|index| gradient(step, index) as f32).collect();
            adam.step(&mut parameters, &gradients, 0.5, 1e-2);
        }
        for (index, parameter) in parameters.iter().enumerate() {
            let expected = reference(|step| 0.5 * gradient(step, index), 100, 0.5, 1e-2);
            assert!((f64::from(*parameter) - expected).abs() < 2e-5, "{parameter} {expected}");
        }
    }

    #[test]
    fn a_large_network_takes_the_steps_of_its_parts() {
        let count = 2 * PIECE + 7;
        let gradient: Vec<f32> = (0..count).map(|index| libm::sinf(index as f32)).collect();
        let mut parameters = vec![0.5; count];
        Adam::new(count).step(&mut parameters, &gradient, 0.5, 1e-2);
        for (parameter, gradient) in parameters.iter().zip(&gradient) {
            let mut alone = [0.5];
            Adam::new(1).step(&mut alone, &[*gradient], 0.5, 1e-2);
            assert_eq!(*parameter, alone[0]);
        }
    }

    /// Algorithm 1 of the paper, line by line.
    fn reference(gradient: impl Fn(u32) -> f64, steps: u32, start: f64, learning_rate: f64) -> f64 {
        let (first_decay, second_decay, epsilon) = (0.9, 0.999, 1e-5);
        let (mut parameter, mut first, mut second) = (start, 0.0, 0.0);
        for step in 0..steps {
            let gradient = gradient(step);
            first = first_decay * first + (1.0 - first_decay) * gradient;
            second = second_decay * second + (1.0 - second_decay) * gradient * gradient;
            let power = f64::from(step + 1);
            let corrected_first = first / (1.0 - libm::pow(first_decay, power));
            let corrected_second = second / (1.0 - libm::pow(second_decay, power));
            parameter -= learning_rate * corrected_first / (corrected_second.sqrt() + epsilon);
        }
        parameter
    }
}
