//! The place a drone flies in: solids as data, static or movable.

mod mesh;

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use mesh::{Mesh, Triangle};

/// Gap at which the reference reports contact between the drone and a box \[m\] (two margins and a threshold).
pub const BOX_CONTACT_GAP: f64 = 2.78e-3;

/// Gap at which the reference reports contact with the floor \[m\].
pub const FLOOR_CONTACT_GAP: f64 = 2.0e-3;

/// Everything in one place that a drone can see or touch, except drones.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// Whether z = 0 is solid.
    pub floor: Floor,
    /// Bodies that never move.
    pub solids: Vec<Solid>,
    /// Bodies that move; those that a drone can push, and people, are where their pose says at the start of every episode, the
    /// others where they are while the goal is at the aviary's.
    pub movables: Vec<Movable>,
}

/// Whether a floor at z = 0 can be hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Floor {
    /// A drone that touches z = 0 collides.
    Solid,
    /// Nothing below.
    Absent,
}

/// One body, convex to the touch.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// What it is, for messages and plans: `pillar`, `couch: seat`.
    pub name: String,
    /// Its outline.
    pub shape: Shape,
    /// Where its centre is and how it is turned.
    pub pose: Pose,
    /// What touching it means.
    pub role: Role,
    /// Coulomb friction; the reference multiplies those of both bodies.
    pub friction: f64,
    /// Gap at which the `bullet` physics reports contact \[m\]; `clean` reports it at none.
    pub contact_gap: f64,
    /// Red, green, blue in \[0, 1\].
    pub colour: [f32; 3],
    /// What cameras see in place of the outline, under the same label; the outline itself where there is none.
    pub visual: Option<VisualGeometry>,
}

/// A shape that is seen but not touched.
#[derive(Clone, Debug, PartialEq)]
pub struct VisualGeometry {
    /// A mesh as its triangles; of a movable as its hull.
    pub shape: Shape,
    /// Where it is in the body's frame \[m\], and how it is turned from there.
    pub pose_in_body: Pose,
}

/// A body that does not stay where it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Movable {
    /// Its outline, surface and place at the start.
    pub solid: Solid,
    /// What moves it.
    pub drive: Drive,
}

/// What moves a movable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// Gravity and whatever pushes it.
    Pushed {
        /// \[kg\].
        mass: f64,
    },
    /// It goes where the goal of the first drone goes, whatever is in its way: a landing pad on wheels.
    Carried,
    /// It walks to and fro, whoever is in its way: a person.
    Walking(Walk),
}

/// To and fro between two points, without a rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Walk {
    /// Where it turns round, apart from each other \[m, world\].
    pub ends: [Vector3<f64>; 2],
    /// With which it begins: along the line between them, one way or the other \[m/s, world\].
    pub velocity: Vector3<f64>,
}

impl Walk {
    /// Where somebody has come to who went past an end or not, and its velocity from there \[m/s, world\]: it has turned round
    /// where it passed one.
    pub(crate) fn turned(&self, position: Vector3<f64>, velocity: Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let [from, to] = self.ends;
        let (length, speed) = ((to - from).norm(), self.velocity.norm());
        let along = (to - from) / length;
        let passed = (position - from).dot(&along);
        if passed > length {
            (to - along * (passed - length), -along * speed)
        } else if passed < 0.0 {
            (from - along * passed, along * speed)
        } else {
            (position, velocity)
        }
    }
}

impl Movable {
    /// A body of some mass \[kg\] that a drone can push.
    pub fn pushed(solid: Solid, mass: f64) -> Self {
        Self { solid, drive: Drive::Pushed { mass } }
    }
}

/// Outline of a body around its own origin.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A box of these half extents \[m\].
    Cuboid(Vector3<f64>),
    /// A cylinder about its z axis.
    Cylinder {
        /// \[m\].
        radius: f64,
        /// \[m\].
        half_height: f64,
    },
    /// A ball of this radius \[m\].
    Sphere(f64),
    /// The convex hull of these points \[m\], at least four, not in one plane.
    Hull(Vec<Vector3<f64>>),
    /// Triangles.
    Mesh(Mesh),
}

/// Axis-aligned box \[m, world\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cuboid {
    /// Corner with the smallest coordinates.
    pub low: Vector3<f32>,
    /// Corner with the greatest coordinates.
    pub high: Vector3<f32>,
}

/// A place and an orientation, in the world unless something else is said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// \[m\], world.
    pub position: Vector3<f64>,
    /// Unit quaternion.
    pub world_from_body: Attitude<f64>,
}

/// What touching a body means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// A collision.
    Obstacle,
    /// A landing.
    Landing,
    /// Nothing: it can be seen but not touched.
    Decoration,
}

impl World {
    /// Nothing but a floor.
    pub fn empty() -> Self {
        Self { floor: Floor::Solid, solids: Vec::new(), movables: Vec::new() }
    }

    /// The solids that can be touched.
    pub fn tangible(&self) -> impl Iterator<Item = &Solid> {
        self.solids.iter().filter(|solid| solid.role != Role::Decoration)
    }

    /// Axis-aligned bounds of everything that can be touched, movables where they start, in `f32` for drawing.
    pub fn bounds(&self) -> Vec<Cuboid> {
        self.tangible().chain(self.movables.iter().map(|movable| &movable.solid)).map(Solid::bounds).collect()
    }
}

impl Solid {
    /// An axis-aligned grey box from corner to corner \[m, world\].
    pub fn block(name: &str, low: Vector3<f64>, high: Vector3<f64>) -> Self {
        Self {
            name: name.to_owned(),
            shape: Shape::Cuboid((high - low) / 2.0),
            pose: Pose::at((low + high) / 2.0),
            role: Role::Obstacle,
            friction: 0.5,
            contact_gap: BOX_CONTACT_GAP,
            colour: [0.6; 3],
            visual: None,
        }
    }

