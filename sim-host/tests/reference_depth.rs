//! What the reference's camera saw of the worlds, against rays through ours.
//!
//! The pictures in `tests/golden/fork/depth` are 48 rows of 64 depths along the optical axis \[m\], of a camera 39.7 mm
//! above a drone at the start, facing +x, 60 degrees wide and high.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on should panic")]

use std::fs;
use std::path::Path;

use kestrel_sim::config::Place;
use kestrel_sim::world::{Shape, Solid, World};
use nalgebra::Vector3;
use rapier3d::parry::math::Vec3;
use rapier3d::parry::query::{Ray, RayCast};
use rapier3d::parry::shape::{ConvexPolyhedron, Cuboid, Cylinder};

const ROWS: usize = 48;
const COLUMNS: usize = 64;

/// Where nothing is \[m\].
const BACKGROUND: f32 = 1000.0;

/// Height of the camera above the drone \[m\].
const EYE_HEIGHT: f64 = 0.0397;

/// Nearer than this the reference's camera sees the drone itself \[m\].
const OWN_PROPELLERS: f32 = 0.12;

fn golden(name: &str) -> Vec<f32> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../tests/golden/fork/depth/{name}.csv"));
    let text = fs::read_to_string(path).unwrap();
    text.split([',', '\n']).filter(|depth| !depth.is_empty()).map(|depth| depth.parse().unwrap()).collect()
}

/// A solid that rays can hit, in its own frame.
struct Target<'a> {
    solid: &'a Solid,
    outline: Box<dyn RayCast>,
}

impl<'a> Target<'a> {
    fn new(solid: &'a Solid) -> Self {
        let single = |point: &Vector3<f64>| Vec3::new(point.x as f32, point.y as f32, point.z as f32);
        let outline: Box<dyn RayCast> = match &solid.shape {
            Shape::Cuboid(half) => Box::new(Cuboid::new(single(half))),
            Shape::Cylinder { radius, half_height } => {
                Box::new(Cylinder::new(*half_height as f32, *radius as f32))
            }
            Shape::Hull(points) => {
                let points: Vec<Vec3> = points.iter().map(single).collect();
                Box::new(ConvexPolyhedron::from_convex_hull(&points).unwrap())
            }
        };
        Self { solid, outline }
    }

    /// Lengths of `direction` from `eye` to the surface.
    fn distance(&self, eye: Vector3<f64>, direction: Vector3<f64>) -> Option<f32> {
        let pose = &self.solid.pose;
        let local = |vector: Vector3<f64>| {
            let [x, y, z] = vector.map(|value| value as f32).into();
            // The axis of parry's cylinder is y.
            if matches!(self.solid.shape, Shape::Cylinder { .. }) {
                Vec3::new(x, z, -y)
            } else {
                Vec3::new(x, y, z)
            }
        };
        let origin = local(pose.world_from_body.rotate_inverse(eye - pose.position));
        let ray = Ray::new(origin, local(pose.world_from_body.rotate_inverse(direction)));
        self.outline.cast_local_ray(&ray, BACKGROUND, true)
    }
}

/// Depths that the camera sees, row by row from the top.
fn picture(world: &World, start: Vector3<f64>) -> Vec<f32> {
    let targets: Vec<Target<'_>> = world.solids.iter().map(Target::new).collect();
    let eye = start + EYE_HEIGHT * Vector3::z();
    let half_width = 30_f64.to_radians().tan();
    let pixel = |row: usize, column: usize| {
        // TinyRenderer samples at the left and lower ends of its pixels.
        let across = 2.0 * column as f64 / COLUMNS as f64 - 1.0;
        let down = 2.0 * (row as f64 + 1.0) / ROWS as f64 - 1.0;
        let direction = Vector3::new(1.0, -across * half_width, -down * half_width);
        let floor = if direction.z < 0.0 { (-eye.z / direction.z) as f32 } else { BACKGROUND };
        targets.iter().filter_map(|target| target.distance(eye, direction)).fold(floor, f32::min)
    };
    (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| pixel(row, column))).collect()
}

/// Share of the pixels that differ from the recording by more than 1 % and one centimetre.
fn share_of_differences(recording: &str, world: &str) -> f64 {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../assets/worlds/{world}.yaml"));
    let place = Place::read(&path).unwrap();
    let (seen, recorded) = (picture(&place.world, place.starts[0]), golden(recording));
    assert_eq!(seen.len(), recorded.len());
    let pairs: Vec<_> = seen.iter().zip(&recorded).filter(|(_, recorded)| **recorded > OWN_PROPELLERS).collect();
    let differs = |seen: f32, recorded: f32| (seen - recorded).abs() > (0.01 * recorded).max(0.01);
    pairs.iter().filter(|(seen, recorded)| differs(**seen, **recorded)).count() as f64 / pairs.len() as f64
}

#[test]
fn the_camera_of_the_reference_saw_these_worlds() {
    // What is left: cushions and knobs, whose boxes are fuller than they are, and a pixel here and there on an edge.
    let cases = [
        ("cross0", "incremental-cross-0", 0.0),
        ("cross1", "incremental-cross-1", 0.0),
        ("cross6", "incremental-cross-6", 0.0),
        ("cross16", "harder-cross-16", 0.0),
        ("room0", "room-0", 0.08),
        ("room1", "room-1", 0.008),
        ("room2", "room-2", 0.008),
    ];
    for (recording, world, limit) in cases {
        let share = share_of_differences(recording, world);
        println!("{world}: {:.2} % of the pixels differ", 100.0 * share);
        assert!(share <= limit, "{world}: {share} of the pixels differ, at most {limit} should");
    }
}
