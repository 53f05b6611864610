//! What a step means for the future.

use serde::{Deserialize, Serialize};

/// What a step means for the value of the future.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Outcome {
    /// The episode goes on.
    Running,
    /// The task ended it, in success or failure: nothing follows.
    Terminated,
    /// The clock ended it: the future still has worth.
    Truncated,
}
