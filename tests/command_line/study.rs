//! Studies: interrupted, killed and damaged at will, they end with the same bits.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::kestrel::{command, kestrel, refusal};

/// Two tasks, four methods and two seeds.
const STUDY: &str = include_str!("tiny-study.yaml");

/// A place with the study file.
fn place() -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("tiny.yaml"), STUDY).unwrap();
    place
}

const RUN: [&str; 5] = ["study", "run", "tiny.yaml", "--directory", "study"];

/// Runs the study to its end.
fn finish(place: &Path, directory: &str, threads: &str) {
    let arguments = ["study", "run", "tiny.yaml", "--directory", directory, "--threads", threads];
    let output = kestrel(place, &arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Every file below `folder`, with its content; locks name the processes that held them and are left out.
pub(crate) fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if !path.ends_with(".lock") {
                found.insert(path.strip_prefix(folder).unwrap().to_owned(), fs::read(&path).unwrap());
            }
        }
    }
    found
}

/// Rows, curves and the report are the same bits; nothing else lies about.
pub(crate) fn assert_same_study(one: &Path, other: &Path) {
    let (one, other) = (files(one), files(other));
    assert!(one.keys().eq(other.keys()), "{:?}\n{:?}", one.keys(), other.keys());
    for (path, content) in &one {
        assert!(*content == other[path], "{} differs", path.display());
    }
}

/// Starts the study and ends it with `signal` after a while, unless it is done before.
#[cfg(unix)]
fn stop(place: &Path, threads: &str, signal: &str, after: Duration) {
    let mut child = command(place)
        .args([&RUN[..], &["--threads", threads]].concat())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    sleep(after);
    // Where the study was done before, there is nobody to signal.
    let _done =
        Command::new("kill").args([signal, &child.id().to_string()]).stderr(Stdio::null()).status().unwrap();
    let status = child.wait().unwrap();
    assert!(matches!(status.code(), None | Some(0 | 130)), "{status}");
}

#[cfg(unix)]
#[test]
fn a_study_that_is_stopped_and_killed_at_random_ends_with_the_same_bits() {
    let place = place();
    let begun = Instant::now();
    finish(place.path(), "whole", "2");
    // So that all ten fall within the study whatever the machine: each may do about a tenth of it.
    let share = begun.elapsed() / 10;
    // A low-discrepancy sequence stands for chance.
    let moment = |index: u32| share.mul_f64(0.2 + 2.0 * (f64::from(index) * 0.618_034).fract());
    for index in 0..10 {
        let signal = if index % 2 == 0 { "-INT" } else { "-KILL" };
        let threads = if index % 3 == 0 { "1" } else { "2" };
        stop(place.path(), threads, signal, moment(index));
    }
    finish(place.path(), "study", "1");
    assert_same_study(&place.path().join("whole"), &place.path().join("study"));
    finish(place.path(), "study", "2");
    assert_same_study(&place.path().join("whole"), &place.path().join("study"));
}

#[cfg(unix)]
#[test]
fn a_second_process_in_the_same_study_is_refused() {
    let place = place();
    let longer = ["--set", "training.total_steps=8192000"];
    let mut first = command(place.path())
        .args([&RUN[..], &longer].concat())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let begun = Instant::now();
    while !place.path().join("study/study.json").exists() {
        assert!(begun.elapsed() < Duration::from_secs(60), "no study within a minute");
        sleep(Duration::from_millis(5));
    }
    let message = refusal(&kestrel(place.path(), &[&RUN[..], &longer].concat()));
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(message.contains(&format!("study is in use by process {}", first.id())), "{message}");
}

#[test]
fn more_seeds_are_added_and_any_other_change_is_refused() {
    let place = place();
    let few = ["--set", "seeds.count=1"];
    assert!(kestrel(place.path(), &[&RUN[..], &few].concat()).status.success());
    finish(place.path(), "study", "2");
    finish(place.path(), "whole", "2");
    assert_same_study(&place.path().join("whole"), &place.path().join("study"));
    let before = files(&place.path().join("study"));
    for change in
        ["training.epochs=3", "methods.1.learn.sequential.consolidator.anchor.strength.fixed=2", "seeds.first=1"]
    {
        let message = refusal(&kestrel(place.path(), &[&RUN[..], &["--set", change]].concat()));
        assert!(message.contains("study/study.yaml:") && message.contains("as the study now says"), "{message}");
    }
    assert!(before == files(&place.path().join("study")), "a refusal changes nothing");
    let said = [
        "--set",
        "about=said anew",
        "--set",
        "claims=[{claim: solved, method: plain, expected: {at_least: 0.9}}]",
    ];
    let again = kestrel(place.path(), &[&RUN[..], &said].concat());
    assert!(again.status.success(), "{}", String::from_utf8_lossy(&again.stderr));
    let report = std::fs::read_to_string(place.path().join("study/report.md")).unwrap();
    assert!(report.contains("said anew") && report.contains("| solved | `plain`: "), "{report}");
}

