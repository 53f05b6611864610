//! Flights as cameras see them.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::Stdio;

use crate::kestrel::{command, config, kestrel, refusal};

const SMALL: [&str; 6] = ["--columns", "40", "--rows", "30", "--samples", "1"];

fn in_assets(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets").join(name).to_str().unwrap().to_owned()
}

fn drawn(place: &Path, arguments: &[&str]) {
    let output = kestrel(place, &[&["render"], arguments, &SMALL[..]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Width and height in the header of a GIF.
fn gif_size(path: &Path) -> [u16; 2] {
    let file = fs::read(path).unwrap();
    assert!(file.starts_with(b"GIF89a") && file.ends_with(b";"));
    [u16::from_le_bytes([file[6], file[7]]), u16::from_le_bytes([file[8], file[9]])]
}

#[test]
fn what_a_drone_sees_at_its_start_is_drawn() {
    let place = tempfile::tempdir().unwrap();
    let task = config("aviaries/harder-cross-16.yaml");
    let task = task.to_str().unwrap();
    drawn(place.path(), &[task, "--output", "view.png"]);
    let file = fs::read(place.path().join("view.png")).unwrap();
    assert_eq!(file[16..24], [0, 0, 0, 152, 0, 0, 0, 117], "three panels, what is between them, words and legend");
    drawn(place.path(), &[task, "--output", "one.png", "--panels", "chase", "--at", "0.5"]);
    assert_eq!(fs::read(place.path().join("one.png")).unwrap()[16..24], [0, 0, 0, 56, 0, 0, 0, 96]);
}

#[test]
fn policies_pilots_runs_and_recordings_become_films() {
    let place = tempfile::tempdir().unwrap();
    let cross = config("cross.yaml");
    let cross = cross.to_str().unwrap();
    let short = ["--set", "scenario.episode_secs=0.6"];
    let policy = in_assets("pilots/cross.kestrel");
    let film = |name: &str, arguments: &[&str]| {
        drawn(place.path(), &[arguments, &["-o", name][..]].concat());
        gif_size(&place.path().join(name))
    };
    assert_eq!(film("policy.gif", &[&[cross, "--policy", &policy][..], &short].concat()), [200, 117]);
    let chase = [cross, "--pilot", "nothing", "--panels", "chase,labels"];
    assert_eq!(film("nothing.gif", &[&chase[..], &short].concat()), [104, 96]);
    let record = ["baseline", cross, "--episodes", "1", "--record", "flight"];
    assert!(kestrel(place.path(), &[&record[..], &short].concat()).status.success());
    assert_eq!(film("recording.gif", &["flight"]), [200, 117]);
    assert_eq!(film("scripted.gif", &[&[cross, "--seed", "0"][..], &short].concat()), [200, 117]);
    let [recorded, scripted] =
        ["recording.gif", "scripted.gif"].map(|name| fs::read(place.path().join(name)).unwrap());
    assert!(recorded == scripted, "the same flight is the same film");
}

#[test]
fn wrong_requests_for_pictures_are_explained() {
    let place = tempfile::tempdir().unwrap();
    let cross = config("cross.yaml");
    let cross = cross.to_str().unwrap();
    let refused = |arguments: &[&str]| {
        let message = refusal(&kestrel(place.path(), &[&["render"], arguments].concat()));
        assert!(
            fs::read_dir(place.path()).unwrap().all(|entry| entry.unwrap().file_name() == "flight"),
            "{message}"
        );
        message
    };
    for (flag, value) in [
        ("--columns", "0"),
        ("--rows", "5000"),
        ("--view-angle", "180"),
        ("--view-angle", "nan"),
        ("--samples", "9"),
        ("--at", "-1"),
        ("--panels", "left"),
    ] {
        assert!(refused(&[cross, "-o", "no.png", flag, value]).contains(flag));
    }
    let message = refused(&[cross, "-o", "no.png", "--backend", "cuda"]);
    assert!(message.contains("expected `auto`, `cpu`, `gpu` or `software`, found `cuda`"), "{message}");
    assert!(refused(&[cross, "-o", "none/view.png"]).contains("none/view.png"));
    assert!(
        refused(&[cross, "-o", "view.jpg"])
            .contains("view.jpg: found another ending, expected .png, .gif or .mp4")
    );
    assert!(
        refused(&[cross, "-o", "no.png", "--drone", "1"]).contains("found --drone 1, expected a number below 1")
    );
    assert!(refused(&["none.yaml", "-o", "no.png"]).contains("none.yaml"));
    assert!(refused(&["none", "-o", "no.gif"]).contains("none: found neither a file nor a task of this name"));
    assert!(refused(&[".", "-o", "no.gif"]).contains("holds no run"));
    let policy = in_assets("pilots/cross.kestrel");
    assert!(refused(&[&policy, "-o", "no.gif"]).contains("is no recording: it begins with"));
    let hover = config("aviaries/harder-cross-16.yaml");
    let other = refused(&[hover.to_str().unwrap(), "--policy", &policy, "-o", "no.gif"]);
    assert!(other.contains("cross.kestrel was exported for another"), "{other}");
    assert!(refused(&[cross, "--policy", &policy, "--pilot", "random", "-o", "no.gif"]).contains("--pilot"));
    fs::write(place.path().join("flight"), "GIF89a and so on").unwrap();
    let message = refused(&["flight", "--policy", &policy, "-o", "no.gif"]);
    assert!(message.contains("flight: found no experiment file for --policy and --pilot"), "{message}");
    let message = refused(&["flight", "--seed", "3", "-o", "no.gif"]);
    assert!(message.contains("flight: found `evaluation.seed=3` for a recording"), "{message}");
}

#[cfg(unix)]
#[test]
fn a_stopped_film_leaves_nothing() {
    let place = tempfile::tempdir().unwrap();
    let task = config("hover.yaml");
    let large = ["render", task.to_str().unwrap(), "-o", "film.gif", "--columns", "600", "--samples", "1"];
    let mut child = command(place.path()).args(large).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    lines.read_line(&mut line).unwrap();
    assert!(line.contains("pictures"), "{line}");
    let signal = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(signal.success());
    lines.read_to_string(&mut line).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{line}");
    assert!(line.contains("Stopping: nothing is written."), "{line}");
    assert_eq!(fs::read_dir(place.path()).unwrap().count(), 0);
}

#[test]
fn the_viewer_writes_files_without_a_screen() {
    let place = tempfile::tempdir().unwrap();
    let cross = config("cross.yaml");
    let policy = in_assets("pilots/cross.kestrel");
    let view = ["view", cross.to_str().unwrap(), "--policy", &policy, "--columns", "320", "--rows", "240"];
    for name in ["view.png", "view.gif"] {
        let output = kestrel(place.path(), &[&view[..], &["--headless", name, "--camera", "orbit"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    assert_eq!(fs::read(place.path().join("view.png")).unwrap()[16..24], [0, 0, 1, 64, 0, 0, 0, 240]);
    assert_eq!(gif_size(&place.path().join("view.gif")), [320, 240]);
    let wrong = refusal(&kestrel(place.path(), &[&view[..], &["--headless", "view.avi"]].concat()));
    assert!(wrong.contains("view.avi: found another ending, expected .png, .gif or .mp4"), "{wrong}");
    let drone = refusal(&kestrel(place.path(), &[&view[..], &["--headless", "no.png", "--drone", "4"]].concat()));
    assert!(drone.contains("found --drone 4, expected a number below 1"), "{drone}");
    let without = command(place.path()).args(view).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output();
    let message = refusal(&without.unwrap());
    assert!(message.contains("--headless FILE.gif"), "{message}");
}
