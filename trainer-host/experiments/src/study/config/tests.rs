use kestrel_core::action::ActionSpace;
use kestrel_core::airframe::CF2X;
use kestrel_learn::schedule::Schedule;
use kestrel_sim::latency::Latency;
use kestrel_sim::seed::Seed;
use kestrel_sim::termination::Termination;

use super::*;
use crate::golden::{Messages, assert_golden, in_repository};
use crate::study::JobId;
use kestrel_learn::ppo::{CriticScope, PpoSettings, ValueScaling};

/// The shortest study: everything else has a default.
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
methods:
  - name: plain
    learn:
      sequential: {}
";

/// The study `text`, after overrides.
pub(crate) fn study(text: &str, overrides: &[&str]) -> Result<Study, ConfigError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trial.yaml");
    std::fs::write(&path, text).unwrap();
    load(&path, &overrides.iter().map(|text| (*text).to_owned()).collect::<Vec<_>>())
}

/// The shortest study with trainings of two updates a task, after overrides.
pub(crate) fn tiny(overrides: &[&str]) -> Study {
    const TINY: [&str; 11] = [
        "seeds.count=1",
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
    study(MINIMAL, &[&TINY[..], overrides].concat()).unwrap()
}

#[test]
fn wrong_studies_get_their_messages() {
    let check = |document, overrides: &[String]| from_document(document, overrides).map(drop);
    let messages = Messages { minimal: MINIMAL, check };
    messages.assert_golden("trainer-host/experiments/src/study/config/messages.txt", 40);
}

#[test]
fn methods_that_keep_states_are_refused_where_policies_see() {
    let consolidator =
        |name: &str| format!("methods=[{{name: a, learn: {{sequential: {{consolidator: {name}}}}}}}]");
    let with = |method: &str| {
        load(&in_repository("configs/studies/vision.yaml"), &["claims=[]".to_owned(), method.to_owned()])
    };
    for method in [consolidator("none"), "methods=[{name: a, learn: {joint: {}}}]".to_owned()] {
        assert!(with(&method).is_ok(), "{method}");
    }
    for method in [consolidator("{coreset: {strength: 1}}"), "methods=[{name: a, learn: {distil: {}}}]".to_owned()]
    {
        let error = with(&method).expect_err("it knows no images").to_string();
        assert!(error.contains("learn: found tasks with a camera, expected `sequential` without"), "{error}");
    }
}

#[test]
fn only_experts_of_their_own_training_may_see_other_things() {
    let other = "tasks.1.scenario.observation={pilot: {position_scale_m: 3}}";
    let own = "{name: own, learn: {experts: {own_training: true}}}";
    assert!(study(MINIMAL, &[other, &format!("methods=[{own}]")]).is_ok());
    let refused = |methods: &str, expected: &str| {
        let error = study(MINIMAL, &[other, methods]).map(drop).expect_err(methods).to_string();
        assert!(error.contains(expected), "{error}");
    };
    refused("methods=[{name: a, learn: {experts: {}}}]", "found another observation, expected the observation of");
    refused(&format!("methods=[{own}, {{name: a, learn: {{joint: {{}}}}}}]"), "one policy flies them all");
    let with_training = "methods=[{name: a, learn: {experts: {own_training: true}}, training: {}}]";
    refused(with_training, "found `training` beside `own_training`");
    let memory = "tasks.1.training={memory: {units: 4}, analytic: {environments: 128, steps_per_window: 8, total_steps: 5}}";
    let error = study(MINIMAL, &[&format!("methods=[{own}]"), memory]).map(drop).expect_err(memory).to_string();
    assert!(error.contains("tasks.1.training"), "{error}");
}

#[test]
fn boundaries_are_not_to_be_found_by_gradients() {
    let found = "methods.0.learn={sequential: {consolidator: {compact_coreset: {boundaries: found}}}}";
    assert!(study(MINIMAL, &[found]).is_ok());
    let analytic = "training.analytic={environments: 128, steps_per_window: 8}";
    let error = study(MINIMAL, &[found, analytic]).map(drop).expect_err("too few drones").to_string();
    assert!(error.contains("found `boundaries: found` beside `analytic`, expected PPO"), "{error}");
}

#[test]
fn the_schema_is_the_one_in_the_repository() {
    assert_golden("configs/studies/schema.json", &schema());
}

#[test]
fn every_study_of_the_repository_is_sound_and_names_the_schema() {
    for entry in std::fs::read_dir(in_repository("configs/studies")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "yaml") {
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(text.starts_with("# yaml-language-server: $schema="), "{}", path.display());
            if let Err(error) = load(&path, &[]) {
                panic!("{error}");
            }
        }
    }
}

