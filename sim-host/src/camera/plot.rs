//! What of a scene is in view, as affine functions of columns and rows.

mod mesh;

use nalgebra::Vector3;

use super::kernel::{Affine, COLUMNS, Canvas, Figure, Plane, Plot, Quadratic, ROWS, Side};
use super::scene::{Body, BoundingSphere, CurvedSide, FLOOR_SURFACE, Face, Scene};
use super::{Camera, View};

/// Distance within which an eye counts as being beside a plane and not in it \[m\].
pub(super) const LEAST_DISTANCE: f64 = 1e-6;

impl Scene {
    /// Says how everything in view is drawn.
    #[inline(always)]
    pub(super) fn plot(&self, camera: &Camera, rays: &Rays, canvas: &mut Canvas) {
        if self.has_floor && rays.view.eye.z > LEAST_DISTANCE {
            let inverse = rays.meets(&Vector3::z(), 0.0).0;
            canvas.planes.push(Plane { inverse, surface: FLOOR_SURFACE });
            let tiles = [[0, canvas.across], [0, canvas.tiles.len() / canvas.across]];
            let nearest = canvas.limit;
            let figure = Figure::Convex { entered: [0, 1], left: [1, 1], side: None };
            canvas.plots.push(Plot { tiles, nearest, figure });
        }
        for body in &self.bodies {
            if body.ball.is_in_view(camera, &rays.view) {
                body.plot(rays, camera, canvas);
            }
        }
        for mesh in &self.meshes {
            if mesh.ball.is_in_view(camera, &rays.view) {
                mesh.plot(rays, camera, canvas);
            }
        }
    }
}

impl BoundingSphere {
    /// Whether it meets what the camera sees.
    #[inline(always)]
    fn is_in_view(&self, camera: &Camera, view: &View) -> bool {
        let away = self.centre - view.eye;
        let depth = away.dot(&view.forward);
        let beside = |axis: &Vector3<f64>, tangent: f64| {
            (away.dot(axis).abs() - depth * tangent) > self.reach * (1.0 + tangent * tangent).sqrt()
        };
        depth + self.reach > camera.near_m
            && depth - self.reach < camera.far_m
            && !beside(&view.right, camera.tangents[0])
            && !beside(&view.down, camera.tangents[1])
    }
}

impl Body {
    /// Says how it is drawn; not at all when it is not in view, or the eye is inside it.
    #[inline(always)]
    fn plot(&self, rays: &Rays, camera: &Camera, canvas: &mut Canvas) {
        let Some((tiles, nearest)) = rays.area(&self.corners, camera) else { return };
        let first = canvas.planes.len();
        // Those that face the eye from the first on, the others from the last back, without a branch that cannot be foretold.
        let (mut entered, mut left) = (first, first + self.faces.len());
        canvas.planes.resize(left, Plane::default());
        for Face { normal, offset, surface } in &self.faces {
            let (inverse, distance) = rays.meets(normal, *offset);
            let front = usize::from(distance > 0.0);
            left -= 1 - front;
            canvas.planes[if front == 1 { entered } else { left }] = Plane { inverse, surface: *surface };
            entered += front;
        }
        let side = self.round.as_ref().map(|round| round.side(rays));
        if entered > first || side.as_ref().is_some_and(|side| side.from_outside) {
            let left = [entered, canvas.planes.len()];
            let figure = Figure::Convex { entered: [first, entered], left, side };
            canvas.plots.push(Plot { tiles, nearest, figure });
        } else {
            canvas.planes.truncate(first);
        }
    }
}

