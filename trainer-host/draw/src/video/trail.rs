//! Where drones have been, over what a camera sees.

use kestrel_sim::camera::{Image, View};
use nalgebra::Vector3;

use super::chase::VIEW_ANGLE;
use super::playback::{Moment, PICTURE_SECS};
use super::recorded_scene::RecordedScene;
use crate::drawing::{Colour, Drawing, Pen};
use crate::picture::Picture;

/// The first drone, the second and so on, then from the beginning.
const COLOURS: [Colour; 6] = [
    Colour([0xf0, 0x7f, 0x2e]),
    Colour([0x1c, 0x8f, 0xd6]),
    Colour([0x2e, 0xa0, 0x43]),
    Colour([0xd6, 0x33, 0x84]),
    Colour([0xa6, 0x7c, 0x00]),
    Colour([0x00, 0x99, 0xa8]),
];

/// Nothing nearer is drawn, and what is so much behind a surface counts as on it \[m\].
const NEAREST_M: f64 = 0.05;

/// Colour of the trail of a drone, counted from zero.
pub(crate) fn colour(drone: usize) -> Colour {
    COLOURS[drone % COLOURS.len()]
}

/// The picture of the chasing camera, whose depths are in `image`, with the trails of all drones as far as they are seen.
pub(super) fn drawn(
    recorded: &RecordedScene,
    moment: &Moment,
    view: &View,
    image: &Image,
    picture: &Picture,
) -> Picture {
    let pictures = (moment.elapsed_secs / PICTURE_SECS) as usize + 1;
    let past = &recorded.moments()[..pictures.min(recorded.moments().len())];
    let mut drawing = Drawing::new(picture.size[0] as f64, picture.size[1] as f64);
    for drone in 0..recorded.drones() {
        let then = past.iter().chain([moment]);
        let points: Vec<Option<[f64; 2]>> = then
            .map(|moment| seen_at(moment.drones[drone].placement.position.cast(), view, image, picture.size))
            .collect();
        for visible in points.split(Option::is_none).filter(|visible| visible.len() > 1) {
            drawing.path(visible.iter().flatten().copied().collect(), Pen::solid(colour(drone), 2.0));
        }
    }
    drawing.over(picture)
}

/// Where a point of the world is in the picture \[px\], unless it is behind something or outside.
pub(crate) fn seen_at(
    point: Vector3<f64>,
    view: &View,
    image: &Image,
    [width, height]: [usize; 2],
) -> Option<[f64; 2]> {
    let offset = point - view.eye;
    let depth = view.forward.dot(&offset);
    if depth < NEAREST_M {
        return None;
    }
    let half = 0.5 * width as f64;
    let focal = half / (0.5 * VIEW_ANGLE).tan();
    let [x, y] = [
        half + focal * view.right.dot(&offset) / depth,
        0.5 * height as f64 + focal * view.down.dot(&offset) / depth,
    ];
    let inside = (0.0..width as f64).contains(&x) && (0.0..height as f64).contains(&y);
    let samples = image.columns / width;
    let surface =
        inside.then(|| image.depths.get(samples * y as usize * image.columns + samples * x as usize)).flatten()?;
    (depth <= f64::from(*surface) + NEAREST_M).then_some([x, y])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trail_is_seen_before_a_wall_and_not_behind_it() {
        let view = View::towards(Vector3::zeros(), Vector3::x(), Vector3::z());
        let wall = Image { columns: 20, depths: vec![2.0; 200], labels: vec![1; 200], colours: vec![[0; 3]; 200] };
        let at = |x, y| seen_at(Vector3::new(x, y, 0.0), &view, &wall, [10, 5]);
        assert_eq!(at(1.0, 0.0), Some([5.0, 2.5]));
        assert!(at(1.0, 0.2).is_some_and(|[x, _]| x < 5.0), "left is left");
        assert_eq!([at(3.0, 0.0), at(-1.0, 0.0), at(1.0, 1.0)], [None; 3]);
    }

    #[test]
    fn drones_side_by_side_have_colours_of_their_own() {
        let different = (0..6).all(|drone| (0..drone).all(|other| colour(drone) != colour(other)));
        assert!(different && colour(7) == colour(1));
    }
}
