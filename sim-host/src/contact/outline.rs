//! Outlines of drones and bodies as parry's convex shapes.

use core::f64::consts::{FRAC_PI_2, TAU};

use kestrel_core::airframe::Airframe;
use kestrel_core::attitude::Attitude;
use nalgebra::{Matrix3, Vector3};
use rapier3d::geometry::SharedShape;
use rapier3d::parry::query::{DefaultQueryDispatcher, QueryDispatcher as _};
use rapier3d::parry::shape::ConvexPolyhedron;

use super::frame::{compose, relative, to_pose, to_vector};
use crate::world::{Mesh, Pose, Shape};

/// Corners of one face of the drone's prism, as many as the reference gives a URDF cylinder.
const CORNERS: usize = 32;

/// Steps across a hull on the grid of `btConvexHullComputer`.
const HULL_GRID: f64 = 10_216.0;

/// Thickness of the skin around the drone's prism on which it rests \[m\]: the reference's margin of a URDF shape.
pub(super) const MARGIN: f64 = 1e-3;

/// A convex shape in the frame of the body that carries it.
#[derive(Clone)]
pub(super) struct Outline {
    pub(super) shape: SharedShape,
    /// Of the shape in the body.
    pub(super) pose: Pose,
    /// The same shape in `f64`, for what is farthest in a direction.
    extremes: Extremes,
    /// Of the sphere around the body's origin that holds the shape \[m\].
    pub(super) radius: f64,
}

/// A side of something.
#[derive(Clone, Copy)]
pub(super) struct Plane {
    /// On it \[m, world\].
    pub(super) point: Vector3<f64>,
    /// Outwards, world.
    pub(super) normal: Vector3<f64>,
}

impl Plane {
    pub(super) fn floor() -> Self {
        Self { point: Vector3::zeros(), normal: Vector3::z() }
    }
}

/// What can be farthest in a direction.
#[derive(Clone)]
enum Extremes {
    Cuboid(Vector3<f64>),
    /// About y, as parry's.
    Cylinder {
        radius: f64,
        half_height: f64,
    },
    Sphere(f64),
    Corners(Vec<Vector3<f64>>),
}

impl Outline {
    /// A body of a world.
    ///
    /// # Panics
    /// If the points of a hull lie in one plane.
    pub(super) fn of_shape(shape: &Shape) -> Self {
        match shape {
            Shape::Cuboid(half) => {
                let [x, y, z] = [half.x as f32, half.y as f32, half.z as f32];
                Self {
                    shape: SharedShape::cuboid(x, y, z),
                    pose: Pose::at(Vector3::zeros()),
                    extremes: Extremes::Cuboid(*half),
                    radius: half.norm(),
                }
            }
            // parry's cylinders stand on y.
            Shape::Cylinder { radius, half_height } => Self {
                shape: SharedShape::cylinder(*half_height as f32, *radius as f32),
                pose: upright(Vector3::zeros()),
                extremes: Extremes::Cylinder { radius: *radius, half_height: *half_height },
                radius: radius.hypot(*half_height),
            },
            Shape::Sphere(radius) => Self {
                shape: SharedShape::ball(*radius as f32),
                pose: Pose::at(Vector3::zeros()),
                extremes: Extremes::Sphere(*radius),
                radius: *radius,
            },
            Shape::Hull(points) | Shape::Mesh(Mesh { hull: points, .. }) => Self {
                shape: convex_hull(points),
                pose: Pose::at(Vector3::zeros()),
                extremes: Extremes::Corners(points.clone()),
                radius: points.iter().map(Vector3::norm).fold(0.0, f64::max),
            },
        }
    }

    /// The drone's hull as Bullet has it: the convex hull of a prism inscribed in the URDF's cylinder.
    pub(super) fn of_drone(airframe: &Airframe) -> Self {
        let corners = prism(airframe.collision_radius, 0.5 * airframe.collision_height);
        let offset = airframe.collision_offset;
        Self {
            shape: convex_hull(&corners),
            pose: Pose::at(Vector3::new(0.0, 0.0, offset)),
            extremes: Extremes::Corners(corners),
            radius: airframe.collision_radius.hypot(0.5 * airframe.collision_height + offset.abs()),
        }
    }

    /// `plane.urdf` as Bullet has it.
    pub(super) fn of_floor() -> Self {
        let below = Pose::at(Vector3::new(0.0, 0.0, -5.0));
        Self { pose: below, ..Self::of_shape(&Shape::Cuboid(Vector3::new(100.0, 100.0, 5.0))) }
    }

    /// The point that is farthest in a direction, both in the frame of the shape; the first of several.
    fn farthest(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        match &self.extremes {
            Extremes::Cuboid(half) => half.zip_map(direction, f64::copysign),
            Extremes::Cylinder { radius, half_height } => {
                let across = direction.x.hypot(direction.z);
                let scale = if across > 0.0 { radius / across } else { 0.0 };
                Vector3::new(direction.x * scale, half_height.copysign(direction.y), direction.z * scale)
            }
            Extremes::Sphere(radius) => ball(direction, *radius),
            Extremes::Corners(corners) => {
                let (mut farthest, mut most) = (corners[0], f64::NEG_INFINITY);
                for corner in corners {
                    let along = corner.dot(direction);
                    if along > most {
                        (farthest, most) = (*corner, along);
                    }
                }
                farthest
            }
        }
    }

