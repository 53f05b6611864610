//! Where the drone may fly: zones that were uploaded, and a cylinder around home.
//!
//! Zones are polygons and circles on the floor, of any height. Those to stay in belong to groups: a point must be in
//! all zones of at least one group, and in no zone to stay out of.

use mavlink::dialects::common::MavMissionResult;
use nalgebra::{Vector2, Vector3};

use super::place::target;
use super::{FENCE_ITEMS, Item};
use crate::geodesy::Home;

/// Zones lie within this distance of home along every axis, and circles are no larger \[m\]: to there the f32 of a
/// vertex is good to a millimetre.
const REACH_M: f32 = 10_000.0;

/// Corners of the smallest polygon.
const CORNERS: usize = 3;

/// The whole fence.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fence {
    /// What was uploaded.
    pub zones: Zones,
    /// What parameters say.
    pub cylinder: Cylinder,
}

/// A fence around home (`GF_MAX_HOR_DIST`, `GF_MAX_VER_DIST`).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cylinder {
    /// Home \[m, world\].
    pub center: Vector3<f32>,
    /// Greatest horizontal distance \[m\], if any.
    pub radius_m: Option<f32>,
    /// Greatest height \[m\], if any.
    pub height_m: Option<f32>,
}

/// Zones of a fence.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Zones {
    vertices: heapless::Vec<Vector2<f64>, FENCE_ITEMS>,
    zones: heapless::Vec<Zone, FENCE_ITEMS>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Zone {
    shape: Shape,
    side: Side,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    /// Of so many vertices from the first one on.
    Polygon { first: usize, len: usize },
    /// Around a point, of a radius \[m\].
    Circle { center: Vector2<f64>, radius_m: f64 },
}

/// On which side of the border to stay.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Side {
    /// Inside, as a zone of a group.
    Inside { group: u8 },
    /// Outside.
    Outside,
}

impl Fence {
    /// Whether the drone may be at a point \[m, world\]; not if the point is not finite.
    pub fn contains(&self, point: &Vector3<f32>) -> bool {
        self.margin_m(point) >= 0.0
    }

    /// How far a point \[m, world\] lies within the fence \[m\]: negative outside, infinite without a fence. Inside, no
    /// border is closer than this.
    pub fn margin_m(&self, point: &Vector3<f32>) -> f32 {
        if !point.iter().all(|coordinate| coordinate.is_finite()) {
            return f32::NEG_INFINITY;
        }
        self.zones.margin_m(&point.xy().map(f64::from)).min(self.cylinder.margin_m(point))
    }
}

impl Cylinder {
    fn margin_m(&self, point: &Vector3<f32>) -> f32 {
        let way = point - self.center;
        let horizontal = self.radius_m.map_or(f32::INFINITY, |radius_m| radius_m - way.xy().norm());
        let vertical = self.height_m.map_or(f32::INFINITY, |height_m| height_m - way.z);
        horizontal.min(vertical)
    }
}

impl Zones {
    /// The zones of an uploaded fence. Return points are kept by whoever keeps the items, and not flown to.
    ///
    /// # Errors
    /// What is wrong with the first wrong item; polygons that are cut short, mixed up, or cross or touch themselves.
    pub fn of(items: &[Item], home: &Home) -> Result<Self, MavMissionResult> {
        let mut zones = Self::default();
        let mut rest = items;
        while let Some(item) = rest.first() {
            let len = match kind(item)? {
                Kind::ReturnPoint => 1,
                Kind::Vertex => zones.add_polygon(rest, home)?,
                Kind::Circle => zones.add_circle(item, home)?,
            };
            rest = &rest[len..];
        }
        Ok(zones)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.zones.is_empty()
    }

