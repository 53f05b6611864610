//! Contact points between two bodies, gathered one per substep as Bullet does.
//!
//! Bullet finds one point of a pair of convex bodies in a step, the deepest, and keeps up to four of them while they
//! stay where they are: a drone that lands flat touches with one corner first. (`btPersistentManifold`,
//! `btConvexConvexAlgorithm`.)

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::contact::frame::{compose, relative};
use crate::contact::group::{Group, Member};
use crate::world::Pose;

/// Points kept of a pair.
const POINTS: usize = 4;

/// One of two bodies that may touch; indices are those of the world and the swarm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(in crate::contact) enum ContactBody {
    Floor,
    Drone(u32),
    Movable(u32),
    Solid(u32),
}

impl From<Member> for ContactBody {
    fn from(member: Member) -> Self {
        match member {
            Member::Drone(index) => Self::Drone(index as u32),
            Member::Movable(index) => Self::Movable(index as u32),
        }
    }
}

/// What the `bullet` physics remembers of contacts from one substep to the next, of all bodies of an environment:
/// where they touched. It is empty while nothing touches.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ContactMemory {
    pub(in crate::contact) manifolds: Vec<Manifold>,
}

/// The contact points of a pair.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::contact) struct Manifold {
    pub(in crate::contact) parties: [ContactBody; 2],
    pub(in crate::contact) points: Vec<Point>,
}

/// A contact point that moves with both bodies.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::contact) struct Point {
    /// In the frame of each body \[m\].
    local: [[f64; 3]; 2],
    /// From the second to the first body, world.
    pub(in crate::contact) normal: [f64; 3],
    /// Between the surfaces, negative where they overlap \[m\].
    pub(in crate::contact) distance: f64,
}

/// A contact that was just found.
#[derive(Clone, Copy, Debug)]
pub(in crate::contact) struct FoundContact {
    /// On the second body \[m, world\].
    pub(in crate::contact) on_second: Vector3<f64>,
    /// From the second to the first body, world.
    pub(in crate::contact) normal: Vector3<f64>,
    /// Between the surfaces, negative where they overlap \[m\].
    pub(in crate::contact) distance: f64,
}

impl ContactMemory {
    /// Forgets everything, as at the start of an episode.
    pub fn clear(&mut self) {
        self.manifolds.clear();
    }

    /// Takes over what is known of the members of a group that sleeps.
    pub(in crate::contact) fn keep(&mut self, known: &mut Self, group: &Group<'_>) {
        let parties: Vec<ContactBody> = group.members.iter().map(|member| ContactBody::from(*member)).collect();
        let of_group = |manifold: &mut Manifold| manifold.parties.iter().any(|body| parties.contains(body));
        self.manifolds.extend(known.manifolds.extract_if(.., of_group));
    }

    /// Takes out what is known of a pair.
    pub(in crate::contact) fn take(&mut self, parties: [ContactBody; 2]) -> Manifold {
        let known = self.manifolds.iter().position(|manifold| manifold.parties == parties);
        known.map_or_else(|| Manifold { parties, points: Vec::new() }, |index| self.manifolds.remove(index))
    }
}

impl Manifold {
    /// Adds what was found, and refreshes.
    pub(in crate::contact) fn update(&mut self, found: Option<FoundContact>, poses: [&Pose; 2], breaking: f64) {
        if let Some(found) = found.filter(|found| found.distance <= breaking) {
            let point = Point::new(&found, poses);
            match self.nearest(&point, breaking) {
                Some(index) => self.points[index] = point,
                None if self.points.len() < POINTS => self.points.push(point),
                None => {
                    let index = self.superfluous(&point);
                    self.points[index] = point;
                }
            }
        }
        self.refresh(poses, breaking);
    }

    /// Lets the points follow the bodies, and lets go of those that came apart by more than `breaking` \[m\].
    pub(in crate::contact) fn refresh(&mut self, poses: [&Pose; 2], breaking: f64) {
        for index in (0..self.points.len()).rev() {
            let (distance, drift) = self.points[index].separation(poses);
            self.points[index].distance = distance;
            if distance > breaking || drift > breaking {
                self.points.swap_remove(index);
            }
        }
    }

    /// The point that the new one continues, if any is within `breaking` on the first body.
    fn nearest(&self, point: &Point, breaking: f64) -> Option<usize> {
        let apart = |other: &Point| (Vector3::from(other.local[0]) - Vector3::from(point.local[0])).norm_squared();
        let mut nearest = None;
        let mut least = breaking * breaking;
        for (index, other) in self.points.iter().enumerate() {
            if apart(other) < least {
                (nearest, least) = (Some(index), apart(other));
            }
        }
        nearest
    }

    /// Which of four points to give up for a new one: the deepest stays, and the area that is left is the greatest.
    fn superfluous(&self, point: &Point) -> usize {
        let mut deepest = None;
        let mut depth = point.distance;
        for (index, other) in self.points.iter().enumerate() {
            if other.distance < depth {
                (deepest, depth) = (Some(index), other.distance);
            }
        }
        let at = |index: usize| Vector3::from(self.points[index].local[0]);
        let new = Vector3::from(point.local[0]);
        // The points that remain span these diagonals.
        let diagonals = [[1, 3, 2], [0, 3, 2], [0, 3, 1], [0, 2, 1]];
        let (mut best, mut greatest) = (0, f64::NEG_INFINITY);
        for (index, [a, b, c]) in diagonals.into_iter().enumerate() {
            let area = (new - at(a)).cross(&(at(b) - at(c))).norm_squared();
            let area = if deepest == Some(index) { 0.0 } else { area };
            if area > greatest {
                (best, greatest) = (index, area);
            }
        }
        best
    }
}

impl Point {
    fn new(found: &FoundContact, poses: [&Pose; 2]) -> Self {
        let on_first = found.on_second + found.normal * found.distance;
        let local = |pose: &Pose, point: Vector3<f64>| relative(pose, &Pose::at(point)).position.into();
        Self {
            local: [local(poses[0], on_first), local(poses[1], found.on_second)],
            normal: found.normal.into(),
            distance: found.distance,
        }
    }

    /// Where it is on each body now \[m, world\].
    pub(in crate::contact) fn places(&self, poses: [&Pose; 2]) -> [Vector3<f64>; 2] {
        [0, 1].map(|side| compose(poses[side], &Pose::at(self.local[side].into())).position)
    }

    /// How far its two places are apart along the normal and across it \[m\].
    fn separation(&self, poses: [&Pose; 2]) -> (f64, f64) {
        let [first, second] = self.places(poses);
        let normal = Vector3::from(self.normal);
        let distance = (first - second).dot(&normal);
        (distance, (first - second - normal * distance).norm())
    }
}
