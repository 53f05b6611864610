//! Tasks that are broken on purpose: training says what is wrong with them.

use std::path::Path;

use kestrel_experiments::diagnosis::{Cause, of_run};
use kestrel_experiments::experiment_config::load_to_train;
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::results::{evaluate_run, export_policy};
use kestrel_experiments::run_config::Subject;
use kestrel_experiments::run_directory::RunDirectory;
use kestrel_experiments::training_run::TrainingRun;

/// A defect: the task, what is changed in it, and the key that is to blame.
type Defect = (&'static str, &'static [&'static str], &'static str);

const DEFECTS: [Defect; 12] = [
    ("takeoff", &["training.learning_rate={constant: 0.2}"], "training.learning_rate"),
    ("takeoff", &["training.learning_rate={constant: 1.0e-7}"], "training.learning_rate"),
    ("takeoff", &["training.initial_log_std=-2.9"], "training.initial_log_std"),
    ("takeoff", &["training.entropy_weight=0.3"], "training.entropy_weight"),
    ("takeoff", &["training.discount=0.5"], "training.discount"),
    ("takeoff", &["training.gradient_norm_limit=1.0e-7"], "training.gradient_norm_limit"),
    ("takeoff", &["training.total_steps=65536"], "training.total_steps"),
    (
        "takeoff",
        &["scenario.rewards=[alive: {weight: 2.0}, tilt: {weight: -0.2}, failure: {weight: -2.0}]"],
        "scenario.rewards",
    ),
    ("takeoff", &["scenario.observation.body.position_scale_m=500"], "scenario.observation.body.position_scale_m"),
    (
        "incremental-cross-1",
        &["scenario.rewards=[advance: {weight: 2.0}, success: {weight: 10.0}, failure: {weight: -200.0}]"],
        "scenario.rewards[2].failure.weight",
    ),
    ("incremental-cross-1", &["scenario.episode_secs=1"], "scenario.episode_secs"),
    (
        "fly-through-gate",
        &["scenario.rewards=[progress: {weight: 2.0}, success: {weight: 10.0}, alive: {weight: -30.0}]"],
        "scenario.rewards[2].alive.weight",
    ),
];

/// What training for a few seconds says of a task.
fn causes(task: &str, changes: &[&str]) -> Vec<Cause> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../configs/aviaries/{task}.yaml"));
    let few = [
        "training.environments=256",
        "training.minibatch=1024",
        "training.total_steps=196608",
        "evaluation.episodes=64",
    ];
    let overrides: Vec<String> = few.iter().chain(changes).map(ToString::to_string).collect();
    let experiment = load_to_train(&path, &overrides).unwrap();
    let place = tempfile::tempdir().unwrap();
    let directory = RunDirectory::create(&place.path().join("run"), &experiment.resolved_yaml).unwrap();
    let mut run = TrainingRun::begin(experiment, directory).unwrap();
    run.train(&Interrupt::default()).unwrap();
    let subject = Subject::of(run.experiment());
    let (actor, steps) = run.best();
    export_policy(&subject, run.directory(), actor, steps).unwrap();
    of_run(&subject, run.directory(), &evaluate_run(&subject, run.directory()).unwrap()).unwrap()
}

#[test]
fn training_names_the_key_that_breaks_a_task() {
    let missed = DEFECTS.iter().filter_map(|(task, changes, key)| {
        let causes = causes(task, changes);
        let said: Vec<String> = causes.iter().map(ToString::to_string).collect();
        let named = causes.iter().any(|cause| cause.key == *key);
        (!named).then(|| format!("{task} with {changes:?}: {said:#?}"))
    });
    let missed: Vec<String> = missed.collect();
    assert!(missed.is_empty(), "{}", missed.join("\n"));
}

#[test]
fn a_task_that_is_learned_has_no_causes() {
    let changes = ["training.minibatch=2048", "training.total_steps=819200"];
    assert_eq!(causes("fly-through-gate", &changes), []);
}
