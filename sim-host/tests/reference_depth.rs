//! What the reference's camera saw of the worlds, against ours.
//!
//! The pictures in `tests/golden/fork/depth` are 48 rows of 64 depths along the optical axis \[m\], of a camera 39.7 mm
//! above a drone at the start, facing +x, 60 degrees wide and high.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on should panic")]

use std::fs;
use std::path::Path;

use kestrel_sim::camera::{Camera, Scene, View};
use kestrel_sim::config::AviaryParts;
use kestrel_sim::world::{Pose, World};
use nalgebra::Vector3;

/// Height of the camera above the drone \[m\].
const EYE_HEIGHT: f64 = 0.0397;

/// Nearer than this the reference's camera sees the drone itself \[m\].
const OWN_PROPELLERS: f32 = 0.12;

fn golden(name: &str) -> Vec<f32> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../tests/golden/fork/depth/{name}.csv"));
    let text = fs::read_to_string(path).unwrap();
    text.split([',', '\n']).filter(|depth| !depth.is_empty()).map(|depth| depth.parse().unwrap()).collect()
}

/// Depths that the camera sees, row by row from the top.
fn picture(world: &World, start: Vector3<f64>) -> Vec<f32> {
    let view = View::paper(&Pose::at(start), EYE_HEIGHT);
    Scene::new(world).render(&Camera::REFERENCE, &view).depths
}

/// Share of the pixels that differ from the recording by more than 1 % and one centimetre.
fn share_of_differences(recording: &str, world: &str) -> f64 {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../assets/worlds/{world}.yaml"));
    let place = AviaryParts::read(&path).unwrap();
    let (seen, recorded) = (picture(&place.world, place.starts[0]), golden(recording));
    assert_eq!(seen.len(), recorded.len());
    let pairs: Vec<_> = seen.iter().zip(&recorded).filter(|(_, recorded)| **recorded > OWN_PROPELLERS).collect();
    let differs = |seen: f32, recorded: f32| (seen - recorded).abs() > (0.01 * recorded).max(0.01);
    pairs.iter().filter(|(seen, recorded)| differs(**seen, **recorded)).count() as f64 / pairs.len() as f64
}

#[test]
fn the_camera_of_the_reference_saw_these_worlds() {
    // What is left: the creases of cushions, knobs, pots and headphones, which are boxes here, and pixels on edges.
    let cases = [
        ("cross0", "incremental-cross-0", 0.0),
        ("cross1", "incremental-cross-1", 0.0),
        ("cross6", "incremental-cross-6", 0.0),
        ("cross16", "harder-cross-16", 0.0),
        ("room0", "room-0", 0.019),
        ("room1", "room-1", 0.005),
        ("room2", "room-2", 0.008),
    ];
    for (recording, world, limit) in cases {
        let share = share_of_differences(recording, world);
        println!("{world}: {:.2} % of the pixels differ", 100.0 * share);
        assert!(share <= limit, "{world}: {share} of the pixels differ, at most {limit} should");
    }
}
