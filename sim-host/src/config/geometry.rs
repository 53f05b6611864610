//! Boxes, solids and points, as far as checks need them.

use std::collections::BTreeSet;
use std::f64::consts::PI;

use nalgebra::Vector3;
use rapier3d::parry::math::Vec3;
use rapier3d::parry::query::PointQuery;
use rapier3d::parry::shape::ConvexPolyhedron;
use rapier3d::parry::transformation::try_convex_hull;

use crate::world::{Cuboid, Mesh, Shape, Solid};

/// Half the thickness of a surface that has none \[m\], Bullet's margin.
const SKIN: f64 = 1e-3;

/// \[rad\].
const GOLDEN_ANGLE: f64 = PI * (3.0 - 2.236_067_977_499_79);

/// Whether `point` is inside, not on the surface, as the simulation tests it.
pub(crate) fn contains(cuboid: &Cuboid, point: &Vector3<f32>) -> bool {
    (0..3).all(|axis| cuboid.low[axis] < point[axis] && point[axis] < cuboid.high[axis])
}

/// Whether all of `inner` is inside.
pub(crate) fn surrounds(cuboid: &Cuboid, inner: &Cuboid) -> bool {
    contains(cuboid, &inner.low) && contains(cuboid, &inner.high)
}

/// Distance between two boxes \[m\], zero where they overlap.
pub(crate) fn gap(one: &Cuboid, other: &Cuboid) -> f32 {
    (one.low - other.high).sup(&(other.low - one.high)).sup(&Vector3::zeros()).norm()
}

/// Whether `point` \[m, world\] is inside the solid; points on the surface are not, except those of a hull.
pub(crate) fn holds(solid: &Solid, point: &Vector3<f64>) -> bool {
    let local = solid.pose.world_from_body.rotate_inverse(point - solid.pose.position);
    match &solid.shape {
        Shape::Cuboid(half) => (0..3).all(|axis| local[axis].abs() < half[axis]),
        Shape::Cylinder { radius, half_height } => {
            local.x.hypot(local.y) < *radius && local.z.abs() < *half_height
        }
        Shape::Sphere(radius) => local.norm() < *radius,
        Shape::Hull(points) | Shape::Mesh(Mesh { hull: points, .. }) => {
            convex(points).is_some_and(|hull| hull.contains_local_point(single(&local)))
        }
    }
}

/// The convex hull of points \[m\]; `None` where they span no volume.
pub(crate) fn convex(points: &[Vector3<f64>]) -> Option<ConvexPolyhedron> {
    if thickness(points) < 1e-6 {
        return None;
    }
    ConvexPolyhedron::from_convex_hull(&points.iter().map(single).collect::<Vec<_>>())
}

/// How far points reach out of a plane through three of them that are far apart \[m\].
fn thickness(points: &[Vector3<f64>]) -> f64 {
    let (_, normal, out) = plane(points);
    normal.dot(&out).abs()
}

/// Of a plane through three points that are far apart: an edge across \[m\], its unit normal, and from the first point to the
/// farthest outside \[m\].
fn plane(points: &[Vector3<f64>]) -> (Vector3<f64>, Vector3<f64>, Vector3<f64>) {
    let Some((first, others)) = points.split_first() else { return Default::default() };
    let farthest = |measure: &dyn Fn(&Vector3<f64>) -> f64| {
        let edges = others.iter().map(|point| point - first);
        edges.max_by(|one, other| measure(one).total_cmp(&measure(other))).unwrap_or_default()
    };
    let along = farthest(&|edge| edge.norm());
    let across = farthest(&|edge| along.cross(edge).norm());
    let across = across - along * (along.dot(&across) / along.norm_squared().max(f64::MIN_POSITIVE));
    let normal = along.cross(&across).try_normalize(0.0).unwrap_or_default();
    (across, normal, farthest(&|edge| normal.dot(edge).abs()))
}

/// Points in one plane, a little above and a little below it; `None` where they are on one line.
pub(crate) fn thickened(points: &[Vector3<f64>]) -> Option<Vec<Vector3<f64>>> {
    let (across, normal, _) = plane(points);
    let both = |point: &Vector3<f64>| [point + normal * SKIN, point - normal * SKIN];
    (across.norm() > 1e-6).then(|| points.iter().flat_map(both).collect())
}

/// Corners of the convex hull of points \[m\]; where those are more than `limit`, the ones that are farthest in directions
/// spread evenly, as many, so that it lies inside of the hull.
pub(crate) fn convex_corners(points: &[Vector3<f64>], limit: usize) -> Option<Vec<Vector3<f64>>> {
    let (corners, _) = try_convex_hull(&points.iter().map(single).collect::<Vec<_>>()).ok()?;
    let corners: Vec<_> = corners.iter().map(|corner| Vector3::new(corner.x, corner.y, corner.z).cast()).collect();
    if corners.len() <= limit {
        return Some(corners);
    }
    let farthest = |number: usize| {
        // A golden spiral.
        let z = 1.0 - 2.0 * (number as f64 + 0.5) / limit as f64;
        let (sine, cosine) = libm::sincos(GOLDEN_ANGLE * number as f64);
        let across = (1.0 - z * z).sqrt();
        let direction = Vector3::new(across * cosine, across * sine, z);
        let along = |corner: &Vector3<f64>| corner.dot(&direction);
        (0..corners.len()).max_by(|one, other| along(&corners[*one]).total_cmp(&along(&corners[*other])))
    };
    let kept: BTreeSet<usize> = (0..limit).filter_map(farthest).collect();
    Some(kept.into_iter().map(|index| corners[index]).collect())
}

fn single(point: &Vector3<f64>) -> Vec3 {
    Vec3::new(point.x as f32, point.y as f32, point.z as f32)
}
