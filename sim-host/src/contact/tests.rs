//! What an arena says, against closed forms.

use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;

use super::clearance_map::FAR;
use super::{Arena, ContactReport, DistanceField, Motion, ScanMaps, Touch};
use crate::sensor::{BEAM_LIMIT, Scan, ScanRing};
use crate::world::{Cuboid, Floor, Mesh, Movable, Pose, Role, Shape, Solid, Triangle, World};

const OBSTACLE: Touch = Touch { obstacle: true, landing: false };
const LANDING: Touch = Touch { obstacle: false, landing: true };

fn at(x: f64, y: f64, z: f64) -> Pose {
    Pose::at(Vector3::new(x, y, z))
}

fn turned(pose: Pose, axis: Vector3<f64>, angle_rad: f64) -> Pose {
    Pose { world_from_body: Attitude::from_axis_angle(axis, angle_rad), ..pose }
}

/// A box to fly into whose near face is at x = 1, a lying cylinder, a tetrahedron, and a pad.
fn world() -> World {
    let wall = Solid::block("wall", Vector3::new(1.0, -2.0, 0.0), Vector3::new(1.2, 2.0, 4.0));
    let rod = Solid {
        shape: Shape::Cylinder { radius: 0.1, half_height: 1.0 },
        pose: turned(at(-2.0, 0.0, 1.0), Vector3::x(), core::f64::consts::FRAC_PI_2),
        ..wall.clone()
    };
    let corners = [Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::z()];
    let tent = Solid { shape: Shape::Hull(corners.to_vec()), pose: at(-4.0, 3.0, 0.0), ..wall.clone() };
    let pad = Solid {
        role: Role::Landing,
        ..Solid::block("pad", Vector3::new(3.0, 3.0, 0.0), Vector3::new(3.25, 3.25, 0.125))
    };
    let painted = Solid {
        role: Role::Decoration,
        ..Solid::block("arrow", Vector3::new(-1.0, -1.0, 0.0), Vector3::new(0.0, 1.0, 3.0))
    };
    World { floor: Floor::Solid, solids: vec![wall, rod, tent, pad, painted], movables: Vec::new() }
}

fn arena(report: ContactReport) -> Arena {
    Arena::new(&world(), &CF2X, report)
}

/// Distance of a point to the solids and the floor of [`world`].
fn distance(point: Vector3<f64>) -> f64 {
    let to_box = |low: Vector3<f64>, high: Vector3<f64>| (point - point.sup(&low).inf(&high)).norm();
    let wall = to_box(Vector3::new(1.0, -2.0, 0.0), Vector3::new(1.2, 2.0, 4.0));
    let pad = to_box(Vector3::new(3.0, 3.0, 0.0), Vector3::new(3.25, 3.25, 0.125));
    let across = ((point.x + 2.0).hypot(point.z - 1.0) - 0.1).max(0.0);
    let rod = across.hypot((point.y.abs() - 1.0).max(0.0));
    wall.min(pad).min(rod).min(point.z)
}

/// Points in and around the world, none near the tetrahedron.
fn points() -> impl Iterator<Item = Vector3<f64>> {
    (0..4000_u32).map(|number| {
        let spread = |prime: f64| (f64::from(number) * prime.sqrt()).fract();
        Vector3::new(9.0 * spread(2.0) - 3.0, 12.0 * spread(3.0) - 5.0, 6.0 * spread(5.0))
    })
}

#[test]
fn clearance_is_below_the_distance_but_not_far() {
    let arena = arena(ContactReport::Touch);
    let mut tight = 0;
    for point in points().filter(|point| point.x > -2.5) {
        let clearance = f64::from(arena.clearance(point.x as f32, point.y as f32, point.z as f32));
        let distance = distance(point);
        assert!(clearance <= distance + 1e-6, "{clearance} at {point}, expected at most {distance}");
        tight += usize::from(clearance >= distance - 0.2 || clearance > FAR);
    }
    assert!(tight > 2500, "{tight} of the bounds are of use");
}

