//! Triangles of meshes onto pixels.

use nalgebra::Vector3;
use pulp::Simd;

use super::{Affine, COLUMN, COLUMNS, ROWS, Strip, Tile};
use crate::camera::scene::Surface;

/// A corner as the camera sees it.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::camera) struct Corner {
    /// From the eye \[m\], world.
    pub(in crate::camera) away: Vector3<f64>,
    /// Along the optical axis \[m\].
    pub(in crate::camera) depth: f64,
    /// Column and row of the pixel whose ray would meet it, if it is in front of the eye.
    pub(in crate::camera) place: [f64; 2],
}

/// A triangle that faces the eye, as an image sees it.
#[derive(Clone, Copy, Debug)]
pub(in crate::camera) struct Facet {
    /// Columns and rows of tiles, from the first to one past the last.
    pub(in crate::camera) tiles: [[usize; 2]; 2],
    pub(in crate::camera) inverse: Affine,
    /// Nowhere negative where it is. The same edge of the triangle beside it has the same terms with the other sign, so
    /// that no pixel falls between them.
    pub(in crate::camera) edges: [Affine; 3],
    /// Least and greatest inverse depths of its corners \[1/m\]: nearly edge-on, rounding would leave them.
    pub(in crate::camera) range: [f32; 2],
    pub(in crate::camera) surface: Surface,
}

impl Tile {
    /// Draws a triangle where it is nearer, some columns at a time.
    #[inline(always)]
    pub(super) fn draw_facet<S: Simd>(&mut self, simd: S, place: [f32; 2], facet: &Facet, limit: f32) {
        if facet.edges.iter().any(|edge| edge.range(place)[1] < 0.0) {
            return;
        }
        let [column, row] = place;
        let (zero, limit) = (simd.splat_f32s(0.0), simd.splat_f32s(limit));
        let [least, greatest] = facet.range.map(|inverse| simd.splat_f32s(inverse));
        let surface = simd.splat_u32s(facet.surface);
        let mut any = simd.less_than_f32s(zero, zero);
        for part in 0..COLUMNS / S::F32_LANES {
            let columns = simd.add_f32s(simd.splat_f32s(column), S::as_simd_f32s(&COLUMN).0[part]);
            let strip = Strip { simd, columns, row };
            let mut inside = [simd.splat_f32s(f32::INFINITY); ROWS];
            for edge in &facet.edges {
                strip.visit(edge, |line, value| inside[line] = simd.min_f32s(inside[line], value));
            }
            let Self { inverses, surfaces, .. } = self;
            strip.visit(&facet.inverse, |line, value| {
                let inverse = simd.min_f32s(simd.max_f32s(value, least), greatest);
                let old = &mut S::as_mut_simd_f32s(&mut inverses[line]).0[part];
                let seen = simd.and_m32s(
                    simd.less_than_or_equal_f32s(zero, inside[line]),
                    simd.and_m32s(
                        simd.less_than_f32s(*old, inverse),
                        simd.less_than_or_equal_f32s(inverse, limit),
                    ),
                );
                *old = simd.select_f32s(seen, inverse, *old);
                let old = &mut S::as_mut_simd_u32s(&mut surfaces[line]).0[part];
                *old = simd.select_u32s(seen, surface, *old);
                any = simd.or_m32s(any, seen);
            });
        }
        if simd.first_true_m32s(any) < S::F32_LANES {
            self.settle(simd);
        }
    }
}
