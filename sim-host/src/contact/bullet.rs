//! A group's substep as Bullet makes it: contact points that are kept, impulses one after the other.

use kestrel_core::airframe::GRAVITY;
use kestrel_core::attitude::Attitude;
use nalgebra::{Matrix3, Vector3};
use rapier3d::parry::query::{DefaultQueryDispatcher, QueryDispatcher as _};

use super::Motion;
use super::arena::BREAKING_SHARE;
use super::frame::{compose, from_vector, relative, to_pose};
use super::group::{End, Group, Member};
use super::impulses::{self, Meeting, Mobile};
use super::manifold::{ContactMemory, Found, Party};
use super::outline::{MARGIN, Outline};
use super::penetration;
use super::solver::Inertia;
use crate::world::Pose;

/// Friction of a drone: what PyBullet gives a body that states none.
pub(super) const DRONE_FRICTION: f64 = 0.5;

/// Friction of the floor, as in `plane.urdf`.
pub(super) const FLOOR_FRICTION: f64 = 1.0;

/// Bullet's damping of linear and angular velocities; of drones it is a quirk of their free flight.
const DAMPING: f64 = 0.04_f32 as f64;

/// Greatest rotation in one substep \[rad\].
const ROTATION_CAP: f64 = core::f64::consts::FRAC_PI_4;

/// One body of a pair.
struct Side<'a> {
    party: Party,
    /// Index among the members, if it can move.
    member: Option<usize>,
    pose: Pose,
    outline: &'a Outline,
    /// Skin around the outline \[m\].
    margin: f64,
    friction: f64,
    /// Gap at which contacts are let go \[m\].
    breaking: f64,
}

/// Steps the group; what contacts there are moves from one memory to the other.
pub(super) fn step(
    group: &Group<'_>,
    starts: &[Motion],
    known: &mut ContactMemory,
    memory: &mut ContactMemory,
) -> Vec<End> {
    let mut mobiles: Vec<Mobile> =
        group.members.iter().zip(starts).map(|(member, start)| group.mobile(*member, start)).collect();
    let meetings = group.meetings(starts, known, memory);
    let pushed = impulses::resolve(&mut mobiles, &meetings, group.secs);
    let ends = mobiles.iter().zip(starts).zip(pushed);
    ends.map(|((mobile, start), pushed)| End { motion: moved(mobile, start, group.secs), pushed }).collect()
}

