//! What is at hand where there is no repository: tasks of one's own, shipped files by name, flights as files.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::kestrel::{command, config, kestrel, printed, refusal};

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
    let said = printed(&kestrel(
        place.path(),
        &["replay", "hover", "-o", "a.svg", "a.png", "a.csv", "a.mcap", "a.mp4", "a.parquet"],
    ));
    assert!(said.contains("drone 0: 8.00 s, time limit"), "{said}");
    let read = |name: &str| fs::read(place.path().join(name)).unwrap();
    assert!(read("a.svg").starts_with(b"<svg ") && read("a.png").starts_with(b"\x89PNG"));
    assert!(
        read("a.csv").starts_with(b"drone,time_secs,position_x_m,") && read("a.mcap").starts_with(b"\x89MCAP0")
    );
    assert!(read("a.mp4")[4..].starts_with(b"ftyp") && read("a.parquet").starts_with(b"PAR1"));
    let plots = String::from_utf8(read("a.svg")).unwrap();
    for words in ["position [m]", "rotor speeds [rad/s]", "heading_error", "time since the start [s]"] {
        assert!(plots.contains(words), "{words}");
    }
    let before = fs::read_dir(place.path()).unwrap().count();
    for (arguments, expected) in [
        (&["replay", "hover"][..], "found no --output, which only a recording can do without"),
        (
            &["replay", "hover", "-o", "b.avi"],
            "b.avi: found another ending, expected .gif, .mp4, .svg, .png, .csv, .parquet or .mcap",
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

/// What a shell is offered for the last of some words.
fn offered(place: &Path, words: &[&str]) -> Vec<String> {
    let mut shell = command(place);
    shell.env("COMPLETE", "fish").args(["--", "kestrel"]).args(words);
    let said = printed(&shell.output().unwrap());
    said.lines().map(|line| line.split('\t').next().unwrap_or_default().to_owned()).collect()
}

#[test]
fn a_shell_is_offered_names_runs_and_keys() {
    let place = tempfile::tempdir().unwrap();
    let offered = |words: &[&str]| offered(place.path(), words);
    let has = |found: Vec<String>, name: &str| assert!(found.iter().any(|word| word == name), "{name}: {found:?}");
    has(offered(&["train", "room"]), "room-1");
    has(offered(&["fly", "land"]), "land-vision");
    has(offered(&["study", "run", "roo"]), "rooms");
    has(offered(&["aviary", "show", "maz"]), "maze");
    has(offered(&["new", "mine", "--from", "two"]), "two-gates");
    has(offered(&["evaluate", "hover", "--tasks", "hov"]), "hover");
    has(offered(&["train", "hover", "--set", "scenario.rewards.prox"]), "scenario.rewards.proximity.");
    has(offered(&["study", "run", "rooms", "--set", "seeds.c"]), "seeds.count=");
    fs::create_dir_all(place.path().join("runs/mine-1")).unwrap();
    fs::write(place.path().join("runs/mine-1/config.yaml"), "").unwrap();
    has(offered(&["train", "--resume", "runs/m"]), "runs/mine-1");
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        assert!(printed(&kestrel(place.path(), &["completions", shell])).contains("COMPLETE"), "{shell}");
    }
}

#[test]
fn results_are_json_for_programs_and_notes_are_not_for_all() {
    let place = tempfile::tempdir().unwrap();
    let found = |words: &[&str]| -> Value {
        serde_json::from_str(&printed(&kestrel(place.path(), words)))
            .unwrap_or_else(|error| panic!("{words:?}: {error}"))
    };
    let baseline = found(&["baseline", "hover", "--episodes", "2", "--json"]);
    assert_eq!((&baseline["task"], &baseline["rows"][0]["pilot"]), (&"hover".into(), &"do nothing".into()));
    assert_eq!(found(&["inspect", "hover", "--json"])["network"], serde_json::json!([29, 64, 64, 4]));
    let one = ["evaluate", "hover", "--tasks", "hover", "--episodes", "2", "--json"];
    assert_eq!(found(&one)[0]["evaluation"]["episodes"], 2);
    assert_eq!(found(&["evaluate", "hover", "--episodes", "2", "--json"])[0]["rows"][0]["pilot"], "fixed16");
    assert!(
        found(&["test", "hover", "--only", "take-off-and-land", "--json"])[0]["failures"]
            .as_array()
            .unwrap()
            .is_empty()
    );
    let rates =
        printed(&kestrel(place.path(), &["bench", "hover", "--rows", "vehicle", "--secs", "0.001", "--json"]));
    let rates: Vec<Value> = rates.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(rates.len() > 2 && rates.iter().all(|rate| rate["per_second"].as_f64().unwrap() > 0.0), "{rates:?}");
    let heard = |words: &[&str]| String::from_utf8(kestrel(place.path(), words).stderr).unwrap();
    assert!(heard(&one).contains("tasks/s"));
    assert_eq!(heard(&[&one[..], &["--quiet", "--threads", "1"]].concat()), "");
    assert!(heard(&["train", "nothing", "-q"]).starts_with("error: nothing: found neither"));
}

#[test]
fn what_is_there_is_written_over_by_force_alone() {
    let place = tempfile::tempdir().unwrap();
    let new = ["new", "mine", "--from", "hover"];
    printed(&kestrel(place.path(), &new));
    assert!(refusal(&kestrel(place.path(), &new)).contains("or --force to write over it"));
    printed(&kestrel(place.path(), &[&new[..], &["--force"]].concat()));
    let train = [
        "train",
        "hover",
        "--run",
        "run",
        "--set",
        "training.total_steps=32768",
        "--set",
        "evaluation.episodes=2",
    ];
    printed(&kestrel(place.path(), &train));
    let runs: Value = serde_json::from_str(&printed(&kestrel(place.path(), &["runs", "run", "--json"]))).unwrap();
    assert_eq!((&runs[0]["name"], &runs[0]["seed"]), (&"hover".into(), &0.into()));
    assert!(refusal(&kestrel(place.path(), &train)).contains("begin anew with --force"));
    fs::write(place.path().join("run/mine.txt"), "of the run before").unwrap();
    printed(&kestrel(place.path(), &[&train[..], &["--force"]].concat()));
    assert!(!place.path().join("run/mine.txt").exists());
    fs::create_dir(place.path().join("other")).unwrap();
    fs::write(place.path().join("other/mine.txt"), "of somebody").unwrap();
    let other = ["train", "hover", "--run", "other", "--force"];
    refusal(&kestrel(place.path(), &other));
    assert!(place.path().join("other/mine.txt").exists(), "only a run is removed");
}

#[test]
fn a_node_of_ros_has_a_name_and_a_domain_of_ros() {
    let place = tempfile::tempdir().unwrap();
    let fly = ["fly", "hover", "--for-secs", "1", "--listen", "127.0.0.1:0", "--ground-station", "127.0.0.1:9"];
    let refused = |words: &[&str], domain: &str, middleware: &str| {
        let mut command = command(place.path());
        command.args(fly).args(words).env("ROS_DOMAIN_ID", domain).env("RMW_IMPLEMENTATION", middleware);
        refusal(&command.output().unwrap())
    };
    let name = refused(&["--ros2", "my-drone"], "", "");
    assert!(name.starts_with("error: found the ROS 2 name `my-drone`"), "not of the pilot: {name}");
    assert!(refused(&["--ros2"], "300", "").contains("ROS_DOMAIN_ID: found `300`, expected 0 to 232"));
    assert!(refused(&["--ros2"], "", "rmw_zenoh_cpp").contains("RMW_IMPLEMENTATION: found `rmw_zenoh_cpp`"));
    assert!(refused(&["--ros2", "--signing-key", "key"], "", "").contains("--signing-key"));
}
