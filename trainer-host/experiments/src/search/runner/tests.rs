use std::fs;

use super::*;
use crate::search::config::tests::search;

fn finish(search: &Search, path: &Path, threads: usize) -> Vec<Trial> {
    let mut told = Vec::new();
    let run = SearchRun::open(search, path).unwrap();
    let end = run.run(threads, &Interrupt::default(), |trials| told = trials.to_vec()).unwrap();
    assert_eq!(end, End::Finished);
    told
}

fn log_of(path: &Path) -> String {
    fs::read_to_string(path.join(log::FILE)).unwrap()
}

#[test]
fn threads_and_interruptions_leave_no_trace() {
    let place = tempfile::tempdir().unwrap();
    let search = search(&[]);
    let (whole, halves) = (place.path().join("whole"), place.path().join("halves"));
    let trials = finish(&search, &whole, 1);
    assert_eq!(trials.len(), 6);
    assert_eq!(log::load(&whole, &search).unwrap(), trials);
    // Stopped after each of the studies that are done so far.
    for done in 0..4 {
        let interrupt = Interrupt::default();
        let stopper = interrupt.clone();
        let run = SearchRun::open(&search, &halves).unwrap();
        let trials = halves.join("trials");
        std::thread::scope(|scope| {
            scope.spawn(move || {
                let begun = std::time::Instant::now();
                while !trials.join(format!("{done:04}/rows")).exists() && begun.elapsed().as_secs() < 60 {
                    std::thread::sleep(std::time::Duration::from_millis(1));
                }
                stopper.request();
            });
            run.run(2, &interrupt, |_| ()).unwrap();
        });
    }
    finish(&search, &halves, 3);
    assert_eq!(log_of(&halves), log_of(&whole));
    let written = fs::metadata(halves.join("trials/0000/study.json")).unwrap().modified().unwrap();
    assert!(fs::metadata(halves.join(log::FILE)).unwrap().modified().unwrap() >= written);
}

#[test]
fn a_worse_trial_never_gets_more_seeds_than_a_better_one_of_its_batch() {
    let place = tempfile::tempdir().unwrap();
    let trials = finish(&search(&["objective=final_return"]), place.path(), 2);
    assert_eq!(trials[..4].iter().filter(|trial| trial.seeds == 2).count(), 2);
    assert_eq!(trials[4..].iter().filter(|trial| trial.seeds == 2).count(), 1);
    // On the seed that all have flown.
    let search = search(&["objective=final_return"]);
    let early = |trial: &Trial| {
        let (study, path) = (search.study(&trial.point, 1).unwrap(), place.path().join("early"));
        let directory = [StudyDirectory::open_trial(&study, &path.join(trial.number.to_string())).unwrap()];
        runner::run(&directory, 2, &Interrupt::default(), &ranks::alone()).unwrap();
        search.objective.of(&study, &StudyData::load(directory[0].path()).unwrap())
    };
    let (climbed, stayed): (Vec<&Trial>, Vec<&Trial>) = trials[..4].iter().partition(|trial| trial.rungs == 2);
    for trial in stayed {
        assert_eq!(early(trial), trial.objective);
        assert!(climbed.iter().all(|other| early(other) >= trial.objective));
    }
}

#[test]
fn more_trials_may_be_asked_for_and_nothing_else() {
    let place = tempfile::tempdir().unwrap();
    finish(&search(&["trials=4"]), place.path(), 2);
    let more = finish(&search(&[]), place.path(), 2);
    let whole = tempfile::tempdir().unwrap();
    assert_eq!(more, finish(&search(&[]), whole.path(), 2));
    let refusal = |overrides: &[&str]| {
        let error = SearchRun::open(&search(overrides), place.path()).unwrap_err().to_string();
        error.replace(&place.path().display().to_string(), "search")
    };
    assert!(refusal(&["seed=4"]).contains("found `seed: 0`, expected `seed: 4` as the study now says"));
    assert!(refusal(&["seeds.count=3"]).contains("found `count: 2`, expected `count: 3`"));
}

#[test]
fn other_directories_are_left_alone() {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("thesis.tex"), "").unwrap();
    let error = SearchRun::open(&search(&[]), place.path()).unwrap_err().to_string();
    assert!(error.contains("is not empty and holds no search"), "{error}");
}
