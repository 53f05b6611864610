//! What becomes of bodies that touch: who is near whom, and rapier's answer for each group.

use core::fmt;

use kestrel_core::airframe::Airframe;
use nalgebra::Vector3;
use rapier3d::geometry::SharedShape;

use super::group::Group;
use super::outline::{MARGIN, upright};
use super::{Arena, Motion};
use crate::world::{Floor, Pose, World};

/// Finds what contacts do to drones and movables. It remembers nothing from call to call.
#[derive(Clone)]
pub struct ContactSolver {
    pub(super) arena: Arena,
    pub(super) drone: DroneBody,
    /// Of the movables \[kg\].
    pub(super) masses: Vec<f64>,
}

/// A drone as rapier sees it.
#[derive(Clone)]
pub(super) struct DroneBody {
    pub(super) mass: f64,
    pub(super) inertia: Vector3<f64>,
    /// The cylinder around the prism: of a face with many corners parry uses four neighbours only.
    pub(super) hull: SharedShape,
    pub(super) hull_pose: Pose,
}

/// A body that takes part, by its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Member {
    Drone(usize),
    Movable(usize),
}

/// The space that a body may sweep in a substep.
struct Ball {
    member: Member,
    middle: Vector3<f64>,
    radius: f64,
}

impl fmt::Debug for ContactSolver {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("ContactSolver").finish_non_exhaustive()
    }
}

impl ContactSolver {
    /// Prepares for the arena of this world and airframe.
    pub fn new(arena: &Arena, world: &World, airframe: &Airframe) -> Self {
        let half_height = 0.5 * airframe.collision_height;
        Self {
            arena: arena.clone(),
            drone: DroneBody {
                mass: airframe.mass,
                inertia: airframe.inertia.into(),
                hull: SharedShape::cylinder(half_height as f32, airframe.collision_radius as f32),
                hull_pose: upright(Vector3::new(0.0, 0.0, airframe.collision_offset)),
            },
            masses: world.movables.iter().map(|movable| movable.mass).collect(),
        }
    }

    /// One substep of `secs`.
    ///
    /// `before` are the drones at its start, `after` what free flight makes of them, gravity, rotors and air
    /// included. A drone that nothing pushes keeps `after` to the bit; the others get what contacts make of it.
    /// Movables feel gravity here and move in place; those at rest sleep until something that moves comes near.
    ///
    /// # Panics
    /// If there are not as many drones before as after, or not as many movables as in the world.
    pub fn resolve(&self, before: &[Motion], after: &mut [Motion], movables: &mut [Motion], secs: f64) {
        assert_eq!(before.len(), after.len());
        assert_eq!(movables.len(), self.masses.len());
        let balls = self.balls(before, after, movables, secs);
        for members in neighbours(&balls) {
            let awake = members.iter().any(|ball| is_awake(ball.member, movables));
            let solids = self.solids_near(&members);
            let floor = self.floor_near(&members);
            if awake && (members.len() > 1 || floor || !solids.is_empty()) {
                let members = members.iter().map(|ball| ball.member).collect();
                Group { solver: self, members, solids, floor, secs }.resolve(before, after, movables);
            }
        }
    }

    fn balls(&self, before: &[Motion], after: &[Motion], movables: &[Motion], secs: f64) -> Vec<Ball> {
        let drones = before.iter().zip(after).enumerate().map(|(index, (start, end))| Ball {
            member: Member::Drone(index),
            middle: start.pose.position,
            radius: self.arena.drone.radius + MARGIN + end.velocity.norm() * secs,
        });
        let movables = movables.iter().zip(&self.arena.movables).enumerate().map(|(index, (motion, body))| Ball {
            member: Member::Movable(index),
            middle: motion.pose.position,
            radius: body.outline.radius + MARGIN + motion.velocity.norm() * secs,
        });
        drones.chain(movables).collect()
    }

    fn solids_near(&self, members: &[&Ball]) -> Vec<usize> {
        let near = members.iter().flat_map(|ball| self.arena.solids_within(&ball.middle, ball.radius));
        let mut near: Vec<usize> = near.collect();
        near.sort_unstable();
        near.dedup();
        near
    }

    fn floor_near(&self, members: &[&Ball]) -> bool {
        match self.arena.floor {
            Floor::Solid => members.iter().any(|ball| ball.middle.z <= ball.radius),
            Floor::Absent => false,
        }
    }
}

/// Whether a body moves by itself.
fn is_awake(member: Member, movables: &[Motion]) -> bool {
    match member {
        Member::Drone(_) => true,
        Member::Movable(index) => !movables[index].is_at_rest(),
    }
}

/// The bodies, by groups of which no two can touch.
fn neighbours(balls: &[Ball]) -> Vec<Vec<&Ball>> {
    let mut groups: Vec<Vec<&Ball>> = Vec::new();
    for ball in balls {
        let touches = |other: &&Ball| (other.middle - ball.middle).norm() <= other.radius + ball.radius;
        let (touched, mut apart): (Vec<_>, Vec<_>) =
            groups.into_iter().partition(|group: &Vec<&Ball>| group.iter().any(touches));
        let mut merged = touched.concat();
        merged.push(ball);
        apart.push(merged);
        groups = apart;
    }
    groups
}