#[test]
fn a_mesh_is_met_as_its_hull() {
    let hull = world();
    let mut mesh = world();
    let Shape::Hull(points) = &hull.solids[2].shape else { panic!("the tent is a hull") };
    let (corners, hull_points) = (points.clone(), points.clone());
    let triangles = vec![Triangle { corners: [0, 1, 2], colour: None }];
    mesh.solids[2].shape = Shape::Mesh(Mesh { corners, triangles, hull: hull_points });
    let [hull, mesh] = [hull, mesh].map(|world| Arena::new(&world, &CF2X, ContactReport::Touch));
    for point in points_near_the_tent() {
        assert_eq!(hull.touch(&Pose::at(point), &[]), mesh.touch(&Pose::at(point), &[]));
        let ray = |arena: &Arena| arena.raycast(point, Vector3::new(-0.6, 0.0, -0.8), 10.0);
        assert_eq!(ray(&hull), ray(&mesh));
        let clearance = |arena: &Arena| arena.clearance(point.x as f32, point.y as f32, point.z as f32);
        assert_eq!(clearance(&hull), clearance(&mesh));
    }
}

fn points_near_the_tent() -> impl Iterator<Item = Vector3<f64>> {
    (0..64).map(|n| {
        Vector3::new(-4.2, 2.8, 0.0) + 0.4 * Vector3::new((n % 4).into(), (n / 4 % 4).into(), (n / 16).into())
    })
}

#[test]
fn clearance_of_nowhere_does_not_panic() {
    let arena = arena(ContactReport::Touch);
    assert!(arena.clearance(1e9, 0.0, 5.0) > 4.9 && arena.clearance(-1e9, 1e9, 1e9) > 1e8);
    arena.clearance(f32::NAN, f32::NAN, f32::NAN);
    arena.clearance(f32::INFINITY, f32::NEG_INFINITY, f32::NAN);
    let empty = Arena::new(&World::empty(), &CF2X, ContactReport::Touch);
    assert_eq!(empty.clearance(3.0, 4.0, 5.0), 5.0);
    let void = Arena::new(&World { floor: Floor::Absent, ..World::empty() }, &CF2X, ContactReport::Touch);
    assert_eq!(void.clearance(3.0, 4.0, -5.0), f32::INFINITY);
}

#[test]
fn contact_is_reported_from_the_gap_on() {
    let bullet = arena(ContactReport::Bullet);
    let clean = arena(ContactReport::Touch);
    // A corner of the level prism faces the wall at x = 1.
    let half = CF2X.collision_radius;
    let cases = [
        (at(1.0 - half - 2.7e-3, 0.0, 1.0), OBSTACLE, Touch::default()),
        (at(1.0 - half - 2.9e-3, 0.0, 1.0), Touch::default(), Touch::default()),
        (at(1.0 - half - 1.4e-3, 0.0, 1.0), OBSTACLE, OBSTACLE),
        (at(0.3, 0.0, 0.0125 + 1.9e-3), OBSTACLE, Touch::default()),
        (at(0.3, 0.0, 0.0125 + 2.1e-3), Touch::default(), Touch::default()),
        (at(0.3, 0.0, 0.0125 + 1.0e-3), OBSTACLE, OBSTACLE),
        (at(3.1, 3.1, 0.1375 + 1.0e-3), LANDING, LANDING),
        (at(-0.5, 0.0, 1.0), Touch::default(), Touch::default()),
        (at(-2.0, 0.0, 1.1 + 0.0125 + 2.0e-3), OBSTACLE, Touch::default()),
        (
            turned(at(0.3, 0.0, 0.06 + 1.9e-3), Vector3::x(), 0.5 * core::f64::consts::PI),
            OBSTACLE,
            Touch::default(),
        ),
        (at(1.1, 0.0, 1.0), OBSTACLE, OBSTACLE),
    ];
    for (pose, reported, touching) in cases {
        assert_eq!(bullet.touch(&pose, &[]), reported, "{pose:?}");
        assert_eq!(clean.touch(&pose, &[]), touching, "{pose:?}");
    }
}

