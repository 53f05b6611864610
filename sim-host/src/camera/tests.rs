use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;

use super::*;
use crate::contact::{Arena, ContactReport};
use crate::seed::{Purpose, Seed, Stream};
use crate::world::{self, Mesh, Movable, Role, Shape, Solid, Triangle, VisualGeometry, World};
pub(super) use strewn::{ring, strewn, strewn_rings};

mod strewn;

pub(super) fn ahead() -> View {
    View::towards(Vector3::new(-0.5, 0.1, 1.0), Vector3::new(2.0, 0.0, 0.9), Vector3::z())
}

/// Direction of a pixel's ray, one along the optical axis.
fn ray(camera: &Camera, view: &View, column: usize, row: usize) -> Vector3<f64> {
    let share = |place: usize, within: f64, size: usize| 2.0 * (place as f64 + within) / size as f64 - 1.0;
    view.forward
        + view.right * (camera.tangents[0] * share(column, camera.sample[0], camera.columns))
        + view.down * (camera.tangents[1] * share(row, camera.sample[1], camera.rows))
}

#[test]
fn every_pixel_is_where_a_ray_meets_the_world() {
    let camera = Camera { columns: 53, rows: 31, far_m: 50.0, ..Camera::REFERENCE };
    let (mut pixels, mut off) = (0, 0);
    for seed in 0..8 {
        let world = strewn(seed, 12);
        let arena = Arena::new(&world, &CF2X, ContactReport::Touch);
        let image = Scene::new(&world).render(&camera, &ahead());
        for row in 0..camera.rows {
            for column in 0..camera.columns {
                let ray = ray(&camera, &ahead(), column, row);
                let found = arena.raycast(ahead().eye, ray.normalize(), camera.far_m * ray.norm());
                let expected = found.map_or(camera.far_m, |distance| distance / ray.norm()) as f32;
                let depth = image.depths[row * camera.columns + column];
                pixels += 1;
                off += i32::from((depth - expected).abs() > 1e-3 * expected);
                let label = image.labels[row * camera.columns + column];
                assert_eq!(label == NOTHING, depth >= camera.far_m as f32);
            }
        }
    }
    // A ray along an edge may take either side, and one that grazes something round.
    assert!(off < pixels / 1000, "{off} of {pixels} pixels are elsewhere");
}

/// Depth and triangle at which a ray meets the front of a ring nearest (Möller & Trumbore 1997).
fn nearest(solid: &Solid, eye: Vector3<f64>, ray: Vector3<f64>) -> Option<(f64, world::Triangle)> {
    let Shape::Mesh(mesh) = &solid.shape else { return None };
    let placed = |point| solid.pose.position + solid.pose.world_from_body.rotate(point);
    let met = |triangle: &world::Triangle| {
        let [a, b, c] = mesh.places(triangle).map(placed);
        let across = ray.cross(&(c - a));
        let volume = (b - a).dot(&across);
        let along = (eye - a).cross(&(b - a));
        let (u, v) = ((eye - a).dot(&across) / volume, ray.dot(&along) / volume);
        let depth = (c - a).dot(&along) / volume;
        (volume > 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && depth > 0.0).then_some((depth, *triangle))
    };
    mesh.triangles.iter().filter_map(met).min_by(|one, other| one.0.total_cmp(&other.0))
}

