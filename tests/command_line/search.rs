//! Searches: stopped and killed, they end with the same trials.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Instant;

use crate::kestrel::{command, config, kestrel, refusal};
use crate::study::assert_same_study;

/// Six trials of a moment each, of which half get a second seed.
const SEARCH: &str = "\
version: 1
name: tiny
study:
  version: 1
  name: inner
  tasks:
    - version: 1
      name: low
      scenario:
        aviary: {goal_m: [0, 0, 1]}
        start: {position: {around_goal: {farthest_m: 0.5}}, tilt_limit_deg: 10}
        rewards:
          - proximity: {weight: 1, scale_m: 0.5}
        terminations:
          - collision
        success:
          settle: {radius_m: 0.05, within_secs: 4}
  training: {environments: 256, steps_per_rollout: 32, minibatch: 1024, total_steps: 81920, epochs: 2}
  evaluation: {episodes: 5, flights_per_stage: 3, flight_episodes: 4}
  methods:
    - name: plain
      learn: {sequential: {}}
space:
  training.clip_range: {uniform: {low: 0.1, high: 0.4}}
  training.epochs: {whole: {low: 1, high: 3}}
trials: 6
batch: 4
objective: final_return
seeds: {count: 2}
";

fn place() -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("tiny.yaml"), SEARCH).unwrap();
    place
}

fn finish(place: &Path, directory: &str) {
    let output = kestrel(place, &["search", "run", "tiny.yaml", "--directory", directory]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("--set 'training.clip_range=") && text.contains("report.md"), "{text}");
}

#[cfg(unix)]
#[test]
fn a_search_that_is_stopped_and_killed_ends_with_the_same_trials() {
    let place = place();
    let begun = Instant::now();
    finish(place.path(), "whole");
    let share = begun.elapsed() / 6;
    for (index, signal) in ["-INT", "-KILL", "-INT", "-KILL", "-KILL", "-INT"].into_iter().enumerate() {
        let mut child = command(place.path())
            .args(["search", "run", "tiny.yaml", "--directory", "search", "--threads", ["1", "2"][index % 2]])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        sleep(share.mul_f64(0.2 + 2.0 * (index as f64 * 0.618_034).fract()));
        // Where the search was done before, there is nobody to signal.
        let _done =
            Command::new("kill").args([signal, &child.id().to_string()]).stderr(Stdio::null()).status().unwrap();
        let status = child.wait().unwrap();
        assert!(matches!(status.code(), None | Some(0 | 130)), "{status}");
    }
    finish(place.path(), "search");
    assert_same_study(&place.path().join("whole"), &place.path().join("search"));
}

#[test]
fn a_report_can_be_had_again_and_a_damaged_log_is_named() {
    let place = place();
    finish(place.path(), "search");
    let report = place.path().join("search/report.md");
    let before = fs::read(&report).unwrap();
    fs::remove_file(&report).unwrap();
    assert!(kestrel(place.path(), &["search", "report", "search"]).status.success());
    assert!(fs::read(&report).unwrap() == before);
    fs::write(place.path().join("search/trials.csv"), "trial\n").unwrap();
    let message = refusal(&kestrel(place.path(), &["search", "report", "search"]));
    assert!(message.contains("search/trials.csv:1: found `trial`, expected `trial,rungs"), "{message}");
    finish(place.path(), "search");
    assert!(fs::read(&report).unwrap() == before);
}

#[test]
fn what_is_no_search_is_refused() {
    let place = place();
    fs::create_dir(place.path().join("other")).unwrap();
    fs::write(place.path().join("other/thesis.tex"), "").unwrap();
    let run = |more: &[&str]| refusal(&kestrel(place.path(), &[&["search", "run", "tiny.yaml"], more].concat()));
    assert!(run(&["--directory", "other"]).contains("is not empty and holds no search"));
    let message = run(&["--set", "space={training.epochs: {whole: {low: 0, high: 3}}}"]);
    assert!(
        message.contains("space.training.epochs: found 0, expected a whole number from 1 to 100"),
        "{message}"
    );
    assert!(!place.path().join("searches").exists());
}

#[test]
fn the_schema_prints() {
    let place = tempfile::tempdir().unwrap();
    let schema = kestrel(place.path(), &["schema", "search"]).stdout;
    let kept = fs::read(config("searches/schema.json")).unwrap();
    assert!(schema == kept, "configs/searches/schema.json is not what the program prints");
}