#[test]
fn a_surface_of_triangles_is_met_by_the_box_around_the_hull_first() {
    // Where PyBullet reports contact with a wall of triangles at x = 1, by bisection: dead ahead at a gap of 2.03 mm, at
    // 2.78 mm of a hull whose box reaches farther than its corners.
    let mut wall = Solid::block("wall", Vector3::new(1.0, -2.0, 0.0), Vector3::new(1.1, 2.0, 2.0));
    wall.contact_gap = 1.98e-3;
    let arena = Arena::new(&World { solids: vec![wall], ..World::empty() }, &CF2X, ContactReport::Bullet);
    let touches = |heading: f64, gap: f64| {
        let ahead = |corner: u32| (heading - std::f64::consts::TAU * f64::from(corner) / 32.0).cos();
        let reach = 0.06 * (0..32).map(ahead).fold(0.0, f64::max);
        arena.touch(&turned(at(1.0 - gap - reach, 0.0, 1.0), Vector3::z(), heading), &[]).obstacle
    };
    assert!(touches(0.0, 1.9e-3) && !touches(0.0, 2.1e-3));
    assert!(touches(0.1, 2.7e-3) && !touches(0.1, 2.9e-3));
}

#[test]
fn movables_are_touched_where_they_are_now() {
    let block = Solid::block("block", Vector3::repeat(-0.025), Vector3::repeat(0.025));
    let movables = vec![Movable::pushed(block, 0.1)];
    let arena = Arena::new(&World { movables, ..World::empty() }, &CF2X, ContactReport::Bullet);
    let drone = at(0.0, 0.0, 1.0);
    assert_eq!(arena.touch(&drone, &[Motion::at_rest(at(0.0, 0.0, 0.0))]), Touch::default());
    assert_eq!(arena.touch(&drone, &[Motion::at_rest(at(0.086, 0.0, 1.0))]), OBSTACLE);
}

#[test]
fn two_drones_touch_from_the_references_gap_on() {
    let bullet = arena(ContactReport::Bullet);
    let clean = arena(ContactReport::Touch);
    let one = at(0.0, 0.0, 1.0);
    assert!(bullet.drones_touch(&one, &at(0.0, 0.12 + 3.7e-3, 1.0)));
    assert!(!bullet.drones_touch(&one, &at(0.0, 0.12 + 3.9e-3, 1.0)));
    assert!(clean.drones_touch(&one, &at(0.0, 0.0, 1.025 + 2.4e-3)));
    assert!(!clean.drones_touch(&one, &at(0.0, 0.0, 1.025 + 2.6e-3)));
    assert!(!clean.drones_touch(&one, &at(2.0, 0.0, 1.0)));
}

#[test]
fn a_ray_ends_at_the_first_thing_it_meets() {
    let arena = arena(ContactReport::Touch);
    let origin = Vector3::new(0.0, 0.0, 1.0);
    let near = |found: Option<f64>, expected: f64| found.is_some_and(|found| (found - expected).abs() < 1e-5);
    assert!(near(arena.raycast(origin, Vector3::x(), 4.0), 1.0));
    assert!(near(arena.raycast(origin, -Vector3::x(), 4.0), 1.9));
    assert!(near(arena.raycast(origin, -Vector3::z(), 4.0), 1.0));
    assert!(near(arena.raycast(origin, Vector3::new(0.6, 0.0, -0.8), 4.0), 1.25));
    assert_eq!(arena.raycast(origin, Vector3::z(), 4.0), None);
    assert_eq!(arena.raycast(origin, Vector3::x(), 0.9), None);
}

/// Sixteen beams of every kind that see four metres far.
fn scan() -> Scan {
    let rings = [(0.0, 12), (0.5 * core::f64::consts::PI, 1), (-0.5 * core::f64::consts::PI, 1), (-0.3, 2)];
    let rings = rings.map(|(elevation, beams)| ScanRing { elevation, beams });
    Scan { rings: rings.to_vec(), limit: 4.0, near_scale: None, sweeps: false }
}