#[test]
fn every_pixel_of_a_mesh_is_where_a_ray_meets_a_triangle() {
    let camera = Camera { columns: 37, rows: 23, far_m: 50.0, ..Camera::REFERENCE };
    let within = View::towards(Vector3::new(2.5, 0.0, 1.0), Vector3::new(1.0, 0.4, 0.8), Vector3::z());
    let (mut pixels, mut met, mut off) = (0, 0, 0);
    for (seed, view) in [(0, ahead()), (1, ahead()), (2, within)] {
        let mut world = strewn_rings(seed, 8);
        world.solids.retain(|solid| matches!(solid.shape, Shape::Mesh(_)));
        world.floor = world::Floor::Absent;
        let image = Scene::new(&world).render(&camera, &view);
        for place in 0..camera.rows * camera.columns {
            let ray = ray(&camera, &view, place % camera.columns, place / camera.columns);
            let found = (FIRST_SOLID..).zip(&world.solids).filter_map(|(label, solid)| {
                let (depth, triangle) = nearest(solid, view.eye, ray)?;
                (depth >= camera.near_m).then_some((depth, label, triangle.colour.is_some()))
            });
            let found = found.min_by(|one, other| one.0.total_cmp(&other.0));
            let (depth, label, red) = found.unwrap_or((camera.far_m, NOTHING, false));
            let [high, low, _] = image.colours[place];
            let seen = (image.labels[place], image.labels[place] != NOTHING && high / 2 > low);
            let is_far = (f64::from(image.depths[place]) - depth).abs() > 1e-4 * depth;
            pixels += 1;
            met += i32::from(label != NOTHING);
            off += i32::from(is_far || seen != (label, red));
        }
    }
    assert!(met > pixels / 20, "{met} of {pixels} show a ring");
    assert!(off <= pixels / 2000, "{off} of {pixels} pixels are elsewhere");
}

#[test]
fn nothing_is_seen_between_triangles() {
    // A closed ring around the eye, seen from within its tube's hole: no ray through its wall finds a gap.
    let mut solid = Solid::block("ball", Vector3::repeat(-1.0), Vector3::repeat(1.0));
    solid.shape = ring(0.25, 0.25, 60, 50);
    let world = World { solids: vec![solid], floor: world::Floor::Absent, ..World::empty() };
    let scene = Scene::new(&world);
    let camera = Camera { columns: 256, rows: 256, tangents: [0.2; 2], ..Camera::REFERENCE };
    let view = View::towards(Vector3::new(0.9, 0.1, 0.7), Vector3::new(0.25, 0.0, 0.0), Vector3::z());
    let image = scene.render(&camera, &view);
    assert!(image.labels.iter().all(|label| *label == FIRST_SOLID), "a gap");
}

#[test]
fn labels_name_the_nearest_thing() {
    let near = Solid::block("near", Vector3::new(1.0, -0.2, 0.8), Vector3::new(1.2, 0.2, 1.2));
    let far = Solid::block("far", Vector3::new(3.0, -2.0, 0.0), Vector3::new(3.1, 2.0, 1.6));
    let world = World { solids: vec![far, near], ..World::empty() };
    let image = Scene::new(&world)
        .render(&Camera::REFERENCE, &View::towards(Vector3::z(), Vector3::new(1.0, 0.0, 1.0), Vector3::z()));
    let at = |column: usize, row: usize| (image.labels[row * 64 + column], image.depths[row * 64 + column]);
    assert_eq!(at(32, 24), (FIRST_SOLID + 1, 1.0));
    assert_eq!(at(2, 24).0, FIRST_SOLID);
    assert_eq!(at(32, 47).0, FLOOR);
    assert_eq!(at(32, 0), (NOTHING, 1000.0));
}

