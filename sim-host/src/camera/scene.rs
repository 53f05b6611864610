//! A world prepared for cameras.

#[cfg(feature = "gpu")]
pub(super) mod words;

use nalgebra::Vector3;
use pulp::{Arch, Simd, WithSimd};

use super::kernel::{Affine, Canvas, Plot, Quadratic, Side};
use super::{Camera, FIRST_SOLID, FLOOR, Image, NOTHING, View};
use crate::contact::face_normals;
use crate::world::{Floor, Shape, Solid, World};

/// Direction towards the light; the reference's.
const LIGHT: [f64; 3] = [-50.0, 30.0, 100.0];

/// Light from everywhere, and from the light onto a surface that faces it; the reference's.
const AMBIENT: f64 = 0.6;
const DIFFUSE: f64 = 0.35;

/// Where nothing is.
const BACKGROUND: [u8; 3] = [255; 3];

/// Squares of the floor, one metre each.
const FLOOR_COLOURS: [[f32; 3]; 2] = [[1.0, 1.0, 1.0], [173.0 / 255.0, 199.0 / 255.0, 239.0 / 255.0]];

/// Distance within which an eye counts as being beside a plane and not in it \[m\].
const LEAST_DISTANCE: f64 = 1e-6;

/// What a pixel can show: an entry of the scene's table of surfaces. The first two are nothing and the floor.
pub(super) type Surface = u32;

const NO_SURFACE: Surface = 0;
const FLOOR_SURFACE: Surface = 1;

/// A world prepared for cameras. Never changes, so that environments can share it.
#[derive(Clone, Debug)]
pub struct Scene {
    bodies: Vec<Body>,
    has_floor: bool,
    surfaces: Vec<Look>,
    floor: [[u8; 3]; 2],
}

/// How a surface looks.
#[derive(Clone, Copy, Debug)]
struct Look {
    label: u16,
    /// Of a flat surface.
    colour: [u8; 3],
    /// Of a cylinder: which.
    round: Option<u32>,
}

/// A convex body.
#[derive(Clone, Debug)]
struct Body {
    faces: Vec<Face>,
    round: Option<Round>,
    /// Points whose hull holds the body \[m\].
    corners: Vec<Vector3<f64>>,
}

/// A flat face: the body is where `normal · x ≤ offset`.
#[derive(Clone, Copy, Debug)]
struct Face {
    normal: Vector3<f64>,
    offset: f64,
    surface: Surface,
}

/// The side of a cylinder.
#[derive(Clone, Copy, Debug)]
struct Round {
    centre: Vector3<f64>,
    axis: Vector3<f64>,
    radius: f64,
    surface: Surface,
    colour: [f32; 3],
}

impl Scene {
    /// Prepares a world; its movables stand where they start.
    ///
    /// # Panics
    /// When it has more bodies than there are labels, 65,533.
    pub fn new(world: &World) -> Self {
        let nothing = Look { label: NOTHING, colour: BACKGROUND, round: None };
        let floor = Look { label: FLOOR, colour: BACKGROUND, round: None };
        let up = Vector3::z();
        let mut scene = Self {
            bodies: Vec::new(),
            has_floor: world.floor == Floor::Solid,
            surfaces: vec![nothing, floor],
            floor: FLOOR_COLOURS.map(|colour| shaded(colour, &up)),
        };
        let bodies = world.solids.len() + world.movables.len();
        assert!(bodies <= usize::from(u16::MAX - FIRST_SOLID), "{bodies} bodies have no labels");
        let movables = world.movables.iter().map(|movable| &movable.solid);
        for (label, solid) in (FIRST_SOLID..).zip(world.solids.iter().chain(movables)) {
            scene.add(solid, label);
        }
        scene
    }

    fn add(&mut self, solid: &Solid, label: u16) {
        let pose = &solid.pose;
        let placed = |point: Vector3<f64>| pose.position + pose.world_from_body.rotate(point);
        let mut faces = Vec::new();
        for (normal, offset) in local_faces(&solid.shape) {
            let normal = pose.world_from_body.rotate(normal);
            let surface = self.surfaces.len() as Surface;
            self.surfaces.push(Look { label, colour: shaded(solid.colour, &normal), round: None });
            faces.push(Face { normal, offset: offset + normal.dot(&pose.position), surface });
        }
        let round = match solid.shape {
            Shape::Cylinder { radius, .. } => {
                let surface = self.surfaces.len() as Surface;
                let round = Some(self.bodies.len() as u32);
                self.surfaces.push(Look { label, colour: BACKGROUND, round });
                let axis = pose.world_from_body.rotate(Vector3::z());
                Some(Round { centre: pose.position, axis, radius, surface, colour: solid.colour })
            }
            Shape::Cuboid(_) | Shape::Hull(_) => None,
        };
        let corners = local_corners(&solid.shape).into_iter().map(placed).collect();
        self.bodies.push(Body { faces, round, corners });
    }