    /// Adds the polygon that begins here; how many items it has.
    fn add_polygon(&mut self, items: &[Item], home: &Home) -> Result<usize, MavMissionResult> {
        let len = corners(&items[0])?;
        let items = items.get(..len).ok_or(MavMissionResult::MAV_MISSION_INVALID_PARAM1)?;
        let side = side(&items[0])?;
        let first = self.vertices.len();
        for item in items {
            if item.command != items[0].command || corners(item) != Ok(len) {
                return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1);
            }
            if self::side(item)? != side {
                return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM2);
            }
            self.vertices.push(center(item, home)?).map_err(|_| MavMissionResult::MAV_MISSION_NO_SPACE)?;
        }
        if !is_simple(&self.vertices[first..]) {
            return Err(MavMissionResult::MAV_MISSION_INVALID);
        }
        self.add(Shape::Polygon { first, len }, side)?;
        Ok(len)
    }

    /// Adds a circle; it has one item.
    fn add_circle(&mut self, item: &Item, home: &Home) -> Result<usize, MavMissionResult> {
        let shape = Shape::Circle { center: center(item, home)?, radius_m: radius_m(item)? };
        self.add(shape, side(item)?)?;
        Ok(1)
    }

    fn add(&mut self, shape: Shape, side: Side) -> Result<(), MavMissionResult> {
        self.zones.push(Zone { shape, side }).map_err(|_| MavMissionResult::MAV_MISSION_NO_SPACE)
    }

    fn margin_m(&self, point: &Vector2<f64>) -> f32 {
        let outside = self.zones.iter().filter(|zone| zone.side == Side::Outside);
        let outside = outside.map(|zone| -self.depth_m(&zone.shape, point)).fold(f64::INFINITY, f64::min);
        let inside = self.groups().map(|group| self.group_margin_m(group, point)).reduce(f64::max);
        inside.unwrap_or(f64::INFINITY).min(outside) as f32
    }

    /// The groups of zones to stay in, each once.
    fn groups(&self) -> impl Iterator<Item = Side> {
        let zones = self.zones.iter().enumerate();
        zones.filter_map(|(index, zone)| {
            let new = self.zones[..index].iter().all(|earlier| earlier.side != zone.side);
            (new && zone.side != Side::Outside).then_some(zone.side)
        })
    }

    fn group_margin_m(&self, group: Side, point: &Vector2<f64>) -> f64 {
        let zones = self.zones.iter().filter(|zone| zone.side == group);
        zones.map(|zone| self.depth_m(&zone.shape, point)).fold(f64::INFINITY, f64::min)
    }

    /// Distance to the border of a shape \[m\], negative outside.
    fn depth_m(&self, shape: &Shape, point: &Vector2<f64>) -> f64 {
        match *shape {
            Shape::Circle { center, radius_m } => radius_m - (point - center).norm(),
            Shape::Polygon { first, len } => polygon_depth_m(&self.vertices[first..first + len], point),
        }
    }
}

/// Checks an item by itself, before its polygon is whole.
///
/// # Errors
/// What is wrong with it.
pub(super) fn check(item: &Item, home: &Home) -> Result<(), MavMissionResult> {
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

fn kind(item: &Item) -> Result<Kind, MavMissionResult> {
    match item.command {
        5000 => Ok(Kind::ReturnPoint),
        5001 | 5002 => Ok(Kind::Vertex),
        5003 | 5004 => Ok(Kind::Circle),
        _ => Err(MavMissionResult::MAV_MISSION_UNSUPPORTED),
    }
}

fn side(item: &Item) -> Result<Side, MavMissionResult> {
    let group = item.parameters[1];
    match item.command {
        5002 | 5004 => Ok(Side::Outside),
        _ if group.is_nan() => Ok(Side::Inside { group: 0 }),
        _ if (0.0..=255.0).contains(&group) && group == libm::truncf(group) => {
            Ok(Side::Inside { group: group as u8 })
        }
        _ => Err(MavMissionResult::MAV_MISSION_INVALID_PARAM2),
    }
}

/// Number of vertices of the polygon of a vertex.
fn corners(item: &Item) -> Result<usize, MavMissionResult> {
    let corners = item.parameters[0] as usize;
    let whole = corners as f32 == item.parameters[0];
    if whole && (CORNERS..=FENCE_ITEMS).contains(&corners) {
        Ok(corners)
    } else {
        Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1)
    }
}

