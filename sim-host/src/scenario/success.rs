//! What counts as success.

use crate::world::Cuboid;

/// What counts as success.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Success {
    /// Within the radius of the goal from the given time to the end of the episode without leaving it.
    Settle {
        /// \[m\].
        radius_m: f32,
        /// \[s\].
        within_secs: f32,
    },
    /// Inside the region and slower than the limit; ends the episode.
    Reach {
        /// Where the centre of mass must be.
        region: Cuboid,
        /// \[m/s\].
        speed_limit: f32,
    },
    /// Inside the region for so many control periods of an episode that does not end in failure.
    Visit {
        /// Where the centre of mass must be.
        region: Cuboid,
        /// At least one.
        periods: u32,
    },
    /// A termination that is a success ended the episode (landing, coverage, arrival).
    Ending,
}
