//! One body: a box, a cylinder, a sphere, a cone, a superellipsoid, a hull or a mesh, and what its surface is like.

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::mesh::MeshConfig;
use super::outline::OutlineKeys;
use super::shape::{ConeConfig, CylinderConfig, HullConfig, SphereConfig, TurnedBoxConfig};
use super::superellipsoid::SuperellipsoidConfig;
use super::surface::{Surface, SurfaceKeys};
use super::visual::VisualConfig;
use crate::config::error::ConfigError;
use crate::config::field::{Field, Limits};
use crate::world::{Movable, Pose, Role, Shape, Solid};

/// Pitch of the reference's pillars \[rad\]: meant to be a right angle.
const PILLAR_PITCH: f64 = 1.57057;

/// Half extents of a pillar before it is pitched \[m\]: the reference's block of 0.1 x 0.018 x 0.018 m at scale 10.
const PILLAR_HALF: Vector3<f64> = Vector3::new(0.5, 0.09, 0.09);

/// One body that never moves. It has one outline: `low_m` and `high_m`, or `box`, `cylinder`, `sphere`,
/// `cone`, `superellipsoid`, `hull` or `mesh`; and it may have another `look`.
#[derive(Clone, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SolidConfig {
    /// What it is, for messages and plans.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
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
    /// A surface of triangles, usually from a file. Its parts are bodies of their own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<MeshConfig>,
    /// What cameras see in place of the outline, which everything else meets: contacts, beams, ways, plans.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub look: Option<VisualConfig>,
    /// What touching it means; `obstacle` unless something says otherwise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub role: Option<Role>,
    /// Coulomb friction, multiplied by that of what touches it; 0.5 unless something says otherwise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Gap at which the reference reports contact with it; only `bullet` physics uses it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact_gap_m: Option<f64>,
    /// Red, green and blue from 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub colour: Option<[f64; 3]>,
}

/// A body that a drone can push: a `box` or a `cylinder`.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MovableConfig {
    /// What it is, for messages and plans.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// A box by centre, size and angles, where an episode starts.
    #[serde(default, rename = "box", skip_serializing_if = "Option::is_none")]
    pub turned_box: Option<TurnedBoxConfig>,
    /// A cylinder, where an episode starts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cylinder: Option<CylinderConfig>,
    /// Mass; its inertia is that of even density.
    pub mass_kg: f64,
    /// Coulomb friction, multiplied by that of what touches it; 0.5 unless it is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Gap at which the reference reports contact with it; only `bullet` physics uses it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact_gap_m: Option<f64>,
    /// Red, green and blue from 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour: Option<[f64; 3]>,
}

impl SolidConfig {
    /// The body; of a mesh one for each of its parts, named after both.
    ///
    /// # Errors
    /// When it has no outline, several or an empty one, a look beside several bodies, or a number is out of range.
    pub fn check(&self, field: &Field<'_>) -> Result<Vec<Solid>, ConfigError> {
        self.check_on(Surface::default(), field)
    }

    /// The body on top of what `surface` says of the whole of which it is a part.
    pub(super) fn check_on(&self, surface: Surface, field: &Field<'_>) -> Result<Vec<Solid>, ConfigError> {
        let Self { role, friction, contact_gap_m, colour, .. } = *self;
        let surface = surface.with(SurfaceKeys { role, friction, contact_gap_m, colour }, field)?;
        let name = self.name.as_deref().unwrap_or("solid");
        let outline = self.outline_keys();
        outline.refuse_several(field)?;
        let mut solids = if let Some(mesh) = &self.mesh {
            mesh.solids(name, surface, &field.at("mesh"))?
        } else {
            let (shape, pose) = outline.check(field)?;
            vec![surface.around(name, shape, pose)]
        };
        if let Some(look) = &self.look {
            let field = field.at("look");
            let [solid] = &mut solids[..] else {
                let found = format!("a look of {} bodies, the parts of `mesh`", solids.len());
                return Err(field.reject(found, "one body that has it"));
            };
            solid.visual = Some(look.check(&solid.pose, &field)?);
        }
        Ok(solids)
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

impl MovableConfig {
    /// The body.
    ///
    /// # Errors
    /// When it has no outline or both, or a number is out of range.
    pub fn check(&self, field: &Field<'_>) -> Result<Movable, ConfigError> {
        let keys = SurfaceKeys {
            role: None,
            friction: self.friction,
            contact_gap_m: self.contact_gap_m,
            colour: self.colour,
        };
        let surface = Surface::default().with(keys, field)?;
        let (shape, pose) = match (&self.turned_box, &self.cylinder) {
            (Some(turned), None) => turned.outline(&field.at("box"))?,
            (None, Some(cylinder)) => cylinder.outline(&field.at("cylinder"))?,
            (Some(_), Some(_)) => return Err(field.reject("two outlines", "`box` or `cylinder`")),
            (None, None) => return Err(field.reject("no outline", "`box` or `cylinder`")),
        };
        let mass = field.at("mass_kg").real(self.mass_kg, &Limits::from(1e-4, 1e6, "kg"))?;
        Ok(Movable::pushed(surface.around(self.name.as_deref().unwrap_or("movable"), shape, pose), mass))
    }
}

/// A pillar of the reference system around `[x, y]` \[m\]; it leans by 0.2 mm per metre, as there.
pub(crate) fn pillar(center: [f64; 2], field: &Field<'_>) -> Result<Solid, ConfigError> {
    let [x, y] = center;
    let limits = Limits::from(-1000.0, 1000.0, "m");
    let (x, y) = (field.at(0).real(x, &limits)?, field.at(1).real(y, &limits)?);
    Ok(pillar_around([x, y]))
}

/// The same pillar, anywhere.
pub(crate) fn pillar_around([x, y]: [f64; 2]) -> Solid {
    let pose = Pose {
        position: Vector3::new(x, y, 0.5),
        world_from_body: Attitude::from_axis_angle(Vector3::y(), PILLAR_PITCH),
    };
    let surface = Surface { friction: 1.0, colour: [0.1, 0.7, 0.1], ..Surface::default() };
    surface.around("pillar", Shape::Cuboid(PILLAR_HALF), pose)
}
