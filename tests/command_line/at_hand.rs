//! What is at hand where there is no repository: tasks of one's own, shipped files by name, flights as files.

use std::fs;

use crate::kestrel::{config, kestrel, printed, refusal};

#[test]
fn a_task_of_ones_own_begins_as_a_shipped_one() {
    let place = tempfile::tempdir().unwrap();
    for (from, seen) in
        [("two-gates", "38 observed values"), ("hover", "29 observed values"), ("crosses", "13 tasks")]
    {
        let name = format!("my-{from}");
        printed(&kestrel(place.path(), &["new", &name, "--from", from]));
        let file = format!("{name}.yaml");
        let text = fs::read_to_string(place.path().join(&file)).unwrap();
        assert!(text.contains(&format!("\nname: {name}\n")) && !text.contains("import: .."), "{text}");
        let said = printed(&kestrel(place.path(), &["check", &file]));
        assert!(said.contains("right") && said.contains(seen), "{said}");
    }
    let again = refusal(&kestrel(place.path(), &["new", "my-hover"]));
    assert!(again.contains("my-hover.yaml: found a file of this name"), "{again}");
    let unknown = refusal(&kestrel(place.path(), &["new", "mine", "--from", "two-gate"]));
    assert!(unknown.contains("found no task of this name, expected one: two-gates"), "{unknown}");
    for name in ["../mine", "Mine", "", "a b"] {
        assert!(refusal(&kestrel(place.path(), &["new", name])).contains("lower-case letters"), "{name}");
    }
    assert_eq!(fs::read_dir(place.path()).unwrap().count(), 3);
}

#[test]
fn studies_searches_flight_tests_and_aviaries_have_names() {
    let place = tempfile::tempdir().unwrap();
    let flown = printed(&kestrel(place.path(), &["test", "hover", "--only", "hand-over"]));
    assert!(flown.contains("1 passed, 0 failed"), "{flown}");
    printed(&kestrel(place.path(), &["aviary", "show", "room-1", "-o", "plan.svg"]));
    assert!(place.path().join("plan.svg").exists());
    for (arguments, expected) in [
        (
            &["study", "run", "romms"][..],
            "found neither a file nor a shipped one of this name, expected one: rooms",
        ),
        (&["search", "run", "xyz"], "expected one: anchor-strength"),
        (&["test", "hovr"], "expected one: hover"),
    ] {
        let said = refusal(&kestrel(place.path(), arguments));
        assert!(said.contains(expected), "{said}");
    }
}

#[test]
fn a_flight_becomes_every_file_that_is_asked_for() {
    let place = tempfile::tempdir().unwrap();
    let said = printed(&kestrel(place.path(), &["replay", "hover", "-o", "a.svg", "a.png", "a.csv", "a.mcap"]));
    assert!(said.contains("drone 0: 8.00 s, time limit"), "{said}");
    let read = |name: &str| fs::read(place.path().join(name)).unwrap();
    assert!(read("a.svg").starts_with(b"<svg ") && read("a.png").starts_with(b"\x89PNG"));
    assert!(read("a.csv").starts_with(b"drone,secs,px,") && read("a.mcap").starts_with(b"\x89MCAP0"));
    let plots = String::from_utf8(read("a.svg")).unwrap();
    for words in ["position [m]", "rotor speeds [rad/s]", "heading_error", "time since the start [s]"] {
        assert!(plots.contains(words), "{words}");
    }
    let before = fs::read_dir(place.path()).unwrap().count();
    for (arguments, expected) in [
        (&["replay", "hover"][..], "found no --output, which only a recording can do without"),
        (
            &["replay", "hover", "-o", "b.mp4"],
            "b.mp4: found another ending, expected .gif, .svg, .png, .csv or .mcap",
        ),
        (&["replay", "hover", "-o", "b.svg", "--drone", "1"], "found --drone 1, expected a number below 1"),
        (&["replay", "hover", "-o", "none/b.svg"], "none/b.svg"),
    ] {
        let said = refusal(&kestrel(place.path(), arguments));
        assert!(said.contains(expected), "{said}");
    }
    assert_eq!(fs::read_dir(place.path()).unwrap().count(), before);
}

#[test]
fn a_file_for_another_command_is_told_what_it_is() {
    let place = tempfile::tempdir().unwrap();
    let study = config("studies/rooms.yaml");
    let world = config("../assets/worlds/room-0.yaml");
    let hover = config("hover.yaml");
    for (command, file, expected) in [
        ("train", &study, "is a study: `kestrel study run"),
        ("train", &world, "is a world, which a task imports"),
        ("inspect", &hover, "is a task: `kestrel train"),
        ("test", &hover, "is a task: `kestrel train"),
    ] {
        let said = refusal(&kestrel(place.path(), &[command, file.to_str().unwrap()]));
        assert!(said.starts_with("error: ") && said.contains(expected), "{said}");
    }
}
