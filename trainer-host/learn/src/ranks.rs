//! Processes that work on one run together, on one machine or on several.
//!
//! Each has the whole state of the run and comes to the same bits. What is costly is shared: every rank flies its part of
//! the environment batches and differentiates its part of every minibatch, then all ranks show each other what they
//! have. Sums are added up in the order in which one process alone adds them, so that the number of ranks changes
//! nothing. Rank 0 owns the files and decides what is done next; the others follow its orders.

pub mod threads;

use std::fmt::Debug;
use std::ops::Range;
use std::sync::Arc;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// The processes that work on a run, seen from one of them.
pub trait Ranks: Debug + Send + Sync {
    /// Which of them this is, from 0.
    fn rank(&self) -> usize;

    /// How many there are.
    fn size(&self) -> usize;

    /// Everybody's part of `all`, in which each rank in turn has one of the same length; mine is in its place.
    fn share(&self, all: &mut [f32]);

    /// What everybody has to say, in the order of the ranks.
    fn gather(&self, mine: &[u8]) -> Vec<Vec<u8>>;
}

/// One process.
#[derive(Clone, Copy, Debug)]
struct Alone;

impl Ranks for Alone {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn share(&self, _all: &mut [f32]) {}

    fn gather(&self, mine: &[u8]) -> Vec<Vec<u8>> {
        vec![mine.to_vec()]
    }
}

/// One process that works alone.
pub fn alone() -> Arc<dyn Ranks> {
    Arc::new(Alone)
}

/// What rank 0 tells all others to do next.
#[derive(Debug, Serialize, Deserialize)]
pub enum Order<S> {
    /// To begin with a state.
    Begin(Box<S>),
    /// One update.
    Update,
    /// To show what only they know of the state.
    Save,
    /// To leave.
    End,
}

/// Parts that cannot be dealt to so many ranks.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{ranks} ranks cannot share {parts} {what} equally: use as many as divide them")]
pub struct UnequalShares {
    ranks: usize,
    parts: usize,
    what: &'static str,
}

/// Rank 0 lets all others leave; of no effect elsewhere.
pub fn end(ranks: &Arc<dyn Ranks>) {
    if ranks.rank() == 0 {
        order::<()>(ranks, &Order::End);
    }
}

/// Rank 0 says what is done next; the others do not call this.
pub fn order<S: Serialize>(ranks: &Arc<dyn Ranks>, order: &Order<S>) {
    if ranks.size() > 1 {
        ranks.gather(&encoded(order));
    }
}

/// What rank 0 has said; rank 0 does not call this.
pub fn hear<S: DeserializeOwned>(ranks: &Arc<dyn Ranks>) -> Order<S> {
    decoded(&ranks.gather(&[])[0])
}

/// What everybody has, in the order of the ranks.
pub(crate) fn gathered<T: Serialize + DeserializeOwned>(ranks: &Arc<dyn Ranks>, mine: &T) -> Vec<T> {
    ranks.gather(&encoded(mine)).iter().map(|bytes| decoded(bytes)).collect()
}

/// My part of so many things.
pub(crate) fn part(ranks: &Arc<dyn Ranks>, count: usize) -> Range<usize> {
    let each = count / ranks.size();
    ranks.rank() * each..(ranks.rank() + 1) * each
}

/// Whether every rank has as many.
pub(crate) fn check(ranks: &Arc<dyn Ranks>, parts: usize, what: &'static str) -> Result<(), UnequalShares> {
    let size = ranks.size();
    if parts.is_multiple_of(size) { Ok(()) } else { Err(UnequalShares { ranks: size, parts, what }) }
}

fn encoded<T: Serialize>(value: &T) -> Vec<u8> {
    postcard::to_allocvec(value).expect("memory is the only limit")
}

fn decoded<T: DeserializeOwned>(bytes: &[u8]) -> T {
    postcard::from_bytes(bytes).expect("all ranks are the same program")
}
