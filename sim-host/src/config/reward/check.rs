//! From reward terms as users write them to those that run.

use std::sync::Arc;

use nalgebra::Vector3;

use super::{AgentSetConfig, NeighbourConfig, RewardConfig};
use crate::config::area::AreaConfig;
use crate::config::error::ConfigError;
use crate::config::field::{Field, Limits};
use crate::contact::DistanceField;
use crate::scenario::{
    AgentSet, Component, Field as Cells, FrameCount, Growth, Neighbour, RewardTerm, Span, WeightedTerm,
};

/// Most reward terms; every one is a column of the log.
const REWARDS_LIMIT: usize = 16;

/// Most waypoints of one term.
const WAYPOINTS_LIMIT: usize = 64;

const WEIGHT: Limits = Limits::from(-10_000.0, 10_000.0, "");
const LENGTH: Limits = Limits::above(0.0, 1000.0, "m");

/// Height of a resting drone's centre above what it stands on, as the reference has it \[m\].
const REST_HEIGHT: f64 = 0.01347;

/// Least approach per step that the reference rewards \[m\].
const PUBLISHED_APPROACH: f64 = 0.01;

/// Physics steps per second of the reference, which it takes for its control rate where it counts steps.
pub(crate) const PUBLISHED_RATE: f64 = 240.0;

/// Least approach that the reference's `SafeDeltaDistanceReward` pays, whatever it is told \[m\].
const PUBLISHED_STRIDE: f64 = 0.2;

/// Where the reference's `IncreaseXRewardV2` takes every drone to have been \[m\].
const PUBLISHED_LEAST_X: f64 = -1000.0;

/// Greatest magnitude of the quaternion's x at the reference's exit of the maze.
pub(crate) const PUBLISHED_ROLL: f64 = 0.1;

impl RewardConfig {
    /// The reward terms, at least one; `control_rate_hz` turns times into control periods, `ways` lead to the goal.
    ///
    /// # Errors
    /// When the list is empty or too long, or a number is out of range.
    pub fn check_all(
        rewards: &[Self],
        control_rate_hz: f64,
        ways: &Arc<DistanceField>,
        field: &Field<'_>,
    ) -> Result<Vec<WeightedTerm>, ConfigError> {
        if rewards.is_empty() || rewards.len() > REWARDS_LIMIT {
            return Err(field.refuse("", format!("a list of 1 to {REWARDS_LIMIT}")));
        }
        let check = |(index, reward): (usize, &Self)| reward.check(control_rate_hz, ways, &field.at(index));
        rewards.iter().enumerate().map(check).collect()
    }

    fn check(
        &self,
        control_rate_hz: f64,
        ways: &Arc<DistanceField>,
        field: &Field<'_>,
    ) -> Result<WeightedTerm, ConfigError> {
        let (name, weight) = self.name_and_weight();
        let field = field.at(name);
        let weight = field.at("weight").real(weight, &WEIGHT)?;
        let agents = match self {
            Self::Proximity { agents, .. }
            | Self::SquaredDistance { agents, .. }
            | Self::HeightDifference { agents, .. } => agents.check(),
            _ => AgentSet::All,
        };
        let term = match self {
            Self::Advance { .. } => RewardTerm::Advance(Arc::clone(ways)),
            other => other.term(control_rate_hz, &field)?,
        };
        Ok(WeightedTerm { term, weight, agents })
    }

