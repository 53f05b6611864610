//! What an arena says, against closed forms.

use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;

use super::distance_map::FAR;
use super::{Arena, ContactReport, Motion, Touch};
use crate::world::{Floor, Movable, Pose, Role, Shape, Solid, World};

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
fn movables_are_touched_where_they_are_now() {
    let block = Solid::block("block", Vector3::repeat(-0.025), Vector3::repeat(0.025));
    let movables = vec![Movable { solid: block, mass: 0.1 }];
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