fn radius_m(item: &Item) -> Result<f64, MavMissionResult> {
    let radius_m = item.parameters[0];
    let possible = radius_m > 0.0 && radius_m <= REACH_M;
    if possible { Ok(f64::from(radius_m)) } else { Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1) }
}

fn center(item: &Item, home: &Home) -> Result<Vector2<f64>, MavMissionResult> {
    let on_floor = Item { height: f32::NAN, ..*item };
    let place = target(&on_floor, home, REACH_M)?.horizontal_m;
    let [x, y] = place.ok_or(MavMissionResult::MAV_MISSION_INVALID_PARAM5_X)?.map(f64::from);
    Ok(Vector2::new(x, y))
}

/// The edges of a polygon.
fn edges(vertices: &[Vector2<f64>]) -> impl Iterator<Item = [Vector2<f64>; 2]> + Clone {
    vertices.iter().copied().zip(vertices.iter().copied().cycle().skip(1)).map(<[Vector2<f64>; 2]>::from)
}

/// Distance to the nearest edge \[m\], negative outside.
fn polygon_depth_m(vertices: &[Vector2<f64>], point: &Vector2<f64>) -> f64 {
    let distance = edges(vertices).map(|edge| edge_distance_m(&edge, point)).fold(f64::INFINITY, f64::min);
    // Whether a ray to the east crosses the border an odd number of times.
    let crossings = edges(vertices).filter(|[a, b]| {
        let crosses = (a.y > point.y) != (b.y > point.y);
        crosses && point.x < a.x + (b.x - a.x) * (point.y - a.y) / (b.y - a.y)
    });
    if crossings.count() % 2 == 1 { distance } else { -distance }
}

fn edge_distance_m([a, b]: &[Vector2<f64>; 2], point: &Vector2<f64>) -> f64 {
    let along = b - a;
    let share = ((point - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    (a + along * share - point).norm()
}

/// Whether no edge is without length, folds back onto its neighbour, or meets one that is not its neighbour.
fn is_simple(vertices: &[Vector2<f64>]) -> bool {
    let len = vertices.len();
    edges(vertices).enumerate().all(|(i, first)| {
        edges(vertices).enumerate().skip(i + 1).all(|(j, second)| {
            if j == i + 1 {
                turns([first[0], first[1], second[1]])
            } else if i == 0 && j + 1 == len {
                turns([second[0], second[1], first[1]])
            } else {
                !meet(&first, &second)
            }
        })
    })
}

/// Whether the way over three corners goes somewhere: neither stays on one of them nor goes straight back.
fn turns([a, b, c]: [Vector2<f64>; 3]) -> bool {
    let (first, second) = (b - a, c - b);
    let back = first.perp(&second) == 0.0 && first.dot(&second) <= 0.0;
    !back
}

/// Whether two edges have a point in common.
fn meet([a, b]: &[Vector2<f64>; 2], [c, d]: &[Vector2<f64>; 2]) -> bool {
    let side = |from: &Vector2<f64>, to: &Vector2<f64>, point: &Vector2<f64>| {
        let area = (to - from).perp(&(point - from));
        i32::from(area > 0.0) - i32::from(area < 0.0)
    };
    let within = |from: &Vector2<f64>, to: &Vector2<f64>, point: &Vector2<f64>| {
        side(from, to, point) == 0 && (point - from).dot(&(point - to)) <= 0.0
    };
    let crossing = side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0;
    crossing || within(a, b, c) || within(a, b, d) || within(c, d, a) || within(c, d, b)
}

#[cfg(test)]
mod tests;