    /// What cameras see of it, and where \[m, world\].
    pub fn seen(&self) -> (&Shape, Pose) {
        match &self.visual {
            None => (&self.shape, self.pose),
            Some(VisualGeometry { shape, pose_in_body }) => (shape, pose_in_body.within(&self.pose)),
        }
    }

    /// Its axis-aligned bounds \[m, world\].
    pub fn bounds(&self) -> Cuboid {
        let (low, high) = self.extent();
        Cuboid { low: low.cast(), high: high.cast() }
    }

    /// Its lowest and highest coordinates \[m, world\], as it is touched.
    pub fn extent(&self) -> (Vector3<f64>, Vector3<f64>) {
        let rows = self.pose.world_from_body.rows();
        let (low, high) = self.shape.extent_along(&rows);
        (self.pose.position + low, self.pose.position + high)
    }
}

impl Shape {
    /// Distance of its farthest point from its origin \[m\].
    pub fn reach(&self) -> f64 {
        match self {
            Self::Cuboid(half) => half.norm(),
            Self::Cylinder { radius, half_height } => radius.hypot(*half_height),
            Self::Sphere(radius) => *radius,
            Self::Hull(points) | Self::Mesh(Mesh { corners: points, .. }) => {
                points.iter().map(Vector3::norm).fold(0.0, f64::max)
            }
        }
    }

    /// So many times as large.
    #[must_use]
    pub fn scaled(self, scale: f64) -> Self {
        match self {
            Self::Cuboid(half) => Self::Cuboid(half * scale),
            Self::Cylinder { radius, half_height } => {
                Self::Cylinder { radius: radius * scale, half_height: half_height * scale }
            }
            Self::Sphere(radius) => Self::Sphere(radius * scale),
            Self::Hull(points) => Self::Hull(points.into_iter().map(|point| point * scale).collect()),
            Self::Mesh(mesh) => Self::Mesh(mesh.scaled(scale)),
        }
    }

    /// Extent along three directions, the rows of a rotation matrix, relative to the shape's origin \[m\].
    fn extent_along(&self, rows: &[[f64; 3]; 3]) -> (Vector3<f64>, Vector3<f64>) {
        let directions = rows.map(Vector3::from);
        match self {
            Self::Cuboid(half) => {
                let reach = Vector3::from(directions.map(|direction| direction.abs().dot(half)));
                (-reach, reach)
            }
            Self::Cylinder { radius, half_height } => {
                let reach = Vector3::from(directions.map(|direction| {
                    let across = direction.x.hypot(direction.y);
                    radius * across + half_height * direction.z.abs()
                }));
                (-reach, reach)
            }
            Self::Sphere(radius) => (Vector3::repeat(-radius), Vector3::repeat(*radius)),
            Self::Hull(points) | Self::Mesh(Mesh { hull: points, .. }) => {
                let along = |pick: fn(f64, f64) -> f64| {
                    let of = |direction: Vector3<f64>| points.iter().map(|p| direction.dot(p)).reduce(pick);
                    Vector3::from(directions.map(|direction| of(direction).unwrap_or(0.0)))
                };
                (along(f64::min), along(f64::max))
            }
        }
    }
}

impl Pose {
    /// Upright at a position \[m, world\].
    pub fn at(position: Vector3<f64>) -> Self {
        Self { position, world_from_body: Attitude::level() }
    }

    /// In the world, if it is in the frame of a body that is there.
    #[must_use]
    pub fn within(&self, body: &Self) -> Self {
        Self {
            position: body.position + body.world_from_body.rotate(self.position),
            world_from_body: body.world_from_body.after(&self.world_from_body),
        }
    }

    /// In the frame of a body, if both are in the world; undone by [`Self::within`].
    #[must_use]
    pub fn relative_to(&self, body: &Self) -> Self {
        let Attitude { w, x, y, z } = body.world_from_body;
        let body_from_world = Attitude { w, x: -x, y: -y, z: -z };
        Self {
            position: body.world_from_body.rotate_inverse(self.position - body.position),
            world_from_body: body_from_world.after(&self.world_from_body),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_box_reaches_farther() {
        let mut solid = Solid::block("box", Vector3::new(0.0, -1.0, -0.5), Vector3::new(2.0, 1.0, 0.5));
        assert_eq!(solid.extent(), (Vector3::new(0.0, -1.0, -0.5), Vector3::new(2.0, 1.0, 0.5)));
        solid.pose.world_from_body = Attitude::from_axis_angle(Vector3::z(), core::f64::consts::FRAC_PI_4);
        let (low, high) = solid.extent();
        let reach = core::f64::consts::SQRT_2;
        assert!((high - Vector3::new(1.0 + reach, reach, 0.5)).norm() < 1e-12);
        assert!((low - Vector3::new(1.0 - reach, -reach, -0.5)).norm() < 1e-12);
    }

    #[test]
    fn a_lying_cylinder_is_as_wide_as_it_was_high() {
        let mut solid = Solid::block("rod", Vector3::zeros(), Vector3::zeros());
        solid.shape = Shape::Cylinder { radius: 0.1, half_height: 1.0 };
        solid.pose.world_from_body = Attitude::from_axis_angle(Vector3::y(), core::f64::consts::FRAC_PI_2);
        let (_, high) = solid.extent();
        assert!((high - Vector3::new(1.0, 0.1, 0.1)).norm() < 1e-12);
    }
}
