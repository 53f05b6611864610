//! A world prepared for cameras.

mod drone;
mod mesh;
mod moving;

pub use moving::Mover;

use moving::Moving;
use nalgebra::Vector3;

pub(super) use mesh::{Mesh, Triangle};

use super::{FIRST_SOLID, FLOOR, NOTHING};
use crate::contact::face_normals;
use crate::world::{Floor, Shape, Solid, World};

/// Direction towards the light; the reference's.
const LIGHT: [f64; 3] = [-50.0, 30.0, 100.0];

/// Light from everywhere, and from the light onto a surface that faces it; the reference's.
pub(super) const AMBIENT: f64 = 0.6;
pub(super) const DIFFUSE: f64 = 0.35;

/// Light that is mirrored straight up, as the reference has it.
pub(super) const SPECULAR: f64 = 0.05;

/// Where nothing is.
pub(super) const BACKGROUND: [u8; 3] = [255; 3];

/// Squares of the floor, one metre each.
const FLOOR_COLOURS: [[f32; 3]; 2] = [[1.0, 1.0, 1.0], [173.0 / 255.0, 199.0 / 255.0, 239.0 / 255.0]];

/// What a pixel can show: an entry of the scene's table of surfaces. The first three are nothing and the floor.
pub(super) type Surface = u32;

pub(super) const NO_SURFACE: Surface = 0;
/// Squares of the floor; the other ones are the next surface.
pub(super) const FLOOR_SURFACE: Surface = 1;

/// A world prepared for cameras. What moves in it, movables and drones, is placed for each image ([`Self::place`]); the
/// rest is prepared once.
#[derive(Clone, Debug)]
pub struct Scene {
    pub(super) bodies: Vec<Body>,
    pub(super) meshes: Vec<Mesh>,
    pub(super) has_floor: bool,
    pub(super) surfaces: Vec<Appearance>,
    moving: Moving,
}

/// How a surface looks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Appearance {
    pub(super) label: u16,
    /// Of a flat surface.
    pub(super) colour: [u8; 3],
    /// Of a round surface: of which body.
    pub(super) round: Option<u32>,
}

/// A ball around something.
#[derive(Clone, Copy, Debug)]
pub(super) struct BoundingSphere {
    /// \[m\].
    pub(super) centre: Vector3<f64>,
    /// Its radius \[m\].
    pub(super) reach: f64,
}

/// A convex body.
#[derive(Clone, Debug)]
pub(super) struct Body {
    pub(super) ball: BoundingSphere,
    pub(super) faces: Vec<Face>,
    pub(super) round: Option<CurvedSide>,
    /// Points whose hull holds the body \[m\].
    pub(super) corners: Vec<Vector3<f64>>,
}

/// A flat face: the body is where `normal · x ≤ offset`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Face {
    pub(super) normal: Vector3<f64>,
    pub(super) offset: f64,
    pub(super) surface: Surface,
}

/// The side of a cylinder, or a sphere, whose axis is zero: it is about no direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct CurvedSide {
    pub(super) centre: Vector3<f64>,
    pub(super) axis: Vector3<f64>,
    pub(super) radius: f64,
    pub(super) surface: Surface,
    pub(super) shading: Shading,
}

/// How light falls on what is round.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shading {
    pub(super) centre: [f32; 3],
    pub(super) axis: [f32; 3],
    /// Towards the light, by the radius.
    pub(super) light: [f32; 3],
    /// Its part along the axis.
    pub(super) along: f32,
    /// How far up the light is, and one by the radius.
    pub(super) rise: f32,
    pub(super) per_radius: f32,
    /// Times 255.
    pub(super) colour: [f32; 3],
}

impl Scene {
    /// Prepares a world; its movables stand where they start.
    ///
    /// # Panics
    /// When it has more bodies than there are labels, 65,533.
    pub fn new(world: &World) -> Self {
        let nothing = Appearance { label: NOTHING, colour: BACKGROUND, round: None };
        let floor = |colour| Appearance { label: FLOOR, colour: shaded(colour, &Vector3::z()), round: None };
        let mut scene = Self {
            bodies: Vec::new(),
            meshes: Vec::new(),
            has_floor: world.floor == Floor::Solid,
            surfaces: vec![nothing, floor(FLOOR_COLOURS[0]), floor(FLOOR_COLOURS[1])],
            moving: Moving::default(),
        };
        let bodies = world.solids.len() + world.movables.len();
        assert!(bodies <= usize::from(u16::MAX - FIRST_SOLID), "{bodies} bodies have no labels");
        for (label, solid) in (FIRST_SOLID..).zip(&world.solids) {
            scene.add(solid, label);
        }
        scene.add_movables(world);
        scene
    }

