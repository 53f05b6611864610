//! Who touches what, and what becomes of it.
//!
//! An [`Arena`] is a world prepared for one airframe: it says how far away everything is, lane by lane, so that free
//! flight stays fast, and what a drone touches. A [`ContactSolver`] says what happens to those that touch something.

mod arena;
mod body;
mod clearance_map;
mod distance_field;
mod drones;
mod frame;
mod group;
mod impulses;
mod outline;
mod rapier;
mod ray_caster;
mod reference;
mod route;
mod scan_maps;
mod scanner;
mod solver;
#[cfg(test)]
mod tests;

use core::ops::BitOrAssign;

use nalgebra::Vector3;

pub use arena::Arena;
use body::Body;
pub use distance_field::DistanceField;
pub(crate) use outline::face_normals;
pub(crate) use ray_caster::{BANK, Cone, Rays};
pub use reference::ContactMemory;
pub use route::{AXIS_M, Passage, race_line};
pub use scan_maps::ScanMaps;
pub use solver::ContactSolver;

use crate::world::{Pose, Role, Solid};

/// Gap from which `clean` calls it a touch \[m\]: bodies rest on a skin of one millimetre, with some play.
pub(crate) const TOUCH_GAP: f64 = 1.5e-3;

/// When contact is reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContactReport {
    /// When bodies touch, the skin of a millimetre on which they rest included.
    Touch,
    /// As the reference reports it: from a gap on that every body states.
    Bullet,
}

/// What a drone touches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Touch {
    /// A wall, the floor, or anything else that counts as a collision.
    pub obstacle: bool,
    /// Something to land on.
    pub landing: bool,
}

/// The nearest of some solids that are obstacles, and its distance from a point \[m, world\].
pub fn nearest_obstacle<'a>(
    solids: impl IntoIterator<Item = &'a Solid>,
    point: &Vector3<f64>,
) -> Option<(&'a Solid, f64)> {
    let obstacles = solids.into_iter().filter(|solid| solid.role == Role::Obstacle);
    obstacles.fold(None, |nearest, solid| {
        let least = nearest.map_or(f64::INFINITY, |(_, distance)| distance);
        let (low, high) = solid.extent();
        // Cheap, and never more than the distance.
        if (point - point.sup(&low).inf(&high)).norm() > least {
            return nearest;
        }
        let distance = Body::new(solid, ContactReport::Touch).distance_to(point);
        if distance < least { Some((solid, distance)) } else { nearest }
    })
}

impl BitOrAssign for Touch {
    fn bitor_assign(&mut self, other: Self) {
        self.obstacle |= other.obstacle;
        self.landing |= other.landing;
    }
}

/// A rigid body between two substeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Of the centre of mass.
    pub pose: Pose,
    /// Of the centre of mass \[m/s\], world.
    pub velocity: Vector3<f64>,
    /// Angular velocity \[rad/s\], body.
    pub body_rates: Vector3<f64>,
}

impl Motion {
    /// A body that does not move: a movable in this state stays until something comes near.
    pub fn at_rest(pose: Pose) -> Self {
        Self { pose, velocity: Vector3::zeros(), body_rates: Vector3::zeros() }
    }

    /// A body in mid-air, or perhaps leaning on something: a movable in this state is awake.
    pub fn let_go(pose: Pose) -> Self {
        Self { velocity: Vector3::new(0.0, 0.0, -1e-6), ..Self::at_rest(pose) }
    }

    /// Angular velocity \[rad/s\], world.
    pub(crate) fn angular_velocity(&self) -> Vector3<f64> {
        self.pose.world_from_body.rotate(self.body_rates)
    }

    /// Whether it does not move at all.
    pub(crate) fn is_at_rest(&self) -> bool {
        self.velocity == Vector3::zeros() && self.body_rates == Vector3::zeros()
    }
}
