//! Pieces of furniture: solids in a frame of their own, placed in the world.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::shape::turned;
use super::solid::SolidConfig;
use super::surface::{Surface, SurfaceKeys};
use crate::config::error::ConfigError;
use crate::config::field::{Field, Limits};
use crate::world::{Pose, Role, Solid, VisualGeometry};

/// One piece of furniture: its parts, and where they are.
///
/// A point p of a part is in the world at `at_m` plus `scale` times p turned by `yaw_deg` about z.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FurnitureConfig {
    /// What it is, for messages and plans.
    pub name: String,
    /// What it is made of, in its own frame.
    pub parts: Vec<SolidConfig>,
    /// What touching it means, where a part does not say it; `obstacle` unless it is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub role: Option<Role>,
    /// Coulomb friction, where a part does not say it; 0.5 unless it is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Gap at which the reference reports contact, where a part does not say it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact_gap_m: Option<f64>,
    /// Red, green and blue from 0 to 1, where a part does not say it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour: Option<[f64; 3]>,
    /// Where its origin is: `[x, y, z]`.
    #[serde(default)]
    pub at_m: [f64; 3],
    /// How far it is turned, counter-clockwise seen from above.
    #[serde(default)]
    pub yaw_deg: f64,
    /// How many times larger it is than its parts say.
    #[serde(default = "scale")]
    pub scale: f64,
}

/// How many times larger a piece may be than its parts say.
pub(crate) const SCALES: Limits = Limits::from(1e-4, 1e4, "");

fn scale() -> f64 {
    1.0
}

impl FurnitureConfig {
    /// Its parts in the world, each named after the piece.
    ///
    /// # Errors
    /// When a part is wrong or a number is out of range.
    pub fn check(&self, field: &Field<'_>) -> Result<Vec<Solid>, ConfigError> {
        let yaw_deg = field.at("yaw_deg").real(self.yaw_deg, &Limits::from(-360.0, 360.0, "degrees"))?;
        let at = field.at("at_m").place(self.at_m)?;
        let placement = Placement::new(at.into(), yaw_deg, field.at("scale").real(self.scale, &SCALES)?);
        Ok(self.parts(field)?.into_iter().map(|part| placement.apply(part)).collect())
    }

    /// Its parts in its own frame, each named after the piece.
    ///
    /// # Errors
    /// When a part is wrong.
    pub fn parts(&self, field: &Field<'_>) -> Result<Vec<Solid>, ConfigError> {
        let Self { role, friction, contact_gap_m, colour, .. } = *self;
        let surface = Surface::default().with(SurfaceKeys { role, friction, contact_gap_m, colour }, field)?;
        let field = field.at("parts");
        let mut solids = Vec::new();
        for (index, part) in self.parts.iter().enumerate() {
            for solid in part.check_on(surface, &field.at(index))? {
                let is_named = part.name.is_some() || part.mesh.is_some();
                let name = if is_named { format!("{}: {}", self.name, solid.name) } else { self.name.clone() };
                solids.push(Solid { name, ..solid });
            }
        }
        Ok(solids)
    }
}

/// From the frame of a piece into the world.
pub(crate) struct Placement {
    origin: Pose,
    scale: f64,
}

impl Placement {
    /// At a point \[m\], turned by an angle \[degrees\] about z, so many times larger.
    pub(crate) fn new(at: [f64; 3], yaw_deg: f64, scale: f64) -> Self {
        let world_from_body = turned(Vector3::new(0.0, 0.0, yaw_deg));
        Self { origin: Pose { position: at.into(), world_from_body }, scale }
    }

    pub(crate) fn apply(&self, solid: Solid) -> Solid {
        let Self { origin, scale } = self;
        let enlarged = |pose: Pose| Pose { position: pose.position * *scale, ..pose };
        let visual = solid.visual.map(|look| VisualGeometry {
            shape: look.shape.scaled(*scale),
            pose_in_body: enlarged(look.pose_in_body),
        });
        Solid { shape: solid.shape.scaled(*scale), pose: enlarged(solid.pose).within(origin), visual, ..solid }
    }
}
