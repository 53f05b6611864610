//! Tasks and pilots by name, anywhere on the machine.

use std::fs;
use std::path::Path;

use crate::kestrel::{TINY, command, kestrel, printed, refusal};

/// Names of the pilots in the repository.
fn pilots() -> Vec<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/pilots");
    let named = |folder: &Path, before: &str| {
        let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        let files = files.filter(|path| path.extension().is_some_and(|ending| ending == "kestrel"));
        files.map(|path| format!("{before}{}", path.file_stem().unwrap().to_str().unwrap())).collect::<Vec<_>>()
    };
    let mut names = [named(&folder, ""), named(&folder.join("aviaries"), "aviaries/")].concat();
    names.sort();
    names
}

#[test]
fn a_task_trains_by_its_name_where_there_is_no_repository() {
    let place = tempfile::tempdir().unwrap();
    printed(&kestrel(place.path(), &[&["train", "hover", "--run", "run"], &TINY[..]].concat()));
    let config = fs::read_to_string(place.path().join("run/config.yaml")).unwrap();
    assert!(config.contains("name: hover\n") && config.contains("crazyflie_2_1"), "{config}");
    let text = printed(&kestrel(place.path(), &["baseline", "aviaries/hover", "--episodes", "2"]));
    assert!(text.contains("scripted pilot"), "{text}");
}

#[test]
fn every_pilot_succeeds_in_the_task_of_its_name() {
    let place = tempfile::tempdir().unwrap();
    for pilot in pilots() {
        let text = printed(&kestrel(place.path(), &["evaluate", &pilot, "--episodes", "12"]));
        assert!(!text.contains("float32"), "{pilot}: {text}");
        let rows: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("fixed16")).collect();
        let share = |row: &str| row.split_once('%').unwrap().0.trim().parse::<f64>().unwrap();
        assert!(!rows.is_empty() && rows.into_iter().all(|row| share(row) > 80.0), "{pilot}: {text}");
    }
}

#[test]
fn a_pilot_is_inspected_and_drawn_by_its_name() {
    let place = tempfile::tempdir().unwrap();
    let text = printed(&kestrel(place.path(), &["inspect", "room-1"]));
    assert!(text.contains("fixed16"), "{text}");
    for more in [&[][..], &["--pilot", "scripted"], &["--policy", "room-1"]] {
        let command = ["render", "room-1", "--panels", "chase", "--columns", "32", "--at", "1", "-o", "still.png"];
        printed(&kestrel(place.path(), &[&command[..], more].concat()));
        fs::remove_file(place.path().join("still.png")).unwrap();
    }
}

#[test]
fn files_and_runs_come_before_names() {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("hover"), "version: 1\nname: mine\n").unwrap();
    let text = refusal(&kestrel(place.path(), &["baseline", "hover"]));
    assert!(text.contains("hover"), "{text}");
    // A folder of that name that is no run does not count.
    fs::create_dir(place.path().join("cross")).unwrap();
    printed(&kestrel(place.path(), &["baseline", "cross", "--episodes", "2"]));
}

#[test]
fn unknown_names_are_answered_with_the_nearest() {
    let place = tempfile::tempdir().unwrap();
    let text = refusal(&kestrel(place.path(), &["train", "romm-1"]));
    assert!(text.contains("romm-1: found neither a file nor a task of this name, expected one: room-1"), "{text}");
    let text = refusal(&kestrel(place.path(), &["fly", "hoover"]));
    assert!(
        text.contains("found neither a run nor a policy file nor a pilot of this name, expected one: hover"),
        "{text}"
    );
}

#[test]
fn a_file_that_was_changed_in_the_cache_is_made_again() {
    let [place, cache] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let baseline = || {
        let mut command = command(place.path());
        command.env("XDG_CACHE_HOME", cache.path()).args(["baseline", "hover", "--episodes", "2"]);
        printed(&command.output().unwrap())
    };
    let before = baseline();
    let file = cache.path().join("kestrel").join(env!("CARGO_PKG_VERSION")).join("configs/hover.yaml");
    let task = fs::read(&file).unwrap();
    fs::write(&file, "version: 1\n").unwrap();
    assert_eq!(baseline(), before);
    assert_eq!(fs::read(&file).unwrap(), task);
}

#[test]
fn a_cache_that_cannot_be_written_is_named() {
    let [place, cache] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let blocked = cache.path().join("kestrel");
    fs::write(&blocked, "a file").unwrap();
    let mut command = command(place.path());
    command.env("XDG_CACHE_HOME", cache.path()).args(["baseline", "hover"]);
    let text = refusal(&command.output().unwrap());
    assert!(text.contains(blocked.to_str().unwrap()), "{text}");
}