impl Group<'_> {
    fn mobile(&self, member: Member, start: &Motion) -> Mobile {
        let Inertia { mass, moments } = match member {
            Member::Drone(_) => self.solver.drone,
            Member::Movable(index) => self.solver.movables[index],
        };
        let inverse = moments.try_inverse().unwrap_or_else(Matrix3::zeros);
        let Motion { pose, velocity, body_rates } = match member {
            Member::Drone(_) => *start,
            Member::Movable(_) => falling(start, &moments, &inverse, self.secs),
        };
        let turn = pose.world_from_body.matrix();
        Mobile {
            inverse_mass: 1.0 / mass,
            inverse_inertia: turn * inverse * turn.transpose(),
            position: pose.position,
            velocity,
            angular_velocity: pose.world_from_body.rotate(body_rates),
        }
    }

    /// All points at which members touch anything.
    fn meetings(&self, starts: &[Motion], known: &mut ContactMemory, memory: &mut ContactMemory) -> Vec<Meeting> {
        let sides: Vec<Side<'_>> = (0..starts.len()).map(|index| self.side(index, &starts[index])).collect();
        let floor = self.floor.then(|| self.ground());
        let solids: Vec<Side<'_>> = self.solids.iter().map(|index| self.solid(*index)).collect();
        let mut meetings = Vec::new();
        for (index, side) in sides.iter().enumerate() {
            // The floor is loaded before the drones, the rest of a world after them.
            let pairs = floor.iter().map(|floor| [floor, side]);
            let pairs = pairs.chain(solids.iter().chain(&sides[index + 1..]).map(|other| [side, other]));
            for pair in pairs {
                let mut manifold = known.take(pair.map(|side| side.party));
                let poses = pair.map(|side| &side.pose);
                let breaking = pair[0].breaking.min(pair[1].breaking);
                if let Party::Floor = pair[0].party {
                    // The floor is a compound shape, of which Bullet refreshes the contacts twice.
                    manifold.refresh(poses, breaking);
                }
                manifold.update(self.find(pair), poses, breaking);
                meetings.extend(manifold.points.iter().map(|point| Meeting {
                    bodies: pair.map(|side| side.member),
                    places: point.places(poses),
                    normal: point.normal.into(),
                    distance: point.distance,
                    friction: pair[0].friction * pair[1].friction,
                }));
                memory.manifolds.extend((!manifold.points.is_empty()).then_some(manifold));
            }
        }
        meetings
    }

    fn side(&self, index: usize, start: &Motion) -> Side<'_> {
        let arena = &self.solver.arena;
        let party = Party::from(self.members[index]);
        let (outline, margin, friction, breaking) = match self.members[index] {
            Member::Drone(_) => (&arena.drone, MARGIN, DRONE_FRICTION, arena.breaking),
            Member::Movable(movable) => {
                let body = &arena.movables[movable];
                let breaking = BREAKING_SHARE * body.outline.radius;
                (&body.outline, 0.0, body.friction, breaking)
            }
        };
        Side { party, member: Some(index), pose: start.pose, outline, margin, friction, breaking }
    }

    fn solid(&self, index: usize) -> Side<'_> {
        let body = &self.solver.arena.solids[index];
        Side {
            party: Party::Solid(index as u32),
            member: None,
            pose: body.pose,
            outline: &body.outline,
            margin: 0.0,
            friction: body.friction,
            breaking: BREAKING_SHARE * body.outline.radius,
        }
    }

    fn ground(&self) -> Side<'_> {
        Side {
            party: Party::Floor,
            member: None,
            pose: Pose::at(Vector3::zeros()),
            outline: &self.solver.arena.ground,
            margin: 0.0,
            friction: FLOOR_FRICTION,
            breaking: f64::INFINITY,
        }
    }

    /// The deepest contact of a pair.
    fn find(&self, pair: [&Side<'_>; 2]) -> Option<Found> {
        let outlines = pair.map(|side| side.outline);
        let shapes = pair.map(|side| side.outline.placed(&side.pose));
        let found = match pair.map(|side| side.party) {
            [Party::Floor, Party::Drone(_)] if !self.solver.arena.is_floor_pending(&shapes[1]) => return None,
            [Party::Floor, _] => on_floor(pair[1].outline, &shapes[1], pair[1].margin),
            _ => beside(pair, &shapes)?,
        };
        if found.distance >= -2.0 * MARGIN {
            return Some(found);
        }
        // The cores overlap: this is where Bullet looks for the way out.
        let exit = penetration::exit(outlines, shapes.each_ref());
        Some(exit.map_or(found, |exit| Found {
            on_second: exit.on_second,
            normal: exit.normal,
            distance: -exit.depth,
        }))
    }
}

/// The nearest points of two bodies beside each other.
fn beside([first, second]: [&Side<'_>; 2], shapes: &[Pose; 2]) -> Option<Found> {
    let between = to_pose(&relative(&shapes[0], &shapes[1]));
    let margin = first.margin + second.margin;
    let reach = (margin + first.breaking.min(second.breaking)) as f32;
    let contact = DefaultQueryDispatcher
        .contact(&between, &*first.outline.shape.0, &*second.outline.shape.0, reach)
        .ok()??;
    let normal = -shapes[0].world_from_body.rotate(from_vector(contact.normal1));
    let on_second = compose(&shapes[1], &Pose::at(from_vector(contact.point2))).position;
    let on_second = on_second + normal * second.margin;
    Some(Found { on_second, normal, distance: f64::from(contact.dist) - margin })
}

/// The lowest point of an outline above or in the floor.
fn on_floor(outline: &Outline, shape_pose: &Pose, margin: f64) -> Found {
    let normal = -Vector3::z();
    let on_second = outline.lowest(shape_pose) + normal * margin;
    Found { on_second, normal, distance: on_second.z }
}

/// A movable's velocities after a substep of free fall.
fn falling(start: &Motion, moments: &Matrix3<f64>, inverse: &Matrix3<f64>, secs: f64) -> Motion {
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

/// Where the new velocities take a body.
fn moved(mobile: &Mobile, start: &Motion, secs: f64) -> Motion {
    let angle = (mobile.angular_velocity.norm() * secs).min(ROTATION_CAP);
    let axis = mobile.angular_velocity.try_normalize(0.0).unwrap_or_else(Vector3::x);
    let turn = Attitude::from_axis_angle(axis, angle);
    let world_from_body = turn.after(&start.pose.world_from_body).normalized();
    Motion {
        pose: Pose { position: start.pose.position + mobile.velocity * secs, world_from_body },
        velocity: mobile.velocity,
        body_rates: world_from_body.rotate_inverse(mobile.angular_velocity),
    }
}
