//! What the ground station sends, as users write it.

use kestrel_shim::autopilot::{ALTITUDES_M, SPEED_LIMIT, SPEED_MINIMUM};
use kestrel_shim::flight_mode::FlightMode;
use kestrel_shim::ground_station::{PlanItem, StationOrder};
use kestrel_shim::mission::MISSION_ITEMS;
use kestrel_sim::config::{ConfigError, Field, Limits};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{checked, time};
use crate::flight_test::case::ScriptStep;

/// Longest wait at a waypoint \[s\].
const HOLD_LIMIT: f64 = 600.0;

/// Something that is sent.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct StepConfig {
    /// When.
    at_secs: f64,
    /// What.
    send: OrderConfig,
}

/// What is sent.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum OrderConfig {
    /// Allow the motors to turn.
    Arm,
    /// Forbid it; refused in flight.
    Disarm,
    /// Stop the motors, in flight too.
    StopMotors,
    /// Climb.
    TakeOff {
        /// By this height; left out: the flight's.
        #[serde(default)]
        height_m: Option<f64>,
    },
    /// A set-point of a position.
    GoTo {
        /// x and y, world.
        at_m: [f64; 2],
        /// z, world; left out: the flight's height.
        #[serde(default)]
        height_m: Option<f64>,
        /// Where the nose shall point, counter-clockwise from the world's x axis.
        #[serde(default)]
        heading_deg: Option<f64>,
        /// Sent ten times a second for so long, as the offboard mode needs it; left out: once.
        #[serde(default)]
        for_secs: f64,
    },
    /// Set-points of a velocity, ten a second, which the offboard mode follows.
    Velocity {
        /// World.
        m_per_s: [f64; 3],
        /// For so long.
        for_secs: f64,
    },
    /// Go to points at another speed from now on.
    Speed {
        /// Of the way.
        m_per_s: f64,
    },
    /// Stop here.
    Hold,
    /// Land here.
    Land,
    /// Fly home and land.
    Return,
    /// Follow the stream of set-points.
    Offboard,
    /// Have the policy fly.
    Policy,
    /// Have the cascade fly.
    Cascade,
    /// Upload a mission.
    Upload(Vec<PlanItemConfig>),
    /// Fly the mission that was uploaded.
    StartMission,
}

/// One item of a mission.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum PlanItemConfig {
    /// Climb.
    TakeOff {
        /// To this height; left out: the flight's.
        #[serde(default)]
        height_m: Option<f64>,
    },
    /// Go to a point.
    Waypoint {
        /// x and y, world.
        at_m: [f64; 2],
        /// z, world; left out: the flight's height.
        #[serde(default)]
        height_m: Option<f64>,
        /// Stay there for so long.
        #[serde(default)]
        hold_secs: f64,
    },
    /// Go on at another speed.
    Speed {
        /// Of the way.
        m_per_s: f64,
    },
    /// Fly home and land.
    Return,
    /// Land where the drone is.
    Land,
}

impl StepConfig {
    /// The step of a flight of `secs` at a height of `height_m` where it leaves its own open.
    pub(super) fn check(&self, secs: f64, height_m: f32, field: &Field<'_>) -> Result<ScriptStep, ConfigError> {
        let at_secs = time(self.at_secs, secs, &field.at("at_secs"))?;
        let mut for_secs = 0.0;
        let inner = field.at("send");
        let order = match &self.send {
            OrderConfig::Arm => StationOrder::Arm,
            OrderConfig::Disarm => StationOrder::Disarm,
            OrderConfig::StopMotors => StationOrder::StopMotors,
            OrderConfig::TakeOff { height_m: own } => {
                StationOrder::TakeOff(Some(climb(*own, height_m, &inner.at("take_off"))?))
            }
            OrderConfig::GoTo { at_m, height_m: own, heading_deg, for_secs: stream_secs } => {
                let field = inner.at("go_to");
                for_secs = time(*stream_secs, secs, &field.at("for_secs"))?;
                let heading = heading_deg.map(|degrees| heading(degrees, &field.at("heading_deg"))).transpose()?;
                StationOrder::Position { point: point(*at_m, own.unwrap_or(height_m.into()), &field)?, heading }
            }
            OrderConfig::Velocity { m_per_s, for_secs: stream_secs } => {
                let field = inner.at("velocity");
                for_secs = time(*stream_secs, secs, &field.at("for_secs"))?;
                let limit = f64::from(SPEED_LIMIT);
                let limits = Limits::from(-limit, limit, "m/s");
                let velocity = field.at("m_per_s").numbers(*m_per_s, &limits)?.into();
                StationOrder::Velocity { velocity, yaw_rate: None }
            }
            OrderConfig::Speed { m_per_s } => StationOrder::Speed(speed(*m_per_s, &inner.at("speed"))?),
            OrderConfig::Hold => StationOrder::Mode(FlightMode::Hold),
            OrderConfig::Land => StationOrder::Mode(FlightMode::Land),
            OrderConfig::Return => StationOrder::Mode(FlightMode::Return),
            OrderConfig::Offboard => StationOrder::Mode(FlightMode::Offboard),
            OrderConfig::Policy => StationOrder::Mode(FlightMode::Policy),
            OrderConfig::Cascade => StationOrder::Mode(FlightMode::Cascade),
            OrderConfig::StartMission => StationOrder::Mode(FlightMode::Mission),
            OrderConfig::Upload(items) => StationOrder::Upload(plan(items, height_m, &inner.at("upload"))?),
        };
        Ok(ScriptStep { at_secs, for_secs, order })
    }
}

