//! From a scene to an image.

#[cfg(test)]
mod tests;

use pulp::{Simd, WithSimd};

use super::kernel::{COLUMNS, Canvas, ROWS};
use super::plot::Rays;
use super::scene::{AMBIENT, BACKGROUND, DIFFUSE, FLOOR_SURFACE, NO_SURFACE, SPECULAR, Scene, Shading, Surface};
use super::{Camera, Image, NOTHING, View};
use crate::simd::Arch;

impl Scene {
    /// What a camera sees.
    pub fn render(&self, camera: &Camera, view: &View) -> Image {
        let mut image = Image::default();
        self.render_into(camera, view, &mut Canvas::default(), &mut image);
        image
    }

    /// As [`Self::render`], in memory that is used again.
    pub fn render_into(&self, camera: &Camera, view: &View, canvas: &mut Canvas, image: &mut Image) {
        image.fit(camera);
        Arch::new().dispatch(Render { scene: self, camera, rays: Rays::new(camera, view), canvas, image });
    }
}

impl Image {
    /// Makes room for what a camera sees.
    fn fit(&mut self, camera: &Camera) {
        let pixels = camera.columns * camera.rows;
        self.columns = camera.columns;
        self.depths.resize(pixels, 0.0);
        self.labels.resize(pixels, NOTHING);
        self.colours.resize(pixels, BACKGROUND);
    }
}

/// A picture that is taken with the best instructions of the processor.
struct Render<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    rays: Rays,
    canvas: &'a mut Canvas,
    image: &'a mut Image,
}

impl WithSimd for Render<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { scene, camera, rays, canvas, image } = self;
        canvas.clear(camera);
        scene.plot(camera, &rays, canvas);
        canvas.draw(simd);
        scene.finish(camera, &rays, canvas, image);
    }
}

impl Scene {
    /// What is seen at last, in numbers that others understand.
    #[inline(always)]
    fn finish(&self, camera: &Camera, rays: &Rays, canvas: &Canvas, image: &mut Image) {
        let columns = image.columns;
        let lines = image.depths.chunks_exact_mut(columns).zip(image.labels.chunks_exact_mut(columns));
        for (row, ((depths, labels), colours)) in lines.zip(image.colours.chunks_exact_mut(columns)).enumerate() {
            let tiles = &canvas.tiles[row / ROWS * canvas.across..][..canvas.across];
            for (index, tile) in tiles.iter().enumerate() {
                let first = index * COLUMNS;
                let (inverses, surfaces) = (&tile.inverses[row % ROWS], &tile.surfaces[row % ROWS]);
                let part = Part { first, row, inverses, surfaces };
                let end = (first + COLUMNS).min(columns);
                let pixels = Pixels {
                    depths: &mut depths[first..end],
                    labels: &mut labels[first..end],
                    colours: &mut colours[first..end],
                };
                self.show((camera, rays), &part, pixels);
            }
        }
    }

    /// Writes some pixels.
    #[inline(always)]
    fn show(&self, (camera, rays): (&Camera, &Rays), part: &Part<'_>, pixels: Pixels<'_>) {
        let Pixels { depths: out, labels, colours } = pixels;
        let far = camera.far_m as f32;
        let mut depths = [0.0; COLUMNS];
        let (mut others, mut floors) = (0, false);
        for lane in 0..COLUMNS {
            let surface = part.surfaces[lane];
            let depth = 1.0 / part.inverses[lane];
            depths[lane] = if surface == NO_SURFACE { far } else { depth };
            others |= surface ^ part.surfaces[0];
            floors |= surface == FLOOR_SURFACE;
        }
        out.copy_from_slice(&depths[..out.len()]);
        let first = &self.surfaces[part.surfaces[0] as usize];
        if others == 0 && first.round.is_none() && !floors {
            labels.fill(first.label);
            colours.fill(first.colour);
            return;
        }
        let points = rays.points([part.first, part.row], &depths);
        let mut surfaces = *part.surfaces;
        if floors {
            for lane in 0..COLUMNS {
                let square = floor(points[0][lane]).wrapping_add(floor(points[1][lane])) & 1;
                surfaces[lane] += if surfaces[lane] == FLOOR_SURFACE { square as Surface } else { 0 };
            }
        }
        for lane in 0..out.len() {
            let look = &self.surfaces[surfaces[lane] as usize];
            labels[lane] = look.label;
            colours[lane] = match look.round {
                None => look.colour,
                Some(body) => self.round_colour(body, [points[0][lane], points[1][lane], points[2][lane]]),
            };
        }
    }

    /// Of a point of something round.
    #[inline(always)]
    fn round_colour(&self, body: u32, point: [f32; 3]) -> [u8; 3] {
        let Some(round) = &self.bodies[body as usize].round else { return BACKGROUND };
        let Shading { centre, axis, light, along, rise, per_radius, colour } = &round.shading;
        let away = [point[0] - centre[0], point[1] - centre[1], point[2] - centre[2]];
        let dot = |one: &[f32; 3], other: &[f32; 3]| one[0] * other[0] + one[1] * other[1] + one[2] * other[2];
        let along_axis = dot(&away, axis);
        let facing = dot(&away, light) - along_axis * along;
        let up = (away[2] - along_axis * axis[2]) * per_radius;
        let mirrored = 2.0 * facing * up - rise;
        let lit = |share: f32| if share > 0.0 { share } else { 0.0 };
        let mirrored = lit(mirrored) * lit(mirrored);
        let share = AMBIENT as f32 + DIFFUSE as f32 * lit(facing) + SPECULAR as f32 * mirrored;
        [(colour[0] * share) as u8, (colour[1] * share) as u8, (colour[2] * share) as u8]
    }
}

/// Where some pixels go.
struct Pixels<'a> {
    depths: &'a mut [f32],
    labels: &'a mut [u16],
    colours: &'a mut [[u8; 3]],
}

/// Pixels of a tile in one row.
struct Part<'a> {
    first: usize,
    row: usize,
    inverses: &'a [f32; COLUMNS],
    surfaces: &'a [Surface; COLUMNS],
}

/// The greatest whole number that is not greater.
#[inline(always)]
fn floor(value: f32) -> i32 {
    let whole = value as i32;
    whole - i32::from(value < whole as f32)
}
