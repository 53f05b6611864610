//! Meshes among the bodies of a world.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::shape::turned;
use super::surface::Surface;
use crate::config::error::ConfigError;
use crate::config::field::{Field, Limits};
use crate::config::geometry::{convex, convex_corners, thickened};
use crate::config::mesh::{Part, Surface as Triangles, Triangle as Indices, parse};
use crate::world::{Mesh, Pose, Shape, Solid, Triangle};

/// A surface of triangles, usually from a file: `import: chair.obj` or `import: chair.stl`, as text or binary.
///
/// The camera sees the triangles, from the side of which their corners are counterclockwise. Everything else meets the
/// convex hull of each part (an OBJ's `o` or `g`), as Bullet has it: contacts, beams, ways, plans.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshConfig {
    /// Its triangles in the words of an OBJ file: `v`, `f`, `o`, `usemtl`, a statement a line.
    pub obj: String,
    /// Red, green and blue from 0 to 1 of its materials (`usemtl`), from the OBJ's library (`Kd`); triangles of other
    /// materials have the colour of the body.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub materials: BTreeMap<String, [f64; 3]>,
    /// How many metres a unit of the file is, along its own x, y and z.
    #[serde(default = "metres")]
    pub scale: [f64; 3],
    /// Where its origin is: `[x, y, z]`.
    #[serde(default)]
    pub at_m: [f64; 3],
    /// Roll, pitch and yaw: turned about the world's x first, then y, then z; `[90, 0, 0]` for files with y up.
    #[serde(default)]
    pub rpy_deg: [f64; 3],
}

/// Farthest coordinate of a corner \[m\].
const FARTHEST: f64 = 1000.0;

/// Most points of a hull that is touched, as many as `btShapeHull` looks in directions for.
const HULL_LIMIT: usize = 256;

fn metres() -> [f64; 3] {
    [1.0; 3]
}

impl MeshConfig {
    /// A body for each part.
    ///
    /// # Errors
    /// When its triangles are wrong or too far away, a part has no extent, or a number is out of range.
    pub(super) fn solids(
        &self,
        name: &str,
        surface: Surface,
        field: &Field<'_>,
    ) -> Result<Vec<Solid>, ConfigError> {
        let placed = self.placed(field)?;
        let parts = &placed.triangles.parts;
        let mut solids = Vec::new();
        for part in parts {
            let called = if parts.len() > 1 { format!("{name}: {}", part.name) } else { name.to_owned() };
            let (shape, pose) = placed
                .outline(part)
                .map_err(|(found, expected)| field.at("obj").reject(format!("{found} ({called})"), expected))?;
            solids.push(surface.around(&called, shape, pose));
        }
        Ok(solids)
    }

    /// All parts as one.
    ///
    /// # Errors
    /// As of [`Self::solids`].
    pub(super) fn outline(&self, field: &Field<'_>) -> Result<(Shape, Pose), ConfigError> {
        let placed = self.placed(field)?;
        let triangles = placed.triangles.parts.iter().flat_map(|part| &part.triangles).copied().collect();
        let whole = Part { triangles, ..Part::default() };
        placed.outline(&whole).map_err(|(found, expected)| field.at("obj").reject(found, expected))
    }

    fn placed(&self, field: &Field<'_>) -> Result<Placed<'_>, ConfigError> {
        let angles = Limits::from(-360.0, 360.0, "degrees");
        let scale = field.at("scale").reals(self.scale, &Limits::above(0.0, 1e6, ""))?;
        let position = field.at("at_m").place(self.at_m)?;
        let world_from_body = turned(field.at("rpy_deg").reals(self.rpy_deg, &angles)?);
        let colours = self.colours(&field.at("materials"))?;
        let triangles = parse(&self.obj).map_err(|fault| {
            field.at("obj").reject(format!("{} in line {}", fault.found, fault.position.line), fault.expected)
        })?;
        Ok(Placed { triangles, scale, origin: Pose { position, world_from_body }, colours })
    }

    fn colours(&self, field: &Field<'_>) -> Result<BTreeMap<&str, [f32; 3]>, ConfigError> {
        let limits = Limits::from(0.0, 1.0, "");
        let colour = |(name, colour): (&'_ String, &[f64; 3])| field.at(name).numbers(*colour, &limits);
        self.materials.iter().map(|material| Ok((material.0.as_str(), colour(material)?))).collect()
    }
}

/// Triangles and where they are.
struct Placed<'a> {
    triangles: Triangles,
    scale: Vector3<f64>,
    origin: Pose,
    colours: BTreeMap<&'a str, [f32; 3]>,
}

impl Placed<'_> {
    /// A part and where its middle is, or what was found and expected.
    fn outline(&self, part: &Part) -> Result<(Shape, Pose), (String, String)> {
        let (mesh, middle) = mesh(&self.triangles, part, &self.scale, &self.colours)?;
        Ok((Shape::Mesh(mesh), Pose::at(middle).within(&self.origin)))
    }
}

/// A part around the middle of its bounds, and where that is \[m\]; or what was found and expected.
fn mesh(
    all: &Triangles,
    part: &Part,
    scale: &Vector3<f64>,
    colours: &BTreeMap<&str, [f32; 3]>,
) -> Result<(Mesh, Vector3<f64>), (String, String)> {
    let place = |corner: u32| Vector3::from(all.corners[corner as usize]).component_mul(scale);
    let mut numbers = BTreeMap::new();
    let mut corners = Vec::new();
    let mut number = |corner: u32| {
        *numbers.entry(corner).or_insert_with(|| {
            corners.push(place(corner));
            corners.len() as u32 - 1
        })
    };
    let triangle = |Indices { corners, material }: &Indices| {
        let name = material.map(|material| all.materials[material].as_str());
        Triangle { corners: corners.map(&mut number), colour: name.and_then(|name| colours.get(name).copied()) }
    };
    let triangles: Vec<_> = part.triangles.iter().map(triangle).collect();
    let (low, high) = corners.iter().fold((corners[0], corners[0]), |(a, b), c| (a.inf(c), b.sup(c)));
    let farthest = low.amax().max(high.amax());
    if farthest > FARTHEST {
        let expected = format!("corners at most {FARTHEST} m from its origin along each axis (`scale`)");
        return Err((format!("a corner at {farthest} m"), expected));
    }
    let middle = (low + high) / 2.0;
    for corner in &mut corners {
        *corner -= middle;
    }
    let hull = hull(&corners).ok_or_else(|| {
        ("corners on one line".to_owned(), "a surface that is at least two micrometres wide".to_owned())
    })?;
    Ok((Mesh { corners, triangles, hull }, middle))
}

/// Points whose hull is that of the corners, or nearly; `None` where they are on one line.
fn hull(corners: &[Vector3<f64>]) -> Option<Vec<Vector3<f64>>> {
    let solid = if convex(corners).is_some() { corners.to_vec() } else { thickened(corners)? };
    let hull = convex_corners(&solid, HULL_LIMIT)?;
    convex(&hull).map(|_| hull)
}
