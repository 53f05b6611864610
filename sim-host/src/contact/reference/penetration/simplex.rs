//! Up to four points of a difference of shapes, brought around the origin (Gilbert, Johnson & Keerthi 1988).

use nalgebra::Vector3;

use super::{Overlap, Vertex};

const ITERATIONS: usize = 128;

/// Squared distance of vertices that count as one, distance of the origin that counts as none, and relative progress
/// that counts as none.
const ACCURACY: f64 = 1e-12;

/// Vertices with their weights for the point that is nearest to the origin.
#[derive(Clone, Copy, Debug)]
pub(super) struct Simplex {
    pub(super) vertices: [Vertex; 4],
    pub(super) len: usize,
}

/// The point of a simplex that is nearest to the origin.
struct Nearest {
    /// Its squared distance.
    square: f64,
    weights: [f64; 4],
}

/// A simplex that touches or holds the origin; `None` if the shapes do not overlap.
pub(super) fn around_origin(overlap: &Overlap<'_>, guess: Vector3<f64>) -> Option<Simplex> {
    let first = overlap.farthest(&guess);
    let mut simplex = Simplex { vertices: [first; 4], len: 1 };
    let mut ray = first.point;
    let mut recent = [ray; 4];
    let mut newest = 0;
    let mut lower_bound = 0.0_f64;
    for _ in 0..ITERATIONS {
        let length = ray.norm();
        if length < ACCURACY {
            return Some(simplex);
        }
        let vertex = overlap.farthest(&-ray);
        if recent.iter().any(|point| (vertex.point - point).norm_squared() < ACCURACY) {
            return None;
        }
        newest = (newest + 1) & 3;
        recent[newest] = vertex.point;
        lower_bound = lower_bound.max(ray.dot(&vertex.point) / length);
        if length - lower_bound - ACCURACY * length <= 0.0 {
            return None;
        }
        simplex.push(vertex);
        let nearest = simplex.nearest_to_origin()?;
        ray = simplex.reduce(&nearest.weights);
        if simplex.len == 4 {
            return Some(simplex);
        }
    }
    None
}

impl Simplex {
    fn push(&mut self, vertex: Vertex) {
        self.vertices[self.len] = vertex;
        self.len += 1;
    }

    fn nearest_to_origin(&self) -> Option<Nearest> {
        let [a, b, c, d] = self.vertices.map(|vertex| vertex.point);
        match self.len {
            2 => on_segment(&a, &b),
            3 => on_triangle(&a, &b, &c),
            _ => in_tetrahedron(&[a, b, c, d]),
        }
    }

    /// Keeps the vertices that have weight; their weighted sum.
    fn reduce(&mut self, weights: &[f64; 4]) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        let mut kept = 0;
        for index in 0..self.len {
            if weights[index].is_nan() {
                continue;
            }
            self.vertices[kept] = self.vertices[index];
            sum += self.vertices[kept].point * weights[index];
            kept += 1;
        }
        self.len = kept;
        sum
    }

    /// Adds vertices until the simplex is a tetrahedron with a volume.
    pub(super) fn encloses_origin(&mut self, overlap: &Overlap<'_>) -> bool {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let [a, b, c, d] = self.vertices.map(|vertex| vertex.point);
        match self.len {
            1 => axes.iter().any(|axis| self.encloses_origin_with(overlap, axis)),
            2 => axes.iter().any(|axis| self.encloses_origin_with(overlap, &(b - a).cross(axis))),
            3 => self.encloses_origin_with(overlap, &(b - a).cross(&(c - a))),
            _ => volume(&(a - d), &(b - d), &(c - d)).abs() > 0.0,
        }
    }

    fn encloses_origin_with(&mut self, overlap: &Overlap<'_>, direction: &Vector3<f64>) -> bool {
        let len = self.len;
        if direction.norm_squared() <= 0.0 {
            return false;
        }
        [*direction, -direction].iter().any(|direction| {
            self.len = len;
            self.push(overlap.farthest(direction));
            self.encloses_origin(overlap)
        })
    }
}

/// Six times the volume of the tetrahedron of three vectors.
pub(super) fn volume(a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>) -> f64 {
    a.y * b.z * c.x + a.z * b.x * c.y - a.x * b.z * c.y - a.y * b.x * c.z + a.x * b.y * c.z - a.z * b.y * c.x
}

/// Of a vertex that does not count; zero weights do.
const NONE: f64 = f64::NAN;

fn on_segment(a: &Vector3<f64>, b: &Vector3<f64>) -> Option<Nearest> {
    let along = b - a;
    let square = along.norm_squared();
    if square <= 0.0 {
        return None;
    }
    let share = -a.dot(&along) / square;
    let (square, first, second) = if share >= 1.0 {
        (b.norm_squared(), NONE, 1.0)
    } else if share <= 0.0 {
        (a.norm_squared(), 1.0, NONE)
    } else {
        ((a + along * share).norm_squared(), 1.0 - share, share)
    };
    Some(Nearest { square, weights: [first, second, NONE, NONE] })
}

fn on_triangle(a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>) -> Option<Nearest> {
    let corners = [a, b, c];
    let edges = [a - b, b - c, c - a];
    let normal = edges[0].cross(&edges[1]);
    let square = normal.norm_squared();
    if square <= 0.0 {
        return None;
    }
    let mut nearest: Option<Nearest> = None;
    for (index, next) in [(0, 1), (1, 2), (2, 0)] {
        if corners[index].dot(&edges[index].cross(&normal)) <= 0.0 {
            continue;
        }
        // Bullet takes an edge without length for nearest of all; it does not occur.
        let found = on_segment(corners[index], corners[next])?;
        if nearest.as_ref().is_none_or(|nearest| found.square < nearest.square) {
            let mut weights = [NONE; 4];
            (weights[index], weights[next]) = (found.weights[0], found.weights[1]);
            nearest = Some(Nearest { weights, ..found });
        }
    }
    nearest.or_else(|| {
        let foot = normal * (a.dot(&normal) / square);
        let length = square.sqrt();
        let first = edges[1].cross(&(b - foot)).norm() / length;
        let second = edges[2].cross(&(c - foot)).norm() / length;
        let weights = [first, second, 1.0 - (first + second), NONE];
        Some(Nearest { square: foot.norm_squared(), weights })
    })
}

fn in_tetrahedron(corners: &[Vector3<f64>; 4]) -> Option<Nearest> {
    let [a, b, c, d] = corners;
    let edges = [a - d, b - d, c - d];
    let all = volume(&edges[0], &edges[1], &edges[2]);
    if all * a.dot(&(b - c).cross(&(a - b))) > 0.0 || all == 0.0 {
        return None;
    }
    let mut nearest: Option<Nearest> = None;
    for (index, next) in [(0, 1), (1, 2), (2, 0)] {
        if all * d.dot(&edges[index].cross(&edges[next])) <= 0.0 {
            continue;
        }
        let found = on_triangle(&corners[index], &corners[next], d)?;
        if nearest.as_ref().is_none_or(|nearest| found.square < nearest.square) {
            let mut weights = [NONE; 4];
            (weights[index], weights[next], weights[3]) = (found.weights[0], found.weights[1], found.weights[2]);
            nearest = Some(Nearest { weights, ..found });
        }
    }
    nearest.or_else(|| {
        let share = |a, b, c| volume(a, b, c) / all;
        let [first, second, third] = [share(c, b, d), share(a, c, d), share(b, a, d)];
        Some(Nearest { square: 0.0, weights: [first, second, third, 1.0 - (first + second + third)] })
    })
}
