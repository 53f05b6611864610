//! Solids as flat outlines.

use std::f64::consts::TAU;

use kestrel_sim::world::{Mesh, Shape, Solid};
use nalgebra::Vector3;

/// Corners of the polygon that stands for a circle.
const CIRCLE_CORNERS: usize = 32;

/// From where a solid is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    /// x to the right, y up.
    Above,
    /// From the right: x to the right, z up.
    Side,
}

impl Direction {
    /// A point of the world in the view \[m\].
    pub(super) fn project(self, point: Vector3<f64>) -> [f64; 2] {
        match self {
            Self::Above => [point.x, point.y],
            Self::Side => [point.x, point.z],
        }
    }

    /// How near a point is to whoever looks \[m\].
    pub(super) fn nearness(self, point: Vector3<f64>) -> f64 {
        match self {
            Self::Above => point.z,
            Self::Side => -point.y,
        }
    }
}

/// Corners of the convex polygon that the solid covers \[m\], counter-clockwise.
pub(super) fn outline(solid: &Solid, direction: Direction) -> Vec<[f64; 2]> {
    let in_world = |local: Vector3<f64>| solid.pose.position + solid.pose.world_from_body.rotate(local);
    hull(corners(&solid.shape).into_iter().map(|corner| direction.project(in_world(corner))).collect())
}

/// Points whose convex hull is the shape.
fn corners(shape: &Shape) -> Vec<Vector3<f64>> {
    let ends = [-1.0, 1.0];
    match shape {
        Shape::Cuboid(half) => ends
            .into_iter()
            .flat_map(|x| ends.map(|y| (x, y)))
            .flat_map(|(x, y)| ends.map(|z| half.component_mul(&Vector3::new(x, y, z))))
            .collect(),
        Shape::Cylinder { radius, half_height } => (0..CIRCLE_CORNERS)
            .flat_map(|corner| {
                let (sine, cosine) = libm::sincos(TAU * corner as f64 / CIRCLE_CORNERS as f64);
                ends.map(|end| Vector3::new(radius * cosine, radius * sine, end * half_height))
            })
            .collect(),
        Shape::Sphere(radius) => (0..=CIRCLE_CORNERS / 2)
            .flat_map(|ring| (0..CIRCLE_CORNERS).map(move |corner| (ring, corner)))
            .map(|(ring, corner)| {
                let (sine, cosine) = libm::sincos(TAU * corner as f64 / CIRCLE_CORNERS as f64);
                let (across, along) = libm::sincos(TAU * ring as f64 / CIRCLE_CORNERS as f64);
                *radius * Vector3::new(across * cosine, across * sine, along)
            })
            .collect(),
        Shape::Hull(points) | Shape::Mesh(Mesh { hull: points, .. }) => points.clone(),
    }
}

/// Convex hull of points in the plane (Andrew's monotone chain).
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|one, other| one[0].total_cmp(&other[0]).then(one[1].total_cmp(&other[1])));
    points.dedup();
    let mut hull = half_hull(points.iter().copied());
    hull.extend(half_hull(points.into_iter().rev()));
    hull
}

/// The hull below points that go from left to right, without the last one.
fn half_hull(points: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    let mut chain: Vec<[f64; 2]> = Vec::new();
    for point in points {
        while let [.., before, last] = chain.as_slice() {
            let turn =
                (last[0] - before[0]) * (point[1] - before[1]) - (last[1] - before[1]) * (point[0] - before[0]);
            if turn > 0.0 {
                break;
            }
            chain.pop();
        }
        chain.push(point);
    }
    chain.pop();
    chain
}
