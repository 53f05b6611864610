//! What can be rewarded.

use std::sync::Arc;

use nalgebra::Vector3;

use crate::contact::DistanceField;
use crate::world::Cuboid;

/// A reward term and its weight.
#[derive(Clone, Debug, PartialEq)]
pub struct WeightedTerm {
    /// What is measured.
    pub term: RewardTerm,
    /// What one unit of it is worth; penalties are negative.
    pub weight: f64,
    /// Which drones it is paid to.
    pub agents: AgentSet,
}

/// Some drones of an environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AgentSet {
    /// All.
    All,
    /// The first, who leads.
    First,
    /// All but the first.
    Others,
}

/// What can be rewarded. Terms are rates, multiplied by the control period, unless they say otherwise.
#[derive(Clone, Debug, PartialEq)]
pub enum RewardTerm {
    /// One.
    Alive,
    /// `1 / (1 + (d / scale)²)` of the distance d to the goal.
    Proximity {
        /// Distance at which it is one half \[m\].
        scale_m: f32,
    },
    /// Distance to the goal \[m\].
    Distance,
    /// Squared speed \[m²/s²\].
    Velocity,
    /// Squared angular velocity \[rad²/s²\].
    BodyRates,
    /// One minus the cosine of the tilt.
    Tilt,
    /// Squared action.
    Action,
    /// Squared change of the action since the last step.
    ActionChange,
    /// Metres closer to the goal in this step (not a rate).
    Progress,
    /// Metres by which the shortest free way to the goal became shorter in this step (not a rate).
    Advance(Arc<DistanceField>),
    /// Potential-based shaping (Ng, Harada & Russell 1999): `discount · Φ(s′) − Φ(s)` with Φ the negative distance to
    /// the goal \[m\] (not a rate). It changes no optimal policy.
    Shaping {
        /// Discount per step of the learner.
        discount: f32,
    },
    /// One, once, when the episode ends in success.
    Success,
    /// One, once, when the episode ends in failure.
    Failure,
    /// One of the reference's, paid every control period.
    Component(Component),
}

/// The reference's reward components and tasks, each as it is published or corrected; see the configuration for
/// which parameters make which. All are paid every control period, whatever that is.
#[derive(Clone, Debug, PartialEq)]
pub enum Component {
    /// −1 outside the box (`BoundsReward`).
    Bounds {
        /// The box, its surface included.
        bounds: Cuboid,
        /// How it grows.
        growth: Growth,
    },
    /// −1 in contact with anything but the landing zone, unless inside the area (`CollisionReward`).
    Collision {
        /// Where touching is free.
        allowed: Option<Area>,
    },
    /// −1 in contact as before, else +1 (`NoCollisionReward`).
    NoCollision {
        /// Where touching is free.
        allowed: Option<Area>,
    },
    /// +1 within the radius of the target or when more than 1 cm nearer than in the step before, else −1; 0 in the
    /// first step (`DeltaDistanceReward`, `DeltaDistanceRewardV2`).
    DeltaDistance {
        /// \[m, world\].
        target: Vector3<f64>,
        /// Which distance.
        span: Span,
        /// \[m\].
        radius: f64,
        /// Least approach in one step \[m\].
        least: f64,
    },
    /// +1 within 9.9 cm of the target or when `delta` nearer than at the last payment (`SafeDeltaDistanceReward`).
    SafeDeltaDistance {
        /// \[m, world\].
        target: Vector3<f64>,
        /// \[m\].
        delta: f64,
    },
    /// `1 − √(d / 5)` (`DistanceReward`, `DistanceRewardV2`).
    DistanceRoot {
        /// \[m, world\].
        target: Vector3<f64>,
        /// Which distance.
        span: Span,
    },
    /// `max(0, 1 − (d / reach)^0.4)` (`SafeDistanceReward`).
    SafeDistance {
        /// \[m, world\].
        target: Vector3<f64>,
        /// Distance from which it is zero \[m\].
        reach: f64,
    },
    /// Within a horizontal distance of the target +1 for not rising, −1 for rising (`DropAltitudeReward`).
    DropAltitude {
        /// \[m, world\].
        target: Vector3<f64>,
        /// \[m\].
        start_distance: f64,
    },
    /// +1 for every cell entered for the first time (`FieldCoverageReward`).
    FieldCoverage(Field),
    /// Above the pad `1 − |z − height|`, and 10 from the tenth step there (`LandingReward`).
    Landing {
        /// Middle of the pad; z is the height that pays most \[m, world\].
        target: Vector3<f64>,
        /// When the steps start anew.
        frames: FrameCount,
    },
    /// Above the pad and level: 1 within a hundredth of the height, less above it (`LandingRewardV2`).
    LandingHeight {
        /// Middle of the pad; z is the height that pays most \[m, world\].
        target: Vector3<f64>,
    },
    /// +1 while roll and pitch are within ±1 rad, else −1 (`OrientationReward`).
    Orientation,
    /// Every so often +1 within 12.5 cm of the target, else −1 (`RebaseReward`).
    Rebase {
        /// \[m, world\].
        target: Vector3<f64>,
        /// Control periods between two judgements.
        periods: u32,
    },
    /// Near the target `1 − √(|v_xy| / 5)` (`SlowdownReward`).
    Slowdown {
        /// \[m, world\].
        target: Vector3<f64>,
        /// \[m\].
        distance: f64,
    },
    /// −1 when faster than the limit (`SpeedReward`).
    SpeedLimit {
        /// \[m/s\].
        limit: f64,
    },
    /// +1 while touching the landing zone (`TouchLandingZoneReward`).
    TouchLandingZone,
    /// Metres towards the next waypoint, +1 when within 0.707 m of it (`WaypointReward`).
    Waypoints(Vec<Vector3<f64>>),
    /// +1 inside the area (`EnterAreaReward`).
    EnterArea(Area),
    /// A tenth of a positive x (`IncreaseXReward`).
    IncreaseX,
    /// +1 when x exceeds its greatest value so far by `delta` (`IncreaseXRewardV2`).
    IncreaseXStride {
        /// \[m\].
        delta: f64,
        /// Where "so far" begins: the reference's −1000 m, which pays for the first step, or the start.
        from: Option<f64>,
    },
    /// −1 per squared metre from the goal (hover, gate, tuning).
    SquaredDistance,
    /// `max(0, 2 − d⁴)` of the distance to the goal (upstream's hover).
    QuarticDistance,
    /// −5 below 2 cm, else −1 / (10 z) (take-off).
    Climb,
    /// +1000 where [`super::Termination::LevelWithin`] ends the episode, else −1 (maze).
    Exit {
        /// Where.
        region: Cuboid,
        /// Greatest magnitude of the quaternion's x.
        roll_limit: f64,
    },
    /// The land-vision aviary's staircase around the target.
    LandVision {
        /// \[m, world\].
        target: Vector3<f64>,
    },
    /// −1 per squared metre of height between the drone and another (leader-follower, flock).
    HeightDifference {
        /// Whose height.
        to: Neighbour,
        /// Multiplied by this (the reference divides by the number of drones).
        factor: f64,
    },
    /// −1 per squared metre between the drone and its opposite, drone i and N − 1 − i (meetup).
    Meeting,
}