#[test]
fn studies_make_a_page_and_other_folders_are_refused() {
    let place = place();
    finish(place.path(), "study", "2");
    let page = place.path().join("RESULTS.md");
    let results = |folder: &str| kestrel(place.path(), &["study", "results", "study", folder, "-o", "RESULTS.md"]);
    let message = refusal(&results("nowhere"));
    assert!(message.contains("nowhere holds no study"), "{message}");
    assert!(!page.exists(), "nothing is half-written");
    assert!(results("study").status.success());
    assert!(std::fs::read_to_string(&page).unwrap().starts_with("# Results\n"));
    assert!(!place.path().join("pictures").exists());
    let drawn = ["study", "results", "study", "study", "-o", "RESULTS.md", "--pictures", "pictures/of-studies"];
    assert!(kestrel(place.path(), &drawn).status.success());
    assert!(place.path().join("pictures/of-studies/tiny-final.svg").is_file());
    assert!(std::fs::read_to_string(page).unwrap().contains("](pictures/of-studies/tiny-final.svg)"));
}

#[test]
fn a_directory_with_something_else_is_refused() {
    let place = place();
    fs::create_dir(place.path().join("study")).unwrap();
    fs::write(place.path().join("study/thesis.tex"), "").unwrap();
    let message = refusal(&kestrel(place.path(), &RUN));
    assert!(message.contains("study is not empty and holds no study"), "{message}");
    let message = refusal(&kestrel(place.path(), &["study", "report", "study"]));
    assert!(message.contains("study.json"), "{message}");
}

#[test]
fn damaged_rows_are_named_and_had_again() {
    let place = place();
    finish(place.path(), "study", "2");
    let before = files(&place.path().join("study"));
    let rows = place.path().join("study/rows/plain/0-1.csv");
    let text = fs::read_to_string(&rows).unwrap();
    fs::write(&rows, &text[..text.len() / 2]).unwrap();
    let message = refusal(&kestrel(place.path(), &RUN));
    let advice = "remove study/rows/plain/0-1.csv and run the study again to get it back";
    assert!(message.contains("study/rows/plain/0-1.csv:") && message.contains(advice), "{message}");
    fs::remove_file(&rows).unwrap();
    finish(place.path(), "study", "2");
    assert!(files(&place.path().join("study")) == before);
}

#[cfg(unix)]
#[test]
fn a_full_disk_is_one_error_and_costs_nothing() {
    let place = place();
    // A limit on the size of files stands in for a disk on which rows of flights have no room.
    let many = "--set evaluation.episodes=400";
    let script = format!(
        "trap '' XFSZ; ulimit -f 16; exec '{}' study run tiny.yaml --directory study {many}",
        env!("CARGO_BIN_EXE_kestrel")
    );
    let output = Command::new("bash").args(["-c", &script]).current_dir(place.path()).output().unwrap();
    let message = refusal(&output);
    assert!(message.contains("cannot write study/"), "{message}");
    let run = |directory: &str| {
        let arguments =
            ["study", "run", "tiny.yaml", "--directory", directory, "--set", "evaluation.episodes=400"];
        assert!(kestrel(place.path(), &arguments).status.success());
    };
    run("study");
    run("whole");
    assert_same_study(&place.path().join("whole"), &place.path().join("study"));
}

#[test]
fn the_schema_prints() {
    let place = tempfile::tempdir().unwrap();
    let schema = kestrel(place.path(), &["schema", "study"]).stdout;
    let kept = fs::read(crate::kestrel::config("studies/schema.json")).unwrap();
    assert!(schema == kept, "configs/studies/schema.json is not what the program prints");
}
