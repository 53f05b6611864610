//! A short training run on the example task gets better, and the same everywhere.

use std::path::Path;

use kestrel_experiments::drone_environment::Trainer;
use kestrel_experiments::evaluation::{Evaluation, Flyer, Starts, evaluate};
use kestrel_experiments::experiment_config::{Experiment, load_to_train};
use kestrel_sim::seed::Purpose;

fn hover(overrides: &[&str]) -> Experiment {
    experiment("hover.yaml", overrides)
}

fn experiment(file: &str, overrides: &[&str]) -> Experiment {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs").join(file);
    let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
    load_to_train(&path, &overrides).unwrap()
}

fn trained(experiment: &Experiment) -> Trainer {
    let mut trainer =
        Trainer::new(std::slice::from_ref(&experiment.scenario), &experiment.training.ppo, experiment.seed);
    while trainer.steps() < experiment.training.ppo.total_steps {
        trainer.update();
    }
    trainer
}

fn fly(experiment: &Experiment, flyer: Flyer<'_>) -> Evaluation {
    let starts = Starts { seed: experiment.evaluation.seed, purpose: Purpose::Evaluation, episodes: 128 };
    evaluate(&experiment.evaluation.scenario, flyer, starts)
}

#[test]
fn the_scripted_pilot_survives_where_doing_nothing_and_chance_do_not() {
    let experiment = experiment("hover-cf2x.yaml", &[]);
    let lost = |evaluation: &Evaluation| {
        evaluation.endings.iter().filter(|(ending, _)| ending.is_failure()).map(|(_, count)| count).sum::<usize>()
    };
    assert!(lost(&fly(&experiment, Flyer::Nothing)) > 120);
    assert!(lost(&fly(&experiment, Flyer::Random)) > 120);
    assert!(lost(&fly(&experiment, Flyer::Scripted)) < 8);
}

#[test]
fn a_short_training_beats_the_trivial_baselines() {
    let experiment =
        hover(&["training.environments=256", "training.minibatch=2048", "training.total_steps=1048576"]);
    let trainer = trained(&experiment);
    let trained = fly(&experiment, Flyer::Actor(trainer.actor()));
    assert!(trained.length_secs > 2.0 * fly(&experiment, Flyer::Nothing).length_secs, "{trained:?}");
    assert!(trained.length_secs > 2.0 * fly(&experiment, Flyer::Random).length_secs, "{trained:?}");
}

#[test]
fn two_drones_learn_one_policy_for_two_places() {
    let overrides = [
        "training.environments=256",
        "training.minibatch=2048",
        "training.total_steps=393216",
        "scenario.start.position={around_goal: {farthest_m: 0.15}}",
        "scenario.start.tilt_limit_deg=10",
    ];
    let experiment = experiment("aviaries/multi-hover.yaml", &overrides);
    let trainer = trained(&experiment);
    let trained = fly(&experiment, Flyer::Actor(trainer.actor()));
    // From each start fly both.
    assert_eq!(trained.episodes, 256);
    for other in [Flyer::Nothing, Flyer::Random] {
        let untrained = fly(&experiment, other);
        assert!(trained.return_interval[0] > untrained.return_interval[1], "{trained:?}\n{untrained:?}");
    }
}

#[test]
fn an_evaluation_does_not_depend_on_the_number_of_threads() {
    let experiment = hover(&[]);
    let with_threads = |count| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().unwrap();
        pool.install(|| fly(&experiment, Flyer::Random))
    };
    assert_eq!(with_threads(1), with_threads(2));
    assert_eq!(with_threads(1), with_threads(7));
}
