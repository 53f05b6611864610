//! How many views are rendered at once.

use std::ops::Range;

use kestrel_sim::camera::Camera;

/// What an adapter can hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Room {
    /// Largest buffer, and largest part of one that a program sees \[B\].
    pub(super) bytes: u64,
    /// Most views of a dispatch.
    pub(super) views: usize,
    /// Most pixels of a view across, and down.
    pub(super) pixels: usize,
}

/// Words of a pixel: depth, label, colour.
pub(super) const PIXEL_WORDS: usize = 3;

/// Pixels across a tile of `draw.wgsl`, and down.
pub(super) const TILE: usize = 8;

/// Bytes of a view in each of the two large buffers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sizes {
    pub(super) pixels: u64,
    pub(super) plots: u64,
}

impl Room {
    /// `most_views` at once, or fewer.
    pub(super) fn new(limits: &wgpu::Limits, most_views: usize) -> Self {
        let groups = limits.max_compute_workgroups_per_dimension as usize;
        // Indices of words are 32 bits wide.
        let indexed = u64::from(u32::MAX);
        let bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size).min(indexed);
        Self { bytes, views: groups.min(most_views), pixels: groups * TILE }
    }

    /// Divides views, one of which fits, into parts that fit, as equal as can be.
    pub(super) fn parts(&self, views: usize, sizes: &Sizes) -> Vec<Range<usize>> {
        let fitting = (self.bytes / sizes.pixels.max(sizes.plots)).clamp(1, self.views as u64) as usize;
        let count = views.div_ceil(fitting);
        (0..count).map(|part| views * part / count..views * (part + 1) / count).collect()
    }
}

impl Sizes {
    pub(super) fn new(camera: &Camera, most_plots: usize) -> Self {
        let words = PIXEL_WORDS * camera.columns * camera.rows;
        Self { pixels: 4 * words as u64, plots: 16 * most_plots.max(1) as u64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROOM: Room = Room { bytes: 1000, views: 7, pixels: 524_280 };

    #[test]
    fn parts_cover_all_views_in_order_and_fit() {
        for (pixels, plots) in [(100, 30), (30, 100), (1, 1), (999, 1)] {
            let sizes = Sizes { pixels, plots };
            for views in 0..40 {
                let parts = ROOM.parts(views, &sizes);
                assert!(parts.iter().cloned().flatten().eq(0..views));
                assert!(parts.iter().all(|part| !part.is_empty() && part.len() <= ROOM.views));
                assert!(parts.iter().all(|part| part.len() as u64 * pixels.max(plots) <= ROOM.bytes));
            }
        }
    }
}
