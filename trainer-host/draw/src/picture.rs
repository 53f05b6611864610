//! Pictures made of pixels: put together, written on, made smaller.

use tiny_skia::{FillRule, Mask, Transform};

use crate::drawing::{PngError, png_of_pixels};
use crate::font;

/// Red, green, blue.
pub type Rgb = [u8; 3];

/// Rows of pixels from the top, each from the left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Columns and rows \[px\].
    pub size: [usize; 2],
    /// `[row][column]`.
    pub pixels: Vec<Rgb>,
}

impl Picture {
    /// All of one colour.
    pub fn new(size: [usize; 2], colour: Rgb) -> Self {
        Self { size, pixels: vec![colour; size[0] * size[1]] }
    }

    /// The picture as a PNG file.
    ///
    /// # Errors
    /// When it is empty or larger than 16384 pixels, or the encoder fails.
    pub fn png(&self) -> Result<Vec<u8>, PngError> {
        png_of_pixels(self.size, &self.pixels)
    }

    /// Lays another picture over this one, its upper left corner at `[column, row]`; what reaches beyond is cut.
    pub(crate) fn paste(&mut self, other: &Self, [left, top]: [usize; 2]) {
        let width = other.size[0].min(self.size[0].saturating_sub(left));
        let lines = other.pixels.chunks_exact(other.size[0].max(1)).take(self.size[1].saturating_sub(top));
        for (row, line) in lines.enumerate() {
            let start = (top + row) * self.size[0] + left;
            self.pixels[start..start + width].copy_from_slice(&line[..width]);
        }
    }

    /// Fills `[left, top, width, height]` as far as it is in the picture.
    pub(crate) fn fill(&mut self, [left, top, width, height]: [usize; 4], colour: Rgb) {
        let end = (left + width).min(self.size[0]);
        for row in top..(top + height).min(self.size[1]) {
            let line = &mut self.pixels[row * self.size[0]..][..self.size[0]];
            line[left.min(end)..end].fill(colour);
        }
    }

    /// Writes a line of a size \[px\]; `[left, top]` is the corner above its first capital letter.
    pub(crate) fn text(&mut self, [left, top]: [usize; 2], words: &str, size: f32, colour: Rgb) {
        let rows = (1.3 * size).ceil() as usize;
        let columns = text_width(words, size).min(self.size[0].saturating_sub(left));
        let baseline = (font::CAPITALS * size).round();
        let Some(mut mask) = Mask::new(columns as u32, rows as u32) else { return };
        let Some(path) = font::outlines(words, [0.0, baseline], size) else { return };
        mask.fill_path(&path, FillRule::Winding, true, Transform::identity());
        for (row, line) in mask.data().chunks_exact(columns).enumerate().take(self.size[1].saturating_sub(top)) {
            let start = (top + row) * self.size[0] + left;
            for (pixel, coverage) in self.pixels[start..].iter_mut().zip(line) {
                let mix = |below: u8, above: u8| {
                    let cover = u32::from(*coverage);
                    ((u32::from(below) * (255 - cover) + u32::from(above) * cover + 127) / 255) as u8
                };
                *pixel = [0, 1, 2].map(|part| mix(pixel[part], colour[part]));
            }
        }
    }

    /// As much smaller, each pixel the mean of `factor` × `factor`.
    #[must_use]
    pub(crate) fn averaged(&self, factor: usize) -> Self {
        let size = self.size.map(|pixels| pixels / factor);
        let count = (factor * factor) as u32;
        let mean = |place: usize| {
            let (row, column) = (place / size[0] * factor, place % size[0] * factor);
            let mut sums = [count / 2; 3];
            for line in self.pixels[row * self.size[0]..].chunks(self.size[0]).take(factor) {
                for pixel in &line[column..column + factor] {
                    sums.iter_mut().zip(pixel).for_each(|(sum, part)| *sum += u32::from(*part));
                }
            }
            sums.map(|sum| (sum / count) as u8)
        };
        Self { size, pixels: (0..size[0] * size[1]).map(mean).collect() }
    }
}

/// How wide a line of words is \[px\].
pub(crate) fn text_width(words: &str, size: f32) -> usize {
    font::width(words, size).ceil() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLACK: Rgb = [0; 3];
    const WHITE: Rgb = [255; 3];

    fn count(picture: &Picture, colour: Rgb) -> usize {
        picture.pixels.iter().filter(|pixel| **pixel == colour).count()
    }

    #[test]
    fn what_reaches_beyond_the_border_is_cut() {
        let mut picture = Picture::new([4, 3], BLACK);
        picture.paste(&Picture::new([3, 3], WHITE), [2, 1]);
        assert_eq!(count(&picture, WHITE), 4);
        picture.paste(&Picture::new([3, 3], WHITE), [9, 9]);
        picture.fill([0, 2, 100, 100], WHITE);
        picture.fill([7, 0, 1, 1], WHITE);
        assert_eq!(count(&picture, WHITE), 6);
    }

    #[test]
    fn a_mean_is_that_of_its_pixels_rounded() {
        let pixels = vec![[0, 0, 9], [1, 255, 9], [0, 0, 0], [1, 255, 255], [0, 0, 0], [9, 9, 9]];
        let wide = Picture { size: [6, 1], pixels };
        assert_eq!(wide.averaged(1), wide);
        let square = Picture { size: [2, 2], pixels: wide.pixels[..4].to_vec() };
        assert_eq!(square.averaged(2), Picture { size: [1, 1], pixels: vec![[1, 128, 68]] });
    }

    #[test]
    fn words_take_the_width_that_is_told_and_reach_from_the_corner_to_the_baseline() {
        let mut picture = Picture::new([100, 30], WHITE);
        picture.text([10, 5], "HH", 20.0, BLACK);
        let dark = |place: &usize| picture.pixels[*place][0] < 128;
        let columns = || (0..3000).filter(dark).map(|place| place % 100);
        let rows = || (0..3000).filter(dark).map(|place| place / 100);
        let [from, to] = [columns().min(), columns().max()].map(|column| column.unwrap_or(0));
        assert!((10..14).contains(&from) && (10 + text_width("HH", 20.0)).abs_diff(to) < 5, "{from} to {to}");
        assert!(rows().min().unwrap_or(0).abs_diff(5) < 2 && rows().max().unwrap_or(0).abs_diff(19) < 2);
        assert_eq!(text_width("", 3.0), 0);
        picture.text([90, 25], "cut at the border", 20.0, BLACK);
    }
}
