//! A policy that learns from a teacher.

use super::special_cases::policy_gradient;
use super::*;

/// [`task`] with a teacher.
fn taught() -> Task {
    Task { has_teacher: true, ..task(false) }
}

fn with_teacher(weight: f32, until: f32) -> PpoSettings {
    let settings = settings();
    let total_steps = 8 * settings.batch() as u64;
    PpoSettings { teacher: Some(TeacherSettings { weight, until }), total_steps, ..settings }
}

fn after(updates: u32, settings: &PpoSettings) -> Trainer {
    let mut trainer = Trainer::new(&[taught()], settings, Seed(31));
    (0..updates).for_each(|_| drop(trainer.update()));
    trainer
}

/// Mean squared difference between what a policy means to do and what the teacher would, in states of a rollout.
fn distance(actor: &Actor, rollout: &Rollout) -> f32 {
    let slice = rollout.slice(3);
    let values = &slice.batch.values[..actor.mlp().inputs() * ENV_BATCH];
    let mut means = vec![0.0; slice.actions.len()];
    actor.act_mean(InputBatch::without_images(values), &mut means);
    let squares = means.iter().zip(slice.teacher_actions).map(|(mean, action)| (mean - action) * (mean - action));
    squares.sum::<f32>() / means.len() as f32
}

/// All that a run goes on with, in bits: states may hold what is not a number.
fn bits(trainer: &Trainer) -> Vec<u8> {
    postcard::to_allocvec(&trainer.save()).expect("a state serialises")
}

#[test]
fn a_policy_becomes_like_its_teacher() {
    let fast = PpoSettings { learning_rate: Schedule::Constant(1e-2), epochs: 8, ..with_teacher(10.0, 1.0) };
    let (first, last) = (after(0, &fast), after(7, &fast));
    let rollout = last.env_batches[0].rollout();
    let distances = [&first, &last].map(|trainer| distance(trainer.actor(), rollout));
    assert!(distances[1] < 0.3 * distances[0], "{distances:?}");
}

#[test]
fn what_a_teacher_says_is_about_the_state_that_the_policy_observed() {
    let mut trainer = after(2, &with_teacher(10.0, 1.0));
    let points = trainer.env_batches[0].environment().points().to_vec();
    trainer.collect();
    let slice = trainer.env_batches[0].rollout().slice(0);
    for (column, point) in points.iter().enumerate() {
        let said: Vec<f32> = slice.teacher_actions.chunks_exact(ENV_BATCH).map(|row| row[column]).collect();
        assert_eq!(said, Probe::teacher_action(point));
    }
}

#[test]
fn behind_its_share_of_the_training_there_is_no_teacher() {
    let batch = settings().batch() as u64;
    let trainer = after(4, &with_teacher(10.0, 0.5));
    assert_eq!(trainer.steps(), 4 * batch);
    let mut alone = trainer.clone();
    alone.settings.teacher = None;
    let mut trainer = trainer;
    for trainer in [&mut trainer, &mut alone] {
        trainer.update();
    }
    assert_eq!(bits(&trainer), bits(&alone));
    assert_ne!(bits(&after(4, &with_teacher(5.0, 0.5))), bits(&after(4, &with_teacher(10.0, 0.5))));
}

#[test]
fn a_run_with_a_teacher_goes_on_to_the_same_bits_on_any_number_of_threads() {
    let settings = with_teacher(10.0, 0.7);
    let expected = bits(&after(4, &settings));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("a pool");
    let found = pool.install(|| {
        let half = after(2, &settings).save();
        let mut resumed = Trainer::restore(&[taught()], &settings, half).expect("the same run");
        (0..2).for_each(|_| drop(resumed.update()));
        bits(&resumed)
    });
    assert_eq!(found, expected);
}

#[test]
fn the_gradient_has_the_divergence_from_the_teacher() {
    let mut trainer = after(2, &with_teacher(3.0, 1.0));
    trainer.collect();
    trainer.normalise_advantages();
    assert!(trainer.imitation_weight > 1.0);
    let all = trainer.shuffled(0);
    trainer.differentiate(&all);
    let found = trainer.gradient.actor.clone();
    let expected = policy_gradient(&trainer);
    let norm = expected.iter().map(|value| value * value).sum::<f64>().sqrt();
    // The entropy's gradient is not in the expected one.
    let compared = trainer.actor.log_std_places().start;
    for (index, (found, expected)) in found.iter().zip(&expected).take(compared).enumerate() {
        let error = (f64::from(*found) - expected).abs();
        assert!(error < 1e-5 * norm + 1e-4 * expected.abs(), "{index}: {found}, not {expected}");
    }
    trainer.imitation_weight = 0.0;
    trainer.differentiate(&all);
    assert_ne!(found, trainer.gradient.actor);
}
