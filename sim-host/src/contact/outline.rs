//! Outlines of drones and bodies as parry's convex shapes.

use core::f64::consts::{FRAC_PI_2, TAU};

use kestrel_core::airframe::Airframe;
use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;
use rapier3d::geometry::SharedShape;
use rapier3d::parry::query::{DefaultQueryDispatcher, QueryDispatcher as _};

use super::frame::{compose, relative, to_pose, to_vector};
use crate::world::{Pose, Shape};

/// Corners of one face of the drone's prism, as many as PyBullet gives a URDF cylinder.
pub(super) const CORNERS: usize = 32;

/// Thickness of the skin around the drone's prism on which it rests \[m\]: PyBullet's margin of a URDF shape.
pub(super) const MARGIN: f64 = 1e-3;

/// A convex shape in the frame of the body that carries it.
#[derive(Clone)]
pub(super) struct Outline {
    pub(super) shape: SharedShape,
    /// Of the shape in the body.
    pub(super) pose: Pose,
    /// Of the sphere around the body's origin that holds the shape \[m\].
    pub(super) radius: f64,
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
                Self { shape: SharedShape::cuboid(x, y, z), pose: Pose::at(Vector3::zeros()), radius: half.norm() }
            }
            // parry's cylinders stand on y.
            Shape::Cylinder { radius, half_height } => Self {
                shape: SharedShape::cylinder(*half_height as f32, *radius as f32),
                pose: upright(Vector3::zeros()),
                radius: radius.hypot(*half_height),
            },
            Shape::Hull(points) => Self {
                shape: convex_hull(points),
                pose: Pose::at(Vector3::zeros()),
                radius: points.iter().map(Vector3::norm).fold(0.0, f64::max),
            },
        }
    }

    /// The drone's hull as Bullet has it: the convex hull of a prism inscribed in the URDF's cylinder.
    pub(super) fn of_drone(airframe: &Airframe) -> Self {
        let half_height = 0.5 * airframe.collision_height;
        let corners: Vec<_> = [-half_height, half_height]
            .into_iter()
            .flat_map(|height| prism_corners(airframe).map(move |[x, y]| Vector3::new(x, y, height)))
            .collect();
        let middle = Vector3::new(0.0, 0.0, airframe.collision_offset);
        Self {
            shape: convex_hull(&corners),
            pose: Pose::at(middle),
            radius: airframe.collision_radius.hypot(half_height + airframe.collision_offset.abs()),
        }
    }

    /// The shape's pose when the body has this one.
    pub(super) fn placed(&self, body: &Pose) -> Pose {
        compose(body, &self.pose)
    }
}

/// An upright cylinder of parry's.
pub(super) fn upright(position: Vector3<f64>) -> Pose {
    Pose { position, world_from_body: Attitude::from_axis_angle(Vector3::x(), FRAC_PI_2) }
}

/// Corners `[x, y]` of the drone's prism, the first to the left \[m, body\].
pub(super) fn prism_corners(airframe: &Airframe) -> [[f64; 2]; CORNERS] {
    core::array::from_fn(|corner| {
        let (sine, cosine) = libm::sincos(TAU * corner as f64 / CORNERS as f64);
        [airframe.collision_radius * sine, airframe.collision_radius * cosine]
    })
}

fn convex_hull(points: &[Vector3<f64>]) -> SharedShape {
    let points: Vec<_> = points.iter().map(to_vector).collect();
    SharedShape::convex_hull(&points).expect("a hull has four points that are not in one plane")
}

/// Distance between two shapes \[m\], zero where they overlap.
pub(super) fn distance(shapes: [&SharedShape; 2], poses: [&Pose; 2]) -> f64 {
    let between = to_pose(&relative(poses[0], poses[1]));
    let distance = DefaultQueryDispatcher.distance(&between, &*shapes[0].0, &*shapes[1].0);
    f64::from(distance.expect("parry knows the distance of any two convex shapes").distance)
}
