//! What is rewarded.

mod check;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::area::AreaConfig;
use super::aviary::BoxConfig;

pub(crate) use check::{PUBLISHED_RATE, PUBLISHED_ROLL, cells_of};

/// One reward term; a penalty has a negative weight.
///
/// The first terms are paid per second (`progress`, `shaping`, `success` and `failure` are not): changing the control
/// rate does not change what an episode is worth. From `bounds` on the terms are the reference's components, named
/// after its classes, and paid every control period as there; those that penalise are negative themselves.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum RewardConfig {
    /// One for being in the air.
    Alive {
        /// What one unit is worth.
        weight: f64,
    },
    /// `1 / (1 + (d / scale)²)` of the distance d to the goal.
    Proximity {
        /// What one unit is worth.
        weight: f64,
        /// Distance at which it is one half.
        scale_m: f64,
        /// Which drones are paid.
        #[serde(default)]
        agents: AgentSetConfig,
    },
    /// Distance to the goal in metres.
    Distance {
        /// What one unit is worth.
        weight: f64,
    },
    /// Squared speed in m²/s².
    Velocity {
        /// What one unit is worth.
        weight: f64,
    },
    /// Squared angular velocity in rad²/s².
    BodyRates {
        /// What one unit is worth.
        weight: f64,
    },
    /// One minus the cosine of the tilt.
    Tilt {
        /// What one unit is worth.
        weight: f64,
    },
    /// Squared action.
    Action {
        /// What one unit is worth.
        weight: f64,
    },
    /// Squared change of the action since the last step.
    ActionChange {
        /// What one unit is worth.
        weight: f64,
    },
    /// Metres that the drone came closer to the goal in this step.
    Progress {
        /// What one unit is worth.
        weight: f64,
    },
    /// Metres by which the shortest free way to the goal became shorter in this step. Ways lead around what stands in the
    /// way and keep off it: a metre right beside something counts as three. Before an obstacle `progress` pays for
    /// flying into it, and this for flying around it.
    Advance {
        /// What one unit is worth.
        weight: f64,
    },
    /// Potential-based shaping by the distance to the goal in metres: `d − discount · d′`. It changes no optimal policy.
    Shaping {
        /// What one unit is worth.
        weight: f64,
        /// The learner's discount per step.
        discount: f64,
    },
    /// One, once, when the episode ends in success.
    Success {
        /// What one unit is worth.
        weight: f64,
    },
    /// One, once, when a termination ends the episode.
    Failure {
        /// What one unit is worth.
        weight: f64,
    },
    /// −1 outside a box (`BoundsReward`).
    Bounds {
        /// What one unit is worth.
        weight: f64,
        /// The box.
        bounds: BoxConfig,
        /// Whether the penalty of step k is 1 − 1/√k.
        #[serde(default)]
        grows_with_steps: bool,
    },
    /// −1 while touching anything but the landing zone (`CollisionReward`).
    Collision {
        /// What one unit is worth.
        weight: f64,
        /// Where touching is free: its x and y ranges.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        allowed: Option<AreaConfig>,
    },
    /// −1 while touching anything but the landing zone, else +1 (`NoCollisionReward`).
    NoCollision {
        /// What one unit is worth.
        weight: f64,
        /// Where touching is free: its x and y ranges.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        allowed: Option<AreaConfig>,
    },
    /// +1 within 10 cm of the landing zone or when nearer than in the step before, else −1; horizontal
    /// (`DeltaDistanceReward`). As published only an approach of more than 1 cm a step counts, so that flying slower than
    /// 0.48 m/s towards it is punished.
    DeltaDistance {
        /// What one unit is worth.
        weight: f64,
        /// The landing zone: `[x, y, z]`.
        landing_zone_m: [f64; 3],
        /// Whether to keep the defect of the reference that is described above.
        #[serde(default)]
        as_published: bool,
    },
    /// The same in three dimensions, within 9.9 cm (`DeltaDistanceRewardV2`). As published, besides, the target is at
    /// twice the landing zone's height plus 1.347 cm.
    DeltaDistanceV2 {
        /// What one unit is worth.
        weight: f64,
        /// The landing zone: `[x, y, z]`.
        landing_zone_m: [f64; 3],
        /// Whether to keep the defect of the reference that is described above.
        #[serde(default)]
        as_published: bool,
    },
    /// +1 within 9.9 cm of the landing zone or when `delta_m` nearer than at the last payment
    /// (`SafeDeltaDistanceReward`). As published the target is at twice the landing zone's height plus 1.347 cm, and
    /// `delta_m` is ignored for 0.2 m.
    SafeDeltaDistance {
        /// What one unit is worth.
        weight: f64,
        /// The landing zone: `[x, y, z]`.
        landing_zone_m: [f64; 3],
        /// Approach that pays.
        #[serde(default = "delta_m")]
        delta_m: f64,
        /// Whether to keep the defect of the reference that is described above.
        #[serde(default)]
        as_published: bool,
    },
    /// `1 − √(d / 5)` of the horizontal distance to the landing zone (`DistanceReward`).
    DistanceRoot {
        /// What one unit is worth.
        weight: f64,
        /// The landing zone: `[x, y, z]`.
        landing_zone_m: [f64; 3],
    },
    /// The same in three dimensions (`DistanceRewardV2`). As published the target is at twice the landing zone's
    /// height plus 1.347 cm.
    DistanceRootV2 {
        /// What one unit is worth.
        weight: f64,
        /// The landing zone: `[x, y, z]`.
        landing_zone_m: [f64; 3],
        /// Whether to keep the defect of the reference that is described above.
        #[serde(default)]
        as_published: bool,
    },
    /// `max(0, 1 − (d / reach)^0.4)` of the distance to the landing zone (`SafeDistanceReward`).
    SafeDistance {
        /// What one unit is worth.
        weight: f64,
        /// The landing zone: `[x, y, z]`.
        landing_zone_m: [f64; 3],
        /// Distance from which it is zero.
        #[serde(default = "reach_m")]
        reach_m: f64,
    },
    /// Near the landing zone +1 for not rising, −1 for rising (`DropAltitudeReward`).
    DropAltitude {
        /// What one unit is worth.
        weight: f64,
        /// The landing zone: `[x, y, z]`.
        landing_zone_m: [f64; 3],
        /// Horizontal distance that is near.
        start_distance_m: f64,
    },
    /// +1 for every cell of the field entered for the first time (`FieldCoverageReward`). As published a metre beyond
    /// the field's low borders counts as its first cells.
    FieldCoverage {
        /// What one unit is worth.
        weight: f64,
        /// Cells of one metre along each side of the field, which is centred on the origin.
        #[serde(default = "cells")]
        cells: u64,
        /// Whether to keep the defect of the reference that is described above.
        #[serde(default)]
        as_published: bool,
    },
    /// Within 15 cm of the pad's middle `1 − |z − h|`, and 10 from the tenth step there (`LandingReward`). h is the height
    /// of a resting drone. As published it is 10 cm below the pad's middle, and steps count across episodes.
    Landing {
        /// What one unit is worth.
        weight: f64,
        /// The landing zone: `[x, y, z]`.
        landing_zone_m: [f64; 3],
        /// Whether to keep the defect of the reference that is described above.
        #[serde(default)]
        as_published: bool,
    },
    /// Level and within 9.9 cm of the pad's middle: 1 at the height h, less above (`LandingRewardV2`). h is the height
    /// of a drone that rests on a pad whose middle is the landing zone and which stands on the floor. As published it is
    /// that of a drone inside the pad.
    LandingV2 {
        /// What one unit is worth.
        weight: f64,
        /// The landing zone: `[x, y, z]`.
        landing_zone_m: [f64; 3],
        /// Whether to keep the defect of the reference that is described above.
        #[serde(default)]
        as_published: bool,
    },
    /// +1 while roll and pitch are within ±1 rad, else −1 (`OrientationReward`).
    Orientation {
        /// What one unit is worth.
        weight: f64,
    },
    /// Every interval +1 within 12.5 cm of the landing zone, else −1 (`RebaseReward`). As published it counts control
    /// periods as if there were 240 in a second.
    Rebase {
        /// What one unit is worth.
        weight: f64,
        /// The landing zone: `[x, y, z]`.
        landing_zone_m: [f64; 3],
        /// Time between two judgements.
        interval_secs: f64,
        /// Whether to keep the defect of the reference that is described above.
        #[serde(default)]
        as_published: bool,
    },
    /// Near the landing zone `1 − √(|v_xy| / 5)` (`SlowdownReward`).
    Slowdown {
        /// What one unit is worth.
        weight: f64,
        /// The landing zone: `[x, y, z]`.
        landing_zone_m: [f64; 3],
        /// Distance that is near.
        slowdown_distance_m: f64,
    },
    /// −1 when faster than the limit (`SpeedReward`).
    Speed {
        /// What one unit is worth.
        weight: f64,
        /// The limit.
        limit_m_per_s: f64,
    },
    /// +1 while touching the landing zone (`TouchLandingZoneReward`).
    TouchLandingZone {
        /// What one unit is worth.
        weight: f64,
    },
    /// Metres nearer to the next waypoint than when it became the next, +1 within 0.707 m of it (`WaypointReward`).
    Waypoint {
        /// What one unit is worth.
        weight: f64,
        /// The waypoints, at least one.
        waypoints_m: Vec<[f64; 3]>,
    },
    /// +1 inside an area (`EnterAreaReward`).
    EnterArea {
        /// What one unit is worth.
        weight: f64,
        /// Its x and y ranges.
        area: AreaConfig,
    },
    /// A tenth of a positive x (`IncreaseXReward`).
    IncreaseX {
        /// What one unit is worth.
        weight: f64,
    },
    /// +1 when x exceeds its greatest value so far by `delta_m` (`IncreaseXRewardV2`). As published the greatest value
    /// starts at −1000 m, so that the first step pays.
    IncreaseXV2 {
        /// What one unit is worth.
        weight: f64,
        /// Advance that pays.
        #[serde(default = "delta_m")]
        delta_m: f64,
        /// Whether to keep the defect of the reference that is described above.
        #[serde(default)]
        as_published: bool,
    },
    /// −1 per squared metre to the goal (hover, gate and tuning aviaries).
    SquaredDistance {
        /// What one unit is worth.
        weight: f64,
        /// Which drones are paid.
        #[serde(default)]
        agents: AgentSetConfig,
    },
    /// `max(0, 2 − d⁴)` of the distance to the goal (upstream's hover aviary).
    QuarticDistance {
        /// What one unit is worth.
        weight: f64,
    },
    /// −5 below 2 cm, else `−1 / (10 z)` (take-off aviary).
    Climb {
        /// What one unit is worth.
        weight: f64,
    },
    /// +1000 at the exit, else −1 (maze aviary). As published the roll has to be nearly zero there, because a quaternion
    /// is compared with a fourth coordinate.
    Exit {
        /// What one unit is worth.
        weight: f64,
        /// The exit.
        region: BoxConfig,
        /// Whether to keep the defect of the reference that is described above.
        #[serde(default)]
        as_published: bool,
    },
    /// The land-vision aviary's staircase: 2240 or 80 when near and slow, about 2 within a metre, −240 when the episode
    /// fails, else the reciprocal distance.
    LandVision {
        /// What one unit is worth.
        weight: f64,
        /// The landing zone: `[x, y, z]`.
        landing_zone_m: [f64; 3],
    },
    /// −1 per squared metre of height between the drone and another (leader-follower and flock aviaries).
    HeightDifference {
        /// What one unit is worth.
        weight: f64,
        /// Whose height.
        to: NeighbourConfig,
        /// Multiplied by this; the leader-follower aviary has one over the number of drones.
        #[serde(default = "one")]
        factor: f64,
        /// Which drones are paid.
        #[serde(default)]
        agents: AgentSetConfig,
    },
    /// −1 per squared metre between drones i and N − 1 − i (meetup aviary).
    Meeting {
        /// What one unit is worth.
        weight: f64,
    },
}

/// Some drones of an environment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AgentSetConfig {
    /// All.
    #[default]
    All,
    /// The first, who leads.
    First,
    /// All but the first.
    Others,
}

/// Another drone of the environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NeighbourConfig {
    /// The first.
    First,
    /// The one before.
    Previous,
}

fn delta_m() -> f64 {
    0.2
}

fn reach_m() -> f64 {
    20.0
}

fn cells() -> u64 {
    5
}

fn one() -> f64 {
    1.0
}
