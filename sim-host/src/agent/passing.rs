//! Whom a drone meets: a mate or a person, as rewards that look ahead see them.

use nalgebra::Vector3;

use crate::contact::Motion;
use crate::world::{Drive, Movable, Shape};

/// Numbers of a [`Passing`].
pub(crate) const PASSING_LEN: usize = 7;

/// Where nobody is \[m\].
const FAR_M: f64 = 1e4;

/// Somebody who moves, as a ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Passing {
    /// Its middle \[m, world\].
    pub(crate) middle: Vector3<f64>,
    /// \[m\].
    pub(crate) radius: f64,
    /// \[m/s, world\].
    pub(crate) velocity: Vector3<f64>,
}

impl Passing {
    /// Nobody near.
    pub(super) const NOBODY: Self =
        Self { middle: Vector3::new(FAR_M, FAR_M, FAR_M), radius: 0.0, velocity: Vector3::new(0.0, 0.0, 0.0) };

    /// How near it comes to a drone within some time \[s\], surface to centre, if neither changes its velocity \[m\].
    pub(crate) fn least_distance(&self, drone: &Motion, secs: f64) -> f64 {
        let (offset, closing) = (drone.pose.position - self.middle, drone.velocity - self.velocity);
        let square = closing.norm_squared();
        let nearest = if square > 0.0 { (-offset.dot(&closing) / square).clamp(0.0, secs) } else { 0.0 };
        (offset + closing * nearest).norm() - self.radius
    }

    /// Somebody who walks, always as high as this drone: nobody is to be flown over.
    pub(crate) fn of_person(kind: &Movable, body: &Motion, drone: &Motion) -> Option<Self> {
        let (Drive::Walking(_), Shape::Cylinder { radius, .. }) = (&kind.drive, &kind.solid.shape) else {
            return None;
        };
        let beside = |person: &Vector3<f64>, drone: &Vector3<f64>| Vector3::new(person.x, person.y, drone.z);
        Some(Self {
            middle: beside(&body.pose.position, &drone.pose.position),
            radius: *radius,
            velocity: beside(&body.velocity, &drone.velocity),
        })
    }

    /// Middle, radius, velocity.
    pub(super) fn to_array(self) -> [f64; PASSING_LEN] {
        let Self { middle, radius, velocity } = self;
        [middle.x, middle.y, middle.z, radius, velocity.x, velocity.y, velocity.z]
    }
}
