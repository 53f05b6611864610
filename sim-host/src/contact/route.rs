//! A route around what stands between: few points to fly through, each leg straight and free.
//!
//! The shortest free path ([`DistanceField`]) has a point every 5 cm; a pilot that nearly stops at each wants few.

use kestrel_core::airframe::{Airframe, CF2X};
use nalgebra::Vector3;

use super::{Arena, ContactReport, DistanceField};
use crate::course::Gate;
use crate::world::{Cuboid, Pose, World};

/// Between two poses of the probe on a leg \[m\].
const PROBE_STEP_M: f64 = 0.05;

/// A race line leads this far before and behind a gate on its axis \[m\].
pub const AXIS_M: f64 = 0.45;

/// Where a race line may go around what stands in a leg's way: so far along the leg, and so far aside \[m\].
const ALONG: [f64; 3] = [0.5, 0.25, 0.75];
const ASIDE_M: [f64; 4] = [0.4, 0.7, 1.0, 1.4];

/// What a leg keeps of the path's clearance, for it may cut the corners of the path.
const LEG_SHARE: f64 = 0.8;

/// From where to where, and what is in between.
#[derive(Clone, Copy, Debug)]
pub struct Passage<'a> {
    /// What stands there. What there is to land on is not in the way.
    pub world: &'a World,
    /// Where one may fly \[m, world\].
    pub bounds: Cuboid,
    /// Where flights start \[m, world\].
    pub starts: Cuboid,
    /// Where they go \[m, world\].
    pub goal: Vector3<f32>,
    /// Least distance between the path and everything else \[m\].
    pub clearance_m: f64,
}

impl Passage<'_> {
    /// Whether every start sees the goal: nothing is within four fifths of the clearance of the lines between.
    pub fn is_straight(&self) -> bool {
        let probe = Probe::new(self.world, self.clearance_m * LEG_SHARE);
        corners(&self.starts).iter().all(|begin| probe.is_free(begin, &self.goal.cast()))
    }

    /// Whether a free path keeps the clearance, on a grid of 10 cm.
    pub fn is_free(&self) -> bool {
        let middle = (self.starts.low + self.starts.high) / 2.0;
        let field = DistanceField::new(self.world, &self.goal, self.bounds, self.clearance_m).coarse();
        field.free_path_from(middle.into()).is_some()
    }

    /// Points to fly through on the shortest free path \[m, world\], in centimetres, without the start and the goal: none
    /// where every start sees the goal. `None` where no path is free.
    ///
    /// Legs keep four fifths of the clearance, with edges where the ball around a drone has none.
    pub fn route(&self) -> Option<Vec<Vector3<f64>>> {
        let middle = (self.starts.low + self.starts.high) / 2.0;
        let field = DistanceField::new(self.world, &self.goal, self.bounds, self.clearance_m);
        let path: Vec<Vector3<f64>> =
            field.free_path_from(middle.into())?.iter().map(|point| rounded(point.cast())).collect();
        let probe = Probe::new(self.world, self.clearance_m * LEG_SHARE);
        let mut route = Vec::new();
        let mut from = corners(&self.starts);
        let mut passed = 0;
        loop {
            let seen = |end: &Vector3<f64>| from.iter().all(|begin| probe.is_free(begin, end));
            if seen(&self.goal.cast()) {
                return Some(route);
            }
            passed = (passed + 1..path.len()).rev().find(|index| seen(&path[*index]))?;
            route.push(path[passed]);
            from = vec![path[passed]];
        }
    }
}

/// Points to fly through on a course \[m, world\]: on the axis of each gate, before and behind it, and beside what stands
/// between two gates. Its legs keep four fifths of the clearance. `None` where there is no such line; without a start, what
/// leads to the first gate is not looked at.
pub fn race_line(
    world: &World,
    start: Option<Vector3<f64>>,
    gates: &[Gate],
    clearance_m: f64,
) -> Option<Vec<Vector3<f64>>> {
    let probe = Probe::new(world, clearance_m * LEG_SHARE);
    let (mut line, mut from) = (Vec::new(), start);
    for gate in gates {
        let [before, behind] = [-AXIS_M, AXIS_M].map(|way| gate.on_axis(way));
        if let Some(from) = from {
            line.extend(probe.around(&from, &before)?);
        }
        if !probe.is_free(&before, &behind) {
            return None;
        }
        line.extend([before, behind]);
        from = Some(behind);
    }
    Some(line)
}