fn plan(items: &[PlanItemConfig], height_m: f32, field: &Field<'_>) -> Result<Vec<PlanItem>, ConfigError> {
    if items.is_empty() || items.len() > MISSION_ITEMS {
        return Err(field.reject(format!("{} items", items.len()), format!("1 to {MISSION_ITEMS} items")));
    }
    checked(items, field, |item, field| {
        Ok(match item {
            PlanItemConfig::TakeOff { height_m: own } => {
                PlanItem::TakeOff(climb(*own, height_m, &field.at("take_off"))?)
            }
            PlanItemConfig::Waypoint { at_m, height_m: own, hold_secs } => {
                let field = field.at("waypoint");
                let hold_secs = field.at("hold_secs").number(*hold_secs, &Limits::from(0.0, HOLD_LIMIT, "s"))?;
                PlanItem::Waypoint { point: point(*at_m, own.unwrap_or(height_m.into()), &field)?, hold_secs }
            }
            PlanItemConfig::Speed { m_per_s } => PlanItem::Speed(speed(*m_per_s, &field.at("speed"))?),
            PlanItemConfig::Return => PlanItem::Return,
            PlanItemConfig::Land => PlanItem::Land,
        })
    })
}

/// A height of a take-off \[m\].
fn climb(own: Option<f64>, height_m: f32, field: &Field<'_>) -> Result<f32, ConfigError> {
    let limits = Limits::from(f64::from(*ALTITUDES_M.start()), f64::from(*ALTITUDES_M.end()), "m");
    own.map_or(Ok(height_m), |own| field.at("height_m").number(own, &limits))
}

fn speed(m_per_s: f64, field: &Field<'_>) -> Result<f32, ConfigError> {
    let limits = Limits::from(f64::from(SPEED_MINIMUM), f64::from(SPEED_LIMIT), "m/s");
    field.at("m_per_s").number(m_per_s, &limits)
}

/// A point \[m, world\] of a place and a height.
pub(super) fn point(at_m: [f64; 2], height_m: f64, field: &Field<'_>) -> Result<Vector3<f32>, ConfigError> {
    let limits = Limits::from(-1000.0, 1000.0, "m");
    let [x, y] = at_m;
    let across = field.at("at_m");
    let (x, y) = (across.at(0).number(x, &limits)?, across.at(1).number(y, &limits)?);
    Ok(Vector3::new(x, y, field.at("height_m").number(height_m, &Limits::from(0.0, 1000.0, "m"))?))
}

/// A heading \[rad\].
pub(super) fn heading(degrees: f64, field: &Field<'_>) -> Result<f32, ConfigError> {
    Ok(field.number(degrees, &Limits::from(-360.0, 360.0, "degrees"))?.to_radians())
}

/// Where a script sends the drone first, for pictures.
pub(super) fn goal(script: &[ScriptStep]) -> Option<Vector3<f32>> {
    script.iter().find_map(|step| match &step.order {
        StationOrder::Position { point, .. } => Some(*point),
        StationOrder::Upload(items) => items.iter().find_map(|item| match item {
            PlanItem::Waypoint { point, .. } => Some(*point),
            PlanItem::TakeOff(_) | PlanItem::Speed(_) | PlanItem::Return | PlanItem::Land => None,
        }),
        StationOrder::Arm
        | StationOrder::Disarm
        | StationOrder::StopMotors
        | StationOrder::TakeOff(_)
        | StationOrder::Velocity { .. }
        | StationOrder::Mode(_)
        | StationOrder::Speed(_)
        | StationOrder::Interval(..) => None,
    })
}
