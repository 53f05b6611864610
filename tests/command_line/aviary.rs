//! Plans of aviaries, and experiments that import one.

use std::fs;
use std::path::{Path, PathBuf};

use crate::kestrel::{config, kestrel, refusal, train_tiny};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

#[test]
fn aviaries_are_listed_and_drawn_by_name() {
    let list = kestrel(&repository(), &["aviary", "list"]);
    let text = String::from_utf8(list.stdout).unwrap();
    assert!(list.status.success() && text.lines().count() > 40, "{text}");
    let room = text.lines().find(|line| line.starts_with("room-2 ")).unwrap();
    assert!(room.contains("144") && room.contains("8.20 x 3.20 x 1.55 m"), "{room}");

    let place = tempfile::tempdir().unwrap();
    for (name, starts) in [("plan.svg", &b"<svg "[..]), ("plan.png", b"\x89PNG")] {
        let output = place.path().join(name);
        let shown = kestrel(&repository(), &["aviary", "show", "maze", "--output", output.to_str().unwrap()]);
        assert!(shown.status.success(), "{shown:?}");
        assert!(fs::read(&output).unwrap().starts_with(starts), "{name}");
    }
    let several = place.path().join("sheet.svg");
    let arguments = ["aviary", "show", "maze", "configs/cross.yaml", "-o", several.to_str().unwrap()];
    assert!(kestrel(&repository(), &arguments).status.success());
    let sheet = fs::read_to_string(several).unwrap();
    assert!(sheet.contains(">maze</text>") && sheet.contains(">cross</text>"));
}

#[test]
fn what_cannot_be_drawn_is_said() {
    let place = tempfile::tempdir().unwrap();
    let message = |arguments: &[&str]| refusal(&kestrel(place.path(), arguments));
    assert!(
        message(&["aviary", "show", "nowhere", "-o", "x.svg"])
            .contains("nowhere: found neither a file nor a task")
    );
    assert!(message(&["aviary", "list"]).contains("found no YAML files"));
    assert!(message(&["aviary", "list", "none"]).contains("none: found no folder"));
    fs::write(place.path().join("world.yaml"), "solids: [{low_m: [0, 0, 0], high_m: [1, 1, 1]}]\n").unwrap();
    assert!(message(&["aviary", "show", "world.yaml", "-o", "x.gif"]).contains("expected .svg or .png"));
    let wrong = message(&["aviary", "show", "world.yaml", "-o", "x.svg", "--set", "import=none.yaml"]);
    assert!(wrong.contains("--set import=none.yaml: found no such file (none.yaml)"), "{wrong}");
    fs::write(place.path().join("statue.yaml"), "solids: [{mesh: {import: statue.obj}}]\n").unwrap();
    fs::write(place.path().join("statue.obj"), "v 0 0 0\nv 1 0 0\nf 1 2 3\n").unwrap();
    let wrong = message(&["aviary", "show", "statue.yaml", "-o", "x.svg"]);
    assert!(wrong.contains("statue.obj:3:7: found `3`, expected one of the 2 corners (`v`) above"), "{wrong}");
    fs::write(place.path().join("broken.yaml"), "solids: [{}]\n").unwrap();
    let listed = kestrel(place.path(), &["aviary", "list", "."]);
    assert_eq!(listed.status.code(), Some(2));
    let errors = String::from_utf8(listed.stderr).unwrap();
    assert!(errors.contains("broken.yaml:1:10: solids.0: found no outline"), "{errors}");
    assert!(!place.path().join("x.svg").exists());
}

#[test]
fn a_wrong_world_is_blamed_on_its_own_file() {
    let place = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(config("hover.yaml")).unwrap();
    let text = text.replace("  aviary:\n", "  aviary:\n    import: worlds/here.yaml\n");
    fs::write(place.path().join("trial.yaml"), text).unwrap();
    fs::create_dir(place.path().join("worlds")).unwrap();
    fs::write(place.path().join("worlds/here.yaml"), "pillars: [[0, far]]\n").unwrap();
    let message = refusal(&kestrel(place.path(), &["train", "trial.yaml"]));
    assert!(
        message.contains("worlds/here.yaml:1:15: scenario.aviary.pillars.0.1: found the text \"far\""),
        "{message}"
    );
    assert!(message.contains("\n  imported by trial.yaml:16:13\n"), "{message}");
}

