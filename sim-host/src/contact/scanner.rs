//! A world as the beams of a [`Scan`] see it: sixteen of them at once, in lanes.
//!
//! The beams have fixed directions, so that what a beam does to the faces of a body that never moves is known before:
//! a body is a set of slabs (pairs of parallel planes), and for every slab and every beam the reciprocal of the beam's
//! component along the slab's normal is stored. A beam is inside the body between the last slab that it enters and the
//! first that it leaves (Kay & Kajiya 1986).

use core::f64::consts::PI;

use nalgebra::Vector3;

use super::outline::face_normals;
use crate::sensor::{BEAM_LIMIT, Scan};
use crate::world::{Floor, Mesh, Shape, Solid, World};

/// Edge of the cells that know what can be seen from inside them \[m\].
const CELL: f32 = 0.25;

/// Slabs around a cylinder; the prism is wider than it by 0.9 % of the radius at most.
const SIDES: usize = 12;

/// Slabs around a ball; what they enclose is wider than it by 2 % of the radius at most.
const BALL_SIDES: usize = 96;

/// \[rad\].
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// Reciprocal for a beam along a slab: beyond the limit of any scan, and finite.
const PARALLEL: f64 = 1e6;

/// Rounding of `f32`, generously \[m\].
const ROUNDING: f32 = 1e-4;

/// Beams that are clipped at once: two vectors of AVX2.
const BANK: usize = 16;

/// A world prepared for one scan.
#[derive(Clone, Debug)]
pub(super) struct Scanner {
    /// Of each sixteen beams, in their order.
    banks: Vec<Bank>,
}

/// A world prepared for up to sixteen beams.
#[derive(Clone, Debug)]
struct Bank {
    limit: f32,
    /// `-1 / direction.z` of beams that descend onto a floor, else zero.
    per_descent: [f32; BANK],
    slabs: Vec<Slab>,
    /// First slab and one past the last of each body.
    bodies: Vec<[u32; 2]>,
    cells: Cells,
}

/// The space between two parallel planes.
#[derive(Clone, Copy, Debug)]
struct Slab {
    normal: [f32; 3],
    low: f32,
    high: f32,
    /// Metres along each beam for a metre along the normal.
    per_metre: [f32; BANK],
}

/// Which bodies a beam can reach from where.
#[derive(Clone, Debug)]
struct Cells {
    low: [f32; 3],
    counts: [usize; 3],
    /// First entry of `visible` of each cell, and the end of the last; a world has 1,024 bodies at most.
    starts: Vec<u32>,
    visible: Vec<u16>,
    /// Every body, for points outside of all cells.
    all: Vec<u16>,
}

/// Lowest and highest coordinates \[m, world\].
type Extent = (Vector3<f32>, Vector3<f32>);

impl Scanner {
    pub(super) fn new(world: &World, scan: &Scan) -> Self {
        Self { banks: scan.directions().chunks(BANK).map(|beams| Bank::new(world, beams, scan.limit)).collect() }
    }

    /// How near the nearest thing along each beam is: one at the drone, zero at the limit and beyond.
    #[inline(always)]
    pub(super) fn nearness(&self, point: [f32; 3]) -> [f32; BEAM_LIMIT] {
        let mut nearness = [0.0; BEAM_LIMIT];
        for (values, bank) in nearness.as_chunks_mut::<BANK>().0.iter_mut().zip(&self.banks) {
            *values = bank.nearness(point);
        }
        nearness
    }
}

impl Bank {
    fn new(world: &World, directions: &[Vector3<f64>], limit: f32) -> Self {
        let (mut slabs, mut bodies) = (Vec::new(), Vec::new());
        for solid in &world.solids {
            let first = slabs.len() as u32;
            slabs.extend(
                planes(solid).into_iter().map(|(normal, low, high)| Slab::new(normal, low, high, directions)),
            );
            bodies.push([first, slabs.len() as u32]);
        }
        let mut per_descent = [0.0; BANK];
        for (reciprocal, direction) in per_descent.iter_mut().zip(directions) {
            if world.floor == Floor::Solid && direction.z < -1.0 / PARALLEL {
                *reciprocal = (-1.0 / direction.z) as f32;
            }
        }
        let extents: Vec<Extent> = world.solids.iter().map(extent).collect();
        Self { limit, per_descent, slabs, bodies, cells: Cells::new(&extents, directions, limit) }
    }