    /// Adds what is seen of a solid.
    fn add(&mut self, solid: &Solid, label: u16) {
        let (shape, pose) = solid.seen();
        let ball = BoundingSphere { centre: pose.position, reach: shape.reach() };
        let placed = |point: Vector3<f64>| pose.position + pose.world_from_body.rotate(point);
        let corners: Vec<_> = local_corners(shape).into_iter().map(placed).collect();
        if let Shape::Mesh(mesh) = shape {
            let surface = |colour: Option<_>, normal: &_| self.flat(label, colour.unwrap_or(solid.colour), normal);
            let triangles = Triangle::all(mesh, &corners, surface);
            self.meshes.push(Mesh { ball, corners, triangles });
            return;
        }
        let mut faces = Vec::new();
        for (normal, offset) in local_faces(shape) {
            let normal = pose.world_from_body.rotate(normal);
            let surface = self.flat(label, solid.colour, &normal);
            faces.push(Face { normal, offset: offset + normal.dot(&pose.position), surface });
        }
        let round = match shape {
            Shape::Cylinder { radius, .. } => Some((*radius, pose.world_from_body.rotate(Vector3::z()))),
            Shape::Sphere(radius) => Some((*radius, Vector3::zeros())),
            Shape::Cuboid(_) | Shape::Hull(_) | Shape::Mesh(_) => None,
        };
        let round = round.map(|(radius, axis)| {
            let surface = self.surfaces.len() as Surface;
            let body = self.bodies.len() as u32;
            self.surfaces.push(Appearance { label, colour: BACKGROUND, round: Some(body) });
            CurvedSide::new(pose.position, axis, radius, solid.colour.map(|value| 255.0 * value), surface)
        });
        self.bodies.push(Body { ball, faces, round, corners });
    }

    /// A flat surface.
    fn flat(&mut self, label: u16, colour: [f32; 3], normal: &Vector3<f64>) -> Surface {
        let surface = self.surfaces.len() as Surface;
        self.surfaces.push(Appearance { label, colour: shaded(colour, normal), round: None });
        surface
    }
}

impl CurvedSide {
    /// `colour` times 255.
    fn new(centre: Vector3<f64>, axis: Vector3<f64>, radius: f64, colour: [f32; 3], surface: Surface) -> Self {
        let light = Vector3::from(LIGHT).normalize() / radius;
        let shading = Shading {
            centre: centre.cast::<f32>().into(),
            axis: axis.cast::<f32>().into(),
            light: light.cast::<f32>().into(),
            along: light.dot(&axis) as f32,
            rise: (radius * light.z) as f32,
            per_radius: (1.0 / radius) as f32,
            colour,
        };
        Self { centre, axis, radius, surface, shading }
    }
}

/// Outward unit normals of the flat faces of a shape, and how far they are along them \[m\].
fn local_faces(shape: &Shape) -> Vec<(Vector3<f64>, f64)> {
    let both = |axis: Vector3<f64>, half: f64| [(axis, half), (-axis, half)];
    match shape {
        Shape::Cuboid(half) => {
            let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
            axes.into_iter().zip(half.iter()).flat_map(|(axis, half)| both(axis, *half)).collect()
        }
        Shape::Cylinder { half_height, .. } => both(Vector3::z(), *half_height).into(),
        Shape::Sphere(_) | Shape::Mesh(_) => Vec::new(),
        Shape::Hull(points) => {
            let farthest = |normal: &Vector3<f64>| {
                points.iter().map(|point| point.dot(normal)).fold(f64::NEG_INFINITY, f64::max)
            };
            face_normals(points).into_iter().map(|normal| (normal, farthest(&normal))).collect()
        }
    }
}

/// Points whose hull holds a shape \[m\], few of them; the corners of a mesh.
fn local_corners(shape: &Shape) -> Vec<Vector3<f64>> {
    let both = |half: Vector3<f64>| (-half, half);
    let (low, high) = match shape {
        Shape::Mesh(mesh) => return mesh.corners.clone(),
        Shape::Hull(points) if points.len() <= 8 => return points.clone(),
        Shape::Hull(points) => {
            points.iter().fold((points[0], points[0]), |(low, high), point| (low.inf(point), high.sup(point)))
        }
        Shape::Cuboid(half) => both(*half),
        Shape::Cylinder { radius, half_height } => both(Vector3::new(*radius, *radius, *half_height)),
        Shape::Sphere(radius) => both(Vector3::repeat(*radius)),
    };
    (0..8)
        .map(|corner| Vector3::from_fn(|axis, _| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] }))
        .collect()
}

/// A colour under the light.
fn shaded(colour: [f32; 3], normal: &Vector3<f64>) -> [u8; 3] {
    let light = Vector3::from(LIGHT).normalize();
    let facing = normal.dot(&light);
    let mirrored = (2.0 * facing * normal.z - light.z).max(0.0);
    let share = AMBIENT + DIFFUSE * facing.max(0.0) + SPECULAR * mirrored * mirrored;
    colour.map(|value| (255.0 * f64::from(value) * share) as u8)
}