    /// The farthest point of the core that Bullet rounds by the margin: of a box, a cylinder or a ball what is inside by the
    /// margin, of a hull all of it. The direction is in the frame of the shape.
    pub(super) fn farthest_of_core(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        match &self.extremes {
            Extremes::Cuboid(half) => {
                half.zip_map(direction, |half, along| if along >= 0.0 { half - MARGIN } else { MARGIN - half })
            }
            Extremes::Cylinder { .. } => {
                let surface = self.farthest(direction);
                let across = surface.x.hypot(surface.z);
                let scale = if across > 0.0 { (across - MARGIN) / across } else { 0.0 };
                Vector3::new(surface.x * scale, surface.y - MARGIN.copysign(surface.y), surface.z * scale)
            }
            Extremes::Sphere(radius) => ball(direction, radius - MARGIN),
            Extremes::Corners(_) => self.farthest(direction),
        }
    }

    /// The side of a box with this pose that is all of it that a ball can meet, if there is one: that the middle of the ball is
    /// outside of, and within whose edges the ball is.
    pub(super) fn side_met(&self, shape_pose: &Pose, middle: &Vector3<f64>, radius: f64) -> Option<Plane> {
        let Extremes::Cuboid(half) = &self.extremes else { return None };
        let local = shape_pose.world_from_body.rotate_inverse(middle - shape_pose.position);
        let beyond = local.abs() - half;
        let axis = beyond.imax();
        let within = (0..3).all(|other| other == axis || beyond[other] <= -radius);
        (beyond[axis] >= 0.0 && within).then(|| {
            let sign = 1.0_f64.copysign(local[axis]);
            let normal = shape_pose.world_from_body.rotate(Vector3::ith(axis, sign));
            Plane { point: shape_pose.position + normal * half[axis], normal }
        })
    }

    /// Its lowest point when the shape has this pose, world.
    pub(super) fn lowest(&self, shape_pose: &Pose) -> Vector3<f64> {
        let down = shape_pose.world_from_body.rotate_inverse(-Vector3::z());
        compose(shape_pose, &Pose::at(self.farthest(&down))).position
    }

    /// Moments of inertia about the body's origin, per mass \[m²\], body.
    pub(super) fn inertia_per_mass(&self) -> Matrix3<f64> {
        let mass = self.shape.mass_properties(1.0);
        let columns = mass.reconstruct_inertia_matrix().to_cols_array().map(f64::from);
        let turn = self.pose.world_from_body.matrix();
        turn * Matrix3::from_column_slice(&columns) * turn.transpose() / f64::from(mass.mass())
    }

    /// The shape's pose when the body has this one.
    pub(super) fn placed(&self, body: &Pose) -> Pose {
        compose(body, &self.pose)
    }
}

/// The point of a ball that is farthest in a direction; its middle when there is none.
fn ball(direction: &Vector3<f64>, radius: f64) -> Vector3<f64> {
    direction.try_normalize(0.0).unwrap_or_default() * radius
}

/// An upright cylinder of parry's.
pub(super) fn upright(position: Vector3<f64>) -> Pose {
    Pose { position, world_from_body: Attitude::from_axis_angle(Vector3::x(), FRAC_PI_2) }
}

/// Corners of the prism in the order of the reference's hull, of which the first of equals is the one that touches: from
/// the left on to both sides, and `btConvexHullComputer` rounds them towards zero on a grid.
fn prism(radius: f64, half_height: f64) -> Vec<Vector3<f64>> {
    let step = 2.0 * radius / HULL_GRID;
    let on_grid = |value: f64| libm::trunc(value * (1.0 / step)) * step;
    let around: Vec<[f64; 2]> = (0..CORNERS)
        .map(|place| if place % 2 == 1 { place.div_ceil(2) } else { (CORNERS - place / 2) % CORNERS })
        .map(|corner| libm::sincos(TAU * corner as f64 / CORNERS as f64))
        .map(|(sine, cosine)| [on_grid(radius * sine), on_grid(radius * cosine)])
        .collect();
    let at = |place: usize, height: f64| Vector3::new(around[place][0], around[place][1], height);
    let mut corners = vec![at(0, half_height)];
    for place in 0..CORNERS - 1 {
        corners.extend([at(place + 1, half_height), at(place, -half_height)]);
    }
    corners.push(at(CORNERS - 1, -half_height));
    corners
}

pub(super) fn convex_hull(points: &[Vector3<f64>]) -> SharedShape {
    let points: Vec<_> = points.iter().map(to_vector).collect();
    SharedShape::convex_hull(&points).expect("a hull has four points that are not in one plane")
}

/// Outward unit normals of the faces of a hull.
pub(crate) fn face_normals(points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let hull = convex_hull(points);
    let faces = hull.as_convex_polyhedron().map(ConvexPolyhedron::faces).unwrap_or_default();
    faces.iter().map(|face| Vector3::new(face.normal.x, face.normal.y, face.normal.z).cast().normalize()).collect()
}

/// Distance between two shapes \[m\], zero where they overlap.
pub(super) fn distance(shapes: [&SharedShape; 2], poses: [&Pose; 2]) -> f64 {
    let between = to_pose(&relative(poses[0], poses[1]));
    let distance = DefaultQueryDispatcher.distance(&between, &*shapes[0].0, &*shapes[1].0);
    f64::from(distance.expect("parry knows the distance of any two convex shapes").distance)
}
