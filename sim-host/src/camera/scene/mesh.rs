//! Meshes in a scene.

use nalgebra::Vector3;

use super::{BoundingSphere, Face, Surface};
use crate::world;

/// A surface of triangles.
#[derive(Clone, Debug)]
pub(in crate::camera) struct Mesh {
    pub(in crate::camera) ball: BoundingSphere,
    /// \[m\], world.
    pub(in crate::camera) corners: Vec<Vector3<f64>>,
    pub(in crate::camera) triangles: Vec<Triangle>,
}

/// A triangle, seen from the side to which its face's normal points.
#[derive(Clone, Debug)]
pub(in crate::camera) struct Triangle {
    /// Indices, counterclockwise as seen from there.
    pub(in crate::camera) corners: [u32; 3],
    pub(in crate::camera) face: Face,
}

impl Triangle {
    /// Those of a mesh whose corners are there \[m, world\]; `surface` makes one of a colour and a unit normal. Triangles
    /// without an area are left out.
    pub(super) fn all(
        mesh: &world::Mesh,
        places: &[Vector3<f64>],
        mut surface: impl FnMut(Option<[f32; 3]>, &Vector3<f64>) -> Surface,
    ) -> Vec<Self> {
        let triangle = |world::Triangle { corners, colour }: &world::Triangle| {
            let [a, b, c] = corners.map(|corner| places[corner as usize]);
            let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
            let face = Face { normal, offset: normal.dot(&a), surface: surface(*colour, &normal) };
            Some(Self { corners: *corners, face })
        };
        mesh.triangles.iter().filter_map(triangle).collect()
    }
}
