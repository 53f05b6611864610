//! Boxes, spheres and cylinders as the reference's camera saw them: depth, what each pixel shows, and its colour.
//!
//! `tests/golden/pybullet/camera` has frames of `BaseAviary._getDroneImages` (64×48, `TinyRenderer`), of the world in
//! `primitives.yaml` with and without the floor, from the poses in `*.poses.csv`. The drone's own mesh, which the reference
//! sees at the bottom, is masked (255).

#![expect(clippy::unwrap_used, reason = "a test that cannot go on should panic")]

use std::fs;
use std::path::PathBuf;

use kestrel_core::attitude::Attitude;
use kestrel_sim::camera::{Camera, FIRST_SOLID, Image, Scene, View};
use kestrel_sim::config::AviaryParts;
use kestrel_sim::world::{Floor, Pose, Shape, Solid};
use nalgebra::Vector3;

const PIXELS: usize = 64 * 48;

/// Height of the camera above the drone \[m\].
const EYE_HEIGHT: f64 = 0.0397;

/// Label of a pixel that shows the drone.
const DRONE: u8 = 255;

/// A recorded frame.
struct Frame<'a> {
    pose: Pose,
    depths: Vec<f32>,
    labels: &'a [u8],
    colours: &'a [[u8; 3]],
}

/// How many pixels of some frames there are, and how many of them differ.
#[derive(Debug, Default)]
struct Count {
    pixels: usize,
    /// From every one of the nine around it in the recording.
    labels: usize,
    /// By more than 1 %, or 4 % on a sphere, where the label agrees.
    depths: usize,
    /// By more than 3 levels from the colour in the light and from that in a shadow, which the reference draws.
    colours: usize,
}

fn golden(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/pybullet/camera").join(name)
}

fn poses(name: &str) -> Vec<Pose> {
    let text = fs::read_to_string(golden(&format!("{name}.poses.csv"))).unwrap();
    let pose = |line: &str| {
        let values: Vec<f64> = line.split(',').map(|value| value.parse().unwrap()).collect();
        let world_from_body = Attitude { w: values[6], x: values[3], y: values[4], z: values[5] };
        Pose { position: Vector3::from_column_slice(&values[..3]), world_from_body }
    };
    text.lines().skip(1).map(pose).collect()
}

/// Whether any of the nine pixels around one is so.
fn nearby(place: usize, is_so: impl Fn(usize) -> bool) -> bool {
    let (row, column) = (place / 64, place % 64);
    let around = |at: usize, size: usize| at.saturating_sub(1)..=(at + 1).min(size - 1);
    around(row, 48).any(|row| around(column, 64).any(|column| is_so(row * 64 + column)))
}

/// Whether a recorded colour is ours, or would be in a shadow, which takes a fifth of all light that has a direction.
fn is_lit(ours: [u8; 3], recorded: [u8; 3], full: [f32; 3]) -> bool {
    (0..3).all(|i| {
        let (lit, ambient, recorded) = (f32::from(ours[i]), 0.6 * 255.0 * full[i], f32::from(recorded[i]));
        let shadowed = ambient + 0.8 * (lit - ambient);
        (recorded - lit).abs().min((recorded - shadowed).abs()) <= 3.0
    })
}

impl Count {
    fn add(&mut self, frame: &Frame<'_>, seen: &Image, solids: &[Solid]) {
        for place in (0..PIXELS).filter(|place| frame.labels[*place] != DRONE) {
            self.pixels += 1;
            let label = seen.labels[place];
            if !nearby(place, |other| u16::from(frame.labels[other]) == label) {
                self.labels += 1;
            }
            if u16::from(frame.labels[place]) == label {
                let solid = solids.get(usize::from(label.wrapping_sub(FIRST_SOLID)));
                let is_round = solid.is_some_and(|solid| matches!(solid.shape, Shape::Sphere(_)));
                // The reference's spheres are coarse meshes inside of ours.
                let tolerance = if is_round { 0.04 } else { 0.01 };
                let (depth, expected) = (seen.depths[place], frame.depths[place]);
                self.depths += usize::from((depth - expected).abs() > tolerance * expected);
                // Squares of the floor far away are smaller than pixels.
                let (ours, recorded) = (seen.colours[place], frame.colours[place]);
                let is_lit = solid.is_none_or(|solid| is_lit(ours, recorded, solid.colour));
                self.colours += usize::from(!is_lit);
            }
        }
    }
}

fn count(name: &str, floor: Floor) -> Count {
    let mut world = AviaryParts::read(&golden("primitives.yaml")).unwrap().world;
    world.floor = floor;
    let scene = Scene::new(&world);
    let bytes = |kind: &str| fs::read(golden(&format!("{name}.{kind}"))).unwrap();
    let (depths, labels, colours) = (bytes("depths.f32"), bytes("labels.u8"), bytes("colours.u8"));
    let mut count = Count::default();
    for (index, pose) in poses(name).into_iter().enumerate() {
        let pixels = index * PIXELS..(index + 1) * PIXELS;
        let depths = depths.as_chunks().0[pixels.clone()].iter().map(|bytes| f32::from_le_bytes(*bytes));
        let colours = &colours.as_chunks().0[pixels.clone()];
        let frame = Frame { pose, depths: depths.collect(), labels: &labels[pixels], colours };
        let seen = scene.render(&Camera::REFERENCE, &View::paper(&frame.pose, EYE_HEIGHT));
        count.add(&frame, &seen, &world.solids);
    }
    println!("{name}: {count:?}");
    count
}

#[test]
fn the_camera_of_the_reference_saw_these_primitives() {
    for (name, floor) in [("primitives", Floor::Solid), ("primitives_noplane", Floor::Absent)] {
        let Count { pixels, labels, depths, colours } = count(name, floor);
        let share = |part: usize| part as f64 / pixels as f64;
        assert!(share(labels) < 0.001, "{name}: {labels} of {pixels} silhouettes are off by more than a pixel");
        assert!(share(depths) < 0.001, "{name}: {depths} of {pixels} depths differ");
        assert!(share(colours) < 0.01, "{name}: {colours} of {pixels} colours differ");
    }
}
