use super::*;
use crate::golden::{Messages, assert_golden, in_repository};
use crate::search::space::Values;

/// A search in a study of trainings of two updates.
pub(crate) const MINIMAL: &str = "\
version: 1
name: trial
study:
  version: 1
  name: inner
  tasks:
    - version: 1
      name: low
      scenario:
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
  seeds: {first: 3, count: 5}
  training:
    environments: 256
    steps_per_rollout: 16
    minibatch: 1024
    total_steps: 8192
    epochs: 2
    actor_hidden: [8]
    critic_hidden: [8]
  evaluation: {episodes: 2, flights_per_stage: 2, flight_episodes: 2}
  methods:
    - name: plain
      learn:
        sequential: {consolidator: {anchor: {strength: {fixed: 1}}}}
space:
  training.clip_range: {uniform: {low: 0.1, high: 0.4}}
  training.epochs: {whole: {low: 1, high: 3}}
  methods.0.learn.sequential.consolidator.anchor.strength.fixed: {log_uniform: {low: 0.01, high: 100}}
  methods.0.learn.sequential.consolidator.anchor.curvature: {choice: [fisher, identity]}
trials: 6
batch: 4
seeds: {count: 2}
";

/// The minimal search after overrides.
pub(crate) fn search(overrides: &[&str]) -> Search {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trial.yaml");
    std::fs::write(&path, MINIMAL).unwrap();
    load(&path, &overrides.iter().map(|text| (*text).to_owned()).collect::<Vec<_>>()).unwrap()
}

#[test]
fn wrong_searches_get_their_messages() {
    let check = |document, overrides: &[String]| from_document(document, overrides).map(drop);
    let messages = Messages { minimal: MINIMAL, check };
    messages.assert_golden("trainer-host/experiments/src/search/config/messages.txt", 30);
}

#[test]
fn the_schema_is_the_one_in_the_repository() {
    assert_golden("configs/searches/schema.json", &schema());
}

#[test]
fn every_search_of_the_repository_is_sound_and_names_the_schema() {
    for entry in std::fs::read_dir(in_repository("configs/searches")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "yaml") {
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(text.starts_with("# yaml-language-server: $schema=schema.json\n"), "{}", path.display());
            if let Err(error) = load(&path, &[]) {
                panic!("{error}");
            }
        }
    }
}

#[test]
fn seeds_are_not_those_of_the_study_unless_asked_for() {
    assert_eq!(search(&[]).first_seed, 8);
    assert_eq!(search(&["seeds={first: 3}"]).first_seed, 3);
    let study = search(&[]).study(&[0.0; 4], 2).unwrap();
    assert_eq!(study.seeds, [Seed(8), Seed(9)]);
}

#[test]
fn a_point_is_the_study_with_its_values() {
    let search = search(&[]);
    let keys: Vec<&str> = search.space.iter().map(|dimension| dimension.key.as_str()).collect();
    assert_eq!(keys[3], "training.epochs");
    assert_eq!(search.space[0].values, Values::Choice(["fisher", "identity"].map(str::to_owned).to_vec()));
    let study = search.study(&[0.75, 0.5, 1.0, 0.5], 1).unwrap();
    assert_eq!((study.training.ppo.clip_range, study.training.ppo.epochs), (0.4, 2));
    let expected =
        load_study("methods.0.learn.sequential.consolidator.anchor={strength: {fixed: 1}, curvature: identity}");
    assert_eq!(study.methods, expected.methods);
}

/// The minimal study alone, after an override.
fn load_study(assignment: &str) -> Study {
    search(&[&format!("study.{assignment}")]).study(&[0.75, 0.5, 1.0, 0.5], 1).unwrap()
}

#[test]
fn options_are_anything_and_stay_what_they_are() {
    let given = "space={name: {choice: [word, \"true\", \"7\", \"a: b\"]}}";
    let texts = [("word", "word"), ("\"true\"", "true"), ("\"7\"", "7"), ("\"a: b\"", "a: b")];
    let Values::Choice(options) = &document_space(given)[0].values else { panic!("a choice") };
    for (option, (written, text)) in options.iter().zip(texts) {
        assert_eq!(option, written);
        assert_eq!(serde_yaml::from_str::<String>(option).unwrap(), text);
    }
}

/// The space of the minimal search after an override, whatever the study says about its values.
fn document_space(assignment: &str) -> Vec<Dimension> {
    let mut document = Document::parse("trial.yaml", MINIMAL).unwrap();
    document.set(assignment).unwrap();
    document.decode::<SearchConfig>().unwrap().space.check(&document.root().at("space")).unwrap()
}

#[test]
fn rungs_are_numbers_of_seeds() {
    assert_eq!(search(&["seeds.count=8"]).rungs, [2, 4, 8]);
    assert_eq!(search(&["seeds.count=2"]).rungs, [1, 2], "few seeds have fewer rungs");
    assert_eq!(search(&["halving.rungs=[1]"]).rungs, [2]);
}

#[test]
fn a_resolved_search_loads_to_the_same_search() {
    let found = search(&["algorithm=random", "objective=area"]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("search.yaml");
    std::fs::write(&path, &found.resolved_yaml).unwrap();
    let again = load(&path, &[]).unwrap();
    assert_eq!(again.resolved_yaml, found.resolved_yaml);
    assert_eq!((again.space, again.rungs, again.first_seed), (found.space, found.rungs, found.first_seed));
}
