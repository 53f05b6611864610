//! A policy that pays for its divergence from a teacher.

use std::sync::Arc;

use kestrel_sim::contact::WayMap;
use kestrel_sim::world::Cuboid;

use super::special_cases::policy_gradient;
use super::*;
use crate::teacher::{Teacher, TeacherSettings};

/// [`scenario`] with the map of its free ways.
fn mapped() -> Scenario {
    let free = scenario(CriticView::Observation);
    let bounds = Cuboid { low: Vector3::new(-1.0, -1.0, 0.0), high: Vector3::new(1.0, 1.0, 2.0) };
    let ways = Arc::new(WayMap::new(&free.aviary.world, &free.aviary.goal, bounds, CF2X.collision_radius));
    let advance = WeightedTerm::new(RewardTerm::Advance(ways), 1.0);
    Scenario { rewards: [free.rewards, vec![advance]].concat(), ..free }
}

fn taught(weight: f32, until: f32) -> PpoSettings {
    let settings = settings();
    let total_steps = 8 * settings.batch() as u64;
    PpoSettings { teacher: Some(TeacherSettings { weight, until }), total_steps, ..settings }
}

fn after(updates: u32, settings: &PpoSettings) -> Trainer {
    let mut trainer = Trainer::new(&[mapped()], settings, Seed(31));
    (0..updates).for_each(|_| drop(trainer.update()));
    trainer
}

/// Mean squared difference between what a policy means to do and what the teacher would, in states of a rollout.
fn distance(actor: &Actor, rollout: &Rollout) -> f32 {
    let tile = rollout.tile(3);
    let values = &tile.sight.values[..actor.mlp().inputs() * PANEL];
    let mut means = vec![0.0; tile.actions.len()];
    actor.act_mean(Sight::blind(values), &mut means);
    let squares = means.iter().zip(tile.lessons).map(|(mean, lesson)| (mean - lesson) * (mean - lesson));
    squares.sum::<f32>() / means.len() as f32
}

/// All that a run goes on with, in bits: states may hold what is not a number.
fn bits(trainer: &Trainer) -> Vec<u8> {
    postcard::to_allocvec(&trainer.save()).expect("a state serialises")
}

#[test]
fn a_policy_becomes_like_its_teacher() {
    let fast = PpoSettings { learning_rate: Schedule::Constant(1e-2), epochs: 8, ..taught(10.0, 1.0) };
    let (first, last) = (after(0, &fast), after(7, &fast));
    let rollout = last.panels[0].rollout();
    let distances = [&first, &last].map(|trainer| distance(trainer.actor(), rollout));
    assert!(distances[1] < 0.3 * distances[0], "{distances:?}");
}

#[test]
fn what_a_teacher_says_is_about_the_state_that_the_policy_saw() {
    let mut trainer = after(2, &taught(10.0, 1.0));
    let states: Vec<_> = (0..PANEL).map(|row| trainer.panels[0].simulation().state(row)).collect();
    trainer.collect();
    let mut teacher = Teacher::of(&mapped()).expect("it has a map");
    let tile = trainer.panels[0].rollout().tile(0);
    for (column, state) in states.iter().enumerate() {
        let said: Vec<f32> = tile.lessons.chunks_exact(PANEL).map(|row| row[column]).collect();
        assert_eq!(said, teacher.act(state)[..said.len()]);
    }
}

#[test]
fn behind_its_share_of_the_training_nobody_teaches() {
    let batch = settings().batch() as u64;
    let trainer = after(4, &taught(10.0, 0.5));
    assert_eq!(trainer.steps(), 4 * batch);
    let mut alone = trainer.clone();
    alone.settings.teacher = None;
    let mut trainer = trainer;
    for trainer in [&mut trainer, &mut alone] {
        trainer.update();
    }
    assert_eq!(bits(&trainer), bits(&alone));
    assert_ne!(bits(&after(4, &taught(5.0, 0.5))), bits(&after(4, &taught(10.0, 0.5))));
}

#[test]
fn a_taught_run_goes_on_to_the_same_bits_on_any_number_of_threads() {
    let settings = taught(10.0, 0.7);
    let expected = bits(&after(4, &settings));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("a pool");
    let found = pool.install(|| {
        let half = after(2, &settings).save();
        let mut resumed = Trainer::restore(&[mapped()], &settings, half).expect("the same run");
        (0..2).for_each(|_| drop(resumed.update()));
        bits(&resumed)
    });
    assert_eq!(found, expected);
}

#[test]
fn the_gradient_has_the_divergence_from_the_teacher() {
    let mut trainer = after(2, &taught(3.0, 1.0));
    trainer.collect();
    trainer.normalise_advantages();
    assert!(trainer.lesson_weight > 1.0);
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
    trainer.lesson_weight = 0.0;
    trainer.differentiate(&all);
    assert_ne!(found, trainer.gradient.actor);
}
