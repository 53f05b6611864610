//! How deep two rounded shapes overlap, and where.
//!
//! The expanding polytope algorithm (van den Bergen 2001) as Bullet runs it (`btGjkEpa2`, by Nathanael Presson), step by step and with its tolerances: of the many points at which a flat drone overlaps a flat floor it
//! returns one, and which one decides how the drone bounces.

mod polytope;
mod simplex;

use nalgebra::Vector3;

use crate::contact::frame::{compose, inverse, relative};
use crate::contact::outline::{MARGIN, Outline};
use crate::world::Pose;

/// Two rounded shapes, seen from the first.
pub(in crate::contact) struct Overlap<'a> {
    outlines: [&'a Outline; 2],
    second: Pose,
}

/// The least way out of an overlap.
#[derive(Clone, Copy, Debug)]
pub(in crate::contact) struct Exit {
    /// On the surface of the second shape \[m, world\].
    pub(in crate::contact) on_second: Vector3<f64>,
    /// Along which the first shape leaves the second, world.
    pub(in crate::contact) normal: Vector3<f64>,
    /// \[m\].
    pub(in crate::contact) depth: f64,
}

/// A point of the difference of two shapes and the direction in which it is the farthest, in the first's frame.
#[derive(Clone, Copy, Debug)]
struct Vertex {
    direction: Vector3<f64>,
    point: Vector3<f64>,
}

/// The way out of an overlap of two shapes with these poses; `None` if the shapes barely meet.
pub(in crate::contact) fn exit(outlines: [&Outline; 2], poses: [&Pose; 2]) -> Option<Exit> {
    // Around the middle, as Bullet has it: rounding decides between faces of equal depth.
    let middle = (poses[0].position + poses[1].position) * 0.5;
    let poses = poses.map(|pose| Pose { position: pose.position - middle, ..*pose });
    let poses = poses.each_ref();
    let overlap = Overlap { outlines, second: relative(poses[0], poses[1]) };
    let apart = poses[1].position - poses[0].position;
    let guess = apart.try_normalize(0.0).unwrap_or_else(Vector3::x);
    let mut simplex = simplex::around_origin(&overlap, guess)?;
    if !simplex.encloses_origin(&overlap) {
        return None;
    }
    let face = polytope::nearest_face(&overlap, &simplex)?;
    let mut on_first = Vector3::zeros();
    for (direction, weight) in face.directions.iter().zip(face.weights) {
        on_first += overlap.on_first(direction) * weight;
    }
    let on_second = on_first - face.normal * face.depth;
    Some(Exit {
        on_second: compose(poses[0], &Pose::at(on_second)).position + middle,
        normal: -poses[0].world_from_body.rotate(face.normal),
        depth: face.depth,
    })
}

impl Overlap<'_> {
    /// The vertex of the difference, first minus second, that is farthest in a direction of any length.
    fn farthest(&self, direction: &Vector3<f64>) -> Vertex {
        let direction = direction / direction.norm();
        let opposite = inverse(&self.second.world_from_body).rotate(-direction);
        let on_second = compose(&self.second, &Pose::at(self.rounded(1, &opposite))).position;
        Vertex { direction, point: self.on_first(&direction) - on_second }
    }

    fn on_first(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        self.rounded(0, direction)
    }

    /// The farthest point of one of the shapes in its own frame.
    fn rounded(&self, side: usize, direction: &Vector3<f64>) -> Vector3<f64> {
        self.outlines[side].farthest_of_core(direction) + direction * MARGIN
    }
}
