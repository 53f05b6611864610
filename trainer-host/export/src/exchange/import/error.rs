//! Why a network is not imported.

use std::fmt::Display;
use std::io;

use thiserror::Error;

/// Why a network cannot become a policy.
#[derive(Debug, Error)]
pub enum ImportError {
    /// The system refused to read the file.
    #[error("cannot be read")]
    Read(#[from] io::Error),
    /// Something in it is not what a policy can hold.
    #[error("{place}found {found}, expected {expected}")]
    Refused {
        /// Where: `tensor NAME: `, `node NAME: `, or nothing where it is the whole file.
        place: String,
        /// What is there.
        found: String,
        /// What can be there.
        expected: String,
    },
}

impl ImportError {
    pub(super) fn file(found: impl Display, expected: impl Display) -> Self {
        Self::Refused { place: String::new(), found: found.to_string(), expected: expected.to_string() }
    }

    pub(super) fn tensor(name: &str, found: impl Display, expected: impl Display) -> Self {
        let place = format!("tensor {name}: ");
        Self::Refused { place, found: found.to_string(), expected: expected.to_string() }
    }

    pub(super) fn node(name: &str, found: impl Display, expected: impl Display) -> Self {
        let place = format!("node {name}: ");
        Self::Refused { place, found: found.to_string(), expected: expected.to_string() }
    }

    pub(super) fn behind(place: &str, found: impl Display, expected: impl Display) -> Self {
        let place = format!("behind {place}: ");
        Self::Refused { place, found: found.to_string(), expected: expected.to_string() }
    }
}
