//! A surface of triangles.

use nalgebra::Vector3;

/// A surface of triangles around its own origin, which need not be convex. It is seen as it is, from the side of which its
/// triangles are counterclockwise, and touched by its convex hull.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    /// Corners of its triangles \[m\].
    pub corners: Vec<Vector3<f64>>,
    /// At least one.
    pub triangles: Vec<Triangle>,
    /// Points whose convex hull is touched \[m\], at least four, not in one plane: the hull of the corners, or nearly.
    pub hull: Vec<Vector3<f64>>,
}

/// One triangle of a [`Mesh`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// Indices of its corners, counterclockwise as seen from outside.
    pub corners: [u32; 3],
    /// Red, green, blue in \[0, 1\]; the solid's colour where there is none.
    pub colour: Option<[f32; 3]>,
}

impl Mesh {
    /// So many times as large.
    #[must_use]
    pub fn scaled(mut self, scale: f64) -> Self {
        self.corners.iter_mut().chain(&mut self.hull).for_each(|point| *point *= scale);
        self
    }

    /// Where the corners of a triangle are \[m\].
    pub fn places(&self, triangle: &Triangle) -> [Vector3<f64>; 3] {
        triangle.corners.map(|corner| self.corners[corner as usize])
    }
}
