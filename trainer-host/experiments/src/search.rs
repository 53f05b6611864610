//! A search for settings: trials, each a study of its own with the settings that a sampler proposes.
//!
//! [`config`] reads the file, a [`sampler`] proposes a point of the [`space`], the [`runner`] lets trials learn,
//! [`halving`] gives more seeds to the better ones, the [`objective`] judges them, and the [`log`] is what the
//! [`report`] reads. Everything follows from the file: threads and interruptions leave no trace.

pub mod config;
pub mod halving;
pub mod log;
pub mod objective;
pub mod parzen;
pub mod report;
pub mod runner;
pub mod sampler;
pub mod space;

use kestrel_sim::config::Document;
use kestrel_sim::seed::Seed;

use objective::Objective;
use sampler::Algorithm;
use space::Dimension;

/// A search, checked.
#[derive(Clone, Debug)]
pub struct Search {
    /// Name for people and paths.
    pub name: String,
    /// What it asks.
    pub about: String,
    /// What is varied.
    pub space: Vec<Dimension>,
    /// How many points are tried.
    pub trials: usize,
    /// How many are proposed at a time, before any of them is judged.
    pub batch: usize,
    /// How points are proposed.
    pub algorithm: Algorithm,
    /// What the proposals' randomness follows from.
    pub seed: Seed,
    /// Seeds of training after each rung, rising.
    pub rungs: Vec<u64>,
    /// Share of trials that go on from a rung to the next, in (0, 1\].
    pub keep: f64,
    /// The first seed of training.
    pub first_seed: u64,
    /// What is to be as great as possible.
    pub objective: Objective,
    /// The search as YAML with every import resolved and every default filled in.
    pub resolved_yaml: String,
    /// The file, into which the values of trials are written.
    document: Document,
}

/// One point that was tried.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Counted from 0.
    pub number: usize,
    /// Its place in each dimension, as [`Dimension::place`] gives it.
    pub point: Vec<f64>,
    /// How many rungs it has climbed.
    pub rungs: usize,
    /// Seeds with which it was trained.
    pub seeds: u64,
    /// What it came to on them, finite.
    pub objective: f64,
}

impl Trial {
    /// The better of two comes first: who climbed higher was better than all that stayed behind; among equals the
    /// earlier.
    pub fn by_rank(&self, other: &Self) -> std::cmp::Ordering {
        let value = (other.rungs.cmp(&self.rungs)).then(other.objective.total_cmp(&self.objective));
        value.then(self.number.cmp(&other.number))
    }
}
