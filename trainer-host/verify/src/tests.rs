//! The recordings of `tests/golden`, or those that `KESTREL_REFERENCE` names.

use std::fs;
use std::path::{Path, PathBuf};

use super::*;

/// Folder that holds `pybullet` and `fork`.
fn recordings() -> PathBuf {
    let golden = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden");
    std::env::var_os("KESTREL_REFERENCE").map_or_else(golden, PathBuf::from)
}

#[test]
fn every_recording_is_reproduced() {
    let report = verify(&recordings(), &Models::default(), Tolerances::default()).unwrap();
    println!("{report}");
    assert!(report.passed(), "{report}");
    for kind in Kind::ALL {
        let known = report.findings.iter().any(|finding| finding.kind == kind && finding.rows > 0);
        assert!(known, "nothing of {} was compared", kind.name());
    }
}

/// A recording of nothing but one scene, with one thing about it changed; what `verify` says of it.
fn refusal(file: &str, change: impl FnOnce(Vec<u8>) -> Vec<u8>) -> String {
    let place = tempfile::tempdir().unwrap();
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/pybullet/camera");
    fs::create_dir(place.path().join("camera")).unwrap();
    for end in ["json", "rgba.u8.bin", "depth.f32.bin", "seg.i32.bin"] {
        let name = format!("primitives_noplane.{end}");
        fs::copy(golden.join(&name), place.path().join("camera").join(&name)).unwrap();
    }
    let index = r#"{"cases": [{"id": "camera_primitives_noplane", "kind": "camera", "frames": 4}]}"#;
    fs::write(place.path().join("index.json"), index).unwrap();
    let path = place.path().join(file);
    fs::write(&path, change(fs::read(&path).unwrap())).unwrap();
    let report = verify(place.path(), &Models::default(), Tolerances::default());
    report.map_or_else(|error| error.to_string(), |report| format!("passed: {}", report.passed()))
}

#[test]
fn a_damaged_scene_is_refused_with_file_found_and_expected() {
    let text = |from: &'static str, to: &'static str| {
        move |bytes: Vec<u8>| {
            let text = String::from_utf8(bytes).unwrap();
            assert!(text.contains(from), "{from}");
            text.replacen(from, to, 1).into_bytes()
        }
    };
    let scene = "camera/primitives_noplane.json";
    assert_eq!(refusal(scene, |bytes| bytes), "passed: true");
    for (file, from, to, expected) in [
        (
            "index.json",
            "camera_primitives",
            "primitives",
            "found the id primitives_noplane, expected `camera_SCENE`",
        ),
        ("index.json", "\"frames\": 4", "\"frames\": 3", "found 4 poses, expected 3 frames"),
        (scene, "\"width\":64", "\"width\":0", "found a camera of 0x48 pixels"),
        (scene, "\"near\":0.0397", "\"near\":2000.0", "60 degrees, 2000 to 1000 m"),
        (scene, "\"width\":64", "\"width\":32", "found 49152 bytes, expected 24576"),
        (
            scene,
            "\"dims\":[0.25,0.0,0.0]",
            "\"dims\":[-0.25,0.0,0.0]",
            "found body 4 of type 2 and [-0.25, 0.0, 0.0] m",
        ),
        (scene, "\"position\":[1.5,0.0,0.25]", "\"position\":[1e300,0.0,0.25]", "where it can be"),
        (
            scene,
            "\"quat_xyzw\":[0.0,0.0,0.0,1.0]",
            "\"quat_xyzw\":[0.0,-0.7071067811865476,0.0,0.7071067811865476]",
            "straight up",
        ),
        (
            scene,
            "\"quat_xyzw\":[0.0,0.0,0.0,1.0]",
            "\"quat_xyzw\":[0.0,0.0,0.0,2.0]",
            "expected a unit quaternion",
        ),
        (scene, "\"body_id\":9", "\"body_id\":19", "found 0 visual shapes of body 19, expected one"),
        (
            scene,
            "\"drone_body_id\":1",
            "\"drone_body_id\":77",
            "seg.i32.bin: found the body 1, expected one of the objects",
        ),
        (scene, "\"poses\"", "\"places\"", "found no key `poses`"),
    ] {
        let message = refusal(file, text(from, to));
        assert!(message.contains(expected), "{message} instead of {expected}");
    }
    let short = |bytes: Vec<u8>| bytes[4..].to_vec();
    assert!(
        refusal("camera/primitives_noplane.depth.f32.bin", short).contains("found 49148 bytes, expected 49152")
    );
}

#[test]
fn an_image_that_is_off_fails() {
    let far = |bytes: Vec<u8>| {
        bytes.as_chunks().0.iter().flat_map(|value| (f32::from_le_bytes(*value) - 0.01).to_le_bytes()).collect()
    };
    assert_eq!(refusal("camera/primitives_noplane.depth.f32.bin", far), "passed: false");
    let red = |bytes: Vec<u8>| {
        bytes.as_chunks().0.iter().flat_map(|[_, green, blue, alpha]| [0, *green, *blue, *alpha]).collect()
    };
    assert_eq!(refusal("camera/primitives_noplane.rgba.u8.bin", red), "passed: false");
    let boxes = |bytes: Vec<u8>| {
        bytes
            .as_chunks()
            .0
            .iter()
            .map(|body| i32::from_le_bytes(*body).min(2))
            .flat_map(i32::to_le_bytes)
            .collect()
    };
    assert_eq!(refusal("camera/primitives_noplane.seg.i32.bin", boxes), "passed: false");
}
