//! What the reference's drones saw on their flights through Long Cross and Room 2, against ours: what each pixel shows, and
//! the colours of what is in the light or in a shadow.
//!
//! The fork recorded colours only (`tests/golden/pybullet/thesis`, 64×48), and draws every thing plain, so that a colour
//! says what a pixel shows: `*.labels.u8` has that, `*.colours.csv` how many pixels of each frame have which colour.
//! Left out are the drone's own mesh (255), and which of the white things a pixel shows: the floor or the table.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on should panic")]

use std::fs;
use std::path::{Path, PathBuf};

use kestrel_core::attitude::Attitude;
use kestrel_sim::camera::{Camera, FIRST_SOLID, FLOOR, Image, Scene, View};
use kestrel_sim::config::AviaryParts;
use kestrel_sim::world::{Pose, World};
use nalgebra::Vector3;

const PIXELS: usize = 64 * 48;

/// Height of the camera above the drone \[m\].
const EYE_HEIGHT: f64 = 0.0397;

/// Labels of the recording: nothing, what is white or the floor, walls, dressers, cupboards, the drone.
const WHITE: u8 = 1;
const WALL: u8 = 2;
const DRESSER: u8 = 3;
const CUPBOARD: u8 = 4;
const DRONE: u8 = 255;

/// Share of what light gives that is left in a shadow of the reference.
const SHADOW: f32 = 0.8;

/// Levels by which a colour may differ.
const TOLERANCE: f32 = 3.0;

/// Pixels of a colour that are an area and no edge.
const AREA: usize = 30;

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/pybullet/thesis").join(name)
}

/// The rows of a table behind its head, by comma.
fn rows(name: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(golden(name)).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

fn pose(row: &[String]) -> Pose {
    let values: Vec<f64> = row[2..].iter().map(|value| value.parse().unwrap()).collect();
    let world_from_body = Attitude { w: values[6], x: values[3], y: values[4], z: values[5] };
    Pose { position: Vector3::from_column_slice(&values[..3]), world_from_body }
}

/// Labels of the recording for what a picture of ours shows.
fn labels(world: &World, image: &Image) -> Vec<u8> {
    let of_solid = |name: &str| match name {
        name if name.starts_with("dresser") => DRESSER,
        name if name.starts_with("cupboard") => CUPBOARD,
        name if name.contains("wall") => WALL,
        name if name.contains("table") || name == "pad" => WHITE,
        name => panic!("{name} is nothing of the reference's"),
    };
    let label = |label: &u16| match *label {
        kestrel_sim::camera::NOTHING => 0,
        FLOOR => WHITE,
        solid => of_solid(&world.solids[usize::from(solid - FIRST_SOLID)].name),
    };
    image.labels.iter().map(label).collect()
}

/// Whether any of the nine pixels around one is so.
fn nearby(place: usize, is_so: impl Fn(usize) -> bool) -> bool {
    let (row, column) = (place / 64, place % 64);
    let around = |at: usize, size: usize| at.saturating_sub(1)..=(at + 1).min(size - 1);
    around(row, 48).any(|row| around(column, 64).any(|column| is_so(row * 64 + column)))
}

/// Pixels of an image with each label and colour, where those are an area.
fn areas(labels: &[u8], image: &Image) -> Vec<(u8, [u8; 3])> {
    let mut all: Vec<_> = labels.iter().copied().zip(image.colours.iter().copied()).collect();
    all.sort_unstable();
    let same = all.chunk_by(|one, other| one == other);
    same.filter(|area| area.len() >= AREA && [WALL, DRESSER, CUPBOARD].contains(&area[0].0))
        .map(|area| area[0])
        .collect()
}

/// Whether a recorded colour is ours, or would be in a shadow; `full` is it in all light that there is.
fn is_lit(ours: [u8; 3], recorded: [f32; 3], full: [f32; 3]) -> bool {
    (0..3).all(|i| {
        let (lit, ambient) = (f32::from(ours[i]), 0.6 * 255.0 * full[i]);
        let shadowed = ambient + SHADOW * (lit - ambient);
        (recorded[i] - lit).abs().min((recorded[i] - shadowed).abs()) <= TOLERANCE
    })
}

fn colour(world: &World, prefix: &str) -> [f32; 3] {
    world.solids.iter().find(|solid| solid.name.contains(prefix)).map_or([0.0; 3], |solid| solid.colour)
}

/// Shares of the pixels whose label is nowhere near, and of the areas whose colour is in no picture.
fn compare(recording: &str, world: &str) -> [f64; 2] {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../assets/worlds/{world}.yaml"));
    let world = AviaryParts::read(&path).unwrap().world;
    let scene = Scene::new(&world);
    let full = [[0.0; 3], [0.0; 3], colour(&world, "wall"), colour(&world, "dresser"), colour(&world, "cupboard")];
    let recorded = fs::read(golden(&format!("{recording}.labels.u8"))).unwrap();
    let (poses, colours) = (rows(&format!("{recording}.poses.csv")), rows(&format!("{recording}.colours.csv")));
    assert_eq!(recorded.len(), poses.len() * PIXELS);
    let (mut pixels, mut off, mut seen, mut unlike) = (0, 0, 0, 0);
    for (frame, (row, recorded)) in poses.iter().zip(recorded.chunks_exact(PIXELS)).enumerate() {
        let image = scene.render(&Camera::REFERENCE, &View::paper(&pose(row), EYE_HEIGHT));
        let labels = labels(&world, &image);
        for place in (0..PIXELS).filter(|place| !nearby(*place, |other| recorded[other] == DRONE)) {
            pixels += 1;
            off += usize::from(!nearby(place, |other| recorded[other] == labels[place]));
        }
        let number = |text: &String| text.parse::<f32>().unwrap();
        let of_frame: Vec<_> = colours.iter().filter(|row| row[0] == frame.to_string()).collect();
        for (label, ours) in areas(&labels, &image) {
            let is_like = |row: &&Vec<String>| {
                let colour = [number(&row[2]), number(&row[3]), number(&row[4])];
                row[1] == label.to_string() && is_lit(ours, colour, full[usize::from(label)])
            };
            seen += 1;
            if !of_frame.iter().any(is_like) {
                println!("{recording} {frame}: no {ours:?} of {label}");
                unlike += 1;
            }
        }
    }
    println!(
        "{recording}: {off} of {pixels} silhouettes are off by more than a pixel; {unlike} of {seen} areas have other colours"
    );
    [(off, pixels), (unlike, seen)].map(|(part, all)| f64::from(part as u32) / f64::from(all as u32))
}

#[test]
fn the_drones_of_the_reference_saw_these_worlds_on_their_flights() {
    for (recording, world) in [("long", "long-cross-3"), ("room", "room-2-as-published")] {
        let [silhouettes, colours] = compare(recording, world);
        assert!(silhouettes < 0.001, "{recording}: {silhouettes} of the pixels show something else");
        assert!(colours == 0.0, "{recording}: {colours} of the areas have other colours");
    }
}
