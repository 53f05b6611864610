//! Statistics of repeated runs: robust averages, intervals, comparisons and times until an event.
//!
//! The unit of chance is a seed. A [`Sample`](sample::Sample) remembers which seed each of its values came from, the
//! [`bootstrap`] draws whole seeds, and every statistic is a function of how often each seed was drawn. So values of one
//! seed stay together, and a difference of two methods is paired when both flew the same seeds.
//!
//! Sources: Agarwal et al. 2021, *Deep reinforcement learning at the edge of the statistical precipice* (interquartile
//! mean, stratified bootstrap, performance profile, probability of improvement, optimality gap); Kaplan and Meier 1958.

pub mod bootstrap;
pub mod comparison;
pub mod correction;
pub mod proportion;
pub mod sample;
pub mod survival;
