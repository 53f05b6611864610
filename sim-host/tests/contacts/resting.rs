//! Drones on the floor, along walls and against each other, in both physics.

use core::f64::consts::FRAC_PI_2;

use kestrel_core::airframe::{CF2X, HUMMINGBIRD};
use kestrel_core::attitude::Attitude;
use kestrel_core::reference::bullet::BulletMode;
use kestrel_sim::contact::{ContactReport, Touch};
use kestrel_sim::world::{Pose, Solid, World};
use nalgebra::Vector3;

use crate::flight::{Flight, level};

const BOTH: [ContactReport; 2] = [ContactReport::Touch, ContactReport::Bullet];

/// Height on which the reference's Crazyflie rests \[m\].
const REST_HEIGHT: f64 = 0.013_49;

fn wall() -> World {
    let wall = Solid::block("wall", Vector3::new(1.0, -5.0, 0.0), Vector3::new(1.2, 5.0, 4.0));
    World { solids: vec![wall], ..World::empty() }
}

#[test]
fn a_dropped_drone_comes_to_rest_on_its_skin() {
    for report in BOTH {
        let start = vec![level([0.0, 0.0, 0.3], [0.0; 3])];
        let mut flight = Flight::new(&World::empty(), &CF2X, BulletMode::Pyb, report, start);
        for _ in 0..480 {
            flight.step(&[0.0; 4]);
        }
        let drone = flight.drone();
        println!("{report:?}: rests at {:.3} mm", 1e3 * drone.position.z);
        assert!((drone.position.z - REST_HEIGHT).abs() < 1e-3 && drone.velocity.norm() < 1e-3);
        assert_eq!(flight.arena.touch(&flight.pose(), &[]), Touch { obstacle: true, landing: false });
    }
}

#[test]
fn a_resting_drone_neither_creeps_nor_heats_up() {
    for report in BOTH {
        let start = vec![level([0.2, -0.1, REST_HEIGHT], [0.0; 3])];
        let mut flight = Flight::new(&World::empty(), &CF2X, BulletMode::Pyb, report, start);
        let mut fastest = 0.0_f64;
        for step in 0..2400 {
            // Half the weight and some yaw torque.
            let speed = 0.7 * CF2X.hover_rotor_speed();
            flight.step(&[speed, 1.02 * speed, speed, 1.02 * speed]);
            if step > 240 {
                fastest = fastest.max(flight.drone().velocity.norm() + 0.06 * flight.drone().body_rates.norm());
            }
        }
        let drone = flight.drone();
        let crept = (drone.position.xy() - nalgebra::Vector2::new(0.2, -0.1)).norm();
        let turned = drone.world_from_body.z.abs() * 2.0;
        println!("{report:?}: crept {crept:.1e} m, turned {turned:.1e} rad, at most {fastest:.1e} m/s");
        assert!(crept < 1e-3 && turned < 0.02 && fastest < 0.01);
    }
}

#[test]
fn a_drone_with_its_centre_of_mass_on_top_rests_too() {
    for report in BOTH {
        let start = vec![level([0.0, 0.0, 0.3], [0.0; 3])];
        let mut flight = Flight::new(&World::empty(), &HUMMINGBIRD, BulletMode::Pyb, report, start);
        for _ in 0..480 {
            flight.step(&[0.0; 4]);
        }
        assert!((flight.drone().position.z - 0.151).abs() < 2e-3, "{report:?}: {}", flight.drone().position.z);
    }
}

#[test]
fn a_drone_slides_along_a_wall_and_stays_outside() {
    for report in BOTH {
        let mut start = level([0.8, 0.0, 2.0], [0.0, 0.5, 0.0]);
        start.motion.world_from_body = Attitude::from_axis_angle(Vector3::y(), 0.2);
        start.link_attitude = start.motion.world_from_body;
        let mut flight = Flight::new(&wall(), &CF2X, BulletMode::Pyb, report, vec![start]);
        let speed = CF2X.hover_rotor_speed() / 0.2_f64.cos().sqrt();
        let mut farthest = 0.0_f64;
        let mut touched = false;
        for _ in 0..300 {
            flight.step(&[speed; 4]);
            farthest = farthest.max(flight.drone().position.x);
            touched |= flight.arena.touch(&flight.pose(), &[]).obstacle;
        }
        println!("{report:?}: at most at x = {farthest:.4} m, y = {:.3} m", flight.drone().position.y);
        assert!(touched && farthest < 1.0 && flight.drone().position.y > 0.1);
    }
}

/// A table of 0.5 m by 0.5 m whose top is at 0.4 m, turned about the vertical.
fn table(heading: f64) -> World {
    let half = Vector3::new(0.25, 0.25, 0.2);
    let block = Solid::block("table", -half, half);
    let pose = Pose {
        position: Vector3::new(0.0, 0.0, 0.2),
        world_from_body: Attitude::from_axis_angle(Vector3::z(), heading),
    };
    World { solids: vec![Solid { pose, ..block }], ..World::empty() }
}