    /// What a camera sees.
    pub fn render(&self, camera: &Camera, view: &View) -> Image {
        let mut image = Image::default();
        self.render_into(camera, view, &mut Canvas::default(), &mut image);
        image
    }

    /// As [`Self::render`], in memory that is used again.
    pub fn render_into(&self, camera: &Camera, view: &View, canvas: &mut Canvas, image: &mut Image) {
        canvas.clear(camera.columns, camera.rows, (1.0 / camera.far_m) as f32);
        let rays = Rays::new(camera, view);
        if self.has_floor && view.eye.z > LEAST_DISTANCE {
            canvas.plot.begin(camera);
            canvas.plot.entered.push((rays.meets(&Vector3::z(), 0.0).0, FLOOR_SURFACE));
            canvas.draw();
        }
        for body in &self.bodies {
            canvas.plot.begin(camera);
            if body.is_plotted(&rays, camera, &mut canvas.plot) {
                canvas.draw();
            }
        }
        let pixels = camera.columns * camera.rows;
        image.columns = camera.columns;
        image.depths.resize(pixels, 0.0);
        image.labels.resize(pixels, NOTHING);
        image.colours.resize(pixels, BACKGROUND);
        Arch::new().dispatch(Finish { scene: self, rays: &rays, canvas, image, far: camera.far_m as f32 });
    }

    #[inline(always)]
    fn floor_colour(&self, point: &[f32; 3]) -> [u8; 3] {
        let square = floor(point[0]).wrapping_add(floor(point[1]));
        self.floor[(square & 1) as usize]
    }

    fn round_colour(&self, body: u32, point: &[f32; 3]) -> [u8; 3] {
        let Some(round) = &self.bodies[body as usize].round else { return BACKGROUND };
        let away = Vector3::from(*point).cast::<f64>() - round.centre;
        shaded(round.colour, &((away - round.axis * away.dot(&round.axis)) / round.radius))
    }
}

/// The greatest whole number that is not greater.
#[inline(always)]
fn floor(value: f32) -> i32 {
    let whole = value as i32;
    whole - i32::from(value < whole as f32)
}

/// What is seen at last, in numbers that others understand.
struct Finish<'a> {
    scene: &'a Scene,
    rays: &'a Rays,
    canvas: &'a Canvas,
    image: &'a mut Image,
    far: f32,
}

impl WithSimd for Finish<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let Self { scene, rays, canvas, image, far } = self;
        let single = |vector: &Vector3<f64>| -> [f32; 3] { vector.map(|value| value as f32).into() };
        let (eye, per_column) = (single(&rays.view.eye), single(&rays.per_column));
        let columns = image.columns;
        let lines = image.depths.chunks_exact_mut(columns).zip(image.labels.chunks_exact_mut(columns));
        for (row, ((depths, labels), colours)) in lines.zip(image.colours.chunks_exact_mut(columns)).enumerate() {
            let (inverses, surfaces) = canvas.row(row);
            let first = single(&(rays.corner + rays.per_row * row as f64));
            for column in 0..columns {
                let depth = 1.0 / inverses[column];
                depths[column] = if surfaces[column] == NO_SURFACE { far } else { depth };
            }
            for column in 0..columns {
                let look = &scene.surfaces[surfaces[column] as usize];
                labels[column] = look.label;
                let point = || -> [f32; 3] {
                    core::array::from_fn(|axis| {
                        eye[axis] + depths[column] * (first[axis] + column as f32 * per_column[axis])
                    })
                };
                colours[column] = match (surfaces[column], look.round) {
                    (FLOOR_SURFACE, _) => scene.floor_colour(&point()),
                    (_, None) => look.colour,
                    (_, Some(body)) => scene.round_colour(body, &point()),
                };
            }
        }
    }
}

impl Body {
    /// Says how it is drawn; not at all when it is not in view, or the eye is inside it.
    fn is_plotted(&self, rays: &Rays, camera: &Camera, plot: &mut Plot) -> bool {
        let Some(area) = self.area(rays, camera) else { return false };
        plot.area = area;
        for face in &self.faces {
            let (inverse, distance) = rays.meets(&face.normal, face.offset);
            if distance > 0.0 {
                plot.entered.push((inverse, face.surface));
            } else {
                plot.left.push(inverse);
            }
        }
        plot.side = self.round.as_ref().map(|round| round.side(rays));
        !plot.entered.is_empty() || plot.side.as_ref().is_some_and(|side| side.from_outside)
    }

