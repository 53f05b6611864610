use std::fs;

use super::*;
use crate::study::config::tests::tiny;

const JOB: JobId = JobId { seed: 0, order: 0, method: 0 };

/// A study's directory with checkpoints of its first job after one and two updates.
fn with_checkpoints(study: &Study, path: &Path) -> Vec<PathBuf> {
    let directory = StudyDirectory::open_trial(study, path).unwrap();
    let mut run = directory.open_job(JOB).unwrap();
    for _ in 0..2 {
        run.advance();
        directory.save_job(JOB, &run).unwrap();
    }
    let mut checkpoints = entries(&directory.checkpoints(JOB)).unwrap();
    checkpoints.sort();
    assert_eq!(checkpoints.len(), 2);
    checkpoints
}

fn damage(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(path, bytes).unwrap();
}

fn refusal(study: &Study, path: &Path) -> String {
    StudyDirectory::open_trial(study, path).unwrap_err().to_string().replace(&path.display().to_string(), "study")
}

#[test]
fn a_damaged_checkpoint_costs_only_time() {
    let place = tempfile::tempdir().unwrap();
    let study = tiny(&[]);
    let checkpoints = with_checkpoints(&study, place.path());
    let directory = StudyDirectory::open_trial(&study, place.path()).unwrap();
    let steps = || directory.open_job(JOB).unwrap().steps();
    let after_two = steps();
    damage(&checkpoints[1]);
    let after_one = steps();
    assert!(0 < after_one && after_one < after_two, "{after_one} {after_two}");
    damage(&checkpoints[0]);
    assert_eq!(steps(), 0);
    fs::write(&checkpoints[1], b"").unwrap();
    assert_eq!(steps(), 0);
}

#[test]
fn a_checkpoint_of_another_version_is_set_aside_and_its_job_begins_again() {
    let place = tempfile::tempdir().unwrap();
    let study = tiny(&[]);
    let checkpoints = with_checkpoints(&study, place.path());
    for path in &checkpoints {
        let mut bytes = fs::read(path).unwrap();
        bytes[8] = 77;
        fs::write(path, bytes).unwrap();
    }
    let directory = StudyDirectory::open_trial(&study, place.path()).unwrap();
    let foreign = |path: &PathBuf| fs::read(path).unwrap();
    let kept: Vec<Vec<u8>> = checkpoints.iter().map(foreign).collect();
    for number in 1..3 {
        let run = directory.open_job(JOB).unwrap();
        assert_eq!(run.steps(), 0);
        let aside = directory.checkpoints(JOB).with_file_name(format!("plain-0-0.former-{number}"));
        let mut found = entries(&aside).unwrap();
        found.sort();
        assert_eq!(found.iter().map(foreign).collect::<Vec<_>>(), kept);
        assert!(entries(&directory.checkpoints(JOB)).unwrap().is_empty());
        for (path, bytes) in checkpoints.iter().zip(&kept) {
            fs::write(path, bytes).unwrap();
        }
    }
}

#[test]
fn a_state_that_does_not_fit_is_set_aside_as_well() {
    let place = tempfile::tempdir().unwrap();
    with_checkpoints(&tiny(&[]), place.path());
    // As if the simulator had changed since: the directory says what the study says, its states are of other networks.
    let study = tiny(&["training.actor_hidden=[12]"]);
    fs::write(place.path().join(CONFIG), &study.resolved_yaml).unwrap();
    let directory = StudyDirectory::open_trial(&study, place.path()).unwrap();
    assert_eq!(directory.open_job(JOB).unwrap().steps(), 0);
    assert_eq!(entries(&directory.checkpoints(JOB).with_file_name("plain-0-0.former-1")).unwrap().len(), 2);
}

