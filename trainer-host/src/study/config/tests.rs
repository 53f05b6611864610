use std::fs;
use std::path::PathBuf;

use super::*;
use crate::ppo::{CriticScope, ValueScaling};

fn in_repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs").join(path)
}

#[test]
fn the_study_of_teams_differs_in_the_critic_only() {
    let study = load(&in_repository("studies/mappo.yaml"), &[]).expect("it is in the repository");
    let critic = |method: usize| {
        let training = study.training_of(method);
        (study.methods[method].name.as_str(), training.critic_scope, training.value_scale)
    };
    let expected = [
        ("ippo", CriticScope::Own, ValueScaling::Fixed),
        ("ippo-popart", CriticScope::Own, ValueScaling::PopArt),
        ("mappo", CriticScope::Team, ValueScaling::PopArt),
    ];
    assert_eq!([0, 1, 2].map(critic), expected);
    let plain = study.training_of(0);
    for method in 1..3 {
        let (critic_scope, value_scale) = (plain.critic_scope, plain.value_scale);
        let alike = PpoSettings { critic_scope, value_scale, ..study.training_of(method).clone() };
        assert_eq!(&alike, plain);
    }
}

#[test]
fn a_critic_of_teams_reads_teams_of_one_size() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("study.yaml");
    let task = |name: &str| in_repository(&format!("aviaries/{name}.yaml")).display().to_string();
    let text = format!(
        "version: 1\nname: trial\ntasks: [ {{ import: {} }}, {{ import: {} }} ]\n\
         methods: [ {{ name: joint, learn: {{ joint: {{}} }}, training: {{ critic_scope: team }} }} ]\n",
        task("multi-hover"),
        task("hover")
    );
    fs::write(&path, text).expect("it can be written");
    let message = load(&path, &[]).expect_err("it must be refused").to_string();
    let expected = "found `team` beside teams of 2 and 1, expected `own`, or tasks of equally many drones: one critic \
                    reads them all";
    assert!(message.contains(expected), "{message}");
    assert!(load(&path, &["methods.0.training.critic_scope=own".to_owned()]).is_ok());
}