/// Arguments that make one room with few pieces.
fn generation<'a>(folders: &'a [String; 2], more: &[&'a str]) -> Vec<&'a str> {
    let [furniture, base] = folders;
    let parts =
        ["aviary", "generate", "--worlds", "worlds", "--tasks", "tasks", "--furniture", furniture, "--base", base];
    [&parts[..], more].concat()
}

fn folders() -> [String; 2] {
    ["assets/furniture", "configs/aviaries/parts/room.yaml"]
        .map(|path| repository().join(path).display().to_string())
}

#[test]
fn random_rooms_are_written_and_flown() {
    let (place, folders) = (tempfile::tempdir().unwrap(), folders());
    let arguments = generation(&folders, &["--name", "trial", "--count", "1", "--pieces", "5"]);
    let made = kestrel(place.path(), &arguments);
    assert!(made.status.success(), "{made:?}");
    let [task, world] = ["tasks/trial-00.yaml", "worlds/trial-00.yaml"];
    assert_eq!(String::from_utf8(made.stdout).unwrap().trim(), task);
    let text = fs::read_to_string(place.path().join(world)).unwrap();
    assert!(text.starts_with("# Written by: kestrel aviary generate --name trial --count 1 --seed 0 --pieces 5 "));
    let flown = kestrel(place.path(), &["baseline", task, "--episodes", "4"]);
    let report = String::from_utf8(flown.stdout).unwrap();
    assert!(flown.status.success() && report.contains("scripted pilot    100.0 %"), "{report}");

    let message = refusal(&kestrel(place.path(), &arguments));
    assert!(
        message.contains("tasks/trial-00.yaml: found a file")
            || message.contains("worlds/trial-00.yaml: found a file"),
        "{message}"
    );
    assert!(message.contains("--force"), "{message}");
    let again = kestrel(place.path(), &[&arguments[..], &["--force"]].concat());
    assert!(again.status.success());
    assert!(fs::read_to_string(place.path().join(world)).unwrap() == text);
}

#[test]
fn rooms_that_cannot_be_made_are_refused_and_leave_nothing() {
    let (place, folders) = (tempfile::tempdir().unwrap(), folders());
    let message = |more: &[&str]| refusal(&kestrel(place.path(), &generation(&folders, more)));
    assert!(
        message(&["--name", "a", "--count", "0"]).contains("found --count 0, expected a number from 1 to 1000")
    );
    assert!(message(&["--name", "a", "--pieces", "1000"]).contains("found --pieces 1000"));
    assert!(message(&["--name", "a b"]).contains("name: found the text \"a b-00\", expected 1 to 64 letters"));
    let lost = ["none".to_owned(), folders[1].clone()];
    let lost = refusal(&kestrel(place.path(), &generation(&lost, &["--name", "a"])));
    assert!(lost.contains("--furniture none: found no folder"), "{lost}");
    assert_eq!(fs::read_dir(place.path()).unwrap().count(), 0);
}

#[test]
fn a_pillar_is_refused_where_it_makes_no_sense() {
    let place = tempfile::tempdir().unwrap();
    train_tiny(place.path(), "run", &[]);
    let cross = config("aviaries/incremental-cross-0.yaml").display().to_string();
    let hover = config("aviaries/hover.yaml").display().to_string();
    let obstruct = |task: &str, more: &[&str]| {
        let arguments = ["aviary", "obstruct", "run", "--task", task, "-o", "next.yaml", "--world", "world.yaml"];
        refusal(&kestrel(place.path(), &[&arguments[..], more].concat()))
    };
    let other = obstruct(&cross, &[]);
    assert!(other.contains("run/policy.kestrel: found a policy for another observation"), "{other}");
    assert!(obstruct(&cross, &["--flights", "0"]).contains("found --flights 0, expected a number from 1"));
    assert!(obstruct("none.yaml", &[]).contains("none.yaml: found no such file"));
    assert!(obstruct("run/config.yaml", &[]).contains("run/config.yaml: found no world file"));
    let failing = obstruct(&hover, &["--flights", "4"]);
    assert!(failing.contains("found ") && failing.contains("expected"), "{failing}");
    fs::write(place.path().join("next.yaml"), "mine\n").unwrap();
    assert!(obstruct(&cross, &[]).contains("next.yaml: found a file, expected none: --force"));
    assert_eq!(fs::read_to_string(place.path().join("next.yaml")).unwrap(), "mine\n");
    assert!(!place.path().join("world.yaml").exists());
}

#[test]
fn what_drones_see_of_aviaries_is_one_sheet() {
    let place = tempfile::tempdir().unwrap();
    let worlds = ["../assets/worlds/maze.yaml", "../assets/worlds/room-0.yaml"]
        .map(|name| std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(name).to_str().unwrap().to_owned());
    let seen = kestrel(place.path(), &["aviary", "look", &worlds[0], &worlds[1], "-o", "seen.png"]);
    assert!(seen.status.success(), "{}", String::from_utf8_lossy(&seen.stderr));
    assert!(fs::read(place.path().join("seen.png")).unwrap().starts_with(b"\x89PNG"));
    let wrong = refusal(&kestrel(place.path(), &["aviary", "look", &worlds[0], "-o", "seen.svg"]));
    assert!(wrong.contains("seen.svg: found another ending, expected .png"), "{wrong}");
    let unknown = refusal(&kestrel(place.path(), &["aviary", "look", "atlantis", "-o", "no.png"]));
    assert!(unknown.contains("atlantis: found neither a file nor a task of this name"), "{unknown}");
    let none = refusal(&kestrel(place.path(), &["aviary", "look", "-o", "no.png"]));
    assert!(none.contains("found no YAML files in assets/worlds"), "{none}");
}
