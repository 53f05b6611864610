//! Placeholder.
pub mod actor_critic;
pub mod adam;
pub mod advantage;
pub mod fly;
pub mod gaussian;
pub mod network;
pub mod ppo;
pub mod rollout;
pub mod schedule;