    /// As [`Scanner::nearness`].
    #[inline(always)]
    fn nearness(&self, point: [f32; 3]) -> [f32; BANK] {
        let limit = self.limit;
        let height = point[2].max(0.0);
        let mut nearest: [f32; BANK] = core::array::from_fn(|beam| {
            let floor = height * self.per_descent[beam];
            if (self.per_descent[beam] > 0.0) & (floor < limit) { floor } else { limit }
        });
        for body in self.cells.visible_from(point) {
            let [first, end] = self.bodies[*body as usize];
            let mut enter = [0.0_f32; BANK];
            let mut leave = [limit; BANK];
            for slab in &self.slabs[first as usize..end as usize] {
                slab.clip(point, &mut enter, &mut leave);
            }
            for beam in 0..BANK {
                let meets = (enter[beam] <= leave[beam]) & (enter[beam] < nearest[beam]);
                nearest[beam] = if meets { enter[beam] } else { nearest[beam] };
            }
        }
        nearest.map(|distance| 1.0 - distance / limit)
    }
}

impl Slab {
    fn new(normal: Vector3<f64>, low: f64, high: f64, directions: &[Vector3<f64>]) -> Self {
        let per_metre = |beam: usize| {
            let rate = directions.get(beam).map_or(0.0, |direction| direction.dot(&normal));
            if rate.abs() < 1.0 / PARALLEL { PARALLEL as f32 } else { (1.0 / rate) as f32 }
        };
        Self {
            normal: normal.map(|value| value as f32).into(),
            low: low as f32,
            high: high as f32,
            per_metre: core::array::from_fn(per_metre),
        }
    }

    /// Leaves of each beam what is between the planes.
    #[inline(always)]
    fn clip(&self, point: [f32; 3], enter: &mut [f32; BANK], leave: &mut [f32; BANK]) {
        let [x, y, z] = self.normal;
        let along = (x * point[0] + y * point[1]) + z * point[2];
        let (to_low, to_high) = (self.low - along, self.high - along);
        for beam in 0..BANK {
            let (one, other) = (to_low * self.per_metre[beam], to_high * self.per_metre[beam]);
            let (near, far) = if one < other { (one, other) } else { (other, one) };
            enter[beam] = if near > enter[beam] { near } else { enter[beam] };
            leave[beam] = if far < leave[beam] { far } else { leave[beam] };
        }
    }
}

impl Cells {
    fn new(extents: &[Extent], directions: &[Vector3<f64>], limit: f32) -> Self {
        let all = (0..extents.len() as u16).collect();
        let hull = extents.iter().copied().reduce(|(low, high), (a, b)| (low.inf(&a), high.sup(&b)));
        let Some((low, high)) = hull else {
            return Self { low: [0.0; 3], counts: [0; 3], starts: vec![0], visible: Vec::new(), all };
        };
        let counts: [usize; 3] = ((high - low) / CELL).map(|cells| cells.ceil().max(1.0) as usize).into();
        let reaches = Reach::of(directions, limit);
        let (mut starts, mut visible) = (vec![0], Vec::new());
        for index in 0..counts.iter().product() {
            let (x, y, z) = (index % counts[0], index / counts[0] % counts[1], index / (counts[0] * counts[1]));
            let corner = low + Vector3::new(x as f32, y as f32, z as f32) * CELL;
            let cell = (corner, corner.add_scalar(CELL));
            let is_seen = |body: &Extent| reaches.iter().any(|reach| reach.may_meet(&cell, body));
            let seen = extents.iter().enumerate().filter(|(_, body)| is_seen(body));
            visible.extend(seen.map(|(body, _)| body as u16));
            starts.push(visible.len() as u32);
        }
        Self { low: low.into(), counts, starts, visible, all }
    }

