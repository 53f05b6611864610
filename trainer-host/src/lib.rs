//! Kestrel's trainer.

pub mod actor_critic;
pub mod adam;
pub mod advantage;
pub mod animation;
pub mod atomic_file;
pub mod checkpoint;
pub mod curve;
pub mod gaussian;
pub mod interrupt;
pub mod network;
pub mod ppo;
pub mod progress;
pub mod rollout;
pub mod run_directory;
pub mod schedule;
pub mod tensorboard;
