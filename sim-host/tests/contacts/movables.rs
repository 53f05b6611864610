//! Boxes that a drone can push, in both physics.

use kestrel_core::airframe::{CF2X, HUMMINGBIRD};
use kestrel_core::reference::bullet::BulletMode;
use kestrel_sim::contact::{ContactReport, Touch};
use kestrel_sim::world::{Movable, Solid, World};
use nalgebra::Vector3;

use crate::flight::{Flight, level};

/// A box with its middle at a place.
fn movable(name: &str, middle: [f64; 3], size: [f64; 3], mass: f64) -> Movable {
    let (middle, half) = (Vector3::from(middle), Vector3::from(size) / 2.0);
    Movable::pushed(Solid { friction: 1.0, ..Solid::block(name, middle - half, middle + half) }, mass)
}

/// The gate of the reference's fly-through-gate aviary: an architrave on two columns of ten cubes.
fn gate() -> World {
    let cubes = [-0.3, 0.3].into_iter().flat_map(|x| {
        (0..10).map(move |level| movable("cube", [x, -1.0, 0.025 + 0.05 * f64::from(level)], [0.05; 3], 0.1))
    });
    let architrave = movable("architrave", [0.0, -1.0, 0.525], [0.8, 0.05, 0.05], 0.3);
    World { movables: cubes.chain([architrave]).collect(), ..World::empty() }
}

#[test]
fn the_gate_stands_by_itself_and_falls_when_hit() {
    for report in [ContactReport::Touch, ContactReport::Bullet] {
        let far = level([0.0, 3.0, 1.0], [0.0; 3]);
        let mut flight = Flight::new(&gate(), &HUMMINGBIRD, BulletMode::Pyb, report, vec![far]);
        let hover = [HUMMINGBIRD.hover_rotor_speed(); 4];
        for _ in 0..720 {
            flight.step(&hover);
        }
        let top = flight.movables[20].pose.position;
        let sway = (top - Vector3::new(0.0, -1.0, 0.525)).norm();
        println!("{report:?}: after 3 s the architrave is {:.1} mm from where it was", 1e3 * sway);
        // In the reference the gate sways by 25 mm.
        let limit = match report {
            ContactReport::Touch => 1e-3,
            ContactReport::Bullet => 0.05,
        };
        assert!(sway < limit, "{report:?}: {top}");
        flight.drones = vec![level([0.3, -0.4, 0.45], [0.0, -3.0, 0.0])];
        let mut touched = Touch::default();
        for _ in 0..480 {
            flight.step(&hover);
            touched |= flight.arena.touch(&flight.pose(), &flight.movables);
        }
        let fallen = flight.movables.iter().map(|motion| motion.pose.position.z).fold(f64::INFINITY, f64::min);
        println!("{report:?}: hit, the architrave is at {:.1} mm", 1e3 * flight.movables[20].pose.position.z);
        assert!(touched.obstacle && flight.movables[20].pose.position.z < 0.5, "{report:?}");
        assert!(fallen > 0.02, "{report:?}: something sank into the floor, to {fallen}");
    }
}

#[test]
fn a_box_in_mid_air_falls_and_falls_asleep() {
    for report in [ContactReport::Touch, ContactReport::Bullet] {
        let world = World { movables: vec![movable("box", [0.0, 0.0, 0.2], [0.1; 3], 0.2)], ..World::empty() };
        let far = level([0.0, 3.0, 1.0], [0.0; 3]);
        let mut flight = Flight::new(&world, &CF2X, BulletMode::Pyb, report, vec![far]);
        for _ in 0..480 {
            flight.step(&[CF2X.hover_rotor_speed(); 4]);
        }
        let motion = flight.movables[0];
        println!("{report:?}: the box rests at {:.2} mm", 1e3 * motion.pose.position.z);
        assert_eq!(motion.velocity, Vector3::zeros(), "{report:?}");
        assert!((motion.pose.position.z - 0.05).abs() < 1e-3, "{report:?}: {}", motion.pose.position.z);
    }
}

#[test]
fn a_drone_pushes_a_box_and_is_slowed_by_it() {
    for report in [ContactReport::Touch, ContactReport::Bullet] {
        let world = World { movables: vec![movable("box", [0.4, 0.0, 0.05], [0.1; 3], 0.05)], ..World::empty() };
        let start = vec![level([0.0, 0.0, 0.06], [1.5, 0.0, 0.0])];
        let mut flight = Flight::new(&world, &CF2X, BulletMode::Pyb, report, start);
        for _ in 0..240 {
            flight.step(&[CF2X.hover_rotor_speed(); 4]);
        }
        println!("{report:?}: the box was pushed to x = {:.3} m", flight.movables[0].pose.position.x);
        assert!(flight.movables[0].pose.position.x > 0.41 && flight.drone().velocity.x < 1.0, "{report:?}");
    }
}
