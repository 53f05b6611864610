//! Scripted flights: those of the repository pass, twice the same, and one that fails says so.

use std::fs;
use std::path::{Path, PathBuf};

use crate::kestrel::{command, config, kestrel, refusal};

/// All files of flights of the repository.
fn files() -> Vec<PathBuf> {
    let entries = fs::read_dir(config("tests")).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|ending| ending == "yaml"));
    files.sort();
    files
}

/// Lines of the flights of the repository, flown by so many threads, and the report.
fn flown(place: &Path, threads: &str) -> (Vec<String>, Vec<u8>) {
    let arguments = ["test", "--threads", threads, "--junit", "flights.xml", "--films", "films"];
    let output = command(place).args(arguments).args(files()).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{text}{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(fs::read_dir(place.join("films")).unwrap().count(), 0, "no flight failed");
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let summary = lines.pop().unwrap();
    assert!(summary.starts_with(&format!("{} passed, 0 failed: ", lines.len())), "{summary}");
    (lines, fs::read(place.join("flights.xml")).unwrap())
}

#[test]
fn the_hundred_flights_of_the_repository_pass_and_are_the_same_bits_twice() {
    let place = tempfile::tempdir().unwrap();
    let once = flown(place.path(), "1");
    assert!(once.0.len() >= 100, "{}", once.0.len());
    assert!(once == flown(place.path(), "2"), "hashes and reports do not depend on the threads");
}

#[test]
fn a_flight_that_fails_is_told_reported_and_filmed() {
    let place = tempfile::tempdir().unwrap();
    let file = config("tests/hover.yaml");
    let arguments = [
        "test",
        file.to_str().unwrap(),
        "--only",
        "take-off-and-land [cascade, 0.5 m]",
        "--set",
        "flights.0.secs=2",
        "--set",
        "flights.0.script.2.at_secs=1.5",
        "--set",
        "flights.0.expect=[ends_landed, {stays_above: {height_m: 0.4}}]",
        "--junit",
        "report.xml",
        "--films",
        "films",
    ];
    let output = kestrel(place.path(), &arguments);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(1), "{text}");
    let lines: Vec<&str> = text.lines().collect();
    assert!(
        lines[0].starts_with("FAILED  ") && lines[0].ends_with("hover/take-off-and-land [cascade, 0.5 m]"),
        "{text}"
    );
    assert!(lines[1].starts_with("        ends_landed: at 2.00 s found a drone that is "), "{text}");
    assert!(lines[2].starts_with("        stays_above: at 0.00 s found a height of 0.01"), "{text}");
    assert!(lines.last().unwrap().starts_with("0 passed, 1 failed: 2 s of flight in "), "{text}");
    let report = fs::read_to_string(place.path().join("report.xml")).unwrap();
    assert!(report.contains("failures=\"1\"") && report.contains("<failure type=\"ends_landed\""), "{report}");
    let film = place.path().join("films/hover-take-off-and-land--cascade--0.5-m.gif");
    assert!(fs::read(film).unwrap().starts_with(b"GIF89a"));
}

#[test]
fn what_is_wrong_in_a_file_of_flights_is_named_once_with_its_line() {
    let place = tempfile::tempdir().unwrap();
    let hover = config("hover.yaml");
    let text = format!(
        "version: 1\nname: mine\ntask: {{ import: {} }}\npilot: hover\nflights:\n  - name: one\n    secs: 3\n    \
         script: []\n    expect:\n      - ends_lander\n",
        hover.display()
    );
    fs::write(place.path().join("mine.yaml"), text).unwrap();
    let message = refusal(&kestrel(place.path(), &["test", "mine.yaml", "--junit", "report.xml"]));
    assert!(message.contains("mine.yaml:10:") && message.contains("did you mean `ends_landed`?"), "{message}");
    assert!(!place.path().join("report.xml").exists());
    assert!(refusal(&kestrel(place.path(), &["test", "none.yaml"])).contains("none.yaml: found no such file"));
    let file = config("tests/rooms.yaml");
    let message = refusal(&kestrel(place.path(), &["test", file.to_str().unwrap(), "--only", "nothing"]));
    assert!(message.contains("found --only nothing"), "{message}");
}

#[cfg(unix)]
#[test]
fn a_user_who_stops_finds_nothing_half_written() {
    use std::process::{Command, Stdio};

    let place = tempfile::tempdir().unwrap();
    // An hour of flight each: stopped before the first is over.
    let arguments = [
        "--threads",
        "2",
        "--junit",
        "flights.xml",
        "--set",
        "flights.0.secs=3600",
        "--set",
        "flights.0.matrix.seeds=[0,1,2,3]",
    ];
    let mut child = command(place.path())
        .arg("test")
        .args(arguments)
        .arg(config("tests/hover.yaml"))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(500));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert_eq!(fs::read_dir(place.path()).unwrap().count(), 0);
}