/// As many beams as there can be, in rings that end where sixteen do not.
fn wide_scan() -> Scan {
    let rings = [(0.0, 24), (0.45, 14), (-0.45, 14), (1.0, 5), (-1.0, 7)];
    let rings = rings.map(|(elevation, beams)| ScanRing { elevation, beams });
    Scan { rings: rings.to_vec(), limit: 4.0, near_scale: None, sweeps: false }
}

#[test]
fn a_scan_sees_what_single_rays_see() {
    assert_eq!(wide_scan().len(), BEAM_LIMIT);
    for scan in [scan(), wide_scan(), Scan { sweeps: true, ..wide_scan() }] {
        assert_rays_agree(&scan);
    }
}

fn assert_rays_agree(scan: &Scan) {
    // A single ray knows nothing of what can be seen but not touched.
    let mut world = world();
    world.solids.retain(|solid| solid.role != Role::Decoration);
    let plain = Arena::new(&world, &CF2X, ContactReport::Touch);
    let arena = plain.clone().with_scan(&world, scan);
    let mut met = 0;
    for (reading, origin) in points().filter(|point| point.z > 0.05).enumerate() {
        let nearness = arena.nearness(origin.map(|value| value as f32).into(), reading);
        for (nearness, direction) in nearness.into_iter().zip(scan.directions(reading % scan.positions())) {
            let found = f64::from(1.0 - nearness) * 4.0;
            let expected = plain.raycast(origin, direction, 4.0).unwrap_or(4.0);
            // A prism of 24 sides stands for the rod, so that a beam along its surface may meet it or not.
            let grazes = (origin + direction * found.min(expected) - Vector3::new(-2.0, 0.0, 1.0)).norm() < 1.2;
            assert!((found - expected).abs() < 1e-3 || grazes, "{found} m, expected {expected} m from {origin}");
            met += usize::from(found < 3.99);
        }
    }
    assert!(met > 5000, "{met} beams meet something");
}

#[test]
fn beams_that_sweep_look_everywhere_between_two_of_them() {
    let scan = Scan { rings: vec![ScanRing { elevation: 0.0, beams: 6 }], sweeps: true, ..scan() };
    let mut headings: Vec<f64> = (0..8)
        .flat_map(|position| scan.directions(position))
        .map(|beam| beam.y.atan2(beam.x).to_degrees())
        .collect();
    headings.sort_by(f64::total_cmp);
    assert!(headings.windows(2).all(|pair| (pair[1] - pair[0] - 7.5).abs() < 1e-9), "{headings:?}");
    let mut rises: Vec<f64> = (0..8).map(|position| scan.directions(position)[0].z.asin().to_degrees()).collect();
    rises.sort_by(f64::total_cmp);
    assert!(rises.windows(2).all(|pair| (pair[1] - pair[0] - 2.5).abs() < 1e-9), "{rises:?}");
    assert!((rises[0] + 8.75).abs() < 1e-9 && (rises[7] - 8.75).abs() < 1e-9, "{rises:?}");
    let still = Scan { sweeps: false, ..scan };
    assert_eq!((still.positions(), still.directions(0)), (1, still.directions(3)));
}

#[test]
fn a_scan_goes_from_one_at_the_drone_to_zero_at_its_limit() {
    let arena = arena(ContactReport::Touch).with_scan(&world(), &scan());
    let nearness = arena.nearness([0.5, 0.0, 1.0], 0);
    assert!((nearness[0] - 0.875).abs() < 1e-6, "the wall is half a metre away: {}", nearness[0]);
    assert!((nearness[6] - 0.875).abs() < 1e-6, "what cannot be touched is seen: {}", nearness[6]);
    assert_eq!(nearness[12], 0.0, "above is nothing");
    assert!((nearness[13] - 0.75).abs() < 1e-6, "the floor is a metre below: {}", nearness[13]);
    assert_eq!(arena.nearness([1.1, 0.0, 1.0], 0)[..12], [1.0; 12], "inside the wall");
    assert_eq!(arena.nearness([500.0, 0.0, 100.0], 0), [0.0; BEAM_LIMIT]);
    assert!(arena.nearness([f32::NAN; 3], 0).iter().all(|value| (0.0..=1.0).contains(value)));
}

