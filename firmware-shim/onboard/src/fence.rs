//! Where the drone may fly: zones on the floor, and a cylinder around home.
//!
//! Zones are polygons and circles of any height. Those to stay in belong to groups: a point must be in all zones of at
//! least one group, and in no zone to stay out of.

use nalgebra::{Vector2, Vector3};

/// Zones of a fence, and vertices of its polygons together.
pub const ZONES: usize = 32;

/// Corners of the smallest polygon.
pub const CORNERS: usize = 3;

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
    vertices: heapless::Vec<Vector2<f64>, ZONES>,
    zones: heapless::Vec<Zone, ZONES>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Zone {
    shape: Shape,
    kind: ZoneKind,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    /// Of so many vertices from the first one on.
    Polygon { first: usize, len: usize },
    /// Around a point, of a radius \[m\].
    Circle { center: Vector2<f64>, radius_m: f64 },
}

/// On which side of the border to stay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ZoneKind {
    /// Inside, as a zone of a group.
    Inside {
        /// Its number.
        group: u8,
    },
    /// Outside.
    Outside,
}

/// Why a zone is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ZoneError {
    /// The fence is full.
    #[error("expected at most {ZONES} zones and corners, found more")]
    NoSpace,
    /// A polygon has too few corners, or an edge without length, or it crosses, touches or folds back onto itself.
    #[error("expected a simple polygon, found one that crosses or touches itself, or is none")]
    NotSimple,
    /// A number is not finite, or a radius not positive.
    #[error("expected finite corners and a positive radius, found others")]
    NotFinite,
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
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.zones.is_empty()
    }

    /// Adds a polygon with these corners \[m, world x and y\], in order.
    ///
    /// # Errors
    /// Why it cannot be added; there are the same zones as before then.
    pub fn add_polygon(&mut self, corners: &[Vector2<f64>], kind: ZoneKind) -> Result<(), ZoneError> {
        if !corners.iter().all(is_finite) {
            return Err(ZoneError::NotFinite);
        }
        if corners.len() < CORNERS || !is_simple(corners) {
            return Err(ZoneError::NotSimple);
        }
        if self.zones.is_full() {
            return Err(ZoneError::NoSpace);
        }
        let shape = Shape::Polygon { first: self.vertices.len(), len: corners.len() };
        self.vertices.extend_from_slice(corners).map_err(|_| ZoneError::NoSpace)?;
        self.add(shape, kind)
    }

    /// Adds a circle around a point \[m, world x and y\] of a radius \[m\].
    ///
    /// # Errors
    /// Why it cannot be added; there are the same zones as before then.
    pub fn add_circle(&mut self, center: Vector2<f64>, radius_m: f64, kind: ZoneKind) -> Result<(), ZoneError> {
        if !(is_finite(&center) && radius_m.is_finite() && radius_m > 0.0) {
            return Err(ZoneError::NotFinite);
        }
        self.add(Shape::Circle { center, radius_m }, kind)
    }

    fn add(&mut self, shape: Shape, kind: ZoneKind) -> Result<(), ZoneError> {
        self.zones.push(Zone { shape, kind }).map_err(|_| ZoneError::NoSpace)
    }

    fn margin_m(&self, point: &Vector2<f64>) -> f32 {
        let outside = self.zones.iter().filter(|zone| zone.kind == ZoneKind::Outside);
        let outside = outside.map(|zone| -self.depth_m(&zone.shape, point)).fold(f64::INFINITY, f64::min);
        let inside = self.groups().map(|group| self.group_margin_m(group, point)).reduce(f64::max);
        inside.unwrap_or(f64::INFINITY).min(outside) as f32
    }

    /// The groups of zones to stay in, each once.
    fn groups(&self) -> impl Iterator<Item = ZoneKind> {
        let zones = self.zones.iter().enumerate();
        zones.filter_map(|(index, zone)| {
            let new = self.zones.iter().take(index).all(|earlier| earlier.kind != zone.kind);
            (new && zone.kind != ZoneKind::Outside).then_some(zone.kind)
        })
    }

    fn group_margin_m(&self, group: ZoneKind, point: &Vector2<f64>) -> f64 {
        let zones = self.zones.iter().filter(|zone| zone.kind == group);
        zones.map(|zone| self.depth_m(&zone.shape, point)).fold(f64::INFINITY, f64::min)
    }

    /// Distance to the border of a shape \[m\], negative outside.
    fn depth_m(&self, shape: &Shape, point: &Vector2<f64>) -> f64 {
        match *shape {
            Shape::Circle { center, radius_m } => radius_m - (point - center).norm(),
            Shape::Polygon { first, len } => {
                polygon_depth_m(self.vertices.get(first..first + len).unwrap_or_default(), point)
            }
        }
    }
}

fn is_finite(point: &Vector2<f64>) -> bool {
    point.x.is_finite() && point.y.is_finite()
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
