//! How a step or an episode ends.

pub use kestrel_core::outcome::Outcome;
use serde::{Deserialize, Serialize};

/// Why an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Ending {
    /// The goal region was reached.
    Success,
    /// The hull touched something.
    Collision,
    /// The drone left the bounds, or its state was no longer finite.
    OutOfBounds,
    /// It tilted beyond the limit.
    Tilt,
    /// It was too far from the goal.
    Distance,
    /// It stayed away from its station until its fuel was gone.
    OutOfFuel,
    /// The rule of the reference that counts its own calls had counted enough.
    Overdue,
    /// Another drone of the team ended the episode for all.
    Teammate,
    /// The episode's time was over.
    TimeLimit,
    /// The drone broke another of the task's limits.
    Limit,
}

impl Ending {
    /// As in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Success => "goal reached",
            Self::Collision => "collision",
            Self::OutOfBounds => "out of bounds",
            Self::Tilt => "tilt",
            Self::Distance => "too far",
            Self::OutOfFuel => "out of fuel",
            Self::Overdue => "overdue",
            Self::Teammate => "teammate ended",
            Self::TimeLimit => "time limit",
            Self::Limit => "beyond a limit",
        }
    }

    /// What the ending usually means for the value of the future.
    pub const fn outcome(self) -> Outcome {
        match self {
            Self::TimeLimit => Outcome::Truncated,
            Self::Success
            | Self::Collision
            | Self::OutOfBounds
            | Self::Tilt
            | Self::Distance
            | Self::OutOfFuel
            | Self::Overdue
            | Self::Limit
            | Self::Teammate => Outcome::Terminated,
        }
    }

    /// Whether the drone was lost.
    pub const fn is_failure(self) -> bool {
        match self {
            Self::Success | Self::Teammate | Self::TimeLimit => false,
            Self::Collision
            | Self::OutOfBounds
            | Self::Tilt
            | Self::Distance
            | Self::OutOfFuel
            | Self::Overdue
            | Self::Limit => true,
        }
    }
}

/// An episode that ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// Index of the environment.
    pub environment: u32,
    /// Index of the drone in its environment.
    pub agent: u32,
    /// Control periods flown.
    pub steps: u32,
    /// Undiscounted return.
    pub total_reward: f32,
    /// Whether it was a success by the scenario's rule.
    pub success: bool,
    /// Why it ended.
    pub ending: Ending,
    /// Undiscounted return of each weighted reward term, in the scenario's order.
    pub terms: Vec<f32>,
}
