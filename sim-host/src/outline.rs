//! Outlines of solids as flat faces and sharp edges, for pictures.

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;
use rapier3d::math::Vector;
use rapier3d::parry::transformation::try_convex_hull;

use crate::world::{Mesh, Pose, Shape, Solid};

/// Sides of a drawn cylinder, and of a sphere around its axis.
const SIDES: usize = 24;

/// Rings of a drawn sphere from pole to pole.
const RINGS: usize = 12;

/// Faces whose normals differ by less are one face, and the edge between faces that differ by less than the other is
/// smooth: cosines of 1° and 20°.
const SAME_FACE: f64 = 0.99985;
const SMOOTH_EDGE: f64 = 0.94;

/// The surface of a convex solid; of a mesh its hull.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// Flat convex faces \[m\], counterclockwise as seen from outside.
    pub faces: Vec<Vec<Vector3<f32>>>,
    /// Edges that are seen as such \[m\].
    pub edges: Vec<[Vector3<f32>; 2]>,
}

impl Outline {
    /// Around the shape's own origin.
    pub fn of(shape: &Shape) -> Self {
        let faces = match shape {
            Shape::Cuboid(half) => cuboid(half),
            Shape::Cylinder { radius, half_height } => prism(*radius, *half_height),
            Shape::Sphere(radius) => ball(*radius),
            Shape::Hull(points) | Shape::Mesh(Mesh { hull: points, .. }) => hull(points),
        };
        let edges = sharp_edges(&faces);
        let single = |point: Vector3<f64>| point.cast();
        Self {
            faces: faces.into_iter().map(|face| face.into_iter().map(single).collect()).collect(),
            edges: edges.into_iter().map(|ends| ends.map(single)).collect(),
        }
    }

    /// Where the solid stands, world.
    pub fn placed(solid: &Solid) -> Self {
        let Pose { position, world_from_body: Attitude { w, x, y, z } } = solid.pose;
        let [w, x, y, z] = [w, x, y, z].map(|part| part as f32);
        Self::of(&solid.shape).moved(position.cast(), &Attitude { w, x, y, z })
    }

    /// Turned, then moved \[m\].
    #[must_use]
    pub fn moved(&self, position: Vector3<f32>, turn: &Attitude<f32>) -> Self {
        let place = |point: &Vector3<f32>| position + turn.rotate(*point);
        Self {
            faces: self.faces.iter().map(|face| face.iter().map(place).collect()).collect(),
            edges: self.edges.iter().map(|[from, to]| [place(from), place(to)]).collect(),
        }
    }

    /// Lowest and highest coordinates \[m\].
    pub fn bounds(&self) -> (Vector3<f32>, Vector3<f32>) {
        let nothing = (Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY));
        self.faces.iter().flatten().fold(nothing, |(low, high), point| (low.inf(point), high.sup(point)))
    }
}

type Face = Vec<Vector3<f64>>;

fn cuboid(half: &Vector3<f64>) -> Vec<Face> {
    let corner = |signs: [f64; 3]| half.component_mul(&Vector3::from(signs));
    let face = |axis: usize, side: f64| {
        let turn = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let place = |[u, v]: [f64; 2]| {
            let mut signs = [side; 3];
            (signs[(axis + 1) % 3], signs[(axis + 2) % 3]) = (u * side, v);
            corner(signs)
        };
        turn.map(place).into()
    };
    (0..3).flat_map(|axis| [face(axis, 1.0), face(axis, -1.0)]).collect()
}

fn prism(radius: f64, half_height: f64) -> Vec<Face> {
    let point = |side: usize, z: f64| {
        let (sine, cosine) = libm::sincos((side % SIDES) as f64 * (std::f64::consts::TAU / SIDES as f64));
        Vector3::new(radius * cosine, radius * sine, z)
    };
    let top = (0..SIDES).map(|side| point(side, half_height)).collect();
    let bottom = (0..SIDES).rev().map(|side| point(side, -half_height)).collect();
    let around = |side: usize| {
        vec![
            point(side, -half_height),
            point(side + 1, -half_height),
            point(side + 1, half_height),
            point(side, half_height),
        ]
    };
    [top, bottom].into_iter().chain((0..SIDES).map(around)).collect()
}

/// Faces between circles of latitude, and a cap at each end.
fn ball(radius: f64) -> Vec<Face> {
    let point = |side: usize, ring: usize| {
        let (sine, cosine) = libm::sincos((side % SIDES) as f64 * (std::f64::consts::TAU / SIDES as f64));
        let (across, along) = libm::sincos(ring as f64 * (std::f64::consts::PI / RINGS as f64));
        radius * Vector3::new(across * cosine, across * sine, along)
    };
    let top = (0..SIDES).map(|side| point(side, 1)).collect();
    let bottom = (0..SIDES).rev().map(|side| point(side, RINGS - 1)).collect();
    let face = |(ring, side): (usize, usize)| {
        vec![point(side, ring + 1), point(side + 1, ring + 1), point(side + 1, ring), point(side, ring)]
    };
    let around = (1..RINGS - 1).flat_map(|ring| (0..SIDES).map(move |side| (ring, side)));
    [top, bottom].into_iter().chain(around.map(face)).collect()
}