#[test]
fn colours_are_those_of_the_reference_under_its_light() {
    // A green pillar's side away from the light is (15, 106, 15) there. A red wall towards -x is (183, 73, 73) in the
    // shadow that the reference finds everywhere (0.6 + 0.8 · 0.35 · 0.432); without it, 0.6 + 0.35 · 0.432.
    let mut wall = Solid::block("wall", Vector3::new(3.0, 0.2, 0.0), Vector3::new(3.1, 2.0, 2.0));
    wall.colour = [1.0, 0.4, 0.4];
    let mut pillar = wall.clone();
    pillar.shape = Shape::Cylinder { radius: 0.3, half_height: 1.0 };
    pillar.pose.position = Vector3::new(-3.0, -1.0, 1.0);
    pillar.colour = [0.1, 0.7, 0.1];
    let scene = Scene::new(&World { solids: vec![wall, pillar], ..World::empty() });
    let eye = Vector3::new(0.5, 0.5, 1.0);
    let colour = |target: Vector3<f64>| {
        let camera = Camera { columns: 1, rows: 1, sample: [0.5; 2], ..Camera::REFERENCE };
        scene.render(&camera, &View::towards(eye, target, Vector3::z())).colours[0]
    };
    assert_eq!(colour(Vector3::new(3.0, 1.0, 1.0)), [191, 76, 76]);
    assert_eq!(colour(Vector3::new(0.5, 0.4, 3.0)), [255, 255, 255], "the sky");
    let [even, odd] = [Vector3::new(1.5, 1.5, 0.0), Vector3::new(1.5, 0.5, 0.0)].map(colour);
    assert_eq!((even, odd), ([239, 239, 239], [162, 186, 224]));
    let [red, green, blue] = colour(Vector3::new(-3.0, -1.0, 1.0));
    assert!(red == blue && (15..=16).contains(&red) && (106..=112).contains(&green), "{red} {green} {blue}");
}

#[test]
fn what_holds_the_eye_or_is_behind_it_or_nearer_than_near_is_not_drawn() {
    let around = Solid::block("around", Vector3::new(-1.0, -1.0, 0.0), Vector3::new(1.0, 1.0, 2.0));
    let behind = Solid::block("behind", Vector3::new(-3.0, -1.0, 0.0), Vector3::new(-2.0, 1.0, 2.0));
    let brushed = Solid::block("brushed", Vector3::new(0.02, -1.0, 0.0), Vector3::new(0.5, 1.0, 2.0));
    let mut within = around.clone();
    within.shape = ring(0.2, 0.1, 30, 20);
    within.pose.position = Vector3::new(-0.2, 0.0, 1.0);
    for solid in [around, behind, brushed, within] {
        let world = World { solids: vec![solid], floor: crate::world::Floor::Absent, ..World::empty() };
        let view = View::towards(Vector3::new(0.0, 0.0, 1.0), Vector3::new(1.0, 0.0, 1.0), Vector3::z());
        let image = Scene::new(&world).render(&Camera::REFERENCE, &view);
        assert!(image.labels.iter().all(|label| *label == NOTHING), "{:?}", world.solids[0].name);
    }
}

#[test]
fn memory_is_used_again_for_images_of_any_size() {
    let scene = Scene::new(&strewn(3, 9));
    let (mut canvas, mut image) = Default::default();
    for (columns, rows) in [(64, 48), (7, 3), (33, 50), (1, 1)] {
        let camera = Camera { columns, rows, ..Camera::REFERENCE };
        scene.render_into(&camera, &ahead(), &mut canvas, &mut image);
        assert_eq!(image, scene.render(&camera, &ahead()));
        assert_eq!(image.colours.len(), columns * rows);
    }
}

#[test]
fn a_tilted_drone_does_not_tilt_the_image_of_the_reference() {
    let roll = Attitude { w: 0.25_f64.cos(), x: 0.25_f64.sin(), y: 0.0, z: 0.0 };
    let pose = Pose { position: Vector3::new(1.0, 2.0, 3.0), world_from_body: roll };
    let view = View::paper(&pose, 0.0397);
    assert!((view.right - Vector3::new(0.0, -1.0, 0.0)).norm() < 1e-4);
    assert!((view.down - Vector3::new(0.0, 0.0, -1.0)).norm() < 1e-4);
    assert_eq!(view.eye, Vector3::new(1.0, 2.0, 3.0397));
}

fn turned(position: Vector3<f64>, axis: Vector3<f64>, angle: f64) -> Pose {
    Pose { position, world_from_body: Attitude::from_axis_angle(axis.normalize(), angle) }
}