    /// Key in the file, and the weight written there.
    const fn name_and_weight(&self) -> (&'static str, f64) {
        match self {
            Self::Alive { weight, .. } => ("alive", *weight),
            Self::Distance { weight, .. } => ("distance", *weight),
            Self::Velocity { weight, .. } => ("velocity", *weight),
            Self::BodyRates { weight, .. } => ("body_rates", *weight),
            Self::Tilt { weight, .. } => ("tilt", *weight),
            Self::Action { weight, .. } => ("action", *weight),
            Self::ActionChange { weight, .. } => ("action_change", *weight),
            Self::Progress { weight, .. } => ("progress", *weight),
            Self::Advance { weight, .. } => ("advance", *weight),
            Self::Success { weight, .. } => ("success", *weight),
            Self::Failure { weight, .. } => ("failure", *weight),
            Self::Proximity { weight, .. } => ("proximity", *weight),
            Self::Shaping { weight, .. } => ("shaping", *weight),
            Self::Bounds { weight, .. } => ("bounds", *weight),
            Self::Collision { weight, .. } => ("collision", *weight),
            Self::NoCollision { weight, .. } => ("no_collision", *weight),
            Self::DeltaDistance { weight, .. } => ("delta_distance", *weight),
            Self::DeltaDistanceV2 { weight, .. } => ("delta_distance_v2", *weight),
            Self::SafeDeltaDistance { weight, .. } => ("safe_delta_distance", *weight),
            Self::DistanceRoot { weight, .. } => ("distance_root", *weight),
            Self::DistanceRootV2 { weight, .. } => ("distance_root_v2", *weight),
            Self::SafeDistance { weight, .. } => ("safe_distance", *weight),
            Self::DropAltitude { weight, .. } => ("drop_altitude", *weight),
            Self::FieldCoverage { weight, .. } => ("field_coverage", *weight),
            Self::Landing { weight, .. } => ("landing", *weight),
            Self::LandingV2 { weight, .. } => ("landing_v2", *weight),
            Self::Orientation { weight, .. } => ("orientation", *weight),
            Self::Rebase { weight, .. } => ("rebase", *weight),
            Self::Slowdown { weight, .. } => ("slowdown", *weight),
            Self::Speed { weight, .. } => ("speed", *weight),
            Self::TouchLandingZone { weight, .. } => ("touch_landing_zone", *weight),
            Self::Waypoint { weight, .. } => ("waypoint", *weight),
            Self::EnterArea { weight, .. } => ("enter_area", *weight),
            Self::IncreaseX { weight, .. } => ("increase_x", *weight),
            Self::IncreaseXV2 { weight, .. } => ("increase_x_v2", *weight),
            Self::SquaredDistance { weight, .. } => ("squared_distance", *weight),
            Self::QuarticDistance { weight, .. } => ("quartic_distance", *weight),
            Self::Climb { weight, .. } => ("climb", *weight),
            Self::Exit { weight, .. } => ("exit", *weight),
            Self::LandVision { weight, .. } => ("land_vision", *weight),
            Self::HeightDifference { weight, .. } => ("height_difference", *weight),
            Self::Meeting { weight, .. } => ("meeting", *weight),
        }
    }

    fn term(&self, control_rate_hz: f64, field: &Field<'_>) -> Result<RewardTerm, ConfigError> {
        Ok(match self {
            Self::Alive { .. } => RewardTerm::Alive,
            Self::Distance { .. } => RewardTerm::Distance,
            Self::Velocity { .. } => RewardTerm::Velocity,
            Self::BodyRates { .. } => RewardTerm::BodyRates,
            Self::Tilt { .. } => RewardTerm::Tilt,
            Self::Action { .. } => RewardTerm::Action,
            Self::ActionChange { .. } => RewardTerm::ActionChange,
            Self::Progress { .. } => RewardTerm::Progress,
            Self::Success { .. } => RewardTerm::Success,
            Self::Failure { .. } => RewardTerm::Failure,
            Self::Proximity { scale_m, .. } => {
                RewardTerm::Proximity { scale_m: field.at("scale_m").number(*scale_m, &LENGTH)? }
            }
            Self::Shaping { discount, .. } => RewardTerm::Shaping {
                discount: field.at("discount").number(*discount, &Limits::from(0.0, 1.0, ""))?,
            },
            component => RewardTerm::Component(component.component(control_rate_hz, field)?),
        })
    }

