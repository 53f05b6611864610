//! Where an item of a plan lies in the world.

use mavlink::dialects::common::MavMissionResult;
use nalgebra::Vector3;

use super::{MissionItem, OPEN};
use crate::geodesy::{Geodetic, Home};

/// Points of a mission lie within this distance of home along every axis \[m\], as set-points do.
pub const REACH_M: f32 = 1000.0;

/// A height above sea level on the floor of the plane may come out this much below it: the ellipsoid sinks below the
/// plane by 16 cm at the corners of the reach \[m\].
const FLOOR_TOLERANCE_M: f32 = 0.2;

/// A point in the world of which parts may be the vehicle's choice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissionTarget {
    /// East and north \[m, world\].
    pub horizontal_m: Option<[f32; 2]>,
    /// Height \[m, world\].
    pub height_m: Option<f32>,
}

impl MissionTarget {
    /// The point itself \[m, world\]; what is left open stays as it is `here`.
    pub fn from(&self, here: &Vector3<f32>) -> Vector3<f32> {
        let [x, y] = self.horizontal_m.unwrap_or([here.x, here.y]);
        Vector3::new(x, y, self.height_m.unwrap_or(here.z))
    }
}

/// What the coordinates of an item mean.
#[derive(Clone, Copy)]
enum Coordinates {
    /// Latitude, longitude, height above sea level.
    Global,
    /// Latitude, longitude, height above home.
    GlobalAboveHome,
    /// North, east, down from home.
    Local,
}

/// The place of an item, as far as it names one: the whole horizontal position or none of it. Zero latitude and
/// longitude name none either, as many clients mean it.
///
/// # Errors
/// An unknown frame, half a position, or a coordinate that is infinite, beyond `reach_m` or below the floor.
pub(super) fn target(item: &MissionItem, home: &Home, reach_m: f32) -> Result<MissionTarget, MavMissionResult> {
    let coordinates = coordinates(item.frame)?;
    if item.height.is_infinite() {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM7);
    }
    let [east, north, up] = match coordinates {
        Coordinates::Local => local_point(item)?,
        Coordinates::Global | Coordinates::GlobalAboveHome => global_point(item, coordinates, home)?,
    };
    let beyond = |coordinate: f32| coordinate.abs() > reach_m;
    if north.is_some_and(beyond) {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM5_X);
    }
    if east.is_some_and(beyond) {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM6_Y);
    }
    if up.is_some_and(|height| height < -FLOOR_TOLERANCE_M || beyond(height)) {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM7);
    }
    Ok(MissionTarget {
        horizontal_m: east.zip(north).map(<[f32; 2]>::from),
        height_m: up.map(|height| height.max(0.0)),
    })
}

fn coordinates(frame: u8) -> Result<Coordinates, MavMissionResult> {
    match frame {
        0 | 5 => Ok(Coordinates::Global),
        3 | 6 => Ok(Coordinates::GlobalAboveHome),
        1 => Ok(Coordinates::Local),
        _ => Err(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME),
    }
}

fn local_point(item: &MissionItem) -> Result<[Option<f32>; 3], MavMissionResult> {
    let up = (!item.height.is_nan()).then_some(-item.height);
    if is_open(item)? {
        return Ok([None, None, up]);
    }
    let [north, east] = item.place.map(|coordinate| (f64::from(coordinate) * 1e-4) as f32);
    Ok([Some(east), Some(north), up])
}

fn global_point(
    item: &MissionItem,
    coordinates: Coordinates,
    home: &Home,
) -> Result<[Option<f32>; 3], MavMissionResult> {
    let named = (!item.height.is_nan()).then_some(f64::from(item.height));
    let altitude_m = match coordinates {
        Coordinates::Global | Coordinates::Local => named,
        Coordinates::GlobalAboveHome => named.map(|height| home.altitude_m + height),
    };
    if is_open(item)? || item.place == [0, 0] {
        return Ok([None, None, altitude_m.map(|altitude_m| (altitude_m - home.altitude_m) as f32)]);
    }
    let [latitude, longitude] = item.place;
    let ground =
        Geodetic::from_integers([latitude, 0], 0.0).ok_or(MavMissionResult::MAV_MISSION_INVALID_PARAM5_X).and(
            Geodetic::from_integers([latitude, longitude], 0.0)
                .ok_or(MavMissionResult::MAV_MISSION_INVALID_PARAM6_Y),
        )?;
    let place = Geodetic { altitude_m: altitude_m.unwrap_or(home.altitude_m), ..ground };
    let point = home.point_at(&place);
    Ok([Some(point.x), Some(point.y), altitude_m.map(|_| point.z)])
}