#[test]
fn what_was_moved_looks_as_if_it_had_always_been_there() {
    let still = strewn(5, 8);
    let movables: Vec<Movable> =
        strewn(6, 8).solids.into_iter().map(|solid| Movable::pushed(solid, 0.1)).collect();
    let mut world = World { movables, ..still };
    let mut scene = Scene::new(&world);
    assert_eq!(
        scene.render(&Camera::REFERENCE, &ahead()),
        Scene::new(&world).render(&Camera::REFERENCE, &ahead())
    );
    for (index, movable) in world.movables.iter_mut().enumerate() {
        let place = Vector3::new(1.5 + 0.2 * index as f64, 0.1 * index as f64 - 0.4, 1.0);
        movable.solid.pose = turned(place, Vector3::new(1.0, 2.0, index as f64), 0.5 + index as f64);
        scene.place(Mover::Movable(index), &movable.solid.pose);
    }
    let image = scene.render(&Camera::REFERENCE, &ahead());
    assert_eq!(image, Scene::new(&world).render(&Camera::REFERENCE, &ahead()));
    assert!(image.labels.iter().any(|label| *label >= FIRST_SOLID + 8), "movables are in view");
}

/// Boxes 20 cm wide that are touched, whose looks are the shapes of another world, each 4 m aside and turned.
fn disguised(world: &World) -> World {
    let disguise = |seen: &Solid| {
        let mut solid = Solid::block("thing", Vector3::repeat(-0.1), Vector3::repeat(0.1));
        solid.pose = turned(seen.pose.position + 4.0 * Vector3::y(), Vector3::new(1.0, 2.0, 3.0), 0.7);
        solid.visual =
            Some(VisualGeometry { shape: seen.shape.clone(), pose_in_body: seen.pose.relative_to(&solid.pose) });
        solid
    };
    World { solids: world.solids.iter().map(disguise).collect(), ..world.clone() }
}

#[test]
fn a_solid_is_seen_by_its_look_and_touched_without_it() {
    for world in [strewn(5, 8), strewn_rings(6, 4)] {
        let disguised = disguised(&world);
        let (image, expected) =
            [&disguised, &world].map(|world| Scene::new(world).render(&Camera::REFERENCE, &ahead())).into();
        let same = image.labels.iter().zip(&expected.labels).filter(|(one, other)| one == other).count();
        assert!(same >= image.labels.len() - 3, "{same} of {} labels, but for rounding", image.labels.len());
        assert!(image.labels.iter().any(|label| *label >= FIRST_SOLID), "something is in view");

        let plain = |solid: &Solid| Solid { visual: None, ..solid.clone() };
        let bare = World { solids: disguised.solids.iter().map(plain).collect(), ..disguised.clone() };
        assert_eq!(disguised.bounds(), bare.bounds());
        let [arena, bare] = [&disguised, &bare].map(|world| Arena::new(world, &CF2X, ContactReport::Touch));
        for (seen, solid) in world.solids.iter().zip(&disguised.solids) {
            let touched = |arena: &Arena, pose: &Pose| arena.touch(pose, &[]).obstacle;
            assert!(touched(&arena, &solid.pose) && !touched(&arena, &Pose::at(seen.pose.position)));
            let beam =
                |arena: &Arena| arena.raycast(ahead().eye, (solid.pose.position - ahead().eye).normalize(), 50.0);
            assert_eq!(beam(&arena), beam(&bare));
        }
    }
}

#[test]
fn the_look_of_a_movable_moves_with_it() {
    let disguised = disguised(&strewn(6, 8));
    let movables: Vec<Movable> = disguised.solids.into_iter().map(|solid| Movable::pushed(solid, 0.1)).collect();
    let mut world = World { movables, ..World::empty() };
    let mut scene = Scene::new(&world);
    for (index, movable) in world.movables.iter_mut().enumerate() {
        let place = movable.solid.pose.position + Vector3::new(0.1 * index as f64, 0.0, 0.1);
        movable.solid.pose = Pose { position: place, ..movable.solid.pose };
        scene.place(Mover::Movable(index), &movable.solid.pose);
    }
    let image = scene.render(&Camera::REFERENCE, &ahead());
    assert_eq!(image, Scene::new(&world).render(&Camera::REFERENCE, &ahead()));
    let solids = world.movables.iter().map(|movable| {
        let (shape, pose) = movable.solid.seen();
        Solid { shape: shape.clone(), pose, visual: None, ..movable.solid.clone() }
    });
    let still =
        Scene::new(&World { solids: solids.collect(), ..World::empty() }).render(&Camera::REFERENCE, &ahead());
    let same = image.labels.iter().zip(&still.labels).filter(|(one, other)| one == other).count();
    assert!(same >= image.labels.len() - 3, "{same} of {} labels, but for rounding", image.labels.len());
    assert!(image.labels.iter().any(|label| *label >= FIRST_SOLID), "something is in view");
}

