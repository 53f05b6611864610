use std::fs;
use std::path::Path;

use super::*;
use crate::multi_task_run::MultiTaskRun;
use crate::results;
use crate::run_config::{RunConfig, Subject};
use crate::run_directory::RunDirectory;
use crate::study::Study;
use crate::study::config::tests::tiny;
use crate::study::data::StudyData;
use kestrel_learn::ranks::threads::run_as;

const METHODS: &str = "methods=[{name: plain, learn: {sequential: {}}}, {name: joint, learn: {joint: {}}}]";

/// Runs a study in a directory to its end.
fn finish(study: &Study, path: &Path, threads: usize) {
    let directory = StudyDirectory::open(study, path).unwrap();
    assert_eq!(run(&[directory], threads, &Interrupt::default(), &ranks::alone()).unwrap(), End::Finished);
}

/// Every file of rows and curves.
fn found(path: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    let untold =
        ["rows/found", "curves/found", "boundaries/found"].into_iter().filter(|folder| path.join(folder).is_dir());
    for folder in ["rows/plain", "rows/joint", "curves/plain", "curves/joint"].into_iter().chain(untold) {
        for entry in fs::read_dir(path.join(folder)).unwrap() {
            let entry = entry.unwrap();
            let name = format!("{folder}/{}", entry.file_name().to_string_lossy());
            files.push((name, fs::read(entry.path()).unwrap()));
        }
    }
    files.sort();
    files
}

#[test]
fn several_studies_are_run_together_to_what_each_is_alone() {
    let place = tempfile::tempdir().unwrap();
    let studies = ["seeds.first=0", "seeds.first=9"].map(|first| tiny(&[METHODS, "seeds.count=2", first]));
    let together: Vec<_> = studies
        .iter()
        .enumerate()
        .map(|(index, study)| StudyDirectory::open_trial(study, &place.path().join(index.to_string())).unwrap())
        .collect();
    run(&together, 3, &Interrupt::default(), &ranks::alone()).unwrap();
    for (index, study) in studies.iter().enumerate() {
        let alone = place.path().join(format!("alone-{index}"));
        finish(study, &alone, 1);
        assert_eq!(found(&place.path().join(index.to_string())), found(&alone));
    }
}

#[test]
fn a_run_that_was_asked_to_stop_does_nothing_and_goes_on_later() {
    let place = tempfile::tempdir().unwrap();
    let study = tiny(&[METHODS, "seeds.count=2"]);
    let interrupt = Interrupt::default();
    interrupt.request();
    let directory = [StudyDirectory::open(&study, place.path()).unwrap()];
    assert_eq!(run(&directory, 2, &interrupt, &ranks::alone()).unwrap(), End::Interrupted);
    assert!(!place.path().join("rows").exists());
    assert_eq!(run(&directory, 2, &Interrupt::default(), &ranks::alone()).unwrap(), End::Finished);
    assert!(!place.path().join("unfinished").exists(), "checkpoints of finished jobs are gone");
    assert_eq!(StudyData::load(place.path()).unwrap().missing, []);
}

#[test]
fn more_seeds_add_rows_and_leave_those_that_are_there() {
    let place = tempfile::tempdir().unwrap();
    let (few, many) = (place.path().join("few"), place.path().join("many"));
    finish(&tiny(&[METHODS, "seeds.count=1"]), &few, 1);
    let before = found(&few);
    finish(&tiny(&[METHODS, "seeds.count=3"]), &few, 2);
    finish(&tiny(&[METHODS, "seeds.count=3"]), &many, 1);
    let after = found(&few);
    assert!(before.iter().all(|file| after.contains(file)));
    assert_eq!(after, found(&many));
    for file in ["study.json", "study.yaml"] {
        assert_eq!(fs::read(few.join(file)).unwrap(), fs::read(many.join(file)).unwrap(), "{file}");
    }
}

#[test]
fn any_number_of_ranks_leaves_the_same_study() {
    let methods = "methods=[{name: plain, learn: {sequential: {consolidator: {anchor: {strength: {fixed: 1}}}}}}, \
                   {name: joint, learn: {sharing: {every_updates: 1}}}, \
                   {name: found, learn: {sequential: {consolidator: {compact_coreset: {bytes: 4096, boundaries: found}}}}}]";
    let elsewhere = "tasks.1.scenario.start.position={within: {low_m: [2, 2, 1], high_m: [3, 3, 2]}}";
    let study = tiny(&[methods, elsewhere, "training.environments=1024", "training.total_steps=65536"]);
    let place = tempfile::tempdir().unwrap();
    let path = |size: usize| place.path().join(size.to_string());
    finish(&study, &path(1), 2);
    for size in [2, 4] {
        run_as(size, |ranks| {
            if ranks.rank() > 0 {
                return follow(&study, &ranks).unwrap();
            }
            // Stopped in the middle, then on to the end.
            for interrupted in [true, false] {
                let interrupt = Interrupt::default();
                let directory = [StudyDirectory::open(&study, &path(size)).unwrap()];
                if interrupted {
                    interrupt.request();
                }
                run(&directory, 1, &interrupt, &ranks).unwrap();
            }
            ranks::end(&ranks);
        });
        let files = found(&path(size));
        assert_eq!(files, found(&path(1)), "{size} ranks");
        let boundaries = b"method,order,seed,stage,steps\nfound,0,0,2,16384\n";
        assert!(files.iter().any(|(name, text)| name == "boundaries/found/0-0.csv" && text == boundaries));
    }
}

