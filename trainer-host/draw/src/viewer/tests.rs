use kestrel_sim::camera::Cpu;

use super::*;
use crate::picture::Picture;
use crate::testing::{flown, scenario, started};
use crate::video::{RecordedScene, VideoFormat};

const EXTENT: Extent = Extent { secs: 2.0, drones: 3, goes_on: false };

fn after(keys: &[&str]) -> Controls {
    let mut controls = Controls::default();
    for key in keys {
        assert_eq!(controls.apply(action(key).unwrap(), &EXTENT), Flow::Continue);
    }
    controls
}

#[test]
fn keys_do_what_the_help_says() {
    let first = Controls::default();
    assert!(!after(&[" "]).playing && after(&["Space", "p"]).playing);
    assert_eq!(
        after(&["ArrowRight", "ArrowRight", "ArrowLeft"]),
        Controls { secs: 0.04, playing: false, newest: false, ..first }
    );
    assert_eq!(after(&["PageDown"]).secs, 1.0);
    assert_eq!(after(&["ArrowLeft"]).secs, 0.0);
    assert_eq!((after(&["ArrowUp"]).speed, after(&["ArrowDown", "-"]).speed), (2.0, 0.25));
    assert_eq!((after(&["+"; 20]).speed, after(&["-"; 20]).speed), (16.0, 0.0625));
    assert_eq!(after(&["c"]).camera, CameraMode::Orbit);
    assert_eq!(after(&["c", "c"]).camera, CameraMode::Onboard);
    assert_eq!(after(&["c", "c", "c"]), first);
    assert_eq!((after(&["n", "Tab"]).drone, after(&["n", "n", "n"]).drone), (2, 0));
    assert_eq!(after(&["c", "n", "+", "PageDown", "Home"]), first);
    for key in ["q", "Escape"] {
        assert_eq!(Controls::default().apply(action(key).unwrap(), &EXTENT), Flow::Quit);
    }
    assert_eq!([action("x"), action(""), action("Shift")], [None; 3]);
}

#[test]
fn time_passes_until_the_end_and_starts_again() {
    let mut controls = after(&["ArrowUp"]);
    controls.advance(0.5, &EXTENT);
    assert_eq!((controls.secs, controls.playing), (1.0, true));
    controls.advance(9.0, &EXTENT);
    assert_eq!((controls.secs, controls.playing), (2.0, false));
    controls.advance(1.0, &EXTENT);
    assert_eq!(controls.secs, 2.0);
    controls.apply(Action::Pause, &EXTENT);
    assert_eq!((controls.secs, controls.playing), (0.0, true));
}

#[test]
fn the_mouse_turns_and_zooms_within_limits() {
    let mut controls = Controls::default();
    controls.drag([100.0, 0.0]);
    assert_eq!(controls.camera, CameraMode::Orbit);
    assert!((controls.heading - (0.6 - 0.8_f64).rem_euclid(std::f64::consts::TAU)).abs() < 1e-12);
    controls.drag([0.0, 1e6]);
    assert!(controls.elevation < std::f64::consts::FRAC_PI_2, "never along its own top");
    let far = controls.zoom;
    controls.zoom(1.0);
    assert!(controls.zoom < far);
    controls.zoom(-1e3);
    assert_eq!(controls.zoom, 40.0);
}

/// Pixels in some columns that differ between two pictures, above the words.
fn differing(one: &Picture, other: &Picture, columns: std::ops::Range<usize>) -> usize {
    let [width, height] = one.size;
    let pairs = one.pixels.iter().zip(&other.pixels).enumerate().take(width * (height - layout::FOOT));
    pairs.filter(|(place, (one, other))| columns.contains(&(place % width)) && one != other).count()
}

#[test]
fn the_picture_follows_the_controls_and_is_the_same_again() {
    let scenario = scenario("aviaries/crossing-3.yaml", 4.0);
    let recorded = RecordedScene::new(flown(&scenario), &scenario, "flight").unwrap();
    let renderer = Cpu::asked_for();
    let secs = recorded.secs();
    let mut viewport = Viewport::new(recorded, &scenario, &renderer, 1.5, [480, 300]);
    assert_eq!(viewport.extent(), Extent { secs, drones: 3, goes_on: false });
    let start = Controls::default();
    let first = viewport.picture(&start).unwrap();
    assert_eq!((first.size, &viewport.picture(&start).unwrap()), ([480, 300], &first));
    let side = 480 - (0.32 * 480.0) as usize - 8;
    let changed = |controls: Controls, columns| differing(&first, &viewport.picture(&controls).unwrap(), columns);
    for camera in [CameraMode::Orbit, CameraMode::Onboard] {
        let camera = Controls { camera, ..start };
        assert!(changed(camera, 0..side) > 5000);
        assert_eq!(changed(camera, side..472), 0, "the small pictures stay");
    }
    assert!(changed(Controls { drone: 1, ..start }, side..472) > 1000);
    assert!(changed(Controls { secs: 2.0, ..start }, 0..480) > 5000);
    let paused = Controls { playing: false, ..start };
    assert_eq!(changed(paused, 0..480), 0, "only the status changes");
    assert!(viewport.picture(&paused).unwrap() != first);
    viewport.resize([1, 1]);
    assert_eq!(viewport.picture(&start).unwrap().size, LEAST_SIZE);
}

#[test]
fn a_flight_without_a_window_is_a_film() {
    let scenario = scenario("aviaries/room-1.yaml", 4.0);
    let recorded = RecordedScene::new(started(&scenario), &scenario, "flight").unwrap();
    let renderer = Cpu::asked_for();
    let viewport = Viewport::new(recorded, &scenario, &renderer, 1.5, [320, 240]);
    let video = viewport.video(&Controls::default(), VideoFormat::Gif, |_| true).unwrap().unwrap();
    assert!(video.starts_with(b"GIF89a") && video[6..10] == [64, 1, 240, 0]);
    assert!(viewport.video(&Controls::default(), VideoFormat::Gif, |_| false).unwrap().is_none());
}
