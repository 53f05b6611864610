//! Networks of other programs become policies. `tests/golden/foreign` holds one that Stable-Baselines3 trained.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::kestrel::{config, kestrel, refusal};

fn foreign(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/foreign").join(name)
}

/// Imports a network for hover into `output`.
fn import(place: &Path, network: &Path, output: &str) -> std::process::Output {
    let task = config("hover.yaml");
    let [network, task] = [network, &task].map(|path| path.to_str().unwrap());
    kestrel(place, &["import", network, "--task", task, "-o", output, "--set", "evaluation.episodes=64"])
}

#[test]
fn a_network_of_stable_baselines_becomes_a_run_that_every_command_takes() {
    let place = tempfile::tempdir().unwrap();
    let mut policies = Vec::new();
    for (form, origin) in [("onnx", "An ONNX model"), ("safetensors", "Stable-Baselines3's PPO")] {
        let output = import(place.path(), &foreign(&format!("sb3-ppo.{form}")), form);
        let printed = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(printed.starts_with(&format!("{origin}: 29-32-32-4, tanh between the layers\n")), "{printed}");
        assert!(printed.contains("fixed16") && printed.contains("scripted pilot"), "{printed}");
        policies.push(fs::read(place.path().join(form).join("policy.kestrel")).unwrap());
    }
    assert!(policies[0] == policies[1], "both forms hold the same numbers");
    let report = fs::read_to_string(place.path().join("onnx/evaluation.json")).unwrap();
    let report: Value = serde_json::from_str(&report).unwrap();
    assert!(report["rows"][0]["success_rate"].as_f64().unwrap() > 0.5, "{report}");
    for arguments in [
        &["evaluate", "onnx", "--episodes", "16"][..],
        &["export", "onnx", "--target", "c"],
        &["export", "onnx", "--target", "crazyflie"],
        &["export", "onnx", "--target", "safetensors"],
        &["inspect", "onnx/policy.kestrel"],
        &["fly", "onnx", "--for-secs", "1", "--speed", "20"],
    ] {
        let output = kestrel(place.path(), arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
    let said = kestrel(place.path(), &["inspect", "onnx/policy.kestrel"]);
    assert!(String::from_utf8(said.stdout).unwrap().contains("trained elsewhere"));
    let again = refusal(&import(place.path(), &foreign("sb3-ppo.onnx"), "onnx"));
    assert!(again.contains("onnx already holds a run"), "{again}");
}

#[test]
fn networks_that_do_not_fit_leave_nothing() {
    let place = tempfile::tempdir().unwrap();
    let network = foreign("sb3-ppo.safetensors");
    let other = config("hover-cf2x.yaml");
    let [path, task] = [&network, &other].map(|path| path.to_str().unwrap());
    let wrong = refusal(&kestrel(place.path(), &["import", path, "--task", task, "-o", "out"]));
    let expected = "sb3-ppo.safetensors: tensor mlp_extractor.policy_net.0.weight: found [32, 29], expected [outputs, 22]: \
                    the observation `pilot` of the task has 22 values";
    assert!(wrong.contains(expected), "{wrong}");
    let bytes = fs::read(&network).unwrap();
    for (name, bytes, expected) in [
        ("cut.safetensors", &bytes[..bytes.len() - 9], "found a damaged safetensors file"),
        ("text.onnx", b"no network", "found a file that begins with \"no network\", expected a model as ONNX"),
    ] {
        fs::write(place.path().join(name), bytes).unwrap();
        let said = refusal(&import(place.path(), Path::new(name), "out"));
        assert!(said.contains(&format!("{name}: {expected}")), "{said}");
    }
    let missing = refusal(&import(place.path(), Path::new("none.onnx"), "out"));
    assert!(missing.contains("none.onnx: cannot be read: "), "{missing}");
    let images = config("aviaries/harder-cross-11-vision.yaml");
    let images =
        refusal(&kestrel(place.path(), &["import", path, "--task", images.to_str().unwrap(), "-o", "out"]));
    assert!(images.contains("which shows images"), "{images}");
    assert!(!place.path().join("out").exists());
}
