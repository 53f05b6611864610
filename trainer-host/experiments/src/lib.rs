//! Experiments: from a file to a trained policy, and from many of them to a report.
//!
//! Read in the order of the data: an [`experiment_config`] becomes a [`training_run`] in a [`run_directory`], then an
//! [`evaluation`] and the files of the [`results`]. A [`study`] is many trainings and a [`search`] many studies.

pub mod atomic_file;
pub mod aviary_files;
pub mod aviary_generator;
pub mod checkpoint;
pub(crate) mod config_file;
pub mod diagnosis;
mod drawn_worlds;
pub mod drone_environment;
pub mod evaluation;
pub mod experiment_config;
pub mod foreign_actor;
#[cfg(test)]
pub(crate) mod golden;
pub mod interrupt;
mod known_way;
pub mod learner;
pub mod multi_task_run;
pub mod obstruction;
pub mod output;
pub mod progress;
pub mod recording;
pub mod results;
pub mod run_config;
pub mod run_directory;
pub(crate) mod run_log;
pub mod run_summary;
pub mod scripted;
pub mod sealed_file;
pub mod search;
pub mod statistics;
pub mod stock;
pub mod study;
pub mod teacher;
pub mod tensorboard;
pub mod training_run;
pub mod watch;
