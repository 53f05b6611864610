use super::*;
use crate::run_config::RunConfig;
use crate::study::config::multi_task::tests::tiny;

fn directory(study: &Study, place: &tempfile::TempDir) -> RunDirectory {
    RunDirectory::create(&place.path().join("run"), &study.resolved_yaml).unwrap()
}

fn whole(study: &Study) -> (Vec<f32>, Vec<EpisodeRow>) {
    let place = tempfile::tempdir().unwrap();
    let mut run = MultiTaskRun::begin(study, directory(study, &place)).unwrap();
    assert_eq!(run.train(&Interrupt::default()).unwrap(), End::Finished);
    (run.actor().parameters().to_vec(), run.flights().to_vec())
}

/// Stopped after every update, and read again.
fn halting(study: &Study) -> (Vec<f32>, Vec<EpisodeRow>) {
    let place = tempfile::tempdir().unwrap();
    let mut run = MultiTaskRun::begin(study, directory(study, &place)).unwrap();
    while !run.is_finished() {
        run.update().unwrap();
        run.save().unwrap();
        let path = run.directory().path().to_owned();
        drop(run);
        let reopened = RunDirectory::resume(&path).unwrap();
        let RunConfig::Several(again) = RunConfig::load_to_train(&reopened.config(), &[]).unwrap() else {
            panic!("the configuration in the directory has several tasks");
        };
        assert_eq!(again.resolved_yaml, study.resolved_yaml);
        run = MultiTaskRun::resume(study, reopened).unwrap();
    }
    let newest = newest_policy(study, run.directory()).unwrap();
    assert_eq!(newest, (run.actor(), run.total_steps()));
    (run.actor().parameters().to_vec(), run.flights().to_vec())
}

#[test]
fn a_run_of_several_tasks_that_is_stopped_after_every_update_ends_with_the_same_bits() {
    for learn in [
        "joint: {}",
        "sequential: {consolidator: {anchor: {strength: {fixed: 1}}}}",
        "sharing: {every_updates: 2}",
        "distil: {bytes: 4096, steps: 7}",
    ] {
        let study = tiny(&[&format!("learn={{{learn}}}")]);
        assert!(whole(&study) == halting(&study), "{learn}");
    }
}

#[test]
fn every_update_has_a_row_and_test_flights_name_their_tasks() {
    let study = tiny(&["learn={sequential: {}}"]);
    let place = tempfile::tempdir().unwrap();
    let mut run = MultiTaskRun::begin(&study, directory(&study, &place)).unwrap();
    run.train(&Interrupt::default()).unwrap();
    let rows: Vec<serde_json::Value> =
        crate::run_directory::metrics::read_rows(&run.directory().metrics()).unwrap();
    let numbers: Vec<u64> = rows.iter().map(|row| row["updates"].as_u64().unwrap()).collect();
    assert_eq!(numbers, [1, 2, 3, 4]);
    let steps: Vec<u64> = rows.iter().map(|row| row["steps"].as_u64().unwrap()).collect();
    assert_eq!(steps, [4096, 8192, 12288, 16384], "both stages count");
    let flown = |row: &serde_json::Value, task: &str| row["flights"][task].is_number();
    assert!(rows[..2].iter().all(|row| flown(row, "low") && !flown(row, "high")));
    assert!(rows[2..].iter().all(|row| flown(row, "high") && !flown(row, "low")));
}

#[test]
fn another_configuration_cannot_go_on_with_a_run() {
    let (study, other) = (tiny(&[]), tiny(&["training.discount=0.5"]));
    let place = tempfile::tempdir().unwrap();
    let run = MultiTaskRun::begin(&study, directory(&study, &place)).unwrap();
    let path = run.directory().path().to_owned();
    drop(run);
    let error = MultiTaskRun::resume(&other, RunDirectory::resume(&path).unwrap()).unwrap_err().to_string();
    assert!(error.contains("says `discount: 0.5`, but the run was trained with `discount: 0.99`"), "{error}");
    let seed = tiny(&["training.seed=9"]);
    let error = MultiTaskRun::resume(&seed, RunDirectory::resume(&path).unwrap()).unwrap_err().to_string();
    assert!(error.starts_with("the run began with seed 0, but its config.yaml says 9"), "{error}");
}
