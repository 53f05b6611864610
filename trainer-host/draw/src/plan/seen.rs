//! What a drone sees of each aviary from its start, beside each other.

use kestrel_core::airframe::CF2X;
use kestrel_sim::camera::{Scene, View};
use kestrel_sim::world::Pose;
use nalgebra::Vector3;

use super::subject::Subject;
use crate::drawing::Colour;
use crate::picture::{Picture, Rgb};
use crate::video::{SMALL, camera};

/// Columns of the sheet, and the pictures in them \[px\].
const COLUMNS: usize = 6;
const SIZE: [usize; 2] = [196, 147];

/// Around and between the cells, and height of their names \[px\].
const MARGIN: usize = 10;
const NAME: usize = 12;

/// Rays across a pixel, and down it.
const SAMPLES: usize = 4;

/// Angle of view, across \[rad\].
const VIEW_ANGLE: f64 = 1.4;

/// Where a drone is in a world that names no start \[m\].
const NO_START: Vector3<f64> = Vector3::new(0.0, 0.0, 1.0);

const PAPER: Rgb = [255; 3];

/// Of the line around each picture: the sky is as white as the paper.
const FRAME: Rgb = [217, 222, 229];

/// A picture for each subject: from its first start, or from the middle of its random ones, along x, where drones look at
/// the start; in colour, with smooth edges.
pub fn seen_sheet(subjects: &[Subject]) -> Picture {
    let [width, height] = SIZE;
    let rows = subjects.len().div_ceil(COLUMNS);
    let columns = subjects.len().clamp(1, COLUMNS);
    let size = [MARGIN + columns * (width + MARGIN), MARGIN + rows * (height + NAME + MARGIN)];
    let mut sheet = Picture::new(size, PAPER);
    for (index, subject) in subjects.iter().enumerate() {
        let left = MARGIN + index % COLUMNS * (width + MARGIN);
        let top = MARGIN + index / COLUMNS * (height + NAME + MARGIN);
        let Colour(ink) = super::INK;
        sheet.text([left, top], &subject.name, SMALL, ink);
        sheet.fill([left - 1, top + NAME - 1, width + 2, height + 2], FRAME);
        sheet.paste(&seen(subject), [left, top + NAME]);
    }
    sheet
}

fn seen(subject: &Subject) -> Picture {
    let middle = subject.start_region.map(|region| ((region.low + region.high) * 0.5).cast());
    let start = subject.starts.first().copied().or(middle).unwrap_or(NO_START);
    let view = View::paper(&Pose::at(start), CF2X.arm);
    let size = SIZE.map(|pixels| pixels * SAMPLES);
    let image = Scene::new(&subject.world).render(&camera(size, VIEW_ANGLE), &view);
    Picture { size, pixels: image.colours }.averaged(SAMPLES)
}
