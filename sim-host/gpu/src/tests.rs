//! The GPU's images beside the processor's, in every world of `assets/worlds`. Needs an adapter: a GPU, or
//! mesa-vulkan-drivers; without one these tests fail.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;
use kestrel_sim::camera::{FIRST_SOLID, FLOOR, Mover, View};
use kestrel_sim::config::AviaryParts;
use kestrel_sim::seed::{Purpose, Seed, Stream};
use kestrel_sim::world::{Mesh, Movable, Pose, Role, Shape, Solid, Triangle, World};
use nalgebra::Vector3;

use super::*;
use strewn::{strewn, strewn_rings};

#[path = "../../src/camera/tests/strewn.rs"]
mod strewn;

/// A GPU, or what there is.
fn gpu() -> &'static Gpu {
    static OPENED: OnceLock<Gpu> = OnceLock::new();
    OPENED.get_or_init(|| {
        let gpu = Gpu::open(Backend::Gpu).or_else(|_| Gpu::open(Backend::Software));
        let gpu = gpu.expect("these tests need a GPU or mesa-vulkan-drivers");
        println!("{gpu}");
        gpu
    })
}

fn worlds() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/worlds");
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<_> = entries.filter(|path| path.extension().is_some_and(|end| end == "yaml")).collect();
    paths.sort();
    paths
}

/// All over a world and beside it; every other looks at its middle, the rest in all directions.
fn shots(world: &World, scene: usize, count: usize) -> Vec<Shot> {
    let (low, high) = world
        .solids
        .iter()
        .map(Solid::extent)
        .reduce(|(a, b), (c, d)| (a.inf(&c), b.sup(&d)))
        .unwrap_or((Vector3::repeat(-1.0), Vector3::repeat(1.0)));
    let (low, high) = (low.add_scalar(-1.0), high.add_scalar(1.0));
    let middle = Vector3::new(0.5 * (low.x + high.x), 0.5 * (low.y + high.y), 0.0);
    let mut stream = Stream::new(Seed(scene as u64), 0, Purpose::Baseline);
    let mut share = || f64::from(stream.between(0.1, 0.9));
    let view = |index| {
        let eye =
            Vector3::new(low.x + share() * (high.x - low.x), low.y + share() * (high.y - low.y), 0.2 + share());
        let (sine, cosine) = (TAU * share()).sin_cos();
        let around = eye + Vector3::new(cosine, sine, share() - 0.7);
        let target = if index % 2 == 0 { middle } else { around };
        Shot { scene, view: View::towards(eye, target, Vector3::z()) }
    };
    (0..count).map(view).collect()
}

fn rendered(gpu: &Gpu, camera: &Camera, scenes: &[&Scene], shots: &[Shot]) -> Vec<Image> {
    let scenes = gpu.upload(scenes).unwrap();
    let mut batch = scenes.batch(camera, shots.len()).unwrap();
    let mut images = Vec::new();
    batch.render(shots).unwrap();
    batch.read(&mut images).unwrap();
    images
}

/// A pixel with those around it.
fn around(image: &Image, place: usize) -> impl Iterator<Item = usize> + use<> {
    let (rows, columns) = (image.labels.len() / image.columns, image.columns);
    let near = |middle: usize, size: usize| middle.saturating_sub(1)..(middle + 2).min(size);
    let across = near(place % columns, columns);
    near(place / columns, rows).flat_map(move |row| across.clone().map(move |column| row * columns + column))
}

/// Whether a neighbour shows something else, or another square of the floor.
fn is_edge(image: &Image, place: usize) -> bool {
    let shown = |place: usize| {
        let label = image.labels[place];
        (label, (label == FLOOR).then(|| image.colours[place]))
    };
    around(image, place).any(|beside| shown(beside) != shown(place))
}

/// What is wrong in an image: labels, and, away from edges, depths and colours; and how many pixels were away from edges.
/// A ray along the ridge between two faces of a body may take either: if it has the colour of a neighbour it counts among
/// the labels, which may differ in few pixels.
fn deviations(image: &Image, expected: &Image) -> [usize; 4] {
    assert_eq!((image.columns, image.labels.len()), (expected.columns, expected.labels.len()));
    let mut wrong = [0; 4];
    for place in 0..expected.labels.len() {
        if image.labels[place] != expected.labels[place] {
            wrong[0] += 1;
            continue;
        }
        if is_edge(expected, place) {
            continue;
        }
        wrong[3] += 1;
        let (depth, should) = (image.depths[place], expected.depths[place]);
        wrong[1] += usize::from((depth - should).abs() > 1e-4 * should);
        let is_like = |other: usize| {
            let parts = image.colours[place].into_iter().zip(expected.colours[other]);
            parts.into_iter().all(|(part, should)| part.abs_diff(should) <= 1)
        };
        if !is_like(place) {
            let kind = if around(expected, place).any(is_like) { 0 } else { 2 };
            wrong[kind] += 1;
        }
    }
    wrong
}

