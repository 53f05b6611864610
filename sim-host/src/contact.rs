//! Who touches what, and what becomes of it.
//!
//! An [`Arena`] is a world prepared for one airframe: it says how far away everything is, lane by lane, so that free
//! flight stays fast, and what a drone touches. A [`ContactSolver`] says what happens to those that touch something.

mod arena;
mod body;
mod bullet;
mod distance_map;
mod frame;
mod group;
mod impulses;
mod manifold;
mod outline;
mod penetration;
mod rapier;
mod separation;
mod solver;
#[cfg(test)]
mod tests;

use core::ops::BitOrAssign;

use kestrel_core::airframe::Airframe;
use nalgebra::Vector3;

pub use arena::Arena;
pub use manifold::ContactMemory;
pub use solver::ContactSolver;

use crate::scenario::{Aviary, Cuboid};
use crate::swarm::{Column, Swarm};
use crate::world::{Floor, Pose};

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

/// The drone's hull: an upright cylinder as wide as the drone and as high as the drone at its tilt.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hull {
    radius: f32,
    half_height: f32,
}

impl Hull {
    pub(crate) fn new(airframe: &Airframe) -> Self {
        Self { radius: airframe.collision_radius as f32, half_height: 0.5 * airframe.collision_height as f32 }
    }

    /// Half the height of the tilted cylinder \[m\], from the cosine of its tilt.
    #[inline(always)]
    fn half_extent(&self, up_cosine: f32) -> f32 {
        let square = up_cosine * up_cosine;
        let sine = if square < 1.0 { (1.0 - square).sqrt() } else { 0.0 };
        self.half_height * up_cosine.abs() + self.radius * sine
    }
}

/// Marks with one the lanes whose drone touches a solid or the floor.
#[inline(always)]
pub(crate) fn find_hits<const LANES: usize>(
    swarm: &Swarm<LANES>,
    aviary: &Aviary,
    hull: &Hull,
    hits: &mut Column<LANES>,
) {
    let mut extents = [0.0; LANES];
    for lane in 0..LANES {
        extents[lane] = hull.half_extent(swarm.state(lane).world_from_body.up_cosine());
    }
    *hits = match aviary.world.floor {
        Floor::Solid => core::array::from_fn(|lane| f32::from(swarm.position[2][lane] < extents[lane])),
        Floor::Absent => [0.0; LANES],
    };
    for solid in aviary.world.bounds() {
        add_hits(swarm, &solid, hull.radius, &extents, hits);
    }
}

#[inline(always)]
fn add_hits<const LANES: usize>(
    swarm: &Swarm<LANES>,
    solid: &Cuboid,
    radius: f32,
    extents: &Column<LANES>,
    hits: &mut Column<LANES>,
) {
    let [x, y, z] = &swarm.position;
    let reach = radius * radius;
    for lane in 0..LANES {
        let across = gap(x[lane], solid.low.x, solid.high.x);
        let beside = gap(y[lane], solid.low.y, solid.high.y);
        let above = gap(z[lane], solid.low.z, solid.high.z);
        let near = if across * across + beside * beside < reach { 1.0 } else { 0.0 };
        let hit = if above < extents[lane] { near } else { 0.0 };
        hits[lane] = if hits[lane] < hit { hit } else { hits[lane] };
    }
}

/// Distance of a coordinate from an interval \[m\].
#[inline(always)]
fn gap(value: f32, low: f32, high: f32) -> f32 {
    let below = low - value;
    let above = value - high;
    let outside = if below < above { above } else { below };
    if outside < 0.0 { 0.0 } else { outside }
}
