//! Falls and collisions that the reference recorded, to their end.

use std::fs;
use std::path::PathBuf;

use kestrel_core::airframe::{Airframe, CF2P, CF2X, RADIANS_PER_SECOND_PER_RPM, RotorOrder};
use kestrel_core::attitude::Attitude;
use kestrel_core::reference::bullet::{BulletMode, BulletState};
use kestrel_core::vehicle::State;
use kestrel_sim::contact::{Arena, ContactReport};
use kestrel_sim::world::{Pose, Shape, Solid, World};
use nalgebra::Vector3;
use serde_json::Value;

use crate::flight::Flight;

/// Speed below which a drone is at rest \[m/s\].
const REST: f64 = 0.01;

/// Steps after the first contact in which the drone rebounds.
const REBOUND_STEPS: usize = 60;

/// What is compared of a flight, at the steps that were recorded.
struct Track {
    steps: Vec<usize>,
    states: Vec<State<f64>>,
}

/// How a flight ends.
struct Outcome {
    /// Greatest speed away from what was hit \[m/s\].
    rebound: f64,
    /// Step from which on the drone does not move any more.
    rest: Option<usize>,
}

impl Track {
    fn outcome(&self, contact: usize) -> Outcome {
        let after = || self.steps.iter().zip(&self.states).filter(|(step, _)| **step >= contact);
        let before = self.steps.iter().position(|step| *step >= contact).unwrap() - 1;
        let incoming = self.states[before].velocity.normalize();
        let rebounding = after().filter(|(step, _)| **step < contact + REBOUND_STEPS);
        let rebound = rebounding.map(|(_, state)| -state.velocity.dot(&incoming)).fold(f64::MIN, f64::max);
        let last_moving = after().rfind(|(_, state)| state.velocity.norm() >= REST);
        let moving = last_moving.map_or(contact, |(step, _)| *step);
        Outcome { rebound, rest: self.steps.iter().copied().find(|step| *step > moving) }
    }
}

fn folder() -> PathBuf {
    std::env::var_os("KESTREL_REFERENCE")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/golden")), PathBuf::from)
}

fn json(path: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(folder().join(path)).unwrap()).unwrap()
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    core::array::from_fn(|index| value[index].as_f64().unwrap())
}

/// Rows of a CSV file of numbers.
fn rows(path: &str) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(folder().join(path)).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect()
}

/// A state from position, quaternion x, y, z, w, velocity and angular velocity, both in the world.
fn state(logged: &[f64]) -> State<f64> {
    let world_from_body = Attitude { w: logged[6], x: logged[3], y: logged[4], z: logged[5] };
    State {
        position: Vector3::from_column_slice(&logged[..3]),
        world_from_body,
        velocity: Vector3::from_column_slice(&logged[7..10]),
        body_rates: world_from_body.rotate_inverse(Vector3::from_column_slice(&logged[10..13])),
        rotor_speeds: [0.0; 4],
    }
}

fn turned([roll, pitch, yaw]: [f64; 3]) -> Attitude<f64> {
    let about = Attitude::from_axis_angle;
    about(Vector3::z(), yaw).after(&about(Vector3::y(), pitch).after(&about(Vector3::x(), roll)))
}

fn world(case: &Value) -> World {
    let solid = |block: &Value| Solid {
        shape: Shape::Cuboid(numbers(&block["half_extents"]).into()),
        pose: Pose {
            position: numbers(&block["position"]).into(),
            world_from_body: turned(numbers(&block["rpy"])),
        },
        ..Solid::block("box", Vector3::zeros(), Vector3::zeros())
    };
    World { solids: case["boxes"].as_array().unwrap().iter().map(solid).collect(), ..World::empty() }
}

fn settings(case: &Value) -> (Airframe, BulletMode) {
    let airframe = match case["model"].as_str().unwrap() {
        "cf2x" => CF2X,
        "cf2p" => CF2P.numbered(RotorOrder::CounterClockwise),
        other => panic!("unknown model {other}"),
    };
    let mode = match case["physics"].as_str().unwrap() {
        "pyb" => BulletMode::Pyb,
        "pyb_gnd_drag_dw" => BulletMode::PybGndDragDw,
        other => panic!("unknown physics {other}"),
    };
    (airframe, mode)
}

/// The recorded and the computed flight.
fn tracks(case: &Value) -> [Track; 2] {
    let path = format!("pybullet/open_loop/{}", case["id"].as_str().unwrap());
    let recorded = rows(&format!("{path}.state.csv"));
    let steps: Vec<usize> = recorded.iter().map(|row| row[0] as usize).collect();
    let logged: Vec<State<f64>> = recorded.iter().map(|row| state(&row[2..15])).collect();
    let (airframe, mode) = settings(case);
    let start = vec![BulletState::placed(logged[0])];
    let mut flight = Flight::new(&world(case), &airframe, mode, ContactReport::Bullet, start);
    let substeps = 240 / case["ctrl_freq"].as_u64().unwrap() as usize;
    let commands = rows(&format!("{path}.rpm.csv"));
    let mut commands = commands.iter().peekable();
    let (mut speeds, mut states) = ([0.0; 4], Vec::new());
    for step in 0..=*steps.last().unwrap() {
        if steps.contains(&step) {
            states.push(*flight.drone());
        }
        while let Some(row) = commands.next_if(|row| row[0] as usize * substeps <= step) {
            speeds = [2, 3, 4, 5].map(|column| row[column] * RADIANS_PER_SECOND_PER_RPM);
        }
        flight.step(&speeds);
    }
    [Track { steps: steps.clone(), states: logged }, Track { steps, states }]
}

