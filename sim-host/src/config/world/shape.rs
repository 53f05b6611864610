//! Shapes of bodies: a box, a cylinder, a sphere, a cone or a hull, and where it is.

use std::f64::consts::TAU;

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::error::ConfigError;
use crate::config::field::{Field, Limits};
use crate::config::geometry::convex;
use crate::world::{Pose, Shape};

/// Corners of the polygons at both ends of a cone.
const CONE_CORNERS: usize = 32;

/// Most points of a hull.
const POINTS_LIMIT: usize = 256;

const LENGTH: Limits = Limits::above(0.0, 1000.0, "m");

/// A box, which may be turned.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TurnedBoxConfig {
    /// Where its centre is: `[x, y, z]`.
    pub center_m: [f64; 3],
    /// Length of its edges along its own x, y and z.
    pub size_m: [f64; 3],
    /// Roll, pitch and yaw: turned about the world's x first, then y, then z.
    #[serde(default, skip_serializing_if = "level")]
    pub rpy_deg: [f64; 3],
}

/// A cylinder, which may be turned.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CylinderConfig {
    /// Where its centre is: `[x, y, z]`.
    pub center_m: [f64; 3],
    /// Radius.
    pub radius_m: f64,
    /// Length along its own axis, which is z until it is turned.
    pub height_m: f64,
    /// Roll, pitch and yaw: turned about the world's x first, then y, then z.
    #[serde(default, skip_serializing_if = "level")]
    pub rpy_deg: [f64; 3],
}

/// A sphere.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SphereConfig {
    /// Where its centre is: `[x, y, z]`.
    pub center_m: [f64; 3],
    /// Radius.
    pub radius_m: f64,
}

/// An upright cone with 32 edges, their corners on the circle; without its tip where `top_radius_m` is given.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ConeConfig {
    /// Middle of its lower end: `[x, y, z]`.
    pub base_m: [f64; 3],
    /// Height.
    pub height_m: f64,
    /// Radius of its lower end.
    pub base_radius_m: f64,
    /// Radius of its upper end.
    pub top_radius_m: f64,
}

/// The smallest convex body around points.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HullConfig {
    /// At least four, not in one plane: `[[x, y, z], …]`.
    pub points_m: Vec<[f64; 3]>,
}

fn level(rpy_deg: &[f64; 3]) -> bool {
    *rpy_deg == [0.0; 3]
}

impl TurnedBoxConfig {
    pub(super) fn outline(&self, field: &Field<'_>) -> Result<(Shape, Pose), ConfigError> {
        let size = field.at("size_m").reals(self.size_m, &LENGTH)?;
        Ok((Shape::Cuboid(size / 2.0), pose(self.center_m, self.rpy_deg, field)?))
    }
}

impl CylinderConfig {
    pub(super) fn outline(&self, field: &Field<'_>) -> Result<(Shape, Pose), ConfigError> {
        let radius = field.at("radius_m").real(self.radius_m, &LENGTH)?;
        let half_height = field.at("height_m").real(self.height_m, &LENGTH)? / 2.0;
        Ok((Shape::Cylinder { radius, half_height }, pose(self.center_m, self.rpy_deg, field)?))
    }
}

impl SphereConfig {
    pub(super) fn outline(&self, field: &Field<'_>) -> Result<(Shape, Pose), ConfigError> {
        let radius = field.at("radius_m").real(self.radius_m, &LENGTH)?;
        Ok((Shape::Sphere(radius), pose(self.center_m, [0.0; 3], field)?))
    }
}

impl ConeConfig {
    pub(super) fn outline(&self, field: &Field<'_>) -> Result<(Shape, Pose), ConfigError> {
        let base = field.at("base_m").place(self.base_m)?;
        let half_height = field.at("height_m").real(self.height_m, &LENGTH)? / 2.0;
        let low = field.at("base_radius_m").real(self.base_radius_m, &LENGTH)?;
        let high = field.at("top_radius_m").real(self.top_radius_m, &Limits::from(0.0, 1000.0, "m"))?;
        let circle = |radius: f64, z: f64| {
            let corners = if radius > 0.0 { CONE_CORNERS } else { 1 };
            (0..corners).map(move |corner| {
                let (sine, cosine) = libm::sincos(TAU * corner as f64 / CONE_CORNERS as f64);
                Vector3::new(radius * cosine, radius * sine, z)
            })
        };
        let points = circle(low, -half_height).chain(circle(high, half_height)).collect();
        Ok((Shape::Hull(points), Pose::at(base + half_height * Vector3::z())))
    }
}

impl HullConfig {
    pub(super) fn outline(&self, field: &Field<'_>) -> Result<(Shape, Pose), ConfigError> {
        let field = field.at("points_m");
        let points = self.points_m.iter().enumerate();
        let points: Vec<_> =
            points.map(|(index, point)| field.at(index).place(*point)).collect::<Result<_, _>>()?;
        let expected = format!("4 to {POINTS_LIMIT} points, not all in one plane");
        if !(4..=POINTS_LIMIT).contains(&points.len()) {
            return Err(field.refuse("", expected));
        }
        let pick = |pick: fn(&Vector3<f64>, &Vector3<f64>) -> Vector3<f64>| {
            points.iter().copied().reduce(|one, other| pick(&one, &other)).unwrap_or_default()
        };
        let middle = (pick(Vector3::inf) + pick(Vector3::sup)) / 2.0;
        let points: Vec<_> = points.iter().map(|point| point - middle).collect();
        if convex(&points).is_none() {
            return Err(field.reject("points in one plane", expected));
        }
        Ok((Shape::Hull(points), Pose::at(middle)))
    }
}

fn pose(center_m: [f64; 3], rpy_deg: [f64; 3], field: &Field<'_>) -> Result<Pose, ConfigError> {
    let position = field.at("center_m").place(center_m)?;
    let angles = field.at("rpy_deg").reals(rpy_deg, &Limits::from(-360.0, 360.0, "degrees"))?;
    Ok(Pose { position, world_from_body: turned(angles) })
}

/// The orientation after roll, pitch and yaw \[degrees\].
pub(crate) fn turned(rpy_deg: Vector3<f64>) -> Attitude<f64> {
    let [roll, pitch, yaw] = [0, 1, 2].map(|axis| {
        let mut direction = Vector3::zeros();
        direction[axis] = 1.0;
        Attitude::from_axis_angle(direction, rpy_deg[axis].to_radians())
    });
    yaw.after(&pitch.after(&roll))
}
