//! Studies: many runs of several methods, compared with each other.
//!
//! A study is a directory. Each finished job leaves the [`rows`] of its flights there; [`data`] loads what is there, and
//! the [`report`] says what it means.
//!
//! ```text
//! study.json                     what was to be run: tasks, orders, methods, seeds, baselines
//! rows/METHOD/ORDER-SEED.csv     every test flight of a job, after each of its stages
//! curves/METHOD/ORDER-SEED.csv   success while it trained
//! report.md, report/*.svg        what it means
//! ```

pub mod data;
pub mod report;
pub mod rows;
