//! The fence that was uploaded: items of a plan to zones.

use kestrel_onboard::fence::{CORNERS, ZoneError, ZoneKind, Zones};
use mavlink::dialects::common::MavMissionResult;
use nalgebra::Vector2;

use super::place::target;
use super::{FENCE_ITEMS, MissionItem};
use crate::geodesy::Home;

/// Zones lie within this distance of home along every axis, and circles are no larger \[m\]: to there the f32 of a
/// vertex is good to a millimetre.
const REACH_M: f32 = 10_000.0;

/// The zones of an uploaded fence. Return points are kept with the items, and not flown to.
///
/// # Errors
/// What is wrong with the first wrong item; polygons that are cut short, mixed up, or cross or touch themselves.
pub fn zones(items: &[MissionItem], home: &Home) -> Result<Zones, MavMissionResult> {
    let mut zones = Zones::default();
    let mut rest = items;
    while let Some(item) = rest.first() {
        let len = match kind(item)? {
            Kind::ReturnPoint => 1,
            Kind::Vertex => add_polygon(&mut zones, rest, home)?,
            Kind::Circle => {
                zones.add_circle(center(item, home)?, radius_m(item)?, side(item)?).map_err(result)?;
                1
            }
        };
        rest = &rest[len..];
    }
    Ok(zones)
}

/// Adds the polygon that begins here; how many items it has.
fn add_polygon(zones: &mut Zones, items: &[MissionItem], home: &Home) -> Result<usize, MavMissionResult> {
    let len = corners(&items[0])?;
    let items = items.get(..len).ok_or(MavMissionResult::MAV_MISSION_INVALID_PARAM1)?;
    let side = side(&items[0])?;
    let mut vertices = heapless::Vec::<Vector2<f64>, FENCE_ITEMS>::new();
    for item in items {
        if item.command != items[0].command || corners(item) != Ok(len) {
            return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1);
        }
        if self::side(item)? != side {
            return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM2);
        }
        vertices.push(center(item, home)?).map_err(|_| MavMissionResult::MAV_MISSION_NO_SPACE)?;
    }
    zones.add_polygon(&vertices, side).map_err(result)?;
    Ok(len)
}

/// Numbers were checked item by item.
fn result(error: ZoneError) -> MavMissionResult {
    match error {
        ZoneError::NoSpace => MavMissionResult::MAV_MISSION_NO_SPACE,
        ZoneError::NotSimple | ZoneError::NotFinite => MavMissionResult::MAV_MISSION_INVALID,
    }
}

/// Checks an item by itself, before its polygon is whole.
///
/// # Errors
/// What is wrong with it.
pub(super) fn check(item: &MissionItem, home: &Home) -> Result<(), MavMissionResult> {
    match kind(item)? {
        Kind::ReturnPoint => return Ok(()),
        Kind::Vertex => corners(item).map(drop)?,
        Kind::Circle => radius_m(item).map(drop)?,
    }
    side(item)?;
    center(item, home).map(drop)
}

/// What an item of a fence is a part of.
enum Kind {
    ReturnPoint,
    Vertex,
    Circle,
}

fn kind(item: &MissionItem) -> Result<Kind, MavMissionResult> {
    match item.command {
        5000 => Ok(Kind::ReturnPoint),
        5001 | 5002 => Ok(Kind::Vertex),
        5003 | 5004 => Ok(Kind::Circle),
        _ => Err(MavMissionResult::MAV_MISSION_UNSUPPORTED),
    }
}

fn side(item: &MissionItem) -> Result<ZoneKind, MavMissionResult> {
    let group = item.parameters[1];
    match item.command {
        5002 | 5004 => Ok(ZoneKind::Outside),
        _ if group.is_nan() => Ok(ZoneKind::Inside { group: 0 }),
        _ if (0.0..=255.0).contains(&group) && group == libm::truncf(group) => {
            Ok(ZoneKind::Inside { group: group as u8 })
        }
        _ => Err(MavMissionResult::MAV_MISSION_INVALID_PARAM2),
    }
}

/// Number of vertices of the polygon of a vertex.
fn corners(item: &MissionItem) -> Result<usize, MavMissionResult> {
    let corners = item.parameters[0] as usize;
    let whole = corners as f32 == item.parameters[0];
    if whole && (CORNERS..=FENCE_ITEMS).contains(&corners) {
        Ok(corners)
    } else {
        Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1)
    }
}

fn radius_m(item: &MissionItem) -> Result<f64, MavMissionResult> {
    let radius_m = item.parameters[0];
    let possible = radius_m > 0.0 && radius_m <= REACH_M;
    if possible { Ok(f64::from(radius_m)) } else { Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1) }
}

fn center(item: &MissionItem, home: &Home) -> Result<Vector2<f64>, MavMissionResult> {
    let on_floor = MissionItem { height: f32::NAN, ..*item };
    let place = target(&on_floor, home, REACH_M)?.horizontal_m;
    let [x, y] = place.ok_or(MavMissionResult::MAV_MISSION_INVALID_PARAM5_X)?.map(f64::from);
    Ok(Vector2::new(x, y))
}

#[cfg(test)]
mod tests;