impl CurvedSide {
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
            middle: Affine::new(-b[0] / c, -b[1] / c, -b[2] / c, rays.size),
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
pub(super) struct Rays {
    pub(super) view: View,
    pub(super) corner: Vector3<f64>,
    pub(super) per_column: Vector3<f64>,
    pub(super) per_row: Vector3<f64>,
    /// Columns and rows of all tiles.
    pub(super) size: [f64; 2],
}

impl Rays {
    pub(super) fn new(camera: &Camera, view: &View) -> Self {
        let per_column = view.right * (2.0 * camera.tangents[0] / camera.columns as f64);
        let per_row = view.down * (2.0 * camera.tangents[1] / camera.rows as f64);
        let left = view.right * camera.tangents[0] + view.down * camera.tangents[1];
        let [across, down] = camera.sample;
        let corner = view.forward - left + across * per_column + down * per_row;
        let size = [(camera.columns, COLUMNS), (camera.rows, ROWS)];
        let size = size.map(|(size, tile)| size.next_multiple_of(tile) as f64);
        Self { view: *view, corner, per_column, per_row, size }
    }

    /// Where in the world pixels of a row from one on see something at depths \[m\], axis by axis.
    #[inline(always)]
    pub(super) fn points(&self, [first, row]: [usize; 2], depths: &[f32; COLUMNS]) -> [[f32; COLUMNS]; 3] {
        let start = self.corner + self.per_row * row as f64 + self.per_column * first as f64;
        let mut points = [[0.0; COLUMNS]; 3];
        for axis in 0..3 {
            let (eye, first) = (self.view.eye[axis] as f32, start[axis] as f32);
            let per_column = self.per_column[axis] as f32;
            for lane in 0..COLUMNS {
                points[axis][lane] = eye + depths[lane] * (first + lane as f32 * per_column);
            }
        }
        points
    }

    /// Tiles that the hull of some points may cover, and its greatest inverse depth \[1/m\].
    #[inline(always)]
    fn area(&self, corners: &[Vector3<f64>], camera: &Camera) -> Option<([[usize; 2]; 2], f32)> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
        let axes = [self.view.right / camera.tangents[0], self.view.down / camera.tangents[1]];
        for corner in corners {
            let away = corner - self.view.eye;
            let depth = away.dot(&self.view.forward);
            least = if depth < least { depth } else { least };
            greatest = if depth > greatest { depth } else { greatest };
            let inverse = 1.0 / if depth > camera.near_m { depth } else { camera.near_m };
            for axis in 0..2 {
                let share = away.dot(&axes[axis]) * inverse;
                low[axis] = if share < low[axis] { share } else { low[axis] };
                high[axis] = if share > high[axis] { share } else { high[axis] };
            }
        }
        if greatest <= camera.near_m {
            return None;
        }
        let sizes = [(camera.columns, COLUMNS), (camera.rows, ROWS)];
        let tiles = core::array::from_fn(|axis| {
            let (size, tile) = sizes[axis];
            if least <= camera.near_m {
                return [0, size.div_ceil(tile)];
            }
            let place = |share: f64| 0.5 * (share + 1.0) * size as f64 - camera.sample[axis];
            // A pixel more on each side, against rounding.
            let first = (place(low[axis]) - 1.0).max(0.0) as usize;
            let end = ((place(high[axis]) + 2.0).max(0.0) as usize).min(size);
            [first / tile, end.div_ceil(tile).max(first / tile)]
        });
        let nearest = (1.001 / least.max(camera.near_m)) as f32;
        Some((tiles, nearest))
    }

    /// Inverse depth at which rays meet a plane, and how far in front of it the eye is \[m\].
    fn meets(&self, normal: &Vector3<f64>, offset: f64) -> (Affine, f64) {
        let distance = normal.dot(&self.view.eye) - offset;
        let distance = if distance.abs() < LEAST_DISTANCE { LEAST_DISTANCE.copysign(distance) } else { distance };
        let inverse = -1.0 / distance;
        let share = |vector: &Vector3<f64>| normal.dot(vector) * inverse;
        let [base, per_column, per_row] = [&self.corner, &self.per_column, &self.per_row].map(share);
        (Affine::new(base, per_column, per_row, self.size), distance)
    }
}
