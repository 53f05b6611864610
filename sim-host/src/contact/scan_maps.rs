//! Worlds as the beams of a [`Scan`] see them, for the simulation's lanes and for firmware alike.

use core::f64::consts::PI;
use std::collections::HashMap;

use kestrel_core::scan::{PARALLEL, ScanMap, Slab};
use nalgebra::Vector3;

use super::outline::face_normals;
use crate::sensor::Scan;
use crate::world::{Floor, Mesh, Shape, Solid, World};

/// Slabs around a cylinder; the prism is wider than it by 0.9 % of the radius at most.
const SIDES: usize = 12;

/// Slabs around a ball; what they enclose is wider than it by 2 % of the radius at most.
const BALL_SIDES: usize = 96;

/// \[rad\].
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// Maps of worlds for one scan. They share beams and normals: what stands in one room stands in another.
#[derive(Clone, Debug)]
pub struct ScanMaps {
    limit: f32,
    near_scale: Option<f32>,
    normals: Vec<[f32; 3]>,
    per_metre: Vec<f32>,
    sides: Vec<[u64; 2]>,
    rooms: Vec<Room>,
}

/// What is in one of the worlds.
#[derive(Clone, Debug)]
struct Room {
    per_descent: Vec<f32>,
    slabs: Vec<Slab>,
    bodies: Vec<u32>,
}

impl ScanMaps {
    /// The solids of these worlds; what moves in them is not seen. Of beams that sweep, their first position.
    pub fn new<'w>(worlds: impl IntoIterator<Item = &'w World>, scan: &Scan) -> Self {
        Self::at(0, worlds, scan)
    }

    /// As [`Self::new`], for another position of beams that sweep.
    pub(super) fn at<'w>(position: usize, worlds: impl IntoIterator<Item = &'w World>, scan: &Scan) -> Self {
        let directions = scan.directions(position);
        let mut normals = Normals::default();
        let rooms = worlds.into_iter().map(|world| Room::new(world, &directions, &mut normals)).collect();
        let Normals { normals, .. } = normals;
        Self {
            limit: scan.limit,
            near_scale: scan.near_scale,
            per_metre: normals.iter().flat_map(|normal| per_metre(normal, &directions)).collect(),
            sides: normals.iter().map(|normal| sides(normal, &directions)).collect(),
            normals: normals.iter().map(|normal| normal.map(|value| value as f32).into()).collect(),
            rooms,
        }
    }

    /// How many there are.
    #[expect(clippy::len_without_is_empty, reason = "a world is asked for")]
    pub fn len(&self) -> usize {
        self.rooms.len()
    }

    /// The map of a world, by its place among them.
    ///
    /// # Panics
    /// When there are not so many.
    pub fn map(&self, index: usize) -> ScanMap<'_> {
        let Room { per_descent, slabs, bodies } = &self.rooms[index];
        let Self { limit, near_scale, normals, per_metre, sides, .. } = self;
        ScanMap { limit: *limit, near_scale: *near_scale, per_descent, normals, per_metre, sides, slabs, bodies }
    }
}

/// Normals of slabs, each once: most bodies of a room stand as another does.
#[derive(Default)]
struct Normals {
    normals: Vec<Vector3<f64>>,
    places: HashMap<[u64; 3], u32>,
}

impl Normals {
    fn place(&mut self, normal: Vector3<f64>) -> u32 {
        // Zero is added because there are two zeros.
        let bits = normal.map(|value| (value + 0.0).to_bits()).into();
        *self.places.entry(bits).or_insert_with(|| {
            self.normals.push(normal);
            self.normals.len() as u32 - 1
        })
    }
}

