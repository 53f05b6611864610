//! Kestrel's trainer: from an experiment file to a flown policy.
//!
//! Read in the order of the data: an [`experiment_config`] becomes a [`training_run`] in a [`run_directory`]: a
//! [`rollout`] of the [`actor_critic`], which a [`teacher`] may comment, its [`advantage`]s, the update of [`ppo`]; then an
//! [`evaluation`], the [`export`] and the pictures of the [`results`]. A [`study`] is many trainings and a [`search`] many
//! studies. [`fly`] puts an exported policy behind MAVLink, and [`mod@bench`] measures every stage.

pub mod actor_critic;
pub mod adam;
pub mod advantage;
pub mod animation;
pub mod atomic_file;
pub mod aviary_generator;
pub mod bench;
pub mod bridge;
pub mod checkpoint;
pub mod consolidation;
pub mod curve;
pub mod drawing;
pub mod evaluation;
pub mod experiment_config;
pub mod export;
pub mod film;
pub mod fly;
pub mod free_route;
pub mod gaussian;
#[cfg(test)]
pub(crate) mod golden;
pub mod inspection;
pub mod interrupt;
pub mod network;
pub mod obstruction;
pub mod output;
mod perception;
pub mod picture;
pub mod plan;
pub mod policy;
pub mod ppo;
pub mod processor;
pub mod progress;
mod quantisation;
pub mod ranks;
pub mod recording;
pub mod results;
pub mod rollout;
pub mod run_directory;
pub mod schedule;
pub mod scripted;
pub mod sealed_file;
pub mod search;
pub mod statistics;
pub mod study;
pub mod teacher;
pub mod tensorboard;
pub mod training_run;
pub mod verify;
pub mod viewer;
