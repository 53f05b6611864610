use std::fs;

use super::*;
use crate::golden::{Messages, assert_golden, in_repository};

/// The shortest file: everything else has a default.
pub(crate) const MINIMAL: &str = "\
version: 1
name: trial
tasks:
  - version: 1
    name: low
    scenario: &scenario
      aviary:
        goal_m: [0, 0, 1]
      start:
        position:
          around_goal: {farthest_m: 0.5}
        tilt_limit_deg: 10
      rewards:
        - proximity: {weight: 1, scale_m: 0.5}
      terminations:
        - collision
      success:
        settle: {radius_m: 0.05, within_secs: 4}
  - version: 1
    name: high
    scenario: *scenario
";

/// The shortest file with trainings of two updates a task, after overrides.
pub(crate) fn tiny(overrides: &[&str]) -> Study {
    const TINY: [&str; 10] = [
        "training.environments=256",
        "training.steps_per_rollout=16",
        "training.minibatch=1024",
        "training.total_steps=8192",
        "training.epochs=2",
        "training.actor_hidden=[8]",
        "training.critic_hidden=[8]",
        "evaluation.episodes=3",
        "evaluation.flights_per_stage=2",
        "evaluation.flight_episodes=2",
    ];
    let overrides: Vec<String> = TINY.iter().chain(overrides).map(|text| (*text).to_owned()).collect();
    from_document(Document::parse("trial.yaml", MINIMAL).unwrap(), &overrides).unwrap()
}

#[test]
fn wrong_files_get_their_messages() {
    let check = |document, overrides: &[String]| from_document(document, overrides).map(drop);
    let messages = Messages { minimal: MINIMAL, check };
    messages.assert_golden("trainer-host/experiments/src/study/config/multi_task/messages.txt", 9);
}

#[test]
fn the_schema_is_the_one_in_the_repository() {
    assert_golden("configs/tasks-schema.json", &schema());
}

#[test]
fn the_shipped_file_trains_as_the_joint_method_of_its_study() {
    let path = in_repository("configs/crosses.yaml");
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.starts_with("# yaml-language-server: $schema=tasks-schema.json\n"));
    let shipped = load(&path, &[]).unwrap();
    let study = super::super::load(&in_repository("configs/studies/crosses.yaml"), &[]).unwrap();
    let joint = study.methods.iter().position(|method| method.name == "joint").unwrap();
    assert_eq!(&shipped.training, study.training_of(joint));
    assert_eq!(shipped.methods[0].procedure, study.methods[joint].procedure);
    assert_eq!(shipped.evaluation, study.evaluation);
    let names = |study: &Study| study.tasks.iter().map(|task| task.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&shipped), names(&study));
}

#[test]
fn every_task_is_judged_from_as_many_starts_of_the_same_seed() {
    let study = tiny(&["evaluation.seed=7"]);
    assert!(study.tasks.iter().all(|task| task.evaluation.episodes == 3 && task.evaluation.seed == Seed(7)));
    let again = Document::parse("again.yaml", &study.resolved_yaml).unwrap();
    assert_eq!(from_document(again, &[]).unwrap(), study, "the resolved file is the same");
}