/// Faces of the convex hull; none for points that have none.
fn hull(points: &[Vector3<f64>]) -> Vec<Face> {
    let single: Vec<_> = points.iter().map(|p| Vector::new(p.x as f32, p.y as f32, p.z as f32)).collect();
    let Ok((vertices, triangles)) = try_convex_hull(&single) else { return Vec::new() };
    let vertex = |index: u32| {
        let Vector { x, y, z } = vertices[index as usize];
        Vector3::new(x, y, z).cast::<f64>()
    };
    let mut faces: Vec<(Vector3<f64>, Face)> = Vec::new();
    for triangle in triangles {
        let corners: Face = triangle.map(vertex).into();
        let normal = normal(&corners);
        match faces.iter_mut().find(|(other, _)| other.dot(&normal) > SAME_FACE) {
            Some((_, face)) => face.extend(corners),
            None => faces.push((normal, corners)),
        }
    }
    faces.into_iter().map(|(normal, corners)| in_order(&normal, corners)).collect()
}

/// The corners of a face, each once, counterclockwise around its normal.
fn in_order(normal: &Vector3<f64>, corners: Face) -> Face {
    let middle = corners.iter().sum::<Vector3<f64>>() / corners.len() as f64;
    let first = (corners[0] - middle).normalize();
    let second = normal.cross(&first);
    let angle = |corner: &Vector3<f64>| libm::atan2(second.dot(&(corner - middle)), first.dot(&(corner - middle)));
    let mut sorted = corners;
    sorted.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    sorted.dedup();
    sorted
}

fn normal(face: &Face) -> Vector3<f64> {
    (face[1] - face[0]).cross(&(face[2] - face[0])).normalize()
}

/// Edges between faces that meet at an angle; each is run through one way by one face, the other way by the other.
fn sharp_edges(faces: &[Face]) -> Vec<[Vector3<f64>; 2]> {
    let normals: Vec<_> = faces.iter().map(normal).collect();
    let sides: Vec<_> = faces
        .iter()
        .enumerate()
        .flat_map(|(face, corners)| {
            let next = |index: usize| corners[(index + 1) % corners.len()];
            corners.iter().enumerate().map(move |(index, from)| (face, [*from, next(index)]))
        })
        .collect();
    let sharp = |(index, (face, [from, to])): (usize, &(usize, [Vector3<f64>; 2]))| {
        let twin = sides.iter().position(|(_, ends)| ends == &[*to, *from]);
        let once = twin.is_none_or(|twin| index < twin);
        let smooth = twin.is_some_and(|twin| normals[*face].dot(&normals[sides[twin].0]) > SMOOTH_EDGE);
        (once && !smooth).then_some([*from, *to])
    };
    sides.iter().enumerate().filter_map(sharp).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The volume inside, by the divergence theorem: only closed surfaces that face outward have the right one.
    fn volume(outline: &Outline) -> f32 {
        let cone = |a: &Vector3<f32>, b: &Vector3<f32>, c: &Vector3<f32>| a.dot(&b.cross(c)) / 6.0;
        let of =
            |face: &Vec<Vector3<f32>>| face.windows(2).map(|pair| cone(&face[0], &pair[0], &pair[1])).sum::<f32>();
        outline.faces.iter().map(of).sum()
    }

    #[test]
    fn a_box_has_six_faces_and_twelve_edges() {
        let outline = Outline::of(&Shape::Cuboid(Vector3::new(0.5, 1.0, 1.5)));
        assert_eq!((outline.faces.len(), outline.edges.len()), (6, 12));
        assert!((volume(&outline) - 6.0).abs() < 1e-5, "{}", volume(&outline));
        assert_eq!(outline.bounds().1, Vector3::new(0.5, 1.0, 1.5));
    }

    #[test]
    fn a_cylinder_shows_its_rims_only() {
        let outline = Outline::of(&Shape::Cylinder { radius: 1.0, half_height: 0.5 });
        assert_eq!((outline.faces.len(), outline.edges.len()), (SIDES + 2, 2 * SIDES));
        assert!((volume(&outline) - std::f32::consts::PI).abs() < 0.04);
    }

    #[test]
    fn the_hull_of_a_boxs_corners_is_the_box() {
        let half = Vector3::new(0.2, 0.3, 0.4);
        let corner = |bits: usize| {
            let sign = |axis: usize| if bits >> axis & 1 == 1 { 1.0 } else { -1.0 };
            Vector3::new(half.x * sign(0), half.y * sign(1), half.z * sign(2))
        };
        let outline = Outline::of(&Shape::Hull((0..8).map(corner).collect()));
        assert_eq!((outline.faces.len(), outline.edges.len()), (6, 12));
        assert!(outline.faces.iter().all(|face| face.len() == 4));
        assert!((volume(&outline) - 8.0 * 0.024).abs() < 1e-5, "{}", volume(&outline));
    }

    #[test]
    fn a_turned_solid_reaches_its_bounds() {
        let mut solid = Solid::block("box", Vector3::new(-1.0, -1.0, 0.0), Vector3::new(1.0, 1.0, 2.0));
        solid.pose.world_from_body = Attitude::from_axis_angle(Vector3::z(), 0.7);
        let (low, high) = Outline::placed(&solid).bounds();
        let bounds = solid.bounds();
        assert!((low - bounds.low).norm() < 1e-5 && (high - bounds.high).norm() < 1e-5);
    }
}
