//! One body: a box, a cylinder, a sphere, a cone, a superellipsoid, a hull or a mesh, and what its surface is like.

use std::f64::consts::TAU;

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::look::LookConfig;
use super::mesh::MeshConfig;
use super::outline::OutlineKeys;
use super::superellipsoid::SuperellipsoidConfig;
use crate::config::error::ConfigError;
use crate::config::field::{Field, Limits};
use crate::config::geometry::{convex, exact, exact_numbers, exact_point};
use crate::world::{BOX_CONTACT_GAP, Movable, Pose, Role, Shape, Solid};

/// Corners of the polygons at both ends of a cone.
const CONE_CORNERS: usize = 32;

/// Most points of a hull.
const POINTS_LIMIT: usize = 256;

/// Pitch of the reference's pillars \[rad\]: meant to be a right angle.
const PILLAR_PITCH: f64 = 1.57057;

/// Half extents of a pillar before it is pitched \[m\]: the reference's block of 0.1 x 0.018 x 0.018 m at scale 10.
const PILLAR_HALF: Vector3<f64> = Vector3::new(0.5, 0.09, 0.09);

const LENGTH: Limits = Limits::above(0.0, 1000.0, "m");

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
    pub look: Option<LookConfig>,
    /// What touching it means; `obstacle` unless something says otherwise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub role: Option<RoleConfig>,
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

/// What touching a body means.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RoleConfig {
    /// A collision.
    Obstacle,
    /// A landing.
    Landing,
    /// Nothing: it can be seen but not touched.
    Decoration,
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

fn level(rpy_deg: &[f64; 3]) -> bool {
    *rpy_deg == [0.0; 3]
}

/// What a body is apart from its outline.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surface {
    pub(super) role: Role,
    pub(super) friction: f64,
    pub(super) contact_gap: f64,
    pub(super) colour: [f32; 3],
}

/// Keys that change a [`Surface`]; what is left out stays.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfaceKeys {
    pub(super) role: Option<RoleConfig>,
    pub(super) friction: Option<f64>,
    pub(super) contact_gap_m: Option<f64>,
    pub(super) colour: Option<[f64; 3]>,
}

impl Default for Surface {
    fn default() -> Self {
        Self { role: Role::Obstacle, friction: 0.5, contact_gap: BOX_CONTACT_GAP, colour: [0.6; 3] }
    }
}

impl Surface {
    /// With the keys that are written at `field`.
    pub(super) fn with(self, keys: SurfaceKeys, field: &Field<'_>) -> Result<Self, ConfigError> {
        let number = |key: &str, value: Option<f64>, default: f64, limits: Limits| {
            value.map_or(Ok(default), |value| exact(&field.at(key), value, &limits))
        };
        let colour = keys.colour.map(|colour| field.at("colour").numbers(colour, &Limits::from(0.0, 1.0, "")));
        Ok(Self {
            role: match keys.role {
                None => self.role,
                Some(RoleConfig::Obstacle) => Role::Obstacle,
                Some(RoleConfig::Landing) => Role::Landing,
                Some(RoleConfig::Decoration) => Role::Decoration,
            },
            friction: number("friction", keys.friction, self.friction, Limits::from(0.0, 10.0, ""))?,
            contact_gap: number(
                "contact_gap_m",
                keys.contact_gap_m,
                self.contact_gap,
                Limits::from(0.0, 0.05, "m"),
            )?,
            colour: colour.transpose()?.unwrap_or(self.colour),
        })
    }

    /// A body with this surface, which looks as it is.
    pub(super) fn around(self, name: &str, shape: Shape, pose: Pose) -> Solid {
        let Self { role, friction, contact_gap, colour } = self;
        Solid { name: name.to_owned(), shape, pose, role, friction, contact_gap, colour, look: None }
    }
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
            solid.look = Some(look.check(&solid.pose, &field)?);
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

impl TurnedBoxConfig {
    pub(super) fn outline(&self, field: &Field<'_>) -> Result<(Shape, Pose), ConfigError> {
        let size = exact_numbers(&field.at("size_m"), self.size_m, &LENGTH)?;
        Ok((Shape::Cuboid(size / 2.0), pose(self.center_m, self.rpy_deg, field)?))
    }
}

impl CylinderConfig {
    pub(super) fn outline(&self, field: &Field<'_>) -> Result<(Shape, Pose), ConfigError> {
        let radius = exact(&field.at("radius_m"), self.radius_m, &LENGTH)?;
        let half_height = exact(&field.at("height_m"), self.height_m, &LENGTH)? / 2.0;
        Ok((Shape::Cylinder { radius, half_height }, pose(self.center_m, self.rpy_deg, field)?))
    }
}

impl SphereConfig {
    pub(super) fn outline(&self, field: &Field<'_>) -> Result<(Shape, Pose), ConfigError> {
        let radius = exact(&field.at("radius_m"), self.radius_m, &LENGTH)?;
        Ok((Shape::Sphere(radius), pose(self.center_m, [0.0; 3], field)?))
    }
}

impl ConeConfig {
    pub(super) fn outline(&self, field: &Field<'_>) -> Result<(Shape, Pose), ConfigError> {
        let base = exact_point(&field.at("base_m"), self.base_m)?;
        let half_height = exact(&field.at("height_m"), self.height_m, &LENGTH)? / 2.0;
        let low = exact(&field.at("base_radius_m"), self.base_radius_m, &LENGTH)?;
        let high = exact(&field.at("top_radius_m"), self.top_radius_m, &Limits::from(0.0, 1000.0, "m"))?;
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
            points.map(|(index, point)| exact_point(&field.at(index), *point)).collect::<Result<_, _>>()?;
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
        let mass = exact(&field.at("mass_kg"), self.mass_kg, &Limits::from(1e-4, 1e6, "kg"))?;
        Ok(Movable { solid: surface.around(self.name.as_deref().unwrap_or("movable"), shape, pose), mass })
    }
}

/// A pillar of the reference system around `[x, y]` \[m\]; it leans by 0.2 mm per metre, as there.
pub(crate) fn pillar(center: [f64; 2], field: &Field<'_>) -> Result<Solid, ConfigError> {
    let [x, y] = center;
    let limits = Limits::from(-1000.0, 1000.0, "m");
    let (x, y) = (exact(&field.at(0), x, &limits)?, exact(&field.at(1), y, &limits)?);
    let pose = Pose {
        position: Vector3::new(x, y, 0.5),
        world_from_body: Attitude::from_axis_angle(Vector3::y(), PILLAR_PITCH),
    };
    let surface = Surface { friction: 1.0, colour: [0.1, 0.7, 0.1], ..Surface::default() };
    Ok(surface.around("pillar", Shape::Cuboid(PILLAR_HALF), pose))
}

fn pose(center_m: [f64; 3], rpy_deg: [f64; 3], field: &Field<'_>) -> Result<Pose, ConfigError> {
    let position = exact_point(&field.at("center_m"), center_m)?;
    let angles = exact_numbers(&field.at("rpy_deg"), rpy_deg, &Limits::from(-360.0, 360.0, "degrees"))?;
    Ok(Pose { position, world_from_body: turned(angles) })
}

/// The orientation after roll, pitch and yaw \[degrees\].
pub(super) fn turned(rpy_deg: Vector3<f64>) -> Attitude<f64> {
    let [roll, pitch, yaw] = [0, 1, 2].map(|axis| {
        let mut direction = Vector3::zeros();
        direction[axis] = 1.0;
        Attitude::from_axis_angle(direction, rpy_deg[axis].to_radians())
    });
    yaw.after(&pitch.after(&roll))
}
