//! Scenes and views in the words that a GPU reads: the structures of `data.wgsl` in the package `kestrel-gpu`, which says
//! what each word is.

use nalgebra::Vector3;

use super::plot::{LEAST_DISTANCE, Rays};
use super::scene::{Appearance, Body, CurvedSide, FLOOR_SURFACE, Face, Mesh};
use super::{Camera, Scene, Shot};

/// Several scenes, one behind the other.
#[derive(Debug, Default)]
pub struct SceneWords {
    /// Where each begins and ends in the other vectors.
    pub scenes: Vec<[u32; 12]>,
    /// Convex bodies.
    pub bodies: Vec<[u32; 5]>,
    /// Their planes.
    pub faces: Vec<[[u32; 4]; 3]>,
    /// Their corners, and those of meshes \[m\].
    pub corners: Vec<[u32; 4]>,
    /// Of meshes.
    pub triangles: Vec<[[u32; 4]; 4]>,
    /// Curved sides of cylinders, and spheres.
    pub rounds: Vec<[[u32; 4]; 4]>,
    /// Surfaces: label, colour, curved side.
    pub looks: Vec<[u32; 3]>,
    /// Plots of a view in the largest of them.
    pub most_plots: usize,
}

/// Where words of a scene begin among those of all: elements of the vectors of [`SceneWords`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Firsts {
    /// Of `bodies`.
    pub body: usize,
    /// Of `faces`.
    pub face: usize,
    /// Of `corners`.
    pub corner: usize,
    /// Of `rounds`.
    pub round: usize,
    /// Of `looks`.
    pub look: usize,
}

/// A scene among the words of all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    scene: Firsts,
    /// What moves in it; behind that is the next scene.
    pub moving: Firsts,
}

/// A view: nine rows of three numbers and a word.
pub type ViewWords = [[u32; 4]; 9];

impl SceneWords {
    /// Adds a scene behind the others.
    pub fn push(&mut self, scene: &Scene) -> Place {
        let first = self.ends();
        let counted_from = [first.face.wrapping_neg(), 0, first.round.wrapping_neg()];
        let [first_body, first_surface] = scene.first_moving();
        let (still, moving) = scene.bodies.split_at(first_body);
        self.push_bodies(still, counted_from);
        let look = first.look + first_surface;
        let place = Place { scene: first, moving: Firsts { look, ..self.ends() } };
        self.push_bodies(moving, counted_from);
        let triangle = self.triangles.len();
        for mesh in &scene.meshes {
            self.push_mesh(mesh);
        }
        let own = &self.bodies[first.body..];
        self.looks.extend(scene.surfaces.iter().map(|look| look_words(look, |body| own[body][4])));
        let [bodies, faces, rounds] = [own.len(), self.faces.len() - first.face, self.rounds.len() - first.round];
        let triangles = self.triangles.len() - triangle;
        self.most_plots = self.most_plots.max(faces + bodies + 3 * rounds + 5 * triangles);
        let floor = FLOOR_SURFACE as usize;
        let [even, odd] = [floor, floor + 1].map(|square| opaque(scene.surfaces[square].colour));
        let [body, face, round, look] =
            [first.body, first.face, first.round, first.look].map(|first| first as u32);
        let [bodies, faces, rounds, triangle, triangles] =
            [bodies, faces, rounds, triangle, triangles].map(|count| count as u32);
        let has_floor = u32::from(scene.has_floor);
        self.scenes
            .push([body, bodies, face, faces, round, rounds, look, has_floor, even, odd, triangle, triangles]);
        place
    }

    fn push_mesh(&mut self, mesh: &Mesh) {
        let first = self.corners.len() as u32;
        self.corners.extend(mesh.corners.iter().map(|place| row(place, 0)));
        self.triangles.extend(mesh.triangles.iter().map(|triangle| {
            let [normal, place, rest] = face_words(&triangle.face);
            let [a, b, c] = triangle.corners.map(|corner| first + corner);
            [normal, place, rest, [a, b, c, 0]]
        }));
    }

