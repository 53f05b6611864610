//! A course of gates as it is drawn: each gate ahead of the one before, posts between, and a line that leads through all.

use core::f64::consts::PI;

use nalgebra::{Vector3, vector};

use super::STARTS;
use super::furnishing::{WALL_M, walls};
use crate::contact::race_line;
use crate::course::Gate;
use crate::scenario::Aviary;
use crate::seed::Stream;
use crate::world::{Cuboid, Floor, Pose, Shape, Solid, World};

/// Corners of the hall \[m\].
const HALL: Cuboid = Cuboid { low: vector![-1.0, -3.0, 0.0], high: vector![9.0, 3.0, 2.5] };

/// From a gate to the next \[m\], how far off the way flown so far it lies, and how far off that leg it is turned \[degrees\].
const LEG_M: [f32; 2] = [1.5, 3.5];
const BEARING_DEG: f32 = 75.0;
const TURN_DEG: f32 = 40.0;

/// How much higher or lower the next gate is, at most \[m\].
const CLIMB_M: f32 = 0.5;

/// Between the middles of two gates, at least \[m\], and between a gate's frame and the walls, the floor and the ceiling.
const APART_M: f64 = 1.3;
const MARGIN_M: f64 = 0.25;

/// Posts: from the floor to the ceiling, of this radius, this far from every gate's axis \[m\], which is kept free so far before
/// and behind it.
const POST_RADIUS_M: f64 = 0.08;
const POST_APART_M: f64 = 0.5;
const AXIS_M: f64 = 0.6;

/// Between the line through the gates and everything else, on whose legs four fifths of it are kept \[m\].
const CLEARANCE_M: f64 = 0.3;

/// Tries to find the next gate a place before the course is drawn anew.
const TRIES: usize = 40;

/// Width of a frame's bars \[m\].
const BAR_M: f64 = 0.1;

/// What courses are made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Raceway {
    /// Least and greatest number of gates.
    pub gates: [u32; 2],
    /// Least and greatest width and height of their openings \[m\].
    pub opening: [f32; 2],
    /// Most posts between them.
    pub posts: u32,
}

impl Raceway {
    /// Where the middles of gates can be \[m\].
    pub(super) fn goals() -> Cuboid {
        let margin = Vector3::repeat(MARGIN_M as f32);
        Cuboid { low: HALL.low + margin, high: HALL.high - margin }
    }

    /// The hall without a gate.
    pub(super) fn bare() -> World {
        World { floor: Floor::Solid, solids: walls(&HALL), ..World::empty() }
    }

    /// A course with at most so many posts, if this draw has a free line through its gates.
    pub(super) fn draw(&self, posts: u32, stream: &mut Stream) -> Option<Aviary> {
        let gates = self.gates(stream)?;
        let mut world = Self::bare();
        for (index, gate) in gates.iter().enumerate() {
            world.solids.extend(gate.frame(&format!("gate {}", index + 1), BAR_M));
        }
        for _ in 0..stream.below(posts + 1) {
            world.solids.extend(post(&gates, stream));
        }
        let line = race_line(&world, Some(start()), &gates, CLEARANCE_M)?;
        let route = line.iter().map(|point| point.cast()).collect();
        Some(Aviary { goal: gates[0].center.cast(), routes: vec![route], gates, world })
    }

    /// Gates one after the other, if all find a place.
    fn gates(&self, stream: &mut Stream) -> Option<Vec<Gate>> {
        let [least, most] = self.gates;
        let count = least + stream.below(most - least + 1);
        let mut gates: Vec<Gate> = Vec::new();
        let mut from = (start(), 0.0);
        for _ in 0..count {
            let gate = (0..TRIES).map(|_| self.gate(from, stream)).find(|gate| is_clear(gate, &gates))?;
            from = (gate.center, gate.heading);
            gates.push(gate);
        }
        Some(gates)
    }

    /// A gate ahead of a place and a heading.
    fn gate(&self, (from, heading): (Vector3<f64>, f64), stream: &mut Stream) -> Gate {
        let mut between = |low: f32, high: f32| f64::from(stream.between(low, high));
        let bearing = heading + between(-BEARING_DEG, BEARING_DEG).to_radians();
        let length = between(LEG_M[0], LEG_M[1]);
        let (sine, cosine) = libm::sincos(bearing);
        let climb = between(-CLIMB_M, CLIMB_M);
        let turned = bearing + between(-TURN_DEG, TURN_DEG).to_radians();
        let [width, height] = [0, 1].map(|_| between(self.opening[0], self.opening[1]));
        let whole = libm::floor((turned + PI) / (2.0 * PI));
        Gate {
            center: from + Vector3::new(length * cosine, length * sine, climb),
            heading: turned - 2.0 * PI * whole,
            opening: [width, height],
        }
    }
}

/// The middle of the starts \[m\].
fn start() -> Vector3<f64> {
    (STARTS.low + STARTS.high).cast() / 2.0
}

/// Whether a gate is inside the hall, and away from the others and from the starts.
fn is_clear(gate: &Gate, others: &[Gate]) -> bool {
    let reach = |opening: f64| opening / 2.0 + BAR_M + MARGIN_M;
    let [aside, up] = gate.opening.map(reach);
    let reach = Vector3::new(aside, aside, up);
    let (low, high): (Vector3<f64>, Vector3<f64>) = (HALL.low.cast() + reach, HALL.high.cast() - reach);
    let apart = |other: &Vector3<f64>| (gate.center - other).xy().norm() >= APART_M;
    gate.center.sup(&low).inf(&high) == gate.center
        && apart(&start())
        && others.iter().all(|other| apart(&other.center))
}

/// A post that leaves the gates' axes and the starts free, if one is soon found.
fn post(gates: &[Gate], stream: &mut Stream) -> Option<Solid> {
    let height = f64::from(HALL.high.z);
    let margin = (POST_RADIUS_M + WALL_M) as f32;
    (0..TRIES).find_map(|_| {
        let [x, y] =
            [0, 1].map(|axis| f64::from(stream.between(HALL.low[axis] + margin, HALL.high[axis] - margin)));
        let at = Vector3::new(x, y, height / 2.0);
        let near_axis = gates.iter().any(|gate| {
            let along = gate.forward().dot(&(at - gate.center)).clamp(-AXIS_M, AXIS_M);
            (gate.on_axis(along) - at).xy().norm() < POST_APART_M
        });
        let near_start = (at - start()).xy().norm() < 2.0 * POST_APART_M;
        let blank = Solid::block("post", Vector3::zeros(), Vector3::zeros());
        let shape = Shape::Cylinder { radius: POST_RADIUS_M, half_height: height / 2.0 };
        (!near_axis && !near_start).then(|| Solid { shape, pose: Pose::at(at), ..blank })
    })
}
