//! The learner: networks, PPO, and regularisers of continual learning.
//!
//! Read in the order of the data: a [`rollout`] of the [`actor_critic`], which a [`teacher`] may comment, its [`advantage`]s,
//! the update of [`ppo`] by [`adam`], and what a [`consolidation`] keeps of it.

pub mod actor_critic;
pub mod adam;
pub mod advantage;
pub mod consolidation;
pub mod gaussian;
pub mod network;
mod perception;
pub mod ppo;
mod quantisation;
pub mod ranks;
pub mod rollout;
pub mod schedule;
pub mod scripted;
pub mod teacher;
