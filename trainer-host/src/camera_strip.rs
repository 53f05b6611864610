//! What a camera sees, side by side: colour, depth and what each pixel shows.

use kestrel_sim::camera::{FIRST_SOLID, FLOOR, Image, NOTHING};

use crate::drawing::{PngError, png_of_pixels};

/// Depth from near to far: dark blue, green, yellow (after viridis, which keeps its order in grey and for the
/// colour-blind), reversed, so that what is near is bright.
const DEPTH_COLOURS: [[u8; 3]; 5] = [[253, 231, 37], [94, 201, 98], [33, 145, 140], [59, 82, 139], [68, 1, 84]];

/// Where nothing is.
const NOTHING_COLOUR: [u8; 3] = [255; 3];

/// The floor among labels.
const FLOOR_COLOUR: [u8; 3] = [225, 225, 225];

/// Space between pictures \[px\].
const GAP: usize = 8;

/// A PNG file of three pictures.
///
/// # Errors
/// When the image is empty or the strip wider than a PNG of this program may be.
pub fn strip(image: &Image) -> Result<Vec<u8>, PngError> {
    let (columns, rows) = (image.columns, image.colours.len() / image.columns.max(1));
    let seen = || image.depths.iter().zip(&image.labels).filter(|(_, label)| **label != NOTHING);
    let nearest = seen().map(|(depth, _)| *depth).fold(f32::INFINITY, f32::min);
    let farthest = seen().map(|(depth, _)| *depth).fold(nearest, f32::max);
    let width = 3 * columns + 2 * GAP;
    let mut pixels = vec![NOTHING_COLOUR; width * rows];
    for row in 0..rows {
        for column in 0..columns {
            let place = row * columns + column;
            let (depth, label) = (image.depths[place], image.labels[place]);
            let pictures =
                [image.colours[place], depth_colour(depth, label, [nearest, farthest]), label_colour(label)];
            for (index, colour) in pictures.into_iter().enumerate() {
                pixels[row * width + index * (columns + GAP) + column] = colour;
            }
        }
    }
    png_of_pixels([width, rows], &pixels)
}

/// By the logarithm: near differences matter more.
fn depth_colour(depth: f32, label: u16, [nearest, farthest]: [f32; 2]) -> [u8; 3] {
    if label == NOTHING {
        return NOTHING_COLOUR;
    }
    let share = (depth / nearest).ln() / (farthest / nearest).ln().max(f32::MIN_POSITIVE);
    let place = share.clamp(0.0, 1.0) * (DEPTH_COLOURS.len() - 1) as f32;
    let index = (place as usize).min(DEPTH_COLOURS.len() - 2);
    let (from, to) = (DEPTH_COLOURS[index], DEPTH_COLOURS[index + 1]);
    core::array::from_fn(|part| {
        let (from, to) = (f32::from(from[part]), f32::from(to[part]));
        (from + (place - index as f32) * (to - from)).round() as u8
    })
}

/// Neighbouring labels look different: hues a golden section apart.
fn label_colour(label: u16) -> [u8; 3] {
    match label {
        NOTHING => NOTHING_COLOUR,
        FLOOR => FLOOR_COLOUR,
        solid => {
            let hue = (f32::from(solid - FIRST_SOLID) * 0.618_034).fract() * 6.0;
            let part = |offset: f32| {
                let place = (hue + offset).rem_euclid(6.0);
                let share = (2.0 - (place - 3.0).abs()).clamp(0.0, 1.0);
                (60.0 + 170.0 * share) as u8
            };
            [part(3.0), part(1.0), part(5.0)]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_is_bright_far_is_dark_and_nothing_is_white() {
        assert_eq!(depth_colour(1.0, FLOOR, [1.0, 9.0]), DEPTH_COLOURS[0]);
        assert_eq!(depth_colour(3.0, FLOOR, [1.0, 9.0]), DEPTH_COLOURS[2]);
        assert_eq!(depth_colour(9.0, FLOOR, [1.0, 9.0]), DEPTH_COLOURS[4]);
        assert_eq!(depth_colour(2.0, FLOOR, [2.0, 2.0]), DEPTH_COLOURS[0]);
        assert_eq!(depth_colour(1000.0, NOTHING, [1.0, 9.0]), NOTHING_COLOUR);
    }

    #[test]
    fn labels_of_many_solids_have_colours_of_their_own() {
        let mut colours: Vec<[u8; 3]> = (0..40).map(label_colour).collect();
        colours.sort_unstable();
        colours.dedup();
        assert_eq!(colours.len(), 40);
    }

    #[test]
    fn a_strip_is_three_pictures_wide() {
        let image =
            Image { columns: 4, depths: vec![1.0; 8], labels: vec![FLOOR; 8], colours: vec![[1, 2, 3]; 8] };
        let file = strip(&image).unwrap();
        assert_eq!(file[16..24], [0, 0, 0, 28, 0, 0, 0, 2], "width and height in the header");
        assert!(strip(&Image::default()).is_err());
    }
}