impl Room {
    fn new(world: &World, directions: &[Vector3<f64>], normals: &mut Normals) -> Self {
        let descent = |direction: &Vector3<f64>| {
            let descends = world.floor == Floor::Solid && direction.z < -1.0 / f64::from(PARALLEL);
            if descends { (-1.0 / direction.z) as f32 } else { 0.0 }
        };
        let (mut slabs, mut bodies) = (Vec::new(), Vec::new());
        for solid in &world.solids {
            let planes = planes(solid);
            bodies.push(planes.len() as u32);
            slabs.extend(planes.into_iter().map(|(normal, low, high)| Slab {
                normal: normals.place(normal),
                low: low as f32,
                high: high as f32,
            }));
        }
        Self { per_descent: directions.iter().map(descent).collect(), slabs, bodies }
    }
}

/// How much of a beam goes along a normal; none where it is parallel to the slab.
fn rate(normal: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64> {
    let rate = direction.dot(normal);
    (rate.abs() >= 1.0 / f64::from(PARALLEL)).then_some(rate)
}

/// Metres along each beam for a metre along a normal.
fn per_metre(normal: &Vector3<f64>, directions: &[Vector3<f64>]) -> impl Iterator<Item = f32> {
    let normal = *normal;
    directions.iter().map(move |direction| rate(&normal, direction).map_or(PARALLEL, |rate| (1.0 / rate) as f32))
}

/// A bit for each beam that goes along a normal, and for each that goes against it.
fn sides(normal: &Vector3<f64>, directions: &[Vector3<f64>]) -> [u64; 2] {
    let mut sides = [0; 2];
    for (beam, direction) in directions.iter().enumerate() {
        if let Some(rate) = rate(normal, direction) {
            sides[usize::from(rate < 0.0)] |= 1 << beam;
        }
    }
    sides
}

/// The slabs of a solid: unit normal, least and greatest coordinate along it \[m, world\].
fn planes(solid: &Solid) -> Vec<(Vector3<f64>, f64, f64)> {
    let axes = Vector3::from(solid.pose.world_from_body.rows().map(Vector3::from));
    let in_world = |normal: Vector3<f64>| axes.map(|row| row.dot(&normal));
    let place = |(normal, low, high): (Vector3<f64>, f64, f64)| {
        let normal = in_world(normal);
        let middle = normal.dot(&solid.pose.position);
        (normal, middle + low, middle + high)
    };
    local_planes(&solid.shape).into_iter().map(place).collect()
}

/// The slabs of a shape in its own frame, likewise.
pub(super) fn local_planes(shape: &Shape) -> Vec<(Vector3<f64>, f64, f64)> {
    match shape {
        Shape::Cuboid(half) => {
            let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
            axes.into_iter().zip(half.iter()).map(|(axis, half)| (axis, -half, *half)).collect()
        }
        Shape::Cylinder { radius, half_height } => {
            let side = |number: usize| {
                let (sine, cosine) = libm::sincos(PI * number as f64 / SIDES as f64);
                (Vector3::new(cosine, sine, 0.0), -radius, *radius)
            };
            (0..SIDES).map(side).chain([(Vector3::z(), -half_height, *half_height)]).collect()
        }
        Shape::Sphere(radius) => {
            // Directions that a golden spiral spreads evenly over half a ball.
            let side = |number: usize| {
                let along = 1.0 - (number as f64 + 0.5) / BALL_SIDES as f64;
                let (sine, cosine) = libm::sincos(GOLDEN_ANGLE * number as f64);
                let across = (1.0 - along * along).sqrt();
                (Vector3::new(across * cosine, across * sine, along), -radius, *radius)
            };
            (0..BALL_SIDES).map(side).collect()
        }
        Shape::Hull(points) | Shape::Mesh(Mesh { hull: points, .. }) => {
            let mut planes: Vec<(Vector3<f64>, f64, f64)> = Vec::new();
            for normal in face_normals(points) {
                if planes.iter().all(|(other, ..)| other.cross(&normal).norm() > 1e-4) {
                    let along = points.iter().map(|point| point.dot(&normal));
                    let (low, high) =
                        (along.clone().fold(f64::INFINITY, f64::min), along.fold(-f64::INFINITY, f64::max));
                    planes.push((normal, low, high));
                }
            }
            planes
        }
    }
}