#[test]
fn experts_that_are_trained_as_their_files_say_can_be_trained_so_again() {
    let place = tempfile::tempdir().unwrap();
    let study = tiny(&[
        "methods=[{name: own, learn: {experts: {own_training: true}}}]",
        "tasks.0.training={environments: 256, steps_per_rollout: 16, minibatch: 1024, total_steps: 4096, epochs: 1, \
         actor_hidden: [8], critic_hidden: [8]}",
        "tasks.1.training={environments: 256, steps_per_rollout: 16, minibatch: 1024, total_steps: 8192, epochs: 1, \
         actor_hidden: [16], critic_hidden: [8]}",
        "tasks.1.scenario.observation={pilot: {position_scale_m: 3}}",
    ]);
    finish(&study, place.path(), 2);
    assert_eq!(StudyData::load(place.path()).unwrap().missing, []);
    for (task, hidden) in [("low", 8), ("high", 16)] {
        let kept = RunDirectory::open(&place.path().join("policies/own/0-0").join(task)).unwrap();
        let RunConfig::One(experiment) = RunConfig::load_to_train(&kept.config(), &[]).unwrap() else {
            panic!("{task} is one task");
        };
        assert_eq!(experiment.training.ppo.actor_hidden, [hidden]);
        assert_eq!(results::evaluate_run(&Subject::of(&experiment), &kept).unwrap().len(), 1);
    }
}

#[test]
fn every_job_keeps_its_policy_beside_the_configuration_that_trains_it_again() {
    const METHODS: &str = "methods=[{name: kept, learn: {sequential: {consolidator: {anchor: {strength: {fixed: 1}}}}}}, \
                           {name: joint, learn: {joint: {}}, training: {environments: 256, steps_per_rollout: 16, \
                           minibatch: 1024, total_steps: 8192, epochs: 1, actor_hidden: [8], critic_hidden: [8]}}, \
                           {name: experts, learn: {experts: {}}}]";
    let place = tempfile::tempdir().unwrap();
    let study = tiny(&[METHODS, "orders={these: [[high, low]]}", "seeds.first=5"]);
    finish(&study, place.path(), 2);
    for method in ["kept", "joint"] {
        let kept = RunDirectory::open(&place.path().join("policies").join(method).join("0-5")).unwrap();
        let RunConfig::Several(sole) = RunConfig::load_to_train(&kept.config(), &[]).unwrap() else {
            panic!("{method} has several tasks");
        };
        let again = RunDirectory::create(&place.path().join(method), &sole.resolved_yaml).unwrap();
        let mut run = MultiTaskRun::begin(&sole, again).unwrap();
        run.train(&Interrupt::default()).unwrap();
        let subject = Subject { name: &sole.name, seed: sole.seeds[0], tasks: &sole.tasks };
        results::export_policy(&subject, run.directory(), &run.actor(), run.steps()).unwrap();
        let [found, expected] = [&kept, run.directory()].map(|run| fs::read(run.policy()).unwrap());
        assert!(found == expected, "{method} trained again is another policy");
    }
    for task in ["low", "high"] {
        let kept = RunDirectory::open(&place.path().join("policies/experts/0-5").join(task)).unwrap();
        let config = RunConfig::load_to_train(&kept.config(), &[]).unwrap();
        assert_eq!(config.subject().name, task);
        let reports = results::evaluate_run(&config.subject(), &kept).unwrap();
        assert_eq!(reports.len(), 1);
    }
    let policies = |path: &Path| fs::read_dir(path.join("policies")).map_or(0, Iterator::count);
    assert_eq!(policies(place.path()), 3);
    let trial = place.path().join("trial");
    let directory = StudyDirectory::open_trial(&study, &trial).unwrap();
    run(&[directory], 1, &Interrupt::default(), &ranks::alone()).unwrap();
    assert_eq!(policies(&trial), 0, "a search keeps none");
}