/// Another drone of the environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Neighbour {
    /// The first.
    First,
    /// The one before.
    Previous,
}

/// How a penalty grows with the steps of the episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Growth {
    /// Not.
    Constant,
    /// As `1 − 1 / √k` in step k.
    WithSteps,
}

/// Which distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Span {
    /// In x and y only.
    Planar,
    /// In all three.
    Spatial,
}

/// When the steps above the pad are counted anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameCount {
    /// With every episode.
    Episode,
    /// Never, as published.
    Lifetime,
}

/// An upright rectangle, its border excluded, at any height \[m, world\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// Least and greatest x.
    pub x: [f32; 2],
    /// Least and greatest y.
    pub y: [f32; 2],
}

/// A square of cells of one metre around the origin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Cells along each side, at most 8.
    pub cells: u32,
    /// Whether coordinates up to a metre below the field count as its first cell, as in the reference, whose rounding
    /// is towards zero.
    pub rounds_towards_zero: bool,
}

impl WeightedTerm {
    /// A term that all drones are paid.
    pub const fn new(term: RewardTerm, weight: f64) -> Self {
        Self { term, weight, agents: AgentSet::All }
    }
}

impl RewardTerm {
    /// Name in logs and in the configuration.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Alive => "alive",
            Self::Proximity { .. } => "proximity",
            Self::Distance => "distance",
            Self::Velocity => "velocity",
            Self::BodyRates => "body_rates",
            Self::Tilt => "tilt",
            Self::Action => "action",
            Self::ActionChange => "action_change",
            Self::Progress => "progress",
            Self::Advance(_) => "advance",
            Self::Shaping { .. } => "shaping",
            Self::Success => "success",
            Self::Failure => "failure",
            Self::Component(component) => component.name(),
        }
    }
}

impl Component {
    /// Name in logs and in the configuration.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Bounds { .. } => "bounds",
            Self::Collision { .. } => "collision",
            Self::NoCollision { .. } => "no_collision",
            Self::DeltaDistance { span: Span::Planar, .. } => "delta_distance",
            Self::DeltaDistance { span: Span::Spatial, .. } => "delta_distance_v2",
            Self::SafeDeltaDistance { .. } => "safe_delta_distance",
            Self::DistanceRoot { span: Span::Planar, .. } => "distance_root",
            Self::DistanceRoot { span: Span::Spatial, .. } => "distance_root_v2",
            Self::SafeDistance { .. } => "safe_distance",
            Self::DropAltitude { .. } => "drop_altitude",
            Self::FieldCoverage(_) => "field_coverage",
            Self::Landing { .. } => "landing",
            Self::LandingHeight { .. } => "landing_v2",
            Self::Orientation => "orientation",
            Self::Rebase { .. } => "rebase",
            Self::Slowdown { .. } => "slowdown",
            Self::SpeedLimit { .. } => "speed",
            Self::TouchLandingZone => "touch_landing_zone",
            Self::Waypoints(_) => "waypoint",
            Self::EnterArea(_) => "enter_area",
            Self::IncreaseX => "increase_x",
            Self::IncreaseXStride { .. } => "increase_x_v2",
            Self::SquaredDistance => "squared_distance",
            Self::QuarticDistance => "quartic_distance",
            Self::Climb => "climb",
            Self::Exit { .. } => "exit",
            Self::LandVision { .. } => "land_vision",
            Self::HeightDifference { .. } => "height_difference",
            Self::Meeting => "meeting",
        }
    }
}