#[test]
fn a_map_for_firmware_is_read_to_the_same_bits() {
    let empty = World::empty();
    for scan in [scan(), wide_scan(), Scan { near_scale: Some(0.5), limit: 2.0, ..scan() }] {
        let maps = ScanMaps::new([&empty, &world()], &scan);
        assert_eq!(maps.len(), 2);
        for (index, world) in [empty.clone(), world()].iter().enumerate() {
            let arena = arena(ContactReport::Touch).with_scan(world, &scan);
            for point in points().map(|point| point.map(|value| value as f32).into()) {
                let mut seen = [9.0; BEAM_LIMIT];
                maps.map(index).nearness(&point, &mut seen[..scan.len()]);
                let expected = &arena.nearness(point, 0)[..scan.len()];
                assert!(
                    seen.iter()
                        .map(|value| value.to_bits())
                        .take(scan.len())
                        .eq(expected.iter().map(|value| value.to_bits())),
                    "{point:?}"
                );
            }
        }
    }
}

#[test]
fn a_scan_with_a_scale_reads_finer_what_is_near() {
    let fine = Scan { near_scale: Some(0.5), ..scan() };
    let nearness = arena(ContactReport::Touch).with_scan(&world(), &fine).nearness([0.5, 0.0, 1.0], 0);
    assert!((nearness[0] - 0.875 * 0.5).abs() < 1e-6, "the wall is half a metre away: {}", nearness[0]);
    assert_eq!(nearness[12], 0.0, "above is nothing");
    assert!((nearness[13] - 0.75 / 3.0).abs() < 1e-6, "the floor is a metre below: {}", nearness[13]);
}

/// A wall of 4 m by 3 m between x = 1 and 1.1 with a passage at y above 1, and the goal behind it.
fn ways() -> DistanceField {
    let wall = Solid::block("wall", Vector3::new(1.0, -2.0, 0.0), Vector3::new(1.1, 1.0, 2.0));
    let bounds = Cuboid { low: Vector3::new(-2.0, -2.0, 0.0), high: Vector3::new(3.0, 2.0, 2.0) };
    let world = World { solids: vec![wall], ..World::empty() };
    DistanceField::new(&world, &Vector3::new(2.0, 0.0, 1.0), bounds, CF2X.collision_radius)
}

#[test]
fn a_way_in_the_open_is_as_long_as_it_is() {
    let ways = ways();
    assert_eq!(ways.length([2.0, 0.0, 1.0]), 0.0);
    assert!((ways.length([2.0, 1.0, 1.0]) - 1.0).abs() < 1e-4);
    assert!((ways.length([2.0, 0.0, 1.25]) - 0.25).abs() < 1e-4);
    // The lattice knows 26 directions, of which none is more than 8 % longer than the crow's.
    let oblique = ways.length([1.6, 0.7, 0.8]);
    assert!((0.83..0.83 * 1.15).contains(&oblique), "{oblique}");
}

#[test]
fn a_way_leads_around_a_wall_and_not_through_it() {
    let ways = ways();
    // Through the passage it is 2 · √(1 + 1.3²) at least, straight through the wall 2 m.
    let length = ways.length([0.0, 0.0, 1.0]);
    assert!((3.2..4.6).contains(&length), "{length}");
    let way = ways.path_from([0.0, 0.0, 1.0]);
    assert!((way.last().unwrap() - Vector3::new(2.0, 0.0, 1.0)).norm() < 1e-5);
    assert!(way.iter().all(|point| !(0.94..1.16).contains(&point.x) || point.y > 1.06), "{way:?}");
    let lengths: Vec<f32> = way.iter().map(|point| ways.length((*point).into())).collect();
    assert!(lengths.windows(2).all(|pair| pair[1] < pair[0] + 1e-5), "{lengths:?}");
}