fn agrees(what: &str, camera: &Camera, world: &World, shots: &[Shot]) {
    let scene = Scene::new(world);
    let images = rendered(gpu(), camera, &vec![&scene; shots[0].scene + 1], shots);
    let mut wrong = [0; 4];
    let mut solids = 0;
    for (image, shot) in images.iter().zip(shots) {
        let more = deviations(image, &scene.render(camera, &shot.view));
        solids += image.labels.iter().filter(|label| **label >= FIRST_SOLID).count();
        wrong = core::array::from_fn(|kind| wrong[kind] + more[kind]);
    }
    let pixels = shots.len() * camera.columns * camera.rows;
    let [labels, depths, colours, inside] = wrong;
    println!(
        "{what}: of {pixels} pixels, {solids} of solids, {labels} have other labels or faces; \
        of {inside} away from edges {depths} have other depths, {colours} other colours"
    );
    assert!(world.solids.is_empty() || solids > 0, "{what}: nothing is seen");
    assert!(1000 * labels <= pixels, "{what}: {labels} of {pixels} labels or faces differ");
    assert_eq!([depths, colours], [0, 0], "{what}: depths and colours away from edges");
}

#[test]
fn a_deviation_is_noticed() {
    let expected = Image { columns: 3, depths: vec![2.0; 9], labels: vec![7; 9], colours: vec![[9; 3]; 9] };
    assert_eq!(deviations(&expected, &expected), [0, 0, 0, 9]);
    let mut image = expected.clone();
    (image.labels[0], image.depths[4], image.colours[8]) = (8, 2.001, [9, 11, 9]);
    assert_eq!(deviations(&image, &expected), [1, 1, 1, 8]);
    let mut edged = expected.clone();
    edged.labels[4] = 8;
    assert_eq!(deviations(&image, &edged), [2, 0, 0, 0], "edges are left out");
}

#[test]
fn every_world_looks_as_the_processor_renders_it() {
    let worlds = worlds();
    assert!(worlds.len() > 40, "found {} worlds", worlds.len());
    for (index, path) in worlds.iter().enumerate() {
        let world = AviaryParts::read(path).unwrap().world;
        let shots: Vec<Shot> =
            shots(&world, index, SOFTWARE_VIEWS).into_iter().map(|shot| Shot { scene: 0, ..shot }).collect();
        agrees(&path.file_stem().unwrap().to_string_lossy(), &Camera::REFERENCE, &world, &shots);
    }
}

#[test]
fn solids_of_all_shapes_look_as_the_processor_renders_them() {
    for (seed, (columns, rows)) in (0..).zip([(53, 31), (64, 64), (1, 1), (8, 17)]) {
        let camera = Camera { columns, rows, far_m: 50.0, ..Camera::REFERENCE };
        let world = strewn(seed, 90);
        agrees("strewn", &camera, &world, &shots(&world, 0, 4));
    }
}

#[test]
fn meshes_look_as_the_processor_renders_them() {
    for (seed, (columns, rows)) in (0..).zip([(64, 48), (53, 31), (128, 128), (8, 17)]) {
        let camera = Camera { columns, rows, far_m: 50.0, ..Camera::REFERENCE };
        let world = strewn_rings(seed, 24);
        agrees("rings", &camera, &world, &shots(&world, 0, 4));
    }
}

#[test]
fn each_shot_is_of_its_own_scene_and_room_is_used_again() {
    let worlds: Vec<World> = (0..3).map(|seed| strewn(seed, 5 + 20 * seed as usize)).collect();
    let scenes: Vec<Scene> = worlds.iter().map(Scene::new).collect();
    let scenes: Vec<&Scene> = scenes.iter().collect();
    let camera = Camera { columns: 16, rows: 12, ..Camera::REFERENCE };
    let shots: Vec<Shot> = [2, 0, 1, 1, 2].iter().flat_map(|&scene| shots(&worlds[scene], scene, 1)).collect();
    let uploaded = gpu().upload(&scenes).unwrap();
    let mut batch = uploaded.batch(&camera, shots.len()).unwrap();
    let mut images = Vec::new();
    for count in [5, 2, 0, 4] {
        batch.render(&shots[..count]).unwrap();
        batch.read(&mut images).unwrap();
        assert_eq!(images.len(), count);
        for (image, shot) in images.iter().zip(&shots) {
            assert_eq!(
                *image,
                rendered(gpu(), &camera, &scenes, &[*shot])[0],
                "equal to the bit whatever is beside it"
            );
        }
    }
}