#[test]
fn what_a_killed_process_leaves_is_no_obstacle_and_goes() {
    let place = tempfile::tempdir().unwrap();
    let study = tiny(&[]);
    // Killed as it began: nothing but a lock and a half-written study.
    fs::write(place.path().join(".lock"), "1").unwrap();
    fs::write(place.path().join(".unfinished-a"), "vers").unwrap();
    with_checkpoints(&study, place.path());
    // Killed between the rows and the removal of the checkpoints.
    let rows = place.path().join("rows/plain");
    fs::create_dir_all(&rows).unwrap();
    fs::write(rows.join("0-0.csv"), "").unwrap();
    fs::write(rows.join(".unfinished-b"), "method,or").unwrap();
    let directory = StudyDirectory::open_trial(&study, place.path()).unwrap();
    assert!(directory.is_done(JOB));
    let left: Vec<String> = entries(place.path())
        .unwrap()
        .iter()
        .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
        .filter(|name| name != ".lock")
        .collect();
    assert!(
        left.len() == 3 && left.iter().all(|name| ["rows", "study.json", "study.yaml"].contains(&name.as_str())),
        "{left:?}"
    );
    assert_eq!(entries(&rows).unwrap().len(), 1);
}

#[test]
fn a_study_killed_between_its_two_files_goes_on() {
    let place = tempfile::tempdir().unwrap();
    let study = tiny(&[]);
    drop(StudyDirectory::open_trial(&study, place.path()).unwrap());
    fs::remove_file(place.path().join("study.json")).unwrap();
    drop(StudyDirectory::open_trial(&study, place.path()).unwrap());
    assert!(place.path().join("study.json").exists());
}

#[test]
fn only_the_number_of_seeds_may_change() {
    let place = tempfile::tempdir().unwrap();
    drop(StudyDirectory::open_trial(&tiny(&[]), place.path()).unwrap());
    drop(StudyDirectory::open_trial(&tiny(&["seeds.count=5"]), place.path()).unwrap());
    let other_team =
        refusal(&tiny(&["tasks.0.scenario.agents.count=2", "tasks.1.scenario.agents.count=2"]), place.path());
    assert!(other_team.contains("found `count: 1`, expected `count: 2` as the study now says"), "{other_team}");
    let other_seed = refusal(&tiny(&["seeds.first=3"]), place.path());
    assert!(other_seed.contains("found `first: 0`, expected `first: 3`"), "{other_seed}");
    assert!(other_seed.starts_with("study/study.yaml:"), "{other_seed}");
    let added = refusal(&tiny(&["methods.0.training={epochs: 3}"]), place.path());
    assert!(added.contains("expected `training:"), "{added}");
}

#[test]
fn a_study_that_began_before_a_setting_had_a_key_goes_on() {
    let place = tempfile::tempdir().unwrap();
    let study = tiny(&[]);
    drop(StudyDirectory::open_trial(&study, place.path()).unwrap());
    let path = place.path().join("study.yaml");
    let is_new = |line: &&str| line.trim_start().starts_with("gae_lambda:");
    let before: Vec<&str> = study.resolved_yaml.lines().filter(|line| !is_new(line)).collect();
    assert!(before.len() < study.resolved_yaml.lines().count());
    fs::write(&path, before.join("\n")).unwrap();
    drop(StudyDirectory::open_trial(&study, place.path()).unwrap());
    assert_eq!(fs::read_to_string(&path).unwrap(), study.resolved_yaml);
}

#[test]
fn other_directories_are_left_alone() {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("thesis.tex"), "").unwrap();
    assert_eq!(refusal(&tiny(&[]), place.path()), "study is not empty and holds no study: choose a new directory");
    assert_eq!(entries(place.path()).unwrap().len(), 1, "not even a lock is left there");
}

#[test]
fn a_second_process_is_refused() {
    let place = tempfile::tempdir().unwrap();
    let study = tiny(&[]);
    let _first = StudyDirectory::open_trial(&study, place.path()).unwrap();
    assert!(refusal(&study, place.path()).starts_with("study is in use by process "));
}

#[test]
fn a_damaged_manifest_is_named() {
    let place = tempfile::tempdir().unwrap();
    let study = tiny(&[]);
    drop(StudyDirectory::open_trial(&study, place.path()).unwrap());
    fs::write(place.path().join("study.json"), "{\n\"name\": 3}").unwrap();
    let error = refusal(&study, place.path());
    assert!(error.starts_with("study/study.json:2: "), "{error}");
}
