//! What is wrong with a log or with what was asked of it: where, what was found, what was expected.

use std::fmt::Display;

/// Flights from which nothing can be identified.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: found {found}, expected {expected}")]
pub struct LogError {
    place: String,
    found: String,
    expected: String,
}

impl LogError {
    /// About a place in words, such as `flight.csv:12`.
    pub fn at(place: impl Display, found: impl Display, expected: impl Display) -> Self {
        Self { place: place.to_string(), found: found.to_string(), expected: expected.to_string() }
    }
}