#[test]
fn what_moves_is_uploaded_again_and_nothing_else() {
    let movables = strewn(4, 8).solids.into_iter().map(|solid| Movable::pushed(solid, 0.1));
    let worlds = [0, 1].map(|seed| World { movables: movables.clone().collect(), ..strewn(seed, 20) });
    let mut scenes = worlds.each_ref().map(|world| Scene::new(world).with_drones(&CF2X, 3));
    let camera = Camera { columns: 48, rows: 32, far_m: 50.0, ..Camera::REFERENCE };
    let shots: Vec<Shot> = (0..2).flat_map(|scene| shots(&worlds[scene], scene, 3)).collect();
    let uploaded = gpu().upload(&scenes.each_ref()).unwrap();
    let mut batch = uploaded.batch(&camera, shots.len()).unwrap();
    let mut images = Vec::new();
    for round in 0..3 {
        for (index, scene) in scenes.iter_mut().enumerate().filter(|(index, _)| (index + round) % 2 == 0) {
            let eye = shots[3 * index].view.eye;
            for mover in (0..3).map(Mover::Drone).chain((0..8).map(Mover::Movable)) {
                let ahead = shots[3 * index].view.forward * (0.4 + 0.1 * round as f64);
                let place = Pose::at(eye + ahead + Vector3::repeat(0.02 * round as f64));
                scene.place(mover, &place);
            }
            scene.hide(Mover::Drone(round));
            scene.hide(Mover::Movable(round));
            uploaded.update(index, scene);
        }
        batch.render(&shots).unwrap();
        batch.read(&mut images).unwrap();
        assert_eq!(images, rendered(gpu(), &camera, &scenes.each_ref(), &shots), "equal to the bit");
        let wrong = images.iter().zip(&shots).fold([0; 4], |wrong, (image, shot)| {
            let more = deviations(image, &scenes[shot.scene].render(&camera, &shot.view));
            core::array::from_fn(|kind| wrong[kind] + more[kind])
        });
        assert!(wrong[0] <= 6 * 48 * 32 / 500 && wrong[1..3] == [0, 0], "{wrong:?}");
    }
}

#[test]
fn a_batch_too_large_for_a_buffer_is_divided() {
    let world = strewn(7, 30);
    let scene = Scene::new(&world);
    let camera = Camera { columns: 16, rows: 12, ..Camera::REFERENCE };
    let shots = shots(&world, 0, 10);
    let whole = rendered(gpu(), &camera, &[&scene], &shots);
    let view_bytes = 12 * 16 * 12;
    for room in [Room { views: 3, ..gpu().room }, Room { bytes: 20_000, ..gpu().room }] {
        let gpu = Gpu { room, ..gpu().clone() };
        let scenes = gpu.upload(&[&scene]).unwrap();
        let mut batch = scenes.batch(&camera, shots.len()).unwrap();
        assert!(batch.buffers().len() > 1);
        let places: Vec<usize> = batch.buffers().iter().flat_map(|part| part.views.clone()).collect();
        assert!(places.into_iter().eq(0..10));
        assert!(batch.buffers().iter().all(|part| part.pixels.size() == (view_bytes * part.views.len()) as u64));
        let mut images = Vec::new();
        for count in [10, 4] {
            batch.render(&shots[..count]).unwrap();
            batch.read(&mut images).unwrap();
            assert_eq!(images, whole[..count]);
        }
    }
}

#[test]
fn what_cannot_fit_is_refused_with_its_size() {
    let scene = Scene::new(&strewn(1, 9));
    let gpu = Gpu { room: Room { bytes: 100_000, ..gpu().room }, ..gpu().clone() };
    let scenes = gpu.upload(&[&scene]).unwrap();
    let large = Camera { columns: 100, rows: 100, ..Camera::REFERENCE };
    let error = scenes.batch(&large, 1).unwrap_err().to_string();
    let start = "the pixels of one view take 120000 bytes, expected at most 100000, what a buffer of ";
    assert!(error.starts_with(start), "{error}");
    let huge = Camera { columns: 60_000, rows: 60_000, ..Camera::REFERENCE };
    let error = gpu.render(&huge, &[&scene], &shots(&strewn(1, 9), 0, 1)).unwrap_err();
    assert!(error.to_string().contains("43200000000 bytes"), "{error}");
    let wide = Camera { columns: gpu.room.pixels + 1, rows: 1, ..Camera::REFERENCE };
    let roomy = Gpu { room: Room { bytes: u64::MAX, ..gpu.room }, ..gpu.clone() };
    let error = roomy.upload(&[&scene]).unwrap().batch(&wide, 1).unwrap_err().to_string();
    assert!(error.contains("pixels across or down, expected at most "), "{error}");
    let small = Gpu { room: Room { bytes: 100, ..gpu.room }, ..gpu };
    assert!(small.upload(&[&scene]).unwrap_err().to_string().contains("take "), "scenes must fit, too");
}

#[test]
fn software_is_no_gpu_unless_asked_for() {
    let auto = open(Backend::Auto).unwrap().to_string();
    let expected = ["rendered by the processor: found no GPU (", "rendered by the GPU "];
    assert!(expected.iter().any(|start| auto.starts_with(start)), "{auto}");
    if let Ok(gpu) = Gpu::open(Backend::Software) {
        assert!(gpu.is_software());
        assert!(gpu.to_string().starts_with("rendered by the software adapter "), "{gpu}");
    }
    let error = Gpu::open(Backend::Cpu).unwrap_err().to_string();
    assert!(error.starts_with("found no adapter for the backend `cpu` ("), "{error}");
}
