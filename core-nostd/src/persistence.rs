//! How long the controller behind an action space remembers.

use serde::{Deserialize, Serialize};

/// How long a controller remembers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Persistence {
    /// Until the episode ends: what the reference meant.
    #[default]
    ResetEachEpisode,
    /// For ever: what the reference does.
    Persist,
}