    /// Columns and rows that it may cover, from the first to one past the last.
    fn area(&self, rays: &Rays, camera: &Camera) -> Option<[[usize; 2]; 2]> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let (mut before, mut behind) = (false, false);
        for corner in &self.corners {
            let away = corner - rays.view.eye;
            let depth = away.dot(&rays.view.forward);
            before |= depth > camera.near_m;
            behind |= depth <= camera.near_m;
            let axes = [rays.view.right, rays.view.down];
            let sizes = [camera.columns, camera.rows];
            for axis in 0..2 {
                let share = away.dot(&axes[axis]) / (depth.max(camera.near_m) * camera.tangents[axis]);
                let place = 0.5 * (share + 1.0) * sizes[axis] as f64 - camera.sample[axis];
                low[axis] = low[axis].min(place);
                high[axis] = high[axis].max(place);
            }
        }
        if !before {
            return None;
        }
        let span = |low: f64, high: f64, size: usize| {
            let all = [0, size];
            let part = [(low.floor() - 1.0).max(0.0) as usize, ((high.ceil() + 2.0).max(0.0) as usize).min(size)];
            if behind { all } else { part }
        };
        let area = [span(low[0], high[0], camera.columns), span(low[1], high[1], camera.rows)];
        area.iter().all(|[first, end]| first < end).then_some(area)
    }
}

impl Round {
    /// The ray is on the side where `C w² + 2 B w + A = 0` for its inverse depth `w`.
    fn side(&self, rays: &Rays) -> Side {
        let across = |vector: Vector3<f64>| vector - self.axis * vector.dot(&self.axis);
        let eye = across(rays.view.eye - self.centre);
        let [corner, right, down] = [rays.corner, rays.per_column, rays.per_row].map(across);
        let c = eye.dot(&eye) - self.radius * self.radius;
        let b = [eye.dot(&corner), eye.dot(&right), eye.dot(&down)];
        // The discriminant B² − A C, in powers of column and row.
        let term = |one: usize, other: usize| {
            let vectors = [corner, right, down];
            let twice = if one == other { 1.0 } else { 2.0 };
            twice * (b[one] * b[other] - vectors[one].dot(&vectors[other]) * c)
        };
        let c = if c.abs() < LEAST_DISTANCE { LEAST_DISTANCE.copysign(c) } else { c };
        Side {
            middle: Affine::new(-b[0] / c, -b[1] / c, -b[2] / c),
            spread: Quadratic::new(
                [term(0, 0), term(0, 1), term(0, 2), term(1, 1), term(1, 2), term(2, 2)]
                    .map(|value| value / (c * c)),
            ),
            from_outside: c > 0.0,
            surface: self.surface,
        }
    }
}

/// The rays of an image: `corner + column · per_column + row · per_row`.
struct Rays {
    view: View,
    corner: Vector3<f64>,
    per_column: Vector3<f64>,
    per_row: Vector3<f64>,
}

impl Rays {
    fn new(camera: &Camera, view: &View) -> Self {
        let per_column = view.right * (2.0 * camera.tangents[0] / camera.columns as f64);
        let per_row = view.down * (2.0 * camera.tangents[1] / camera.rows as f64);
        let left = view.right * camera.tangents[0] + view.down * camera.tangents[1];
        let [across, down] = camera.sample;
        let corner = view.forward - left + across * per_column + down * per_row;
        Self { view: *view, corner, per_column, per_row }
    }

    /// Inverse depth at which rays meet a plane, and how far in front of it the eye is \[m\].
    fn meets(&self, normal: &Vector3<f64>, offset: f64) -> (Affine, f64) {
        let distance = normal.dot(&self.view.eye) - offset;
        let distance = if distance.abs() < LEAST_DISTANCE { LEAST_DISTANCE.copysign(distance) } else { distance };
        let share = |vector: &Vector3<f64>| -normal.dot(vector) / distance;
        (Affine::new(share(&self.corner), share(&self.per_column), share(&self.per_row)), distance)
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
        Shape::Hull(points) => {
            let farthest = |normal: &Vector3<f64>| {
                points.iter().map(|point| point.dot(normal)).fold(f64::NEG_INFINITY, f64::max)
            };
            face_normals(points).into_iter().map(|normal| (normal, farthest(&normal))).collect()
        }
    }
}

/// Points whose hull holds a shape \[m\].
fn local_corners(shape: &Shape) -> Vec<Vector3<f64>> {
    let half = match shape {
        Shape::Hull(points) => return points.clone(),
        Shape::Cuboid(half) => *half,
        Shape::Cylinder { radius, half_height } => Vector3::new(*radius, *radius, *half_height),
    };
    let sign = |corner: u8, axis: u8| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
    (0..8)
        .map(|corner| half.component_mul(&Vector3::new(sign(corner, 0), sign(corner, 1), sign(corner, 2))))
        .collect()
}

/// A colour under the light.
fn shaded(colour: [f32; 3], normal: &Vector3<f64>) -> [u8; 3] {
    let light = Vector3::from(LIGHT).normalize();
    let share = AMBIENT + DIFFUSE * normal.dot(&light).max(0.0);
    colour.map(|value| (255.0 * f64::from(value) * share) as u8)
}