/// Most of RESULTS.md was found on the drone of gym-pybullet-drones, in rooms whose tables may be rammed.
#[test]
fn every_study_keeps_the_drone_on_which_it_was_run() {
    for entry in std::fs::read_dir(in_repository("configs/studies")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "yaml") {
            continue;
        }
        let study = load(&path, &[]).unwrap();
        if ["crosses-by-gradients", "unseen-worlds"].contains(&study.name.as_str()) {
            // Those that were run on the drone that exists.
            assert!(study.tasks.iter().all(|task| task.scenario.latency != Latency::NONE));
            continue;
        }
        let untaught = ["rooms", "rooms-methods", "landings"].contains(&study.name.as_str());
        for task in study.tasks {
            let scenario = task.scenario;
            let name = path.display();
            if untaught {
                let before = (None, Schedule::Linear { from: 3.0e-3, to: 3.0e-4 });
                assert_eq!(
                    (task.training.ppo.teacher, task.training.ppo.learning_rate),
                    before,
                    "{name}: no directory of before resumes"
                );
            }
            assert_eq!(scenario.latency, Latency::NONE, "{name}");
            assert_eq!(scenario.randomisation.wind_speed, 0.0, "{name}");
            assert!(!matches!(scenario.action, ActionSpace::IntegralVelocities(_)), "{name}");
            assert!(!scenario.terminations.iter().any(|rule| matches!(rule, Termination::Impact(_))), "{name}");
            assert_eq!(scenario.airframe.mass, CF2X.mass, "{name}");
        }
    }
}

#[test]
fn the_study_of_teams_differs_in_the_critic_only() {
    let study = load(&in_repository("configs/studies/mappo.yaml"), &[]).expect("it is in the repository");
    let critic = |method: usize| {
        let training = &study.training_of(method).ppo;
        (study.methods[method].name.as_str(), training.critic_scope, training.value_scale)
    };
    let expected = [
        ("ippo", CriticScope::Own, ValueScaling::Fixed),
        ("ippo-popart", CriticScope::Own, ValueScaling::PopArt),
        ("mappo", CriticScope::Team, ValueScaling::PopArt),
    ];
    assert_eq!([0, 1, 2].map(critic), expected);
    let plain = &study.training_of(0).ppo;
    for method in 1..3 {
        let (critic_scope, value_scale) = (plain.critic_scope, plain.value_scale);
        let alike = PpoSettings { critic_scope, value_scale, ..study.training_of(method).ppo.clone() };
        assert_eq!(&alike, plain);
    }
}

#[test]
fn a_minimal_study_has_its_defaults() {
    let study = study(MINIMAL, &[]).unwrap();
    assert_eq!((study.orders.clone(), study.seeds.len(), study.seeds[15]), (vec![vec![0, 1]], 16, Seed(15)));
    assert_eq!((study.evaluation.episodes, study.evaluation.flights_per_stage), (100, 10));
    assert_eq!(study.jobs().len(), 16);
}

#[test]
fn a_resolved_study_loads_to_the_same_study() {
    let overrides = ["orders=all", "seeds.first=7", "methods.0.learn.sequential.consolidator={coreset: {}}"];
    let found = study(MINIMAL, &overrides).unwrap();
    assert_eq!(study(&found.resolved_yaml, &[]).unwrap(), found);
}

#[test]
fn all_orders_come_in_lexical_order() {
    assert_eq!(permutations(3), [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]]);
    assert_eq!(permutations(5).len(), 120);
}

#[test]
fn orders_may_be_listed_by_name_and_need_not_hold_every_task() {
    let found = study(MINIMAL, &["orders={these: [[high, low], [low]]}"]).unwrap();
    assert_eq!(found.orders, [vec![1, 0], vec![0]]);
}

#[test]
fn who_knows_no_order_learns_the_first_alone() {
    let found = study(MINIMAL, &["orders=all", "seeds.count=2", "methods.0.learn={joint: {}}"]).unwrap();
    let jobs: Vec<JobId> = found.jobs();
    assert_eq!(jobs, [0, 1].map(|seed| JobId { seed, order: 0, method: 0 }));
}

#[test]
fn a_critic_of_teams_reads_teams_of_one_size() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("study.yaml");
    let task = |name: &str| in_repository(&format!("configs/aviaries/{name}.yaml")).display().to_string();
    let text = format!(
        "version: 1\nname: trial\ntasks: [ {{ import: {} }}, {{ import: {} }} ]\n\
         methods: [ {{ name: joint, learn: {{ joint: {{}} }}, training: {{ critic_scope: team }} }} ]\n",
        task("multi-hover"),
        task("hover")
    );
    std::fs::write(&path, text).expect("it can be written");
    let message = load(&path, &[]).expect_err("it must be refused").to_string();
    let expected = "found `team` beside teams of 2 and 1, expected `own`, or tasks of equally many drones: one critic \
                    reads them all";
    assert!(message.contains(expected), "{message}");
    assert!(load(&path, &["methods.0.training.critic_scope=own".to_owned()]).is_ok());
}
