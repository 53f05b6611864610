//! The one outline of a body, or of what is seen of it, among the keys for all kinds.

use super::mesh::MeshConfig;
use super::shape::{ConeConfig, CylinderConfig, HullConfig, SphereConfig, TurnedBoxConfig};
use super::superellipsoid::SuperellipsoidConfig;
use crate::config::area::BoxConfig;
use crate::config::error::ConfigError;
use crate::config::field::Field;
use crate::world::{Pose, Shape};

/// The outlines that a body can have.
const FORMS: &str =
    "one of `low_m` with `high_m`, `box`, `cylinder`, `sphere`, `cone`, `superellipsoid`, `hull` or `mesh`";

/// What is written of an outline.
#[derive(Clone, Copy)]
pub(super) struct OutlineKeys<'a> {
    pub(super) low_m: Option<[f64; 3]>,
    pub(super) high_m: Option<[f64; 3]>,
    pub(super) turned_box: Option<&'a TurnedBoxConfig>,
    pub(super) cylinder: Option<&'a CylinderConfig>,
    pub(super) sphere: Option<&'a SphereConfig>,
    pub(super) cone: Option<&'a ConeConfig>,
    pub(super) superellipsoid: Option<&'a SuperellipsoidConfig>,
    pub(super) hull: Option<&'a HullConfig>,
    pub(super) mesh: Option<&'a MeshConfig>,
}

impl OutlineKeys<'_> {
    pub(super) fn refuse_several(&self, field: &Field<'_>) -> Result<(), ConfigError> {
        let corners = self.low_m.is_some() || self.high_m.is_some();
        let forms = [
            corners,
            self.turned_box.is_some(),
            self.cylinder.is_some(),
            self.sphere.is_some(),
            self.cone.is_some(),
            self.superellipsoid.is_some(),
            self.hull.is_some(),
            self.mesh.is_some(),
        ];
        match forms.into_iter().filter(|written| *written).count() {
            0 => Err(field.reject("no outline", FORMS)),
            1 => Ok(()),
            count => Err(field.reject(format!("{count} outlines"), FORMS)),
        }
    }

    /// The shape, of a mesh all its parts as one, and where it is.
    pub(super) fn check(&self, field: &Field<'_>) -> Result<(Shape, Pose), ConfigError> {
        match *self {
            Self { turned_box: Some(turned), .. } => turned.outline(&field.at("box")),
            Self { cylinder: Some(cylinder), .. } => cylinder.outline(&field.at("cylinder")),
            Self { sphere: Some(sphere), .. } => sphere.outline(&field.at("sphere")),
            Self { cone: Some(cone), .. } => cone.outline(&field.at("cone")),
            Self { superellipsoid: Some(body), .. } => body.outline(&field.at("superellipsoid")),
            Self { hull: Some(hull), .. } => hull.outline(&field.at("hull")),
            Self { mesh: Some(mesh), .. } => mesh.outline(&field.at("mesh")),
            Self { low_m: Some(low_m), high_m: Some(high_m), .. } => {
                let (low, high) = BoxConfig { low_m, high_m }.corners(field)?;
                Ok((Shape::Cuboid((high - low) / 2.0), Pose::at((low + high) / 2.0)))
            }
            Self { low_m: Some(_), high_m: None, .. } => {
                Err(field.reject("no key `high_m`", "one beside `low_m`"))
            }
            Self { low_m: None, high_m: Some(_), .. } => {
                Err(field.reject("no key `low_m`", "one beside `high_m`"))
            }
            Self { low_m: None, high_m: None, .. } => Err(field.reject("no outline", FORMS)),
        }
    }
}
