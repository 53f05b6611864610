//! A polytope inside a difference of shapes, grown until its face nearest to the origin is on the surface.

use nalgebra::Vector3;

use super::simplex::{Simplex, volume};
use super::{Overlap, Vertex};

/// Vertices that may be added, and twice as many faces.
const VERTICES: usize = 128;

/// Length below which a face has no area, and growth that ends the search \[m\].
const ACCURACY: f64 = 1e-12;

/// Distance by which a face may be behind the origin \[m\].
const PLANE: f64 = 1e-14;

/// The face found.
pub(super) struct NearestFace {
    /// Outward.
    pub(super) normal: Vector3<f64>,
    /// Distance of the origin \[m\].
    pub(super) depth: f64,
    /// Directions of its vertices.
    pub(super) directions: [Vector3<f64>; 3],
    /// Of the vertices, for the point below the origin.
    pub(super) weights: [f64; 3],
}

#[derive(Clone, Copy)]
struct Face {
    normal: Vector3<f64>,
    distance: f64,
    corners: [usize; 3],
    /// The face across each edge, and which of its edges that is.
    across: [(usize, usize); 3],
    /// The last round in which it was seen from the new vertex.
    round: usize,
}

struct Polytope {
    vertices: Vec<Vertex>,
    faces: Vec<Face>,
    /// Indices of the faces that are part of it, oldest first.
    surface: Vec<usize>,
}

/// The ring of faces that a new vertex makes.
#[derive(Default)]
struct Ring {
    first: Option<usize>,
    last: Option<usize>,
    len: usize,
}

/// The face of the difference of shapes nearest to the origin, grown from a tetrahedron around the origin.
pub(super) fn nearest_face(overlap: &Overlap<'_>, simplex: &Simplex) -> Option<NearestFace> {
    let mut polytope = Polytope::around(simplex)?;
    let mut best = polytope.best();
    let mut outer = polytope.faces[best];
    for round in 1..=VERTICES {
        polytope.faces[best].round = round;
        let vertex = overlap.farthest(&polytope.faces[best].normal);
        let face = polytope.faces[best];
        if face.normal.dot(&vertex.point) - face.distance <= ACCURACY || !polytope.grow(best, vertex, round) {
            break;
        }
        best = polytope.best();
        outer = polytope.faces[best];
    }
    Some(polytope.result(&outer))
}

impl Polytope {
    /// The tetrahedron, its faces turned outward.
    fn around(simplex: &Simplex) -> Option<Self> {
        let mut vertices = simplex.vertices.to_vec();
        let [a, b, c, d] = [0, 1, 2, 3].map(|index| vertices[index].point);
        if volume(&(a - d), &(b - d), &(c - d)) < 0.0 {
            vertices.swap(0, 1);
        }
        let mut polytope = Self { vertices, faces: Vec::new(), surface: Vec::new() };
        for corners in [[0, 1, 2], [1, 0, 3], [2, 1, 3], [0, 2, 3]] {
            polytope.add(corners, Keep::Always)?;
        }
        for [face, edge, other, edge_of_other] in
            [[0, 0, 1, 0], [0, 1, 2, 0], [0, 2, 3, 0], [1, 1, 3, 2], [1, 2, 2, 1], [2, 2, 3, 1]]
        {
            polytope.join(face, edge, other, edge_of_other);
        }
        Some(polytope)
    }

    /// The newest of the faces nearest to the origin.
    fn best(&self) -> usize {
        let mut best = self.surface[self.surface.len() - 1];
        let mut least = self.faces[best].distance.powi(2);
        for face in self.surface.iter().rev() {
            let square = self.faces[*face].distance.powi(2);
            if square < least {
                (best, least) = (*face, square);
            }
        }
        best
    }