#[test]
fn drones_are_behind_the_movables_and_seen_where_they_are_placed() {
    let solid = Solid::block("box", Vector3::new(3.0, -1.0, 0.0), Vector3::new(3.1, 1.0, 2.0));
    let movables = vec![Movable::pushed(solid.clone(), 0.1)];
    let world = World { solids: vec![solid], movables, ..World::empty() };
    let mut scene = Scene::new(&world).with_drones(&CF2X, 1).with_drones(&CF2X, 1);
    assert_eq!(scene.drones(), 2);
    let camera = Camera { columns: 101, rows: 101, tangents: [0.2; 2], sample: [0.5; 2], ..Camera::REFERENCE };
    let view = View::towards(Vector3::z(), Vector3::new(1.0, 0.0, 1.0), Vector3::z());
    let without = scene.render(&camera, &view);
    assert_eq!(without, Scene::new(&world).render(&camera, &view), "nothing is seen before it is placed");
    scene.place(Mover::Drone(1), &turned(Vector3::new(0.5, 0.0, 1.0), Vector3::y(), 0.5));
    let image = scene.render(&camera, &view);
    let drone = FIRST_SOLID + 3;
    let seen: Vec<usize> = (0..image.labels.len()).filter(|pixel| image.labels[*pixel] == drone).collect();
    assert!(seen.contains(&(50 * 101 + 50)), "its body is in the middle");
    assert!(seen.iter().all(|pixel| (0.43..0.57).contains(&image.depths[*pixel])));
    // From tip to tip of the discs it is 2 (0.0281 + 0.0231) m wide, at distances from 0.47 to 0.53 m.
    let columns = seen.iter().map(|pixel| pixel % 101);
    let width = columns.clone().max().unwrap() - columns.min().unwrap() + 1;
    assert!((50..=55).contains(&width), "{width}");
    scene.hide(Mover::Drone(1));
    assert_eq!(scene.render(&camera, &view), without);
    scene.place(Mover::Drone(1), &turned(Vector3::new(0.5, 0.0, 1.0), Vector3::y(), 0.5));
    assert_eq!(scene.render(&camera, &view), image);
}

#[test]
fn a_drone_is_as_large_as_its_airframe() {
    for airframe in [CF2X, kestrel_core::airframe::HUMMINGBIRD] {
        let mut scene = Scene::new(&World::empty()).with_drones(&airframe, 1);
        scene.place(Mover::Drone(0), &Pose::at(Vector3::new(0.0, 0.0, 1.0)));
        let camera = Camera { columns: 201, rows: 201, tangents: [1.0; 2], sample: [0.5; 2], ..Camera::REFERENCE };
        let view = View::towards(Vector3::new(0.0, 0.0, 2.0), Vector3::new(0.0, 0.0, 1.0), Vector3::x());
        let image = scene.render(&camera, &view);
        let rows = (0..201 * 201).filter(|pixel| image.labels[*pixel] == FIRST_SOLID).map(|pixel| pixel / 201);
        let span = (rows.clone().max().unwrap() - rows.min().unwrap() + 1) as f64 * 2.0 / 201.0;
        let front = airframe.rotor_positions().map(|[x, _]| x).into_iter().fold(0.0, f64::max);
        let expected = 2.0 * (front + airframe.propeller_radius) / (1.0 - 0.3 * airframe.arm);
        assert!((span - expected).abs() < 0.03, "{span} m, expected {expected} m");
    }
}
