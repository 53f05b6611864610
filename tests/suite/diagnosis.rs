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

const DEFECTS: [Defect; 14] = [
    ("hover-cf2x", &["training.learning_rate={constant: 0.2}"], "training.learning_rate"),
    ("hover-cf2x", &["training.learning_rate={constant: 1.0e-7}"], "training.learning_rate"),
    ("hover-cf2x", &["training.initial_log_std=-2.9"], "training.initial_log_std"),
    ("hover-cf2x", &["training.entropy_weight=0.3"], "training.entropy_weight"),
    ("hover-cf2x", &["training.discount=0.5"], "training.discount"),
    ("hover-cf2x", &["training.gradient_norm_limit=1.0e-7"], "training.gradient_norm_limit"),
    ("hover-cf2x", &["training.total_steps=8192"], "training.total_steps"),
    (
        "hover-cf2x",
        &["scenario.rewards=[alive: {weight: 2.0}, tilt: {weight: -0.2}, failure: {weight: -2.0}]"],
        "scenario.rewards",
    ),
    (
        "hover-cf2x",
        &["scenario.observation.pilot.position_scale_m=500"],
        "scenario.observation.pilot.position_scale_m",
    ),
    ("hover-cf2x", &["scenario.terminations=[roll_pitch: {limit_deg: 1}]"], "scenario.start"),
    (
        "aviaries/incremental-cross-1",
        &["scenario.rewards=[success: {weight: 10.0}, failure: {weight: -2.0}]", "training.teacher=null"],
        "scenario.rewards",
    ),
    ("aviaries/incremental-cross-1", &["scenario.episode_secs=1"], "scenario.episode_secs"),
    (
        "aviaries/incremental-cross-1",
        &["scenario.observation={pilot: {position_scale_m: 6.0}}", "training.teacher=null"],
        "scenario.observation",
    ),
    (
        "aviaries/fly-through-gate",
        &["scenario.rewards=[progress: {weight: 2.0}, success: {weight: 10.0}, alive: {weight: -30.0}]"],
        "scenario.rewards[2].alive.weight",
    ),
];

/// What training for a few seconds says of a task.
fn causes(task: &str, changes: &[&str]) -> Vec<Cause> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../configs/{task}.yaml"));
    let few = [
        "training.environments=256",
        "training.steps_per_rollout=8",
        "training.minibatch=512",
        "training.total_steps=49152",
        "training.actor_hidden=[16]",
        "training.critic_hidden=[16]",
        "evaluation.episodes=32",
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
    let mut reports = evaluate_run(&subject, run.directory()).unwrap();
    let causes = of_run(&subject, run.directory(), &reports).unwrap();
    reports[0].rows[0].success_rate = 1.0;
    assert_eq!(of_run(&subject, run.directory(), &reports).unwrap(), [], "of a policy that succeeds");
    causes
}

#[test]
fn training_names_the_key_that_breaks_a_task() {
    // One thread: so small a rollout is over before others wake up.
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let missed = DEFECTS.iter().filter_map(|(task, changes, key)| {
        let causes = one.install(|| causes(task, changes));
        let said: Vec<String> = causes.iter().map(ToString::to_string).collect();
        let named = causes.iter().any(|cause| cause.key == *key);
        (!named).then(|| format!("{task} with {changes:?}: {said:#?}"))
    });
    let missed: Vec<String> = missed.collect();
    assert!(missed.is_empty(), "{}", missed.join("\n"));
}