/// Where a drone is that was put level on a table, this far from its middle \[m\], after two seconds.
fn after_two_seconds_on(table: &World, from_middle: f64, heading: f64) -> Vector3<f64> {
    let place = Attitude::from_axis_angle(Vector3::z(), heading).rotate(Vector3::new(from_middle, 0.0, 0.0));
    let start = vec![level([place.x, place.y, 0.4 + REST_HEIGHT + 1e-3], [0.0; 3])];
    let mut flight = Flight::new(table, &CF2X, BulletMode::Pyb, ContactReport::Touch, start);
    for _ in 0..480 {
        flight.step(&[0.0; 4]);
    }
    flight.drone().position
}

#[test]
fn a_drone_rests_over_the_edge_of_a_table_until_its_centre_is_beyond() {
    for heading in [0.0, 0.3, 0.785] {
        let table = table(heading);
        for from_middle in [0.0, 0.15, 0.2, 0.24] {
            let position = after_two_seconds_on(&table, from_middle, heading);
            let moved = (position.xy().norm() - from_middle).abs();
            assert!((position.z - 0.4 - REST_HEIGHT).abs() < 1e-3, "at {from_middle}: {position}");
            assert!(moved < 1e-3, "at {from_middle}: {position}");
        }
        let fallen = after_two_seconds_on(&table, 0.27, heading);
        assert!(fallen.z < 0.1 && fallen.xy().norm() > 0.25, "{fallen}");
    }
}

#[test]
fn a_drone_stays_on_a_slope_up_to_the_angle_of_friction() {
    // The table's friction is 0.5 and the drone's too: it slides from a slope of one to four on.
    for (slope, stays) in [(0.2_f64, true), (0.3, false)] {
        let mut world = table(0.0);
        let tilt = Attitude::from_axis_angle(Vector3::y(), slope.atan());
        world.solids[0].friction = 0.5;
        world.solids[0].pose = Pose { position: Vector3::new(0.0, 0.0, 1.0), world_from_body: tilt };
        let place = world.solids[0].pose.position + tilt.rotate(Vector3::new(0.0, 0.0, 0.2 + REST_HEIGHT));
        let mut start = level(place.into(), [0.0; 3]);
        start.motion.world_from_body = tilt;
        start.link_attitude = tilt;
        let mut flight = Flight::new(&world, &CF2X, BulletMode::Pyb, ContactReport::Touch, vec![start]);
        for _ in 0..240 {
            flight.step(&[0.0; 4]);
        }
        let slid = (flight.drone().position - place).norm();
        println!("slope {slope}: slid {slid:.4} m");
        assert_eq!(slid < 2e-3, stays, "slope {slope}: slid {slid} m");
    }
}

#[test]
fn a_fast_drone_does_not_pass_a_thin_wall() {
    let sheet = Solid::block("sheet", Vector3::new(1.0, -5.0, 0.0), Vector3::new(1.04, 5.0, 4.0));
    let world = World { solids: vec![sheet], ..World::empty() };
    for report in BOTH {
        let start = vec![level([0.5, 0.0, 2.0], [8.0, 0.0, 0.0])];
        let mut flight = Flight::new(&world, &CF2X, BulletMode::Pyb, report, start);
        for _ in 0..120 {
            flight.step(&[CF2X.hover_rotor_speed(); 4]);
        }
        assert!(flight.drone().position.x < 1.0, "{report:?}: {}", flight.drone().position.x);
    }
}

#[test]
fn drones_that_meet_share_their_momentum() {
    for report in BOTH {
        let start = vec![level([-0.2, 0.0, 2.0], [1.0, 0.0, 0.0]), level([0.2, 0.0, 2.0], [-0.5, 0.0, 0.0])];
        let mut flight = Flight::new(&World::empty(), &CF2X, BulletMode::Pyb, report, start);
        let mut met = false;
        for _ in 0..60 {
            flight.step(&[CF2X.hover_rotor_speed(); 4]);
            let [one, other] = [0, 1].map(|drone| flight.drones[drone].motion);
            let pose = |state: &kestrel_core::vehicle::State<f64>| kestrel_sim::world::Pose {
                position: state.position,
                world_from_body: state.world_from_body,
            };
            met |= flight.arena.drones_touch(&pose(&one), &pose(&other));
        }
        let [one, other] = [0, 1].map(|drone| flight.drones[drone].motion);
        let total = one.velocity + other.velocity;
        println!("{report:?}: {:.3} and {:.3} m/s afterwards", one.velocity.x, other.velocity.x);
        assert!(met && (total.x - 0.5).abs() < 0.02, "{report:?}: {total}");
        assert!(other.position.x - one.position.x > 0.12, "{report:?}: passed through each other");
    }
}

#[test]
fn the_same_fall_has_the_same_bits() {
    for report in BOTH {
        let fall = || {
            let mut start = level([0.93, 0.1, 0.4], [0.7, 0.2, -1.0]);
            start.motion.world_from_body = Attitude::from_axis_angle(Vector3::new(0.6, 0.0, 0.8), FRAC_PI_2);
            start.motion.body_rates = Vector3::new(3.0, -5.0, 2.0);
            let mut flight = Flight::new(&wall(), &CF2X, BulletMode::Pyb, report, vec![start]);
            let mut bits = Vec::new();
            for _ in 0..480 {
                flight.step(&[0.5 * CF2X.hover_rotor_speed(); 4]);
                let drone = flight.drone();
                bits.extend(drone.position.iter().chain(drone.body_rates.iter()).map(|value| value.to_bits()));
            }
            bits
        };
        assert_eq!(fall(), fall());
    }
}