    /// Replaces all faces that the new vertex sees; whether that worked.
    fn grow(&mut self, best: usize, vertex: Vertex, round: usize) -> bool {
        self.vertices.push(vertex);
        let mut ring = Ring::default();
        for edge in 0..3 {
            let (face, edge) = self.faces[best].across[edge];
            if !self.expand(face, edge, round, &mut ring) {
                return false;
            }
        }
        match ring {
            Ring { first: Some(first), last: Some(last), len: 3.. } => {
                self.join(last, 1, first, 2);
                self.remove(best);
                true
            }
            Ring { .. } => false,
        }
    }

    /// Goes on over an edge of a face: the new vertex sees it, or it borders the new faces.
    fn expand(&mut self, face: usize, edge: usize, round: usize, ring: &mut Ring) -> bool {
        if self.faces[face].round == round {
            return false;
        }
        let newest = self.vertices.len() - 1;
        let Face { normal, distance, corners, across, .. } = self.faces[face];
        let next = (edge + 1) % 3;
        if normal.dot(&self.vertices[newest].point) - distance < -PLANE {
            let Some(new) = self.add([corners[next], corners[edge], newest], Keep::IfOutward) else {
                return false;
            };
            self.join(new, 0, face, edge);
            match ring.last {
                Some(last) => self.join(last, 1, new, 2),
                None => ring.first = Some(new),
            }
            ring.last = Some(new);
            ring.len += 1;
            return true;
        }
        self.faces[face].round = round;
        let sides = [across[next], across[(edge + 2) % 3]];
        let seen = sides.into_iter().all(|(face, edge)| self.expand(face, edge, round, ring));
        if seen {
            self.remove(face);
        }
        seen
    }

    fn join(&mut self, face: usize, edge: usize, other: usize, edge_of_other: usize) {
        self.faces[face].across[edge] = (other, edge_of_other);
        self.faces[other].across[edge_of_other] = (face, edge);
    }

    fn remove(&mut self, face: usize) {
        self.surface.retain(|other| *other != face);
    }

    fn add(&mut self, corners: [usize; 3], keep: Keep) -> Option<usize> {
        let [a, b, c] = corners.map(|corner| self.vertices[corner].point);
        let normal = (b - a).cross(&(c - a));
        let length = normal.norm();
        if length <= ACCURACY || self.surface.len() == 2 * VERTICES {
            return None;
        }
        let beyond = beyond_edge(&normal, &a, &b);
        let beyond = beyond.or_else(|| beyond_edge(&normal, &b, &c)).or_else(|| beyond_edge(&normal, &c, &a));
        let distance = beyond.unwrap_or_else(|| a.dot(&normal) / length);
        if matches!(keep, Keep::IfOutward) && distance < -PLANE {
            return None;
        }
        let face = Face { normal: normal / length, distance, corners, across: [(0, 0); 3], round: 0 };
        self.faces.push(face);
        self.surface.push(self.faces.len() - 1);
        Some(self.faces.len() - 1)
    }

    fn result(&self, face: &Face) -> NearestFace {
        let vertices = face.corners.map(|corner| self.vertices[corner]);
        let foot = face.normal * face.distance;
        let [a, b, c] = vertices.map(|vertex| vertex.point - foot);
        let areas = [b.cross(&c).norm(), c.cross(&a).norm(), a.cross(&b).norm()];
        let sum = areas[0] + areas[1] + areas[2];
        NearestFace {
            normal: face.normal,
            depth: face.distance,
            directions: vertices.map(|vertex| vertex.direction),
            weights: areas.map(|area| area / sum),
        }
    }
}

/// Which faces become part of a polytope.
#[derive(Clone, Copy)]
enum Keep {
    Always,
    IfOutward,
}

/// Distance of the origin from the edge of a face, if it is beyond that edge.
fn beyond_edge(normal: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> Option<f64> {
    let along = b - a;
    if a.dot(&along.cross(normal)) >= 0.0 {
        return None;
    }
    Some(if a.dot(&along) > 0.0 {
        a.norm()
    } else if b.dot(&along) < 0.0 {
        b.norm()
    } else {
        let product = a.dot(b);
        let square = (a.norm_squared() * b.norm_squared() - product * product) / along.norm_squared();
        square.max(0.0).sqrt()
    })
}
