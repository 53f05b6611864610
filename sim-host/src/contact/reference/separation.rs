//! The nearest points of two shapes that do not overlap.
//!
//! Gilbert, Johnson and Keerthi's algorithm with Ericson's sub-simplex tests (Real-Time Collision Detection, 5.1) in
//! the steps of Bullet (`btGjkPairDetector`, `btVoronoiSimplexSolver`), in `f64`: where a flat drone
//! meets a flat wall, many points are the nearest, and it matters which ones.

use nalgebra::Vector3;

use crate::contact::frame::compose;
use crate::contact::outline::Outline;
use crate::world::Pose;

/// Steps after which the search is given up.
const ITERATIONS: usize = 1000;

/// Squared distance \[m²\] of the shapes, or of two points, that counts as none, and relative progress that does.
const ACCURACY: f64 = 1e-12;

/// Squared sixfold volume below which a tetrahedron is flat.
const FLAT: f64 = 1e-16;

/// The nearest points of two shapes.
#[derive(Clone, Copy, Debug)]
pub(in crate::contact) struct Nearest {
    /// On the second shape \[m, world\].
    pub(in crate::contact) on_second: Vector3<f64>,
    /// From the second to the first shape, world.
    pub(in crate::contact) normal: Vector3<f64>,
    /// \[m\].
    pub(in crate::contact) distance: f64,
}

/// A corner of the difference of the shapes, first minus second, and of what.
#[derive(Clone, Copy)]
struct Corner {
    point: Vector3<f64>,
    on_second: Vector3<f64>,
}

/// One to four corners, and what is nearest to the origin among them.
struct Simplex {
    corners: Vec<Corner>,
    nearest: Vector3<f64>,
    on_second: Vector3<f64>,
}

/// The nearest points of the cores of two shapes with these poses; `None` if they overlap.
///
/// Pairs that are farther apart than `reach` \[m\] may come out nearer than they are, but not nearer than that.
pub(in crate::contact) fn nearest(outlines: [&Outline; 2], poses: [&Pose; 2], reach: f64) -> Option<Nearest> {
    let middle = (poses[0].position + poses[1].position) * 0.5;
    let poses = poses.map(|pose| Pose { position: pose.position - middle, ..*pose });
    let mut axis = Vector3::y();
    let mut square = f64::MAX;
    let mut simplex = Simplex { corners: Vec::with_capacity(4), nearest: axis, on_second: Vector3::zeros() };
    let mut last = None;
    for _ in 0..ITERATIONS {
        let corner = farthest(outlines, &poses, &axis);
        let along = axis.dot(&corner.point);
        let beyond = along > 0.0 && along * along > square * reach * reach;
        let stuck = simplex.holds(&corner) || last == Some(corner.point) || square - along <= square * ACCURACY;
        if beyond || stuck {
            break;
        }
        last = Some(corner.point);
        if !simplex.add(corner) {
            break;
        }
        let nearest = simplex.nearest.norm_squared();
        if nearest < ACCURACY {
            axis = simplex.nearest;
            break;
        }
        let progress = square - nearest;
        let converged = progress <= f64::EPSILON * square;
        square = nearest;
        if converged {
            break;
        }
        axis = simplex.nearest;
        if simplex.corners.len() == 4 {
            return None;
        }
    }
    let distance = axis.norm();
    // What is nearer than the search is accurate is an overlap: among the corners of a floor 200 m wide, a face through the
    // origin may be the rounding of a thin triangle, and its normal mean nothing.
    (distance * distance >= ACCURACY).then(|| Nearest {
        on_second: simplex.on_second + middle,
        normal: axis / distance,
        distance,
    })
}

/// The corner of the difference that is farthest against a direction.
fn farthest(outlines: [&Outline; 2], poses: &[Pose; 2], axis: &Vector3<f64>) -> Corner {
    let support = |side: usize, direction: Vector3<f64>| {
        let local = outlines[side].farthest_of_core(&poses[side].world_from_body.rotate_inverse(direction));
        compose(&poses[side], &Pose::at(local)).position
    };
    let on_second = support(1, *axis);
    Corner { point: support(0, -axis) - on_second, on_second }
}

impl Simplex {
    fn holds(&self, corner: &Corner) -> bool {
        self.corners.iter().any(|other| (other.point - corner.point).norm_squared() <= ACCURACY)
    }

