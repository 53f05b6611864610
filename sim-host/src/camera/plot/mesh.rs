//! Which triangles of a mesh are in view, and how each is drawn.

use super::Rays;
use crate::camera::Camera;
use crate::camera::kernel::{Affine, COLUMNS, Canvas, Corner, Facet, Figure, Plot, ROWS};
use crate::camera::scene::{Mesh, Triangle};

/// Pixels by which the area of a triangle is larger than its corners say, against rounding.
const MARGIN: f64 = 0.01;

impl Mesh {
    /// Says how the triangles are drawn that face the eye and cover a pixel.
    #[inline(always)]
    pub(in crate::camera) fn plot(&self, rays: &Rays, camera: &Camera, canvas: &mut Canvas) {
        let Some((tiles, nearest)) = rays.area(&self.corners, camera) else { return };
        let scale = [camera.columns, camera.rows].map(|size| 0.5 * size as f64);
        let axes =
            [rays.view.right * (scale[0] / camera.tangents[0]), rays.view.down * (scale[1] / camera.tangents[1])];
        let middle = [scale[0] - camera.sample[0], scale[1] - camera.sample[1]];
        canvas.corners.clear();
        canvas.corners.extend(self.corners.iter().map(|corner| {
            let away = corner - rays.view.eye;
            let depth = away.dot(&rays.view.forward);
            let inverse = 1.0 / depth;
            let place = core::array::from_fn(|axis| middle[axis] + away.dot(&axes[axis]) * inverse);
            Corner { away, depth, place }
        }));
        let first = canvas.facets.len();
        for triangle in &self.triangles {
            if triangle.face.normal.dot(&rays.view.eye) > triangle.face.offset {
                let corners = triangle.corners.map(|corner| &canvas.corners[corner as usize]);
                canvas.facets.extend(triangle.facet(rays, camera, corners));
            }
        }
        let facets = [first, canvas.facets.len()];
        canvas.plots.push(Plot { tiles, nearest, figure: Figure::Facets(facets) });
    }
}

impl Triangle {
    /// How it is drawn, if any pixel can show it.
    #[inline(always)]
    fn facet(&self, rays: &Rays, camera: &Camera, corners: [&Corner; 3]) -> Option<Facet> {
        let depths = corners.map(|corner| corner.depth);
        let (least, greatest) = (depths[0].min(depths[1]).min(depths[2]), depths[0].max(depths[1]).max(depths[2]));
        if greatest <= camera.near_m {
            return None;
        }
        let sizes = [(camera.columns, COLUMNS), (camera.rows, ROWS)];
        let mut tiles = sizes.map(|(size, tile)| [0, size.div_ceil(tile)]);
        if least > camera.near_m {
            for (axis, (size, tile)) in sizes.into_iter().enumerate() {
                let [a, b, c] = corners.map(|corner| corner.place[axis]);
                let first = (a.min(b).min(c) + (1.0 - MARGIN)).max(0.0) as usize;
                let end = ((a.max(b).max(c) + (1.0 + MARGIN)).max(0.0) as usize).min(size);
                if first >= end {
                    return None;
                }
                tiles[axis] = [first / tile, end.div_ceil(tile)];
            }
        }
        let edge = |one: usize, other: usize| {
            let normal = corners[other].away.cross(&corners[one].away);
            let [base, per_column, per_row] =
                [&rays.corner, &rays.per_column, &rays.per_row].map(|vector| normal.dot(vector));
            Affine::new(base, per_column, per_row, rays.size)
        };
        Some(Facet {
            tiles,
            inverse: rays.meets(&self.face.normal, self.face.offset).0,
            edges: [edge(0, 1), edge(1, 2), edge(2, 0)],
            range: [1.0 / greatest, if least > camera.near_m { 1.0 / least } else { f64::INFINITY }]
                .map(|inverse| inverse as f32),
            surface: self.face.surface,
        })
    }
}