/// Whether the horizontal position is left open; half of it must not be.
fn is_open(item: &MissionItem) -> Result<bool, MavMissionResult> {
    match item.place.map(|coordinate| coordinate == OPEN) {
        [true, true] => Ok(true),
        [false, false] => Ok(false),
        [true, false] => Err(MavMissionResult::MAV_MISSION_INVALID_PARAM5_X),
        [false, true] => Err(MavMissionResult::MAV_MISSION_INVALID_PARAM6_Y),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOME: Home = Home { latitude_deg: 47.397_742, longitude_deg: 8.545_594, altitude_m: 488.0 };

    fn item(frame: u8, place: [i32; 2], height: f32) -> MissionItem {
        MissionItem { frame, command: 16, autocontinue: 1, parameters: [0.0; 4], place, height }
    }

    fn found(frame: u8, place: [i32; 2], height: f32) -> Result<MissionTarget, MavMissionResult> {
        target(&item(frame, place, height), &HOME, REACH_M)
    }

    #[test]
    fn one_point_is_the_same_in_every_frame() {
        let point = Vector3::new(12.0, -7.0, 3.0);
        let place = HOME.place_of(&point).integers();
        let points = [
            found(0, place, 491.0),
            found(5, place, 491.0),
            found(3, place, 3.0),
            found(6, place, 3.0),
            found(1, [-70_000, 120_000], -3.0),
        ];
        for target in points {
            let target = target.unwrap();
            assert!((target.from(&Vector3::zeros()) - point).norm() < 0.01, "{target:?}");
        }
    }

    #[test]
    fn what_is_left_open_stays_as_it_is() {
        let here = Vector3::new(1.0, 2.0, 3.0);
        let point = |frame, place, height| found(frame, place, height).map(|target| target.from(&here));
        for (frame, place) in [(6, [OPEN; 2]), (6, [0; 2]), (1, [OPEN; 2])] {
            assert_eq!(point(frame, place, f32::NAN), Ok(here));
        }
        assert_eq!(point(6, [OPEN; 2], 5.0), Ok(Vector3::new(1.0, 2.0, 5.0)));
        assert_eq!(point(0, [OPEN; 2], 493.0), Ok(Vector3::new(1.0, 2.0, 5.0)));
        assert_eq!(point(1, [OPEN; 2], -5.0), Ok(Vector3::new(1.0, 2.0, 5.0)));
        assert_eq!(point(1, [0; 2], f32::NAN), Ok(Vector3::new(0.0, 0.0, 3.0)), "the origin is a place");
    }

    #[test]
    fn what_is_no_place_within_reach_is_refused_by_its_parameter() {
        use MavMissionResult::{
            MAV_MISSION_INVALID_PARAM5_X, MAV_MISSION_INVALID_PARAM6_Y, MAV_MISSION_INVALID_PARAM7,
            MAV_MISSION_UNSUPPORTED_FRAME,
        };
        let home = HOME.place().integers();
        let cases = [
            (6, [home[0] + 100_000, home[1]], 1.0, MAV_MISSION_INVALID_PARAM5_X),
            (6, [home[0], home[1] + 200_000], 1.0, MAV_MISSION_INVALID_PARAM6_Y),
            (6, [900_000_001, home[1]], 1.0, MAV_MISSION_INVALID_PARAM5_X),
            (6, [home[0], i32::MIN], 1.0, MAV_MISSION_INVALID_PARAM6_Y),
            (6, [OPEN, home[1]], 1.0, MAV_MISSION_INVALID_PARAM5_X),
            (6, [home[0], OPEN], 1.0, MAV_MISSION_INVALID_PARAM6_Y),
            (6, home, f32::INFINITY, MAV_MISSION_INVALID_PARAM7),
            (6, home, -1.0, MAV_MISSION_INVALID_PARAM7),
            (6, home, 1001.0, MAV_MISSION_INVALID_PARAM7),
            (0, home, 10.0, MAV_MISSION_INVALID_PARAM7),
            (1, [10_000_001, 0], -1.0, MAV_MISSION_INVALID_PARAM5_X),
            (1, [0, i32::MIN], -1.0, MAV_MISSION_INVALID_PARAM6_Y),
            (1, [0, 0], 1.0, MAV_MISSION_INVALID_PARAM7),
            (2, home, 1.0, MAV_MISSION_UNSUPPORTED_FRAME),
            (8, home, 1.0, MAV_MISSION_UNSUPPORTED_FRAME),
            (255, home, 1.0, MAV_MISSION_UNSUPPORTED_FRAME),
        ];
        for (frame, place, height, expected) in cases {
            assert_eq!(found(frame, place, height), Err(expected), "{frame} {place:?} {height}");
        }
    }

    #[test]
    fn the_floor_far_away_is_still_the_floor() {
        let place = HOME.place_of(&Vector3::new(700.0, 700.0, 0.0)).integers();
        assert_eq!(found(6, place, 0.0).unwrap().height_m, Some(0.0));
    }
}
