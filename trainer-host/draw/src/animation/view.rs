//! Shapes of the world, drawn through a camera onto a canvas.

use nalgebra::Vector3;

use super::camera::Camera;
use super::canvas::{Canvas, Depth, Paint};

/// Corners of a drawn circle.
const CIRCLE: usize = 24;

/// How much nearer than they are lines count, so that edges are seen on their faces.
const LINE_LEAD: f32 = 1.004;

/// A camera and the canvas behind it.
pub(super) struct View<'a> {
    pub(super) camera: &'a Camera,
    pub(super) canvas: &'a mut Canvas,
}

/// A flat circle: its centre \[m, world\] and two radii at right angles \[m\].
#[derive(Clone, Copy)]
pub(super) struct Circle {
    pub(super) centre: Vector3<f32>,
    pub(super) radii: [Vector3<f32>; 2],
}

/// A box: its centre \[m, world\] and half its edges as vectors \[m\].
#[derive(Clone, Copy)]
pub(super) struct Block {
    pub(super) centre: Vector3<f32>,
    pub(super) halves: [Vector3<f32>; 3],
}

impl Circle {
    /// Parallel to the floor.
    pub(super) fn level(centre: Vector3<f32>, radius: f32) -> Self {
        Self { centre, radii: [Vector3::x() * radius, Vector3::y() * radius] }
    }

    /// Points all around.
    pub(super) fn corners(&self) -> [Vector3<f32>; CIRCLE] {
        std::array::from_fn(|index| self.at(index as f32 * (std::f32::consts::TAU / CIRCLE as f32)))
    }

    /// The point at an angle \[rad\] from the first radius.
    pub(super) fn at(&self, angle: f32) -> Vector3<f32> {
        let (sine, cosine) = libm::sincosf(angle);
        self.centre + self.radii[0] * cosine + self.radii[1] * sine
    }
}

impl Block {
    /// The faces that a camera at `eye` sees: the axis across which each lies, and its corners.
    pub(super) fn faces_towards(&self, eye: Vector3<f32>) -> Vec<(usize, [Vector3<f32>; 4])> {
        let sides = (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]);
        let faces = sides.map(|(axis, sign)| (axis, self.centre + self.halves[axis] * sign));
        let seen = faces.filter(|(_, middle)| (middle - self.centre).dot(&(eye - middle)) > 0.0);
        seen.map(|(axis, middle)| (axis, self.face(axis, middle))).collect()
    }

    fn face(&self, axis: usize, middle: Vector3<f32>) -> [Vector3<f32>; 4] {
        let (u, v) = (self.halves[(axis + 1) % 3], self.halves[(axis + 2) % 3]);
        [middle - u - v, middle + u - v, middle + u + v, middle - u + v]
    }
}

impl View<'_> {
    /// Fills a flat convex shape.
    pub(super) fn fill(&mut self, corners: &[Vector3<f32>], paint: Paint, depth: Depth) {
        self.canvas.polygon(&self.camera.project(corners), paint, depth);
    }

    /// Draws a straight line, `width` \[px\] wide.
    pub(super) fn line(&mut self, ends: [Vector3<f32>; 2], width: f32, paint: Paint, depth: Depth) {
        if let [from, to] = self.camera.project(&ends)[..] {
            let ends = [from, to].map(|mut end| {
                end.nearness *= LINE_LEAD;
                end
            });
            self.canvas.line(ends, width, paint, depth);
        }
    }

    /// Draws a rod, `thickness` \[m\], but never so thin that it vanishes.
    pub(super) fn rod(&mut self, ends: [Vector3<f32>; 2], thickness: f32, paint: Paint, depth: Depth) {
        let width = (thickness * self.camera.pixels_per_metre(ends[0])).max(1.3);
        self.line(ends, width, paint, depth);
    }

    /// Draws the outline of a circle, `width` \[px\] wide.
    pub(super) fn ring(&mut self, circle: &Circle, width: f32, paint: Paint, depth: Depth) {
        let corners = circle.corners();
        for (index, &from) in corners.iter().enumerate() {
            self.line([from, corners[(index + 1) % CIRCLE]], width, paint, depth);
        }
    }

    /// Draws a ball, `radius` \[m\].
    pub(super) fn ball(&mut self, centre: Vector3<f32>, radius: f32, paint: Paint, depth: Depth) {
        let pixels = radius * self.camera.pixels_per_metre(centre);
        if let [middle] = self.camera.project(&[centre])[..] {
            self.canvas.dot(middle, pixels, paint, depth);
        }
    }
}
