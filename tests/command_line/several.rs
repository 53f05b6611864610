//! Runs of several tasks, and policies in tasks that they were not trained for.

use std::fs;
use std::path::Path;
use std::process::Output;

use crate::kestrel::{config, kestrel, printed, refusal};

/// One policy for two rooms, for a moment.
fn train(place: &Path) -> Output {
    let rooms = ["incremental-cross-0", "harder-cross-11"].map(|room| config(&format!("aviaries/{room}.yaml")));
    let training = config("parts/crosses.yaml");
    let file = format!(
        "version: 1\nname: two\ntasks: [{{import: {}}}, {{import: {}}}]\ntraining: {{import: {}, total_steps: 16384, \
         environments: 512, minibatch: 1024, epochs: 1}}\nevaluation: {{episodes: 16, flights_per_stage: 1, \
         flight_episodes: 4}}\n",
        rooms[0].display(),
        rooms[1].display(),
        training.display()
    );
    fs::write(place.join("two.yaml"), file).unwrap();
    kestrel(place, &["train", "two.yaml", "--run", "run"])
}

#[test]
fn one_policy_is_trained_judged_exported_and_filmed_in_two_tasks() {
    let place = tempfile::tempdir().unwrap();
    let text = printed(&train(place.path()));
    for words in ["2 tasks at once", "Success after each stage", "harder-cross-11, 16 starts", "float32"] {
        assert!(text.contains(words), "no {words} in:\n{text}");
    }
    for name in ["learning-curve.svg", "flight-incremental-cross-0.gif", "flight-harder-cross-11.gif"] {
        assert!(place.path().join("run").join(name).is_file(), "{name} is missing");
    }
    let policy = fs::read(place.path().join("run/policy.kestrel")).unwrap();
    for (target, written) in [("c", "policy.c"), ("onnx", "policy.onnx")] {
        printed(&kestrel(place.path(), &["export", "run", "--target", target]));
        assert!(place.path().join("run").join(written).is_file(), "{written} is missing");
    }
    assert!(fs::read(place.path().join("run/policy.kestrel")).unwrap() == policy);
    let room = config("aviaries/harder-cross-16.yaml");
    let room = room.to_str().unwrap();
    let flown = ["evaluate", "run", "run/policy-f32.kestrel", "--episodes", "8", "--tasks", room, "run"];
    let text = printed(&kestrel(place.path(), &flown));
    let tasks: Vec<&str> = text.lines().skip(2).map(|line| line.split(' ').next().unwrap()).collect();
    assert_eq!(tasks, ["harder-cross-16", "incremental-cross-0", "harder-cross-11"], "{text}");
    assert!(text.lines().skip(1).all(|line| line.matches('%').count() == 2 || line.starts_with("task ")));
    let text = printed(&kestrel(place.path(), &["evaluate", "run", "--episodes", "8", "--tasks", room]));
    assert!(text.contains("harder-cross-16") && text.contains("mean success:"), "{text}");
    let hover = config("hover.yaml");
    let text = refusal(&kestrel(place.path(), &["evaluate", "run", "--tasks", room, hover.to_str().unwrap()]));
    let expected = "run/policy.kestrel: found a policy for another observation (it has `";
    assert!(text.contains(expected) && text.contains("), expected that of the task \"hover\""), "{text}");
    let text = refusal(&kestrel(place.path(), &["evaluate", "run", "--task", "hover"]));
    assert!(text.contains("found the task \"hover\", expected incremental-cross-0, harder-cross-11"), "{text}");
    let text = refusal(&kestrel(place.path(), &["evaluate", "run/policy.kestrel"]));
    assert!(text.contains("found a file, expected the directory of a run, or tasks to fly in"), "{text}");
}

/// Success of a shipped pilot in a task \[%\], 256 starts.
fn success(place: &Path, pilot: &str, task: &Path) -> f64 {
    let pilot = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../assets/pilots/{pilot}.kestrel"));
    let [pilot, task] = [pilot.to_str().unwrap(), task.to_str().unwrap()];
    let text = printed(&kestrel(place, &["evaluate", pilot, "--episodes", "256", "--tasks", task]));
    let shares = text.split_once("mean success: ").and_then(|(_, rest)| rest.split_once(" %"));
    shares.unwrap_or_else(|| panic!("{text}")).0.parse().unwrap()
}

#[test]
fn shipped_pilots_hover_on_the_drones_that_they_learned_on() {
    let place = tempfile::tempdir().unwrap();
    let hover = config("hover.yaml");
    assert!(success(place.path(), "hover", &hover) > 98.0);
    assert!(success(place.path(), "hover-2-1-plus", &config("hover-2-1-plus.yaml")) > 94.0);
}