    /// Adds a corner, finds what is nearest now, and drops the corners that do not matter; whether there is volume
    /// enough to tell.
    fn add(&mut self, corner: Corner) -> bool {
        self.corners.push(corner);
        let points: Vec<Vector3<f64>> = self.corners.iter().map(|corner| corner.point).collect();
        let weights = match points[..] {
            [_] => [Some(1.0), None, None, None],
            [a, b] => on_segment(&a, &b),
            [a, b, c] => on_triangle(&a, &b, &c),
            [a, b, c, d] => match on_tetrahedron(&[a, b, c, d]) {
                Outside::At(weights) => weights,
                Outside::Nowhere => {
                    self.nearest = Vector3::zeros();
                    return true;
                }
                Outside::Unknown => return false,
            },
            _ => return false,
        };
        let weighted = |pick: fn(&Corner) -> Vector3<f64>| {
            let terms = self.corners.iter().zip(weights);
            terms.map(|(corner, weight)| pick(corner) * weight.unwrap_or(0.0)).sum::<Vector3<f64>>()
        };
        let (nearest, on_second) = (weighted(|corner| corner.point), weighted(|corner| corner.on_second));
        (self.nearest, self.on_second) = (nearest, on_second);
        for index in (0..self.corners.len()).rev() {
            if weights[index].is_none() {
                self.corners.swap_remove(index);
            }
        }
        weights.iter().flatten().all(|weight| *weight >= 0.0)
    }
}

/// Weights of up to four corners; `None` for those that do not matter.
type Weights = [Option<f64>; 4];

fn on_segment(a: &Vector3<f64>, b: &Vector3<f64>) -> Weights {
    let along = b - a;
    let share = -along.dot(a);
    let square = along.norm_squared();
    if share <= 0.0 {
        [Some(1.0), None, None, None]
    } else if share >= square {
        [None, Some(1.0), None, None]
    } else {
        [Some(1.0 - share / square), Some(share / square), None, None]
    }
}

fn on_triangle(a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>) -> Weights {
    let (ab, ac) = (b - a, c - a);
    let [d1, d2] = [-ab.dot(a), -ac.dot(a)];
    if d1 <= 0.0 && d2 <= 0.0 {
        return [Some(1.0), None, None, None];
    }
    let [d3, d4] = [-ab.dot(b), -ac.dot(b)];
    if d3 >= 0.0 && d4 <= d3 {
        return [None, Some(1.0), None, None];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let share = d1 / (d1 - d3);
        return [Some(1.0 - share), Some(share), None, None];
    }
    let [d5, d6] = [-ab.dot(c), -ac.dot(c)];
    if d6 >= 0.0 && d5 <= d6 {
        return [None, None, Some(1.0), None];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let share = d2 / (d2 - d6);
        return [Some(1.0 - share), None, Some(share), None];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let share = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [None, Some(1.0 - share), Some(share), None];
    }
    let scale = 1.0 / (va + vb + vc);
    let (v, w) = (vb * scale, vc * scale);
    [Some(1.0 - v - w), Some(v), Some(w), None]
}

/// Where the nearest point of a tetrahedron is.
enum Outside {
    At(Weights),
    /// The origin is inside.
    Nowhere,
    /// It is too flat to say.
    Unknown,
}

fn on_tetrahedron(corners: &[Vector3<f64>; 4]) -> Outside {
    const FACES: [[usize; 4]; 4] = [[0, 1, 2, 3], [0, 2, 3, 1], [0, 3, 1, 2], [1, 3, 2, 0]];
    let mut best = None;
    let mut least = f64::from(f32::MAX);
    for [i, j, k, opposite] in FACES {
        let [a, b, c, d] = [i, j, k, opposite].map(|index| corners[index]);
        let normal = (b - a).cross(&(c - a));
        let (origin_side, corner_side) = (-a.dot(&normal), (d - a).dot(&normal));
        if corner_side * corner_side < FLAT {
            return Outside::Unknown;
        }
        if origin_side * corner_side >= 0.0 {
            continue;
        }
        let found = on_triangle(&a, &b, &c);
        let weight = |index: usize| found[index].unwrap_or(0.0);
        let square = (a + (b - a) * weight(1) + (c - a) * weight(2)).norm_squared();
        if square < least {
            let mut weights = [None; 4];
            (weights[i], weights[j], weights[k]) = (found[0], found[1], found[2]);
            (best, least) = (Some(weights), square);
        }
    }
    best.map_or(Outside::Nowhere, Outside::At)
}
