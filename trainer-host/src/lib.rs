//! Kestrel's trainer.

pub mod animation;
pub mod atomic_file;
pub mod checkpoint;
pub mod curve;
pub mod interrupt;
pub mod progress;
pub mod run_directory;
pub mod tensorboard;