    /// One of the reference's components; the other terms are none.
    fn component(&self, control_rate_hz: f64, field: &Field<'_>) -> Result<Component, ConfigError> {
        let point = |key: &str, value: &[f64; 3]| field.at(key).place(*value);
        let zone = |value: &[f64; 3]| point("landing_zone_m", value);
        let length = |key: &str, value: f64| field.at(key).real(value, &LENGTH);
        let area = |allowed: &Option<AreaConfig>| {
            allowed.as_ref().map(|area| area.check(&field.at("allowed"))).transpose()
        };
        Ok(match self {
            Self::Bounds { bounds, grows_with_steps, .. } => Component::Bounds {
                bounds: bounds.check(&field.at("bounds"))?,
                growth: if *grows_with_steps { Growth::WithSteps } else { Growth::Constant },
            },
            Self::Collision { allowed, .. } => Component::Collision { allowed: area(allowed)? },
            Self::NoCollision { allowed, .. } => Component::NoCollision { allowed: area(allowed)? },
            Self::DeltaDistance { landing_zone_m, as_published, .. } => Component::DeltaDistance {
                target: zone(landing_zone_m)?,
                span: Span::Planar,
                radius: 0.1,
                least: if *as_published { PUBLISHED_APPROACH } else { 0.0 },
            },
            Self::DeltaDistanceV2 { landing_zone_m, as_published, .. } => Component::DeltaDistance {
                target: doubled(zone(landing_zone_m)?, *as_published),
                span: Span::Spatial,
                radius: 0.099,
                least: if *as_published { PUBLISHED_APPROACH } else { 0.0 },
            },
            Self::SafeDeltaDistance { landing_zone_m, delta_m, as_published, .. } => {
                let delta = length("delta_m", *delta_m)?;
                Component::SafeDeltaDistance {
                    target: doubled(zone(landing_zone_m)?, *as_published),
                    delta: if *as_published { PUBLISHED_STRIDE } else { delta },
                }
            }
            Self::DistanceRoot { landing_zone_m, .. } => {
                Component::DistanceRoot { target: zone(landing_zone_m)?, span: Span::Planar }
            }
            Self::DistanceRootV2 { landing_zone_m, as_published, .. } => Component::DistanceRoot {
                target: doubled(zone(landing_zone_m)?, *as_published),
                span: Span::Spatial,
            },
            Self::SafeDistance { landing_zone_m, reach_m, .. } => {
                Component::SafeDistance { target: zone(landing_zone_m)?, reach: length("reach_m", *reach_m)? }
            }
            Self::DropAltitude { landing_zone_m, start_distance_m, .. } => Component::DropAltitude {
                target: zone(landing_zone_m)?,
                start_distance: length("start_distance_m", *start_distance_m)?,
            },
            Self::FieldCoverage { cells, as_published, .. } => {
                Component::FieldCoverage(cells_of(*cells, *as_published, field)?)
            }
            Self::Landing { landing_zone_m, as_published, .. } => {
                let zone = zone(landing_zone_m)?;
                let height = if *as_published { zone.z - 0.1 } else { 2.0 * zone.z + REST_HEIGHT };
                Component::Landing {
                    target: Vector3::new(zone.x, zone.y, height),
                    frames: if *as_published { FrameCount::Lifetime } else { FrameCount::Episode },
                }
            }
            Self::LandingV2 { landing_zone_m, as_published, .. } => {
                let zone = zone(landing_zone_m)?;
                let top = if *as_published { zone.z } else { 2.0 * zone.z };
                Component::LandingHeight { target: Vector3::new(zone.x, zone.y, top + REST_HEIGHT) }
            }
            Self::Orientation { .. } => Component::Orientation,
            Self::Rebase { landing_zone_m, interval_secs, as_published, .. } => {
                let interval = field.at("interval_secs").real(*interval_secs, &Limits::above(0.0, 600.0, "s"))?;
                let rate = if *as_published { PUBLISHED_RATE } else { control_rate_hz };
                Component::Rebase {
                    target: zone(landing_zone_m)?,
                    periods: (interval * rate).round().max(1.0) as u32,
                }
            }
            Self::Slowdown { landing_zone_m, slowdown_distance_m, .. } => Component::Slowdown {
                target: zone(landing_zone_m)?,
                distance: length("slowdown_distance_m", *slowdown_distance_m)?,
            },
            other => return other.task_component(field),
        })
    }

