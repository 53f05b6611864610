//! From the world to the picture.

use nalgebra::Vector3;

use super::canvas::Vertex;
use super::{SIZE, STRIP};

/// Tangent of half the vertical field of view (40°).
const HALF_VIEW: f32 = 0.364;

/// Nothing closer than this is drawn \[m\].
const NEAREST: f32 = 0.05;

/// Middle of the scene in the picture \[px\].
const CENTRE: [f32; 2] = [0.5 * SIZE[0] as f32, 0.5 * (SIZE[1] - STRIP) as f32];

/// Directions in which the neighbourhood of a point is looked at.
const AROUND: usize = 8;

/// A pinhole camera with its horizon level.
#[derive(Clone, Copy, Debug)]
pub(super) struct Camera {
    /// Where it stands \[m, world\].
    pub(super) position: Vector3<f32>,
    right: Vector3<f32>,
    down: Vector3<f32>,
    forward: Vector3<f32>,
}

impl Camera {
    /// At `position`, looking at `focus`, which must not lie straight above or below.
    pub(super) fn looking_at(position: Vector3<f32>, focus: Vector3<f32>) -> Self {
        let forward = (focus - position).normalize();
        let right = forward.cross(&Vector3::z()).normalize();
        Self { position, right, down: forward.cross(&right), forward }
    }

    /// Points at a distance from `middle`, all around it as seen from the camera.
    pub(super) fn around(&self, middle: Vector3<f32>, distance: f32) -> [Vector3<f32>; AROUND] {
        std::array::from_fn(|index| {
            let (sine, cosine) = libm::sincosf(index as f32 * (std::f32::consts::TAU / AROUND as f32));
            middle + (self.right * cosine + self.down * sine) * distance
        })
    }

    /// Distance at which a ball of this radius fills the scene's height \[m\].
    pub(super) fn distance_for(radius: f32) -> f32 {
        radius / HALF_VIEW
    }

    /// Pixels that one metre takes at a point.
    pub(super) fn pixels_per_metre(&self, point: Vector3<f32>) -> f32 {
        focal() / self.in_view(point).z.max(NEAREST)
    }

    /// The visible part of a convex polygon or, given two points, of a line.
    pub(super) fn project(&self, points: &[Vector3<f32>]) -> Vec<Vertex> {
        let seen: Vec<_> = points.iter().map(|&point| self.in_view(point)).collect();
        let mut vertices = Vec::with_capacity(seen.len() + 1);
        let edges = if seen.len() == 2 { 1 } else { seen.len() };
        for (index, from) in seen.iter().enumerate() {
            if from.z >= NEAREST {
                vertices.push(vertex(*from));
            }
            let to = seen[(index + 1) % seen.len()];
            if index < edges && (from.z < NEAREST) != (to.z < NEAREST) {
                let share = (NEAREST - from.z) / (to.z - from.z);
                vertices.push(vertex(from.lerp(&to, share)));
            }
        }
        vertices
    }

    /// Right, down and forward \[m\].
    fn in_view(&self, point: Vector3<f32>) -> Vector3<f32> {
        let offset = point - self.position;
        Vector3::new(self.right.dot(&offset), self.down.dot(&offset), self.forward.dot(&offset))
    }
}

/// Focal length \[px\].
fn focal() -> f32 {
    CENTRE[1] / HALF_VIEW
}

fn vertex(seen: Vector3<f32>) -> Vertex {
    let nearness = 1.0 / seen.z;
    Vertex { x: CENTRE[0] + focal() * seen.x * nearness, y: CENTRE[1] + focal() * seen.y * nearness, nearness }
}