    #[inline(always)]
    fn visible_from(&self, point: [f32; 3]) -> &[u16] {
        let mut index = 0;
        for axis in [2, 1, 0] {
            // Whatever is below the first cell, or not a number, is cast to a number beyond the last.
            let place = (point[axis] - self.low[axis]) * (1.0 / CELL);
            let place = if place >= 0.0 { place as usize } else { usize::MAX };
            if place >= self.counts[axis] {
                return &self.all;
            }
            index = index * self.counts[axis] + place;
        }
        &self.visible[self.starts[index] as usize..self.starts[index + 1] as usize]
    }
}

/// How far beams of one elevation reach \[m\].
#[derive(Clone, Copy, Debug, PartialEq)]
struct Reach {
    /// Upwards, negative downwards.
    rise: f32,
    across: f32,
}

impl Reach {
    /// Those of some beams, ring by ring.
    fn of(directions: &[Vector3<f64>], limit: f32) -> Vec<Self> {
        let limit = f64::from(limit);
        let reach = |beam: &Vector3<f64>| Self {
            rise: (limit * beam.z) as f32,
            across: (limit * (1.0 - beam.z * beam.z).max(0.0).sqrt()) as f32,
        };
        let mut reaches: Vec<Self> = directions.iter().map(reach).collect();
        reaches.dedup();
        reaches
    }

    /// Whether such a beam from inside the cell may meet the body.
    fn may_meet(self, (low, high): &Extent, (body_low, body_high): &Extent) -> bool {
        let gaps = (body_low - high).sup(&(low - body_high)).add_scalar(-ROUNDING).sup(&Vector3::zeros());
        let rise = if body_low.z > high.z { self.rise } else { -self.rise };
        gaps.z <= rise.max(0.0) && gaps.xy().norm() <= self.across
    }
}

fn extent(solid: &Solid) -> Extent {
    let (low, high) = solid.extent();
    (low.cast(), high.cast())
}

/// The slabs of a solid: unit normal, least and greatest coordinate along it \[m, world\].
fn planes(solid: &Solid) -> Vec<(Vector3<f64>, f64, f64)> {
    let axes = Vector3::from(solid.pose.world_from_body.rows().map(Vector3::from));
    let in_world = |normal: Vector3<f64>| axes.map(|row| row.dot(&normal));
    let place = |(normal, low, high): (Vector3<f64>, f64, f64)| {
        let normal = in_world(normal);
        let middle = normal.dot(&solid.pose.position);
        (normal, middle + low, middle + high)
    };
    local_planes(&solid.shape).into_iter().map(place).collect()
}

fn local_planes(shape: &Shape) -> Vec<(Vector3<f64>, f64, f64)> {
    match shape {
        Shape::Cuboid(half) => {
            let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
            axes.into_iter().zip(half.iter()).map(|(axis, half)| (axis, -half, *half)).collect()
        }
        Shape::Cylinder { radius, half_height } => {
            let side = |number: usize| {
                let (sine, cosine) = libm::sincos(PI * number as f64 / SIDES as f64);
                (Vector3::new(cosine, sine, 0.0), -radius, *radius)
            };
            (0..SIDES).map(side).chain([(Vector3::z(), -half_height, *half_height)]).collect()
        }
        Shape::Sphere(radius) => {
            // Directions that a golden spiral spreads evenly over half a ball.
            let side = |number: usize| {
                let along = 1.0 - (number as f64 + 0.5) / BALL_SIDES as f64;
                let (sine, cosine) = libm::sincos(GOLDEN_ANGLE * number as f64);
                let across = (1.0 - along * along).sqrt();
                (Vector3::new(across * cosine, across * sine, along), -radius, *radius)
            };
            (0..BALL_SIDES).map(side).collect()
        }
        Shape::Hull(points) | Shape::Mesh(Mesh { hull: points, .. }) => {
            let mut planes: Vec<(Vector3<f64>, f64, f64)> = Vec::new();
            for normal in face_normals(points) {
                if planes.iter().all(|(other, ..)| other.cross(&normal).norm() > 1e-4) {
                    let along = points.iter().map(|point| point.dot(&normal));
                    let (low, high) =
                        (along.clone().fold(f64::INFINITY, f64::min), along.fold(-f64::INFINITY, f64::max));
                    planes.push((normal, low, high));
                }
            }
            planes
        }
    }
}