/// A body as large as the clearance, which is led along a leg.
struct Probe(Arena);

impl Probe {
    fn new(world: &World, radius: f64) -> Self {
        let airframe =
            Airframe { collision_radius: radius, collision_height: 2.0 * radius, collision_offset: 0.0, ..CF2X };
        Self(Arena::without_map(world, &airframe, ContactReport::Touch))
    }

    /// Points by way of which the leg touches nothing: none where it is free, or one beside it.
    fn around(&self, begin: &Vector3<f64>, end: &Vector3<f64>) -> Option<Vec<Vector3<f64>>> {
        if self.is_free(begin, end) {
            return Some(Vec::new());
        }
        let leg = end - begin;
        let left = Vector3::new(-leg.y, leg.x, 0.0).try_normalize(1e-6)?;
        let asides = ASIDE_M.into_iter().flat_map(|aside| [aside, -aside]);
        let mut points = asides.flat_map(|aside| ALONG.map(|along| begin + leg * along + left * aside));
        points.find(|point| self.is_free(begin, point) && self.is_free(point, end)).map(|point| vec![point])
    }

    /// Whether the leg touches nothing but what there is to land on.
    fn is_free(&self, begin: &Vector3<f64>, end: &Vector3<f64>) -> bool {
        let steps = ((end - begin).norm() / PROBE_STEP_M).ceil().max(1.0);
        (0..=steps as usize).all(|step| {
            let point = begin + (end - begin) * (step as f64 / steps);
            !self.0.touch(&Pose::at(point), &[]).obstacle
        })
    }
}

fn corners(region: &Cuboid) -> Vec<Vector3<f64>> {
    let ends: [Vector3<f64>; 2] = [region.low.cast(), region.high.cast()];
    let corner = |index: usize| Vector3::from_fn(|axis, _| ends[(index >> axis) & 1][axis]);
    (0..8).map(corner).collect()
}

/// In centimetres; −0 is 0.
fn rounded(point: Vector3<f64>) -> Vector3<f64> {
    point.map(|metres| (metres * 100.0).round() / 100.0 + 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Solid;

    /// A room of 4 m with a wall across at x = 0, from the right up to `left_end` \[m\].
    fn route(left_end: f64) -> Option<Vec<Vector3<f64>>> {
        let wall = Solid::block("wall", Vector3::new(-0.05, -1.0, 0.0), Vector3::new(0.05, left_end, 1.5));
        let world = World { solids: vec![wall], ..World::empty() };
        let passage = Passage {
            world: &world,
            bounds: Cuboid { low: Vector3::new(-2.0, -1.0, 0.0), high: Vector3::new(2.0, 1.0, 1.5) },
            starts: Cuboid { low: Vector3::new(-1.6, -0.2, 0.4), high: Vector3::new(-1.4, 0.2, 0.6) },
            goal: Vector3::new(1.5, 0.0, 0.7),
            clearance_m: 0.2,
        };
        passage.route()
    }

    #[test]
    fn where_nothing_stands_between_there_are_no_points() {
        assert_eq!(route(-0.9), Some(Vec::new()));
    }

    #[test]
    fn it_leads_around_the_end_of_a_wall() {
        let route = route(0.3).unwrap();
        assert!((1..=3).contains(&route.len()), "{route:?}");
        let at_wall = route.iter().map(|point| point.y).fold(f64::MIN, f64::max);
        assert!((0.4..0.8).contains(&at_wall), "{route:?}");
        assert!(route.iter().all(|point| *point == rounded(*point)));
    }

    #[test]
    fn a_passage_too_narrow_is_none() {
        assert_eq!(route(0.7), None);
    }
}
