//! A few bodies that may touch, and what cannot move near them.

use nalgebra::Matrix3;
use rapier3d::geometry::SharedShape;

use super::{Arena, Motion};
use crate::world::Pose;

/// Friction of a drone: what the reference gives a body that states none.
pub(super) const DRONE_FRICTION: f64 = 0.5;

/// Friction of the floor, as in `plane.urdf`.
pub(super) const FLOOR_FRICTION: f64 = 1.0;

/// Speed \[m/s\] and angular velocity \[rad/s\] below which movables that lean on something and that no drone is near
/// fall asleep.
const SLEEPY: [f64; 2] = [3e-3, 0.05];

/// All bodies of an environment: their outlines, and how those resist that can move.
#[derive(Clone)]
pub(super) struct Bodies {
    pub(super) arena: Arena,
    pub(super) drone: Inertia,
    /// The cylinder around the drone's prism: of a face with many corners rapier uses four neighbours only.
    pub(super) hull: SharedShape,
    pub(super) hull_pose: Pose,
    pub(super) hull_size: HullSize,
    pub(super) movables: Vec<Inertia>,
}

/// The cylinder around a drone, upright in its body.
#[derive(Clone, Copy)]
pub(super) struct HullSize {
    /// \[m\].
    pub(super) radius: f64,
    /// \[m\].
    pub(super) half_height: f64,
    /// Of its middle over the centre of mass \[m\].
    pub(super) offset: f64,
}

/// How a body resists; its origin is its centre of mass.
#[derive(Clone, Copy)]
pub(super) struct Inertia {
    /// \[kg\].
    pub(super) mass: f64,
    /// Moments of inertia \[kg m²\], body.
    pub(super) moments: Matrix3<f64>,
}

impl Inertia {
    /// Of a body that nothing pushes.
    pub(super) fn immense() -> Self {
        Self { mass: f64::INFINITY, moments: Matrix3::zeros() }
    }

    pub(super) fn is_immense(&self) -> bool {
        self.mass.is_infinite()
    }
}

/// A body that can move, by its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Member {
    Drone(usize),
    Movable(usize),
}

/// Bodies of which each may touch another or something that cannot move.
pub(super) struct Group<'a> {
    pub(super) bodies: &'a Bodies,
    pub(super) members: Vec<Member>,
    /// Indices of the solids nearby.
    pub(super) solids: Vec<usize>,
    /// Whether the floor is nearby.
    pub(super) floor: bool,
    pub(super) secs: f64,
}

/// A member at the start of the substep.
pub(super) struct Start {
    pub(super) motion: Motion,
    /// Velocities at the end of the substep if nothing were near; those of a movable do not feel gravity yet.
    pub(super) free: Motion,
}

/// What becomes of a member.
pub(super) struct End {
    pub(super) motion: Motion,
    /// Whether any contact pushed it.
    pub(super) pushed: bool,
}

impl<'a> Group<'a> {
    pub(super) fn new(
        bodies: &'a Bodies,
        members: Vec<Member>,
        (solids, floor): (Vec<usize>, bool),
        secs: f64,
    ) -> Self {
        Self { bodies, members, solids, floor, secs }
    }

    pub(super) fn inertia(&self, member: Member) -> &Inertia {
        match member {
            Member::Drone(_) => &self.bodies.drone,
            Member::Movable(index) => &self.bodies.movables[index],
        }
    }

    /// Whether something can be pushed that is no drone.
    pub(super) fn pushes_movables(&self) -> bool {
        let is_movable = |member: &Member| matches!(member, Member::Movable(_));
        self.members.iter().any(|member| is_movable(member) && !self.inertia(*member).is_immense())
    }

    /// Whether all are movables at rest.
    pub(super) fn is_asleep(&self, movables: &[Motion]) -> bool {
        self.members.iter().all(|member| match member {
            Member::Drone(_) => false,
            Member::Movable(index) => movables[*index].is_at_rest(),
        })
    }

    /// Whether it is one drone far from everything.
    pub(super) fn is_free(&self) -> bool {
        matches!(self.members[..], [Member::Drone(_)]) && self.solids.is_empty() && !self.floor
    }

    /// The members at the start of the substep.
    pub(super) fn starts(&self, before: &[Motion], after: &[Motion], movables: &[Motion]) -> Vec<Start> {
        let start = |member: &Member| match *member {
            Member::Drone(index) => Start { motion: before[index], free: after[index] },
            Member::Movable(index) => Start { motion: movables[index], free: movables[index] },
        };
        self.members.iter().map(start).collect()
    }

    /// Moves the members; drones that nothing pushed stay as they are.
    pub(super) fn finish(&self, starts: &[Start], ends: &[End], after: &mut [Motion], movables: &mut [Motion]) {
        let tired = self.members.iter().zip(ends).all(|(member, end)| is_tired(*member, end));
        for ((member, start), end) in self.members.iter().zip(starts).zip(ends) {
            match *member {
                Member::Drone(index) if end.pushed => after[index] = end.motion,
                Member::Drone(_) => {}
                Member::Movable(index) if tired => movables[index] = Motion::at_rest(start.motion.pose),
                Member::Movable(index) => movables[index] = end.motion,
            }
        }
    }
}

/// Whether a member hardly moves and leans on something; drones never tire.
fn is_tired(member: Member, end: &End) -> bool {
    let [slow, calm] = SLEEPY;
    match member {
        Member::Drone(_) => false,
        Member::Movable(_) => {
            end.pushed && end.motion.velocity.norm() < slow && end.motion.body_rates.norm() < calm
        }
    }
}
