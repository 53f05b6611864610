//! A short training run on the example task gets better, and the same everywhere.

use std::path::Path;

use kestrel_sim::seed::Purpose;
use kestrel_train::evaluation::{Evaluation, Flyer, Starts, evaluate};
use kestrel_train::experiment_config::{Experiment, load};
use kestrel_train::ppo::Trainer;

fn hover(overrides: &[&str]) -> Experiment {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/hover.yaml");
    let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
    load(&path, &overrides).unwrap()
}

fn fly(experiment: &Experiment, flyer: Flyer<'_>) -> Evaluation {
    let starts = Starts { seed: experiment.evaluation.seed, purpose: Purpose::Evaluation, episodes: 128 };
    evaluate(&experiment.evaluation.scenario, flyer, starts)
}

#[test]
fn the_scripted_pilot_survives_where_doing_nothing_and_chance_do_not() {
    let experiment = hover(&[]);
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
        hover(&["training.environments=256", "training.minibatch=2048", "training.total_steps=524288"]);
    let mut trainer = Trainer::new(&experiment.scenario, &experiment.ppo, experiment.seed);
    while trainer.steps() < experiment.ppo.total_steps {
        trainer.update();
    }
    let trained = fly(&experiment, Flyer::Actor(trainer.actor()));
    assert!(trained.length_secs > 2.0 * fly(&experiment, Flyer::Nothing).length_secs, "{trained:?}");
    assert!(trained.length_secs > 2.0 * fly(&experiment, Flyer::Random).length_secs, "{trained:?}");
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
