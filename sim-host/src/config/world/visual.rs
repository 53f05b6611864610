//! What cameras see of a body in place of its outline.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::mesh::MeshConfig;
use super::outline::OutlineKeys;
use super::shape::{ConeConfig, CylinderConfig, HullConfig, SphereConfig, TurnedBoxConfig};
use super::superellipsoid::SuperellipsoidConfig;
use crate::config::error::ConfigError;
use crate::config::field::Field;
use crate::world::{Pose, VisualGeometry};

/// What cameras see of a body in place of its outline, as URDF's `visual` beside `collision`. It has one outline: `low_m`
/// and `high_m`, or `box`, `cylinder`, `sphere`, `cone`, `superellipsoid`, `hull` or `mesh`, where the body's would be.
#[derive(Clone, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct VisualConfig {
    /// Corner of an axis-aligned box with the smallest coordinates: `[x, y, z]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub low_m: Option<[f64; 3]>,
    /// Corner of an axis-aligned box with the greatest coordinates: `[x, y, z]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub high_m: Option<[f64; 3]>,
    /// A box by centre, size and angles.
    #[serde(rename = "box", skip_serializing_if = "Option::is_none")]
    pub turned_box: Option<TurnedBoxConfig>,
    /// A cylinder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cylinder: Option<CylinderConfig>,
    /// A sphere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sphere: Option<SphereConfig>,
    /// An upright cone, usually without its tip.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cone: Option<ConeConfig>,
    /// A superellipsoid, such as a cushion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub superellipsoid: Option<SuperellipsoidConfig>,
    /// The convex hull of points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hull: Option<HullConfig>,
    /// A surface of triangles, usually from a file; its parts are one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<MeshConfig>,
}

impl VisualConfig {
    /// The look of a body that is there.
    pub(super) fn check(&self, body: &Pose, field: &Field<'_>) -> Result<VisualGeometry, ConfigError> {
        let outline = self.outline_keys();
        outline.refuse_several(field)?;
        let (shape, pose) = outline.check(field)?;
        Ok(VisualGeometry { shape, pose_in_body: pose.relative_to(body) })
    }

    fn outline_keys(&self) -> OutlineKeys<'_> {
        OutlineKeys {
            low_m: self.low_m,
            high_m: self.high_m,
            turned_box: self.turned_box.as_ref(),
            cylinder: self.cylinder.as_ref(),
            sphere: self.sphere.as_ref(),
            cone: self.cone.as_ref(),
            superellipsoid: self.superellipsoid.as_ref(),
            hull: self.hull.as_ref(),
            mesh: self.mesh.as_ref(),
        }
    }
}
