//! What becomes of bodies that touch: who is near whom, and the answer for each group.

use core::mem;

use core::fmt;

use kestrel_core::airframe::Airframe;
use nalgebra::{Matrix3, Vector3};
use rapier3d::geometry::SharedShape;

use super::group::{Bodies, Group, HullSize, Inertia, Member};
use super::outline::{MARGIN, upright};
use super::{Arena, ContactMemory, ContactReport, Motion, drones, rapier, reference};
use crate::world::{Drive, Floor, World};

/// Finds what contacts do to drones and movables: by impulses on drones alone, by rapier where movables can be pushed, or as
/// Bullet does if the arena reports as Bullet does.
#[derive(Clone)]
pub struct ContactSolver {
    bodies: Bodies,
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
        let inertia = |mass: f64, moments: Matrix3<f64>| Inertia { mass, moments };
        let movables = world.movables.iter().zip(&arena.movables);
        let bodies = Bodies {
            arena: arena.clone(),
            drone: inertia(airframe.mass, Matrix3::from_diagonal(&airframe.inertia.into())),
            hull: SharedShape::cylinder(half_height as f32, airframe.collision_radius as f32),
            hull_pose: upright(Vector3::new(0.0, 0.0, airframe.collision_offset)),
            hull_size: HullSize {
                radius: airframe.collision_radius,
                half_height,
                offset: airframe.collision_offset,
            },
            movables: movables
                .map(|(movable, body)| match movable.drive {
                    Drive::Pushed { mass } => inertia(mass, body.outline.inertia_per_mass() * mass),
                    Drive::Carried | Drive::Walking(_) => Inertia::immense(),
                })
                .collect(),
        };
        Self { bodies }
    }

    /// One substep of `secs`.
    ///
    /// `before` are the drones at its start, `after` what free flight makes of them, gravity, rotors and air
    /// included. A drone that nothing pushes keeps `after` to the bit; the others get what contacts make of it.
    /// Movables feel gravity here and move in place; those at rest sleep until something that moves comes near. Those
    /// that are carried keep the velocity that they have.
    /// `memory` belongs to the environment; only the `bullet` physics writes into it.
    ///
    /// # Panics
    /// If there are not as many drones before as after, or not as many movables as in the world.
    pub fn resolve(
        &self,
        before: &[Motion],
        after: &mut [Motion],
        movables: &mut [Motion],
        memory: &mut ContactMemory,
        secs: f64,
    ) {
        assert_eq!(before.len(), after.len());
        assert_eq!(movables.len(), self.bodies.movables.len());
        let balls = self.balls(before, after, movables, secs);
        let mut known = mem::take(memory);
        for balls in neighbours(&balls) {
            let members = balls.iter().map(|ball| ball.member).collect();
            let group = Group::new(&self.bodies, members, self.near(&balls), secs);
            if group.is_asleep(movables) {
                memory.keep(&mut known, &group);
            } else if !group.is_free() {
                let starts = group.starts(before, after, movables);
                let ends = match self.bodies.arena.report {
                    ContactReport::Touch if group.pushes_movables() => rapier::step(&group, &starts),
                    ContactReport::Touch => drones::step(&group, &starts),
                    ContactReport::Bullet => reference::step(&group, &starts, &mut known, memory),
                };
                group.finish(&starts, &ends, after, movables);
            }
        }
    }

    fn balls(&self, before: &[Motion], after: &[Motion], movables: &[Motion], secs: f64) -> Vec<Ball> {
        let ball = |member, motion: &Motion, speed: f64, radius: f64| Ball {
            member,
            middle: motion.pose.position,
            radius: radius + 2.0 * MARGIN + speed * secs,
        };
        let drones = before.iter().zip(after).enumerate().map(|(index, (start, end))| {
            ball(Member::Drone(index), start, end.velocity.norm(), self.bodies.arena.drone.radius)
        });
        let movables =
            movables.iter().zip(&self.bodies.arena.movables).enumerate().map(|(index, (motion, body))| {
                ball(Member::Movable(index), motion, motion.velocity.norm(), body.outline.radius)
            });
        drones.chain(movables).collect()
    }

    /// What cannot move near the balls: indices of solids, and whether the floor is.
    fn near(&self, balls: &[&Ball]) -> (Vec<usize>, bool) {
        let solids = balls.iter().flat_map(|ball| self.bodies.arena.solids_within(&ball.middle, ball.radius));
        let mut solids: Vec<usize> = solids.collect();
        solids.sort_unstable();
        solids.dedup();
        let floor = match self.bodies.arena.floor {
            Floor::Solid => balls.iter().any(|ball| ball.middle.z <= ball.radius),
            Floor::Absent => false,
        };
        (solids, floor)
    }
}

/// The bodies, by groups of which no two can touch.
fn neighbours(balls: &[Ball]) -> Vec<Vec<&Ball>> {
    if let [lone] = balls {
        return vec![vec![lone]];
    }
    let mut groups: Vec<Vec<&Ball>> = Vec::new();
    for ball in balls {
        let meets = |other: &&Ball| (other.middle - ball.middle).norm() <= other.radius + ball.radius;
        let (met, mut apart): (Vec<_>, Vec<_>) =
            groups.into_iter().partition(|group: &Vec<&Ball>| group.iter().any(meets));
        let mut merged = met.concat();
        merged.push(ball);
        apart.push(merged);
        groups = apart;
    }
    groups
}