#[test]
fn what_is_ahead_lies_on_the_way() {
    let ways = ways();
    let start = [0.0, 0.0, 1.0];
    let way = ways.path_from(start);
    let ahead = ways.ahead(start, 0.3);
    assert!(way.contains(&ahead), "{ahead}");
    let place = way.iter().position(|point| *point == ahead).unwrap();
    let flown: f32 = way[..=place].windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum();
    // Up to a step of the lattice farther.
    assert!((0.3..0.3 + 0.09).contains(&flown), "{flown}");
    assert_eq!(ways.ahead([1.9, 0.0, 1.0], 0.3), Vector3::new(2.0, 0.0, 1.0));
    assert!(ways.ahead([f32::NAN; 3], 0.3).iter().all(|metres| metres.is_finite()));
}

#[test]
fn a_way_is_free_only_where_there_is_a_passage() {
    let bounds = Cuboid { low: Vector3::new(-2.0, -2.0, 0.0), high: Vector3::new(3.0, 2.0, 2.0) };
    let ways = |gap: f64, radius: f64| {
        let wall = Solid::block("wall", Vector3::new(1.0, -2.0, 0.0), Vector3::new(1.1, 2.0 - gap, 2.0));
        let world = World { solids: vec![wall], ..World::empty() };
        DistanceField::new(&world, &Vector3::new(2.0, 0.0, 1.0), bounds, radius)
    };
    let start = [0.0, 0.0, 1.0];
    assert_eq!(ways(1.0, 0.2).free_path_from(start), Some(ways(1.0, 0.2).path_from(start)));
    for blocked in [ways(0.0, 0.2), ways(0.35, 0.2), ways(1.0, 0.6)] {
        assert_eq!(blocked.free_path_from(start), None);
    }
    assert!(ways(0.5, 0.2).free_path_from([1.05, 0.0, 1.0]).is_none(), "inside the wall");
}

#[test]
fn a_way_from_beyond_the_bounds_or_nowhere_is_finite() {
    let ways = ways();
    assert!(ways.length([1.05, 0.0, 1.0]) > ways.length([0.9, 0.0, 1.0]), "inside the wall it is longer");
    for point in [[50.0, -50.0, -50.0], [f32::NAN; 3], [f32::INFINITY, f32::NEG_INFINITY, 0.0]] {
        assert!(ways.length(point).is_finite());
    }
}

#[test]
fn equal_places_share_an_arena_while_somebody_has_it() {
    let shared = |scan: Option<&Scan>| Arena::shared(&world(), &CF2X, ContactReport::Touch, scan);
    let (one, other) = (shared(None), shared(None));
    assert!(std::sync::Arc::ptr_eq(&one, &other));
    assert!(!std::sync::Arc::ptr_eq(&one, &shared(Some(&scan()))));
}

#[test]
fn the_nearest_plane_touches_what_is_nearest_and_obstacles_alone() {
    let arena = arena(ContactReport::Touch);
    let mut planes = 0;
    // The pad is to land on.
    for point in points().filter(|point| point.x < 2.0 || point.y < 2.0) {
        let Some((normal, height)) = arena.nearest_plane(point.map(|value| value as f32).into(), 0.6) else {
            assert!(distance(point) > 0.599, "{point:?}");
            continue;
        };
        assert!(height < 0.6 && (normal.norm() - 1.0).abs() < 1e-4);
        assert!((distance(point) - f64::from(height)).abs() < 1e-3 || height < 0.0, "{point:?}: {height}");
        let foot = point - normal.cast() * f64::from(height);
        assert!(distance(foot) < 1e-3, "{point:?}: {foot:?} is in no surface");
        planes += 1;
    }
    assert!(planes > 500, "{planes}");
    let (normal, distance) = arena.nearest_plane([1.05, 0.0, 2.0], 0.6).unwrap();
    assert!((normal + Vector3::x()).norm() < 1e-5 && (distance + 0.05).abs() < 1e-5, "inside it is negative");
}
