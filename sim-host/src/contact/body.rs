//! A body of a world, made ready for questions about it.

use nalgebra::Vector3;
use rapier3d::parry::query::Ray;

use super::frame::{from_vector, to_vector};
use super::outline::Outline;
use super::{ContactReport, TOUCH_GAP, Touch};
use crate::world::{Pose, Role, Solid};

/// A solid that can be touched.
#[derive(Clone)]
pub(super) struct Body {
    pub(super) outline: Outline,
    /// Where it is, or starts if it can move.
    pub(super) pose: Pose,
    /// Of the outline's shape there.
    pub(super) shape_pose: Pose,
    /// Lowest and highest coordinates there \[m, world\].
    pub(super) extent: (Vector3<f64>, Vector3<f64>),
    /// Gap up to which contact is reported \[m\].
    pub(super) gap: f64,
    /// Coulomb friction of its surface.
    pub(super) friction: f64,
    pub(super) role: Role,
}

impl Body {
    pub(super) fn new(solid: &Solid, report: ContactReport) -> Self {
        let outline = Outline::of_shape(&solid.shape);
        Self {
            shape_pose: outline.placed(&solid.pose),
            extent: solid.extent(),
            gap: match report {
                ContactReport::Touch => TOUCH_GAP,
                ContactReport::Bullet => solid.contact_gap,
            },
            friction: solid.friction,
            role: solid.role,
            pose: solid.pose,
            outline,
        }
    }

    /// What touching it counts as.
    pub(super) fn touched(&self) -> Touch {
        match self.role {
            Role::Obstacle => Touch { obstacle: true, landing: false },
            Role::Landing => Touch { obstacle: false, landing: true },
            Role::Decoration => Touch::default(),
        }
    }

    /// Distance of a point \[m\], zero inside.
    pub(super) fn distance_to(&self, point: &Vector3<f64>) -> f64 {
        f64::from(self.outline.shape.distance_to_local_point(to_vector(&self.seen_from(point)), true))
    }

    /// Normal of the nearest point of its surface to a point \[world\], outwards, and the distance from there \[m\], negative
    /// inside. In the surface itself there is no normal: zero.
    pub(super) fn plane_towards(&self, point: &Vector3<f64>) -> (Vector3<f64>, f64) {
        let local = self.seen_from(point);
        let nearest = self.outline.shape.project_local_point(to_vector(&local), false);
        let away = local - from_vector(nearest.point);
        let distance = away.norm();
        let outwards = if nearest.is_inside { -1.0 } else { 1.0 };
        if distance == 0.0 {
            return (Vector3::zeros(), 0.0);
        }
        let normal = self.shape_pose.world_from_body.rotate(away * (outwards / distance));
        (normal, outwards * distance)
    }

    /// Distance of a point to the box around it \[m\], zero inside: never more than [`Self::distance_to`], and cheap.
    pub(super) fn distance_to_extent(&self, point: &Vector3<f64>) -> f64 {
        let (low, high) = &self.extent;
        (point - point.sup(low).inf(high)).norm()
    }

    /// A point in the frame of the shape.
    fn seen_from(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.shape_pose.world_from_body.rotate_inverse(point - self.shape_pose.position)
    }

    /// Distance at which a ray of unit direction meets it, if within `limit` \[m\].
    pub(super) fn cast_ray(&self, origin: &Vector3<f64>, direction: &Vector3<f64>, limit: f64) -> Option<f64> {
        let local = self.seen_from(origin);
        let along = self.shape_pose.world_from_body.rotate_inverse(*direction);
        let ray = Ray::new(to_vector(&local), to_vector(&along));
        self.outline.shape.cast_local_ray(&ray, limit as f32, true).map(f64::from)
    }
}