    /// One of the reference's rewards that belong to a task rather than to a landing zone.
    fn task_component(&self, field: &Field<'_>) -> Result<Component, ConfigError> {
        let length = |key: &str, value: f64| field.at(key).real(value, &LENGTH);
        Ok(match self {
            Self::Speed { limit_m_per_s, .. } => Component::SpeedLimit {
                limit: field.at("limit_m_per_s").real(*limit_m_per_s, &Limits::above(0.0, 100.0, "m/s"))?,
            },
            Self::TouchLandingZone { .. } => Component::TouchLandingZone,
            Self::Waypoint { waypoints_m, .. } => Component::Waypoints(waypoints(waypoints_m, field)?),
            Self::EnterArea { area, .. } => Component::EnterArea(area.check(&field.at("area"))?),
            Self::IncreaseX { .. } => Component::IncreaseX,
            Self::IncreaseXV2 { delta_m, as_published, .. } => Component::IncreaseXStride {
                delta: length("delta_m", *delta_m)?,
                from: as_published.then_some(PUBLISHED_LEAST_X),
            },
            Self::SquaredDistance { .. } => Component::SquaredDistance,
            Self::QuarticDistance { .. } => Component::QuarticDistance,
            Self::Climb { .. } => Component::Climb,
            Self::Exit { region, as_published, .. } => Component::Exit {
                region: region.check(&field.at("region"))?,
                roll_limit: if *as_published { PUBLISHED_ROLL } else { f64::INFINITY },
            },
            Self::LandVision { landing_zone_m, .. } => {
                Component::LandVision { target: field.at("landing_zone_m").place(*landing_zone_m)? }
            }
            Self::HeightDifference { to, factor, .. } => Component::HeightDifference {
                to: match to {
                    NeighbourConfig::First => Neighbour::First,
                    NeighbourConfig::Previous => Neighbour::Previous,
                },
                factor: field.at("factor").real(*factor, &Limits::above(0.0, 1000.0, ""))?,
            },
            _ => Component::Meeting,
        })
    }
}

impl AgentSetConfig {
    fn check(self) -> AgentSet {
        match self {
            Self::All => AgentSet::All,
            Self::First => AgentSet::First,
            Self::Others => AgentSet::Others,
        }
    }
}

/// The target of a component that takes its landing zone for the middle of a box on the floor, and its target for a
/// drone on that.
fn doubled(zone: Vector3<f64>, as_published: bool) -> Vector3<f64> {
    if as_published { Vector3::new(zone.x, zone.y, 2.0 * zone.z + REST_HEIGHT) } else { zone }
}

/// The field of a coverage reward or termination.
pub(crate) fn cells_of(cells: u64, as_published: bool, field: &Field<'_>) -> Result<Cells, ConfigError> {
    let cells = field.at("cells").whole(cells, 1..=8)? as u32;
    Ok(Cells { cells, rounds_towards_zero: as_published })
}

fn waypoints(points: &[[f64; 3]], field: &Field<'_>) -> Result<Vec<Vector3<f64>>, ConfigError> {
    let field = field.at("waypoints_m");
    if points.is_empty() || points.len() > WAYPOINTS_LIMIT {
        return Err(field.refuse("", format!("a list of 1 to {WAYPOINTS_LIMIT} points")));
    }
    points.iter().enumerate().map(|(index, point)| field.at(index).place(*point)).collect()
}