    /// What moves in a scene, as [`Self::push`] wrote it at `place`.
    pub fn moving(scene: &Scene, place: &Place) -> Self {
        let Place { scene: all, moving: own } = place;
        let mut words = Self::default();
        let [first_body, first_surface] = scene.first_moving();
        words.push_bodies(&scene.bodies[first_body..], [own.face - all.face, own.corner, own.round - all.round]);
        let looks = &scene.surfaces[first_surface..];
        words.looks =
            looks.iter().map(|look| look_words(look, |body| words.bodies[body - first_body][4])).collect();
        words
    }

    fn ends(&self) -> Firsts {
        Firsts {
            body: self.bodies.len(),
            face: self.faces.len(),
            corner: self.corners.len(),
            round: self.rounds.len(),
            look: self.looks.len(),
        }
    }

    /// Numbers of faces, corners and rounds are those of the words here, more by `offsets`.
    fn push_bodies(&mut self, bodies: &[Body], [faces, corners, rounds]: [usize; 3]) {
        for body in bodies {
            let face = self.faces.len().wrapping_add(faces) as u32;
            let corner = self.corners.len().wrapping_add(corners) as u32;
            self.faces.extend(body.faces.iter().map(face_words));
            self.corners.extend(body.corners.iter().map(|place| row(place, 0)));
            self.rounds.extend(body.round.iter().map(round_words));
            let round = if body.round.is_some() { self.rounds.len().wrapping_add(rounds) as u32 } else { 0 };
            // Without corners it is nowhere in view.
            let spanned = if body.is_placed() { body.corners.len() as u32 } else { 0 };
            self.bodies.push([face, body.faces.len() as u32, corner, spanned, round]);
        }
    }
}

/// What a camera looks at.
pub fn view_words(camera: &Camera, shot: &Shot) -> ViewWords {
    let Shot { scene, view } = shot;
    let rays = Rays::new(camera, view);
    // As `Rays::meets`, in double precision, because the floor is seen a thousand times farther than it is below.
    let slopes = Vector3::new(rays.corner.z, rays.per_column.z, rays.per_row.z);
    let floor = if view.eye.z > LEAST_DISTANCE { slopes / -view.eye.z } else { Vector3::zeros() };
    [
        row(&view.eye, *scene as u32),
        row(&rest(&view.eye), 0),
        row(&rays.corner, 0),
        row(&rays.per_column, 0),
        row(&rays.per_row, 0),
        row(&view.right, 0),
        row(&view.down, 0),
        row(&view.forward, 0),
        row(&floor, 0),
    ]
}

fn face_words(face: &Face) -> [[u32; 4]; 3] {
    let place = face.normal * face.offset;
    [row(&face.normal, face.surface), row(&place, 0), row(&rest(&place), 0)]
}

fn round_words(round: &CurvedSide) -> [[u32; 4]; 4] {
    let colour = Vector3::from(round.shading.colour).cast() / 255.0;
    [
        row(&round.centre, (round.radius as f32).to_bits()),
        row(&rest(&round.centre), round.surface),
        row(&round.axis, 0),
        row(&colour, 0),
    ]
}

/// `round` knows the round side of each body of its scene.
fn look_words(look: &Appearance, round: impl Fn(usize) -> u32) -> [u32; 3] {
    let round = look.round.map_or(0, |body| round(body as usize));
    [u32::from(look.label), opaque(look.colour), round]
}

fn opaque([red, green, blue]: [u8; 3]) -> u32 {
    u32::from_le_bytes([red, green, blue, u8::MAX])
}

fn row(vector: &Vector3<f64>, last: u32) -> [u32; 4] {
    let [x, y, z] = (*vector).into();
    [(x as f32).to_bits(), (y as f32).to_bits(), (z as f32).to_bits(), last]
}

/// What single precision leaves of a place.
fn rest(place: &Vector3<f64>) -> Vector3<f64> {
    place.map(|value| value - f64::from(value as f32))
}
