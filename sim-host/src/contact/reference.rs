//! A group's substep as Bullet makes it: contact points that are kept, impulses one after the other.
//!
//! What this module and those below it do, and in which order, is what Bullet 3.27's source does (© Erwin Coumans and
//! contributors, zlib licence), rewritten: a flight that touches something stays within rounding of the reference's.

mod manifold;
mod penetration;
mod separation;

use kestrel_core::airframe::GRAVITY;
use nalgebra::{Matrix3, Vector3};

use super::Motion;
use super::arena::BREAKING_SHARE;
use super::group::{DRONE_FRICTION, End, FLOOR_FRICTION, Group, Member, Start};
use super::impulses::{self, Constraint, Mobile};
use super::outline::{MARGIN, Outline};
use crate::world::Pose;
pub use manifold::ContactMemory;
use manifold::{ContactBody, FoundContact};

/// Bullet's damping of linear and angular velocities; of drones it is a quirk of their free flight.
const DAMPING: f64 = 0.04_f32 as f64;

/// Distance of two cores below which they overlap for Bullet \[m\].
const OVERLAP: f64 = 1e-12;

/// One body of a pair.
struct Side<'a> {
    party: ContactBody,
    /// Index among the members, if it can move.
    member: Option<usize>,
    pose: Pose,
    outline: &'a Outline,
    friction: f64,
    /// Gap at which contacts are let go \[m\].
    breaking: f64,
}

/// Steps the group; what contacts there are moves from one memory to the other.
pub(super) fn step(
    group: &Group<'_>,
    starts: &[Start],
    known: &mut ContactMemory,
    memory: &mut ContactMemory,
) -> Vec<End> {
    let mut mobiles: Vec<Mobile> =
        group.members.iter().zip(starts).map(|(member, start)| group.mobile(*member, start)).collect();
    let constraints = group.constraints(starts, known, memory);
    let pushed = impulses::resolve(&mut mobiles, &constraints, group.secs);
    let ends = mobiles.iter().zip(starts).zip(pushed);
    ends.map(|((mobile, start), pushed)| End { motion: mobile.moved(&start.motion.pose, group.secs), pushed })
        .collect()
}

impl Group<'_> {
    fn mobile(&self, member: Member, start: &Start) -> Mobile {
        let inertia = self.inertia(member);
        let pose = start.motion.pose;
        let Motion { velocity, body_rates, .. } = match member {
            Member::Drone(_) => start.free,
            Member::Movable(_) => falling(&start.free, &inertia.moments, self.secs),
        };
        Mobile::new(inertia, &pose, velocity, pose.world_from_body.rotate(body_rates))
    }

    /// All points at which members touch anything.
    fn constraints(
        &self,
        starts: &[Start],
        known: &mut ContactMemory,
        memory: &mut ContactMemory,
    ) -> Vec<Constraint> {
        let sides: Vec<Side<'_>> =
            (0..starts.len()).map(|index| self.side(index, &starts[index].motion)).collect();
        let floor = self.floor.then(|| self.ground());
        let solids: Vec<Side<'_>> = self.solids.iter().map(|index| self.solid(*index)).collect();
        let mut constraints = Vec::new();
        for (index, side) in sides.iter().enumerate() {
            // The floor is loaded before the drones, the rest of a world after them.
            let pairs = floor.iter().map(|floor| [floor, side]);
            let pairs = pairs.chain(solids.iter().chain(&sides[index + 1..]).map(|other| [side, other]));
            for pair in pairs {
                let mut manifold = known.take(pair.map(|side| side.party));
                let poses = pair.map(|side| &side.pose);
                let breaking = pair[0].breaking.min(pair[1].breaking);
                if let ContactBody::Floor = pair[0].party {
                    // The floor is a compound shape, of which Bullet refreshes the contacts twice.
                    manifold.refresh(poses, breaking);
                }
                manifold.update(self.find(pair), poses, breaking);
                constraints.extend(manifold.points.iter().map(|point| Constraint {
                    bodies: pair.map(|side| side.member),
                    places: point.places(poses),
                    normal: point.normal.into(),
                    distance: point.distance,
                    friction: pair[0].friction * pair[1].friction,
                }));
                memory.manifolds.extend((!manifold.points.is_empty()).then_some(manifold));
            }
        }
        constraints
    }

    fn side(&self, index: usize, start: &Motion) -> Side<'_> {
        let arena = &self.bodies.arena;
        let party = ContactBody::from(self.members[index]);
        let (outline, friction, breaking) = match self.members[index] {
            Member::Drone(_) => (&arena.drone, DRONE_FRICTION, arena.breaking),
            Member::Movable(movable) => {
                let body = &arena.movables[movable];
                let breaking = BREAKING_SHARE * body.outline.radius;
                (&body.outline, body.friction, breaking)
            }
        };
        Side { party, member: Some(index), pose: start.pose, outline, friction, breaking }
    }

    fn solid(&self, index: usize) -> Side<'_> {
        let body = &self.bodies.arena.solids[index];
        Side {
            party: ContactBody::Solid(index as u32),
            member: None,
            pose: body.pose,
            outline: &body.outline,
            friction: body.friction,
            breaking: BREAKING_SHARE * body.outline.radius,
        }
    }

    fn ground(&self) -> Side<'_> {
        Side {
            party: ContactBody::Floor,
            member: None,
            pose: Pose::at(Vector3::zeros()),
            outline: &self.bodies.arena.ground,
            friction: FLOOR_FRICTION,
            breaking: f64::INFINITY,
        }
    }

    /// The deepest contact of a pair.
    fn find(&self, pair: [&Side<'_>; 2]) -> Option<FoundContact> {
        let outlines = pair.map(|side| side.outline);
        let shapes = pair.map(|side| side.outline.placed(&side.pose));
        if let [ContactBody::Floor, ContactBody::Drone(_)] = pair.map(|side| side.party)
            && !self.bodies.arena.is_floor_pending(&shapes[1])
        {
            return None;
        }
        let shapes = shapes.each_ref();
        let reach = 2.0 * MARGIN + pair[0].breaking.min(pair[1].breaking);
        let apart = separation::nearest(outlines, shapes, reach).map(|nearest| FoundContact {
            on_second: nearest.on_second + nearest.normal * MARGIN,
            normal: nearest.normal,
            distance: nearest.distance - 2.0 * MARGIN,
        });
        if apart.is_some_and(|found| found.distance > OVERLAP - 2.0 * MARGIN) {
            return apart;
        }
        let inside = penetration::exit(outlines, shapes).map(|exit| FoundContact {
            on_second: exit.on_second,
            normal: exit.normal,
            distance: -exit.depth,
        });
        inside.or(apart)
    }
}

/// A movable's velocities after a substep of free fall.
fn falling(start: &Motion, moments: &Matrix3<f64>, secs: f64) -> Motion {
    let inverse = moments.try_inverse().unwrap_or_else(Matrix3::zeros);
    let Motion { pose, velocity, body_rates } = *start;
    let damping = |value: &Vector3<f64>| value * (DAMPING + DAMPING * value.norm());
    let gravity = Vector3::new(0.0, 0.0, -GRAVITY);
    let turning = -(inverse * body_rates.cross(&(moments * body_rates)));
    Motion {
        pose,
        velocity: velocity + (gravity - damping(&velocity)) * secs,
        body_rates: body_rates + (turning - damping(&body_rates)) * secs,
    }
}