fn within(computed: f64, recorded: f64, share: f64) -> bool {
    (computed - recorded).abs() <= share * recorded.abs()
}

/// The side of each face of the boxes on which a drone is.
fn sides(world: &World, position: &Vector3<f64>) -> Vec<[bool; 3]> {
    let side = |solid: &Solid| {
        let local = solid.pose.world_from_body.rotate_inverse(position - solid.pose.position);
        let Shape::Cuboid(half) = &solid.shape else { panic!("recorded worlds have boxes only") };
        [0, 1, 2].map(|axis| local[axis] < -half[axis])
    };
    world.solids.iter().map(side).collect()
}

#[test]
fn falls_and_collisions_end_as_recorded() {
    let index = json("pybullet/index.json");
    let touching = |case: &&Value| case["category"] == "drop" || case["category"] == "wall";
    let mut compared = 0;
    for case in index["cases"].as_array().unwrap().iter().filter(touching) {
        let contact = case["first_contact_step"].as_u64().unwrap() as usize;
        let [recorded, computed] = tracks(case);
        let [expected, found] = [&recorded, &computed].map(|track| track.outcome(contact));
        let (last, logged) = (computed.states.last().unwrap(), recorded.states.last().unwrap());
        let off = (last.position - logged.position).norm();
        let name = case["id"].as_str().unwrap();
        println!(
            "{name}: rebound {:.4} m/s (recorded {:.4}), rest at step {:?} ({:?}), end {:.2} mm from the recorded",
            found.rebound,
            expected.rebound,
            found.rest,
            expected.rest,
            1e3 * off
        );
        assert!(within(found.rebound, expected.rebound, 0.1), "{name}: rebound");
        let world = world(case);
        assert_eq!(sides(&world, &last.position), sides(&world, &logged.position), "{name}: side");
        // A drone that comes to rest in the last steps may as well do so after them.
        let end = recorded.steps.last().unwrap() - REBOUND_STEPS;
        if let Some(rest) = expected.rest.filter(|rest| *rest < end) {
            let reached = found.rest.is_some_and(|found| within(found as f64, rest as f64, 0.2));
            assert!(reached, "{name}: time to rest");
            assert!(off < 1e-3, "{name}: rest pose");
        }
        compared += 1;
    }
    assert!(compared > 0);
}

#[test]
fn contact_is_reported_in_the_steps_in_which_it_was_recorded() {
    let index = json("pybullet/index.json");
    let touching = |case: &&Value| case["category"] == "drop" || case["category"] == "wall";
    let mut compared = 0;
    for case in index["cases"].as_array().unwrap().iter().filter(touching) {
        let arena = Arena::new(&world(case), &settings(case).0, ContactReport::Bullet);
        let name = case["id"].as_str().unwrap();
        let recorded = rows(&format!("pybullet/open_loop/{name}.state.csv"));
        // Contact is found where the drone is at the start of a step.
        for rows in recorded.windows(2).filter(|rows| rows[1][0] - rows[0][0] == 1.0) {
            let before = state(&rows[0][2..15]);
            let pose = Pose { position: before.position, world_from_body: before.world_from_body };
            let touching = arena.touch(&pose, &[]).obstacle;
            assert_eq!(touching, rows[1][15] > 0.0, "{name}: step {}", rows[1][0]);
            compared += 1;
        }
    }
    println!("contact reported as recorded in {compared} steps");
    assert!(compared > 500);
}

#[test]
fn the_forks_drone_lands_as_recorded() {
    let recording = &json("fork/physics_golden.json")["drop_to_ground_PYB"];
    let logged = recording["state16"].as_array().unwrap();
    let motion = |row: &Value| {
        let [px, py, pz, x, y, z, w, _, _, _, vx, vy, vz, wx, wy, wz] = numbers(row);
        state(&[px, py, pz, x, y, z, w, vx, vy, vz, wx, wy, wz])
    };
    let start = vec![BulletState::placed(motion(&logged[0]))];
    let airframe = CF2X.numbered(RotorOrder::CounterClockwise);
    let mut flight = Flight::new(&World::empty(), &airframe, BulletMode::Pyb, ContactReport::Bullet, start);
    let mut worst = 0.0_f64;
    for (index, row) in logged[1..].iter().enumerate() {
        let speeds = numbers(&recording["rpm"][index]).map(|rpm: f64| rpm * RADIANS_PER_SECOND_PER_RPM);
        for _ in 0..5 {
            flight.step(&speeds);
        }
        worst = worst.max((flight.drone().position - motion(row).position).norm());
    }
    println!("drop_to_ground_PYB: {worst:.1e} m at worst");
    assert!(worst < 1e-4, "{worst} m from the recording");
    assert!((flight.drone().position.z - 0.013_49).abs() < 2e-5);
}
