//! Studies: many runs of several methods, compared with each other.
//!
//! A study is a directory. Each finished job leaves the [`rows`] of its flights there; [`data`] loads what is there, and
//! the [`report`] says what it means.

pub mod data;
pub mod report;
pub mod rows;
