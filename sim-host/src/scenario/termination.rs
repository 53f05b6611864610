//! What ends an episode, and what counts as success.

use nalgebra::Vector3;

use super::{Area, Field};
use crate::world::Cuboid;

/// A rule and what it means when it ends an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct EndRule {
    /// The rule.
    pub rule: Termination,
    /// Whether the end is a cut-off from which the future is still estimated, rather than a terminal state.
    pub truncates: bool,
}

/// What ends an episode before its time.
#[derive(Clone, Debug, PartialEq)]
pub enum Termination {
    /// The drone touches an obstacle, the floor or another drone, unless it is inside the area.
    Collision {
        /// Where touching is allowed.
        allowed: Option<Area>,
    },
    /// The centre of mass leaves the box.
    OutOfBounds(Cuboid),
    /// The tilt exceeds the limit.
    Tilt {
        /// \[rad\].
        limit: f32,
    },
    /// Roll or pitch reaches the limit (the reference's `OrientationTerm` with 1 rad).
    RollPitch {
        /// \[rad\], below π/2.
        limit: f64,
    },
    /// The drone is farther from the goal than the limit.
    Distance {
        /// \[m\].
        limit_m: f32,
    },
    /// The drone touches what it should land on: success.
    Landing,
    /// Every cell of the field has been visited: success.
    Coverage(Field),
    /// The goal has not been visited for this many control periods (the reference's `FieldCoverageTerm`, whose
    /// interval counts control periods as if they were physics steps).
    Fuel {
        /// Control periods that a full tank lasts.
        periods: u32,
        /// Where it is refilled \[m, world\].
        station: Vector3<f64>,
    },
    /// The reference's `EnterAreaTerm`, which counts its own calls instead of looking: true from the eleventh on.
    EleventhStep,
    /// Position within the box and nearly no roll: the maze's exit as published (success).
    ///
    /// The reference compares the fourth number of its state, the quaternion's x, with zero.
    LevelWithin {
        /// Where.
        region: Cuboid,
        /// Greatest magnitude of the quaternion's x.
        roll_limit: f64,
    },
    /// Inside the area: success.
    EnterArea(Area),
    /// Near the goal and slow for this many control periods: success.
    Hold {
        /// \[m\].
        radius_m: f32,
        /// \[m/s\].
        speed_limit: f32,
        /// In all, not in a row.
        periods: u32,
    },
    /// At rest on what it should land on: touching it, slow and upright for this many control periods in a row: success.
    Rest {
        /// \[m/s\].
        speed_limit: f32,
        /// \[rad\].
        tilt_limit: f32,
        /// Without a break.
        periods: u32,
    },
    /// Nearer to the goal than this: success.
    Arrival {
        /// \[m\].
        radius_m: f32,
    },
}

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

impl EndRule {
    /// A rule whose end is terminal.
    pub const fn terminal(rule: Termination) -> Self {
        Self { rule, truncates: false }
    }
}

impl Termination {
    /// Touching anything is a collision.
    pub const COLLISION: Self = Self::Collision { allowed: None };

    /// Whether it ends an episode in success.
    pub const fn is_success(&self) -> bool {
        match self {
            Self::Landing
            | Self::Coverage(_)
            | Self::LevelWithin { .. }
            | Self::EnterArea(_)
            | Self::Hold { .. }
            | Self::Rest { .. }
            | Self::Arrival { .. } => true,
            Self::Collision { .. }
            | Self::OutOfBounds(_)
            | Self::Tilt { .. }
            | Self::RollPitch { .. }
            | Self::Distance { .. }
            | Self::Fuel { .. }
            | Self::EleventhStep => false,
        }
    }
}
