//! Channels of a camera's image as colours: depth, and what each pixel shows.

use kestrel_sim::camera::{FIRST_SOLID, FLOOR, Image, NOTHING};

use super::SMALL;
use crate::picture::{Picture, Rgb, text_width};

/// Depth from near to far: viridis (van der Walt and Smith 2015; its order is kept in grey and for the colour-blind),
/// reversed, so that what is near is bright. Nine of its colours, evenly apart.
const DEPTH_COLOURS: [Rgb; 9] = [
    [253, 231, 37],
    [170, 220, 50],
    [92, 200, 99],
    [39, 173, 129],
    [33, 144, 141],
    [44, 113, 142],
    [59, 81, 139],
    [71, 44, 122],
    [68, 1, 84],
];

/// Where nothing is.
pub(super) const NOTHING_COLOUR: Rgb = [255; 3];

/// The floor among labels.
const FLOOR_COLOUR: Rgb = [225, 225, 225];

/// Share of what is seen that is nearer than the darkest colour: the floor goes on for a kilometre.
const FAR_SHARE: f64 = 0.98;

/// Least ratio of the farthest to the nearest depth that has a colour of its own.
const LEAST_RATIO: f32 = 1.5;

/// Height of the bar of a legend, and of the bar with its numbers \[px\].
const BAR: usize = 6;
pub(crate) const LEGEND: usize = 18;

/// Which depths \[m\] the colours stand for, evenly in their logarithm: near differences matter more.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthScale {
    nearest: f32,
    farthest: f32,
}

impl DepthScale {
    /// For images that are shown together. Where they show nothing at all, for a metre.
    pub fn of<'a>(images: impl IntoIterator<Item = &'a Image>) -> Self {
        let seen = |image: &'a Image| {
            let pixels = image.depths.iter().zip(&image.labels);
            pixels.filter(|(_, label)| **label != NOTHING).map(|(depth, _)| *depth)
        };
        let mut depths: Vec<f32> = images.into_iter().flat_map(seen).collect();
        depths.sort_unstable_by(f32::total_cmp);
        let nearest = depths.first().copied().unwrap_or(1.0);
        let last = (FAR_SHARE * depths.len().saturating_sub(1) as f64) as usize;
        let farthest = depths.get(last).copied().unwrap_or(1.0);
        Self { nearest, farthest: farthest.max(nearest * LEAST_RATIO) }
    }

    /// Of what is `depth` away \[m\]; nothing is white.
    pub fn colour(&self, depth: f32, label: u16) -> Rgb {
        if label == NOTHING {
            return NOTHING_COLOUR;
        }
        depth_colour((depth / self.nearest).ln() / (self.farthest / self.nearest).ln())
    }

    /// Draws a bar of all colours with the depths of its ends and its middle, [`LEGEND`] high.
    pub(crate) fn draw_legend(&self, picture: &mut Picture, [left, top]: [usize; 2], width: usize, ink: Rgb) {
        for column in 0..width {
            let colour = depth_colour(column as f32 / (width - 1).max(1) as f32);
            picture.fill([left + column, top, 1, BAR], colour);
        }
        let middle = (self.nearest * self.farthest).sqrt();
        let numbers = [metres(self.nearest), metres(middle), format!("{} m", metres(self.farthest))];
        let widths = numbers.each_ref().map(|number| text_width(number, SMALL));
        let places = [0, (width.saturating_sub(widths[1])) / 2, width.saturating_sub(widths[2])];
        for (number, place) in numbers.iter().zip(places) {
            picture.text([left + place, top + BAR + 3], number, SMALL, ink);
        }
    }
}

/// From near to far in \[0, 1\].
fn depth_colour(share: f32) -> Rgb {
    let place = share.clamp(0.0, 1.0) * (DEPTH_COLOURS.len() - 1) as f32;
    let index = (place as usize).min(DEPTH_COLOURS.len() - 2);
    let (from, to) = (DEPTH_COLOURS[index], DEPTH_COLOURS[index + 1]);
    core::array::from_fn(|part| {
        let (from, to) = (f32::from(from[part]), f32::from(to[part]));
        (from + (place - index as f32) * (to - from)).round() as u8
    })
}

/// Two digits that count.
fn metres(depth: f32) -> String {
    let decimals = if depth < 0.995 { 2 } else { usize::from(depth < 9.95) };
    format!("{depth:.decimals$}")
}

/// Neighbouring labels look different: hues a golden section apart.
pub fn label_colour(label: u16) -> Rgb {
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

    fn image(depths: Vec<f32>, labels: Vec<u16>) -> Image {
        let colours = vec![[1, 2, 3]; labels.len()];
        Image { columns: labels.len(), depths, labels, colours }
    }

    #[test]
    fn near_is_bright_far_is_dark_and_nothing_is_white() {
        let scale = DepthScale { nearest: 1.0, farthest: 9.0 };
        assert_eq!(scale.colour(1.0, FLOOR), DEPTH_COLOURS[0]);
        assert_eq!(scale.colour(3.0, FLOOR), DEPTH_COLOURS[4]);
        assert_eq!(scale.colour(9.0, FLOOR), DEPTH_COLOURS[8]);
        assert_eq!(scale.colour(900.0, FLOOR), DEPTH_COLOURS[8]);
        assert_eq!(scale.colour(1000.0, NOTHING), NOTHING_COLOUR);
    }

    #[test]
    fn a_scale_holds_what_is_seen_but_the_far_end_of_the_floor() {
        let depths: Vec<f32> = (0..100).map(|index| 0.5 + index as f32 * 0.01).chain([900.0, 1000.0]).collect();
        let labels = (0..102).map(|index| if index == 101 { NOTHING } else { FLOOR }).collect();
        let scale = DepthScale::of([&image(depths, labels)]);
        assert_eq!(scale.nearest, 0.5);
        assert!((1.4..1.5).contains(&scale.farthest), "{}", scale.farthest);
        let flat = DepthScale::of([&image(vec![2.0; 3], vec![FLOOR; 3])]);
        assert_eq!((flat.nearest, flat.farthest), (2.0, 3.0));
        assert_eq!(DepthScale::of([&Image::default()]).nearest, 1.0);
    }

    #[test]
    fn a_legend_goes_from_near_to_far() {
        let mut picture = Picture::new([90, LEGEND], NOTHING_COLOUR);
        DepthScale { nearest: 0.25, farthest: 12.3 }.draw_legend(&mut picture, [0, 0], 90, [0; 3]);
        assert_eq!((picture.pixels[0], picture.pixels[89]), (DEPTH_COLOURS[0], DEPTH_COLOURS[8]));
        assert!(picture.pixels[90 * (BAR + 3)..].contains(&[0; 3]));
        assert_eq!([0.251, 0.999, 1.75, 12.3].map(metres), ["0.25", "1.0", "1.8", "12"]);
    }

    #[test]
    fn labels_of_many_solids_have_colours_of_their_own() {
        let mut colours: Vec<Rgb> = (0..40).map(label_colour).collect();
        colours.sort_unstable();
        colours.dedup();
        assert_eq!(colours.len(), 40);
    }
}
