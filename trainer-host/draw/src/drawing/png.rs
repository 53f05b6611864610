//! A drawing as pixels.

use tiny_skia::{FillRule, Paint, PathBuilder, Pixmap, Stroke, StrokeDash, Transform};

use super::{Anchor, Colour, Dashed, Drawing, Mark, Pen, Text};
use crate::font;
use crate::picture::Picture;

/// Greatest width or height \[px\].
const SIZE_LIMIT: f64 = 16_384.0;

/// The drawing cannot become pixels.
#[derive(Debug, thiserror::Error)]
#[error("cannot draw the picture: {0}")]
pub struct PngError(String);

impl Drawing {
    /// The drawing as a PNG file, a pixel a pixel.
    ///
    /// # Errors
    /// When the drawing is empty or larger than 16384 pixels, or the encoder fails.
    pub fn png(&self) -> Result<Vec<u8>, PngError> {
        let [width, height] = [self.width, self.height].map(f64::ceil);
        let fits = (1.0..=SIZE_LIMIT).contains(&width) && (1.0..=SIZE_LIMIT).contains(&height);
        let pixels = fits.then(|| Pixmap::new(width as u32, height as u32)).flatten();
        let mut pixels = pixels.ok_or_else(|| PngError(format!("found a size of {width} x {height} pixels")))?;
        pixels.fill(tiny_skia::Color::WHITE);
        for mark in &self.marks {
            draw(&mut pixels, mark);
        }
        pixels.encode_png().map_err(|error| PngError(error.to_string()))
    }
}

impl Drawing {
    /// The picture with the drawing over it, a pixel a pixel; what reaches beyond is cut.
    pub(crate) fn over(&self, picture: &Picture) -> Picture {
        let Ok(mut pixels) = pixmap(picture.size, &picture.pixels) else { return picture.clone() };
        for mark in &self.marks {
            draw(&mut pixels, mark);
        }
        let colour = |pixel: &tiny_skia::PremultipliedColorU8| [pixel.red(), pixel.green(), pixel.blue()];
        Picture { size: picture.size, pixels: pixels.pixels().iter().map(colour).collect() }
    }
}

/// A PNG file of so many columns and rows of red, green and blue.
///
/// # Errors
/// When there are none, or more than 16384 of either, or the encoder fails.
pub fn png_of_pixels(size: [usize; 2], colours: &[[u8; 3]]) -> Result<Vec<u8>, PngError> {
    pixmap(size, colours)?.encode_png().map_err(|error| PngError(error.to_string()))
}

fn pixmap([columns, rows]: [usize; 2], colours: &[[u8; 3]]) -> Result<Pixmap, PngError> {
    let fits = [columns, rows].iter().all(|size| (1..=SIZE_LIMIT as usize).contains(size));
    let pixels = fits.then(|| Pixmap::new(columns as u32, rows as u32)).flatten();
    let mut pixels = pixels.ok_or_else(|| PngError(format!("found a size of {columns} x {rows} pixels")))?;
    for (pixel, [red, green, blue]) in pixels.pixels_mut().iter_mut().zip(colours) {
        *pixel = tiny_skia::ColorU8::from_rgba(*red, *green, *blue, u8::MAX).premultiply();
    }
    Ok(pixels)
}

fn draw(pixels: &mut Pixmap, mark: &Mark) {
    let mut path = PathBuilder::new();
    match mark {
        Mark::Polygon { corners, fill, edge } => {
            connect(&mut path, corners);
            path.close();
            draw_path(pixels, path, *fill, *edge);
        }
        Mark::Line { ends: [[x1, y1], [x2, y2]], pen } => {
            path.move_to(*x1 as f32, *y1 as f32);
            path.line_to(*x2 as f32, *y2 as f32);
            draw_path(pixels, path, None, Some(*pen));
        }
        Mark::Path { points, pen } => {
            connect(&mut path, points);
            draw_path(pixels, path, None, Some(*pen));
        }
        Mark::Disc { centre: [x, y], radius, fill, edge } => {
            path.push_circle(*x as f32, *y as f32, *radius as f32);
            draw_path(pixels, path, *fill, *edge);
        }
        Mark::Text(text) => draw_text(pixels, text),
    }
}

fn connect(path: &mut PathBuilder, points: &[[f64; 2]]) {
    for (index, [x, y]) in points.iter().enumerate() {
        if index == 0 { path.move_to(*x as f32, *y as f32) } else { path.line_to(*x as f32, *y as f32) }
    }
}

fn draw_path(pixels: &mut Pixmap, path: PathBuilder, fill: Option<(Colour, f64)>, edge: Option<Pen>) {
    let Some(path) = path.finish() else { return };
    if let Some((colour, opacity)) = fill {
        let paint = paint(colour, opacity);
        pixels.fill_path(&path, &paint, FillRule::Winding, Transform::identity(), None);
    }
    if let Some(pen) = edge {
        let dash = match pen.dashed {
            Dashed::Solid => None,
            Dashed::Dashes => StrokeDash::new(vec![4.0, 3.0], 0.0),
        };
        let stroke = Stroke { width: pen.width as f32, dash, ..Stroke::default() };
        pixels.stroke_path(&path, &paint(pen.colour, 1.0), &stroke, Transform::identity(), None);
    }
}

fn paint(Colour([red, green, blue]): Colour, opacity: f64) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(red, green, blue, (opacity * 255.0).round() as u8);
    paint
}

fn draw_text(pixels: &mut Pixmap, text: &Text) {
    let size = text.size as f32;
    let left = text.at[0] as f32
        - match text.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => font::width(&text.words, size) / 2.0,
            Anchor::End => font::width(&text.words, size),
        };
    if let Some(path) = font::outlines(&text.words, [left, text.at[1] as f32], size) {
        let paint = paint(text.colour, 1.0);
        pixels.fill_path(&path, &paint, FillRule::Winding, Transform::identity(), None);
    }
}
