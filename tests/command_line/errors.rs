//! What users get wrong, each answered once and clearly, with nothing lost.

use std::fs;
use std::net::UdpSocket;
use std::path::Path;

use crate::kestrel::{command, config, kestrel, refusal, train_tiny};

/// The message for `text` as an experiment file.
fn message_for(text: &str) -> String {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("trial.yaml"), text).unwrap();
    let message = refusal(&kestrel(place.path(), &["train", "trial.yaml"]));
    assert!(!place.path().join("runs").exists(), "a refused experiment leaves no run behind");
    message
}

/// `hover.yaml` with `wrong` where it says `right`.
fn hover_with(right: &str, wrong: &str) -> String {
    let text = fs::read_to_string(config("hover.yaml")).unwrap();
    assert!(text.contains(right), "hover.yaml no longer says {right}");
    text.replace(right, wrong)
}

#[test]
fn wrong_experiments_are_named_with_line_found_and_expected() {
    let cases = [
        (hover_with("tilt_limit_deg", "tilt_limit_degs"), "unknown key `tilt_limit_degs`"),
        (hover_with("control_rate_hz: 50", "control_rate_hz: fast"), "the text \"fast\", expected a number"),
        (hover_with("airframe: crazyflie_2_1", "mass_kg: -0.027\n    airframe: crazyflie_2_1"), "found -0.027"),
        (hover_with("mass_fraction: 0.2", "mass_fraction: -0.1"), "found -0.1"),
        (hover_with("version: 1", "version: 2"), "found 2, expected `version: 1`"),
    ];
    for (text, expected) in cases {
        let message = message_for(&text);
        assert!(message.contains("trial.yaml:") && message.contains(expected), "{message}");
    }
}

#[test]
fn missing_and_empty_files_are_named() {
    let place = tempfile::tempdir().unwrap();
    assert!(refusal(&kestrel(place.path(), &["train", "none.yaml"])).contains("none.yaml: found no such file"));
    assert!(message_for("").contains("trial.yaml"));
    let nothing = refusal(&kestrel(place.path(), &["evaluate", "none"]));
    assert!(nothing.contains("none: found neither a run nor a policy file nor a pilot"), "{nothing}");
    assert!(refusal(&kestrel(place.path(), &["evaluate", "."])).contains(". holds no run"));
    let nothing = refusal(&kestrel(place.path(), &["export", "none"]));
    assert!(
        nothing.contains("at none, expected one of them or a pilot") && nothing.contains("hover"),
        "{nothing}"
    );
    assert!(
        refusal(&kestrel(place.path(), &["export", "none.kestrel"])).contains("cannot read policy none.kestrel")
    );
    assert!(refusal(&kestrel(place.path(), &["train", "--resume", "none"])).contains("none holds no run"));
    assert!(refusal(&kestrel(place.path(), &["fly", "none.kestrel"])).contains("none.kestrel"));
}

#[test]
fn what_is_no_recording_is_not_replayed() {
    let place = tempfile::tempdir().unwrap();
    let missing = refusal(&kestrel(place.path(), &["replay", "none.recording"]));
    assert!(missing.contains("cannot read none.recording"), "{missing}");
    fs::write(place.path().join("other.recording"), "GIF89a and so on").unwrap();
    let other = refusal(&kestrel(place.path(), &["replay", "other.recording"]));
    assert!(other.contains("other.recording is no recording: it begins with \"GIF89a a\""), "{other}");
    let ending = refusal(&kestrel(place.path(), &["replay", "other.recording", "--output", "other.recording"]));
    assert!(ending.contains("other.recording: found another ending, expected .gif, .mp4, .svg"), "{ending}");
    assert!(!place.path().join("other.gif").exists());
}

#[test]
fn wrong_flags_are_explained() {
    let place = tempfile::tempdir().unwrap();
    let hover = config("hover.yaml");
    let hover = hover.to_str().unwrap();
    refusal(&kestrel(place.path(), &["train"]));
    refusal(&kestrel(place.path(), &["train", hover, "--threads", "0"]));
    refusal(&kestrel(place.path(), &["train", hover, "--seed", "-1"]));
    for secs in ["0", "-1", "nan", "1e30"] {
        let message = refusal(&kestrel(place.path(), &["bench", hover, "--secs", secs]));
        assert!(message.contains("--secs") && message.contains("0.001 to 60"), "{message}");
    }
    let message = refusal(&kestrel(place.path(), &["bench", hover, "--rows", "vehicles"]));
    assert!(message.contains("--rows") && message.contains("vehicle, environment"), "{message}");
    assert!(refusal(&kestrel(place.path(), &["tarin"])).contains("train"));
    let message = refusal(&kestrel(place.path(), &["train", hover, "--set", "training.epochs=foo"]));
    assert!(message.contains("--set training.epochs=foo"), "{message}");
}

#[test]
fn damaged_policies_do_not_fly() {
    let place = tempfile::tempdir().unwrap();
    train_tiny(place.path(), "run", &[]);
    let whole = fs::read(place.path().join("run/policy.kestrel")).unwrap();
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 0x10;
    let damaged = [("short", whole[..whole.len() - 5].to_vec()), ("flipped", flipped), ("empty", Vec::new())];
    for (name, bytes) in damaged {
        fs::write(place.path().join(name), bytes).unwrap();
        assert!(refusal(&kestrel(place.path(), &["fly", name, "--for-secs", "1"])).contains(name));
    }
    let policy = place.path().join("run/policy.kestrel");
    fs::write(&policy, &whole[..40]).unwrap();
    let message = refusal(&kestrel(place.path(), &["evaluate", "run"]));
    assert!(message.contains("policy.kestrel"), "{message}");
    assert_eq!(message.matches("policy file is").count(), 1, "said once: {message}");
}

/// The newest of a run's checkpoints.
fn checkpoints(run: &Path) -> Vec<std::path::PathBuf> {
    let entries = fs::read_dir(run.join("checkpoints")).unwrap();
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths
}

#[test]
fn damaged_checkpoints_are_refused() {
    let place = tempfile::tempdir().unwrap();
    train_tiny(place.path(), "run", &[]);
    for path in checkpoints(&place.path().join("run")) {
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(&path, bytes).unwrap();
    }
    let message = refusal(&kestrel(place.path(), &["train", "--resume", "run"]));
    assert!(message.contains("checkpoints"), "{message}");
}

#[test]
fn where_the_newest_checkpoint_is_damaged_export_takes_the_one_before_and_says_so() {
    let place = tempfile::tempdir().unwrap();
    train_tiny(place.path(), "run", &[]);
    let newest = checkpoints(&place.path().join("run")).pop().unwrap();
    let bytes = fs::read(&newest).unwrap();
    fs::write(&newest, &bytes[..bytes.len() - 1]).unwrap();
    let exported = kestrel(place.path(), &["export", "run"]);
    let said = String::from_utf8(exported.stderr).unwrap();
    assert!(exported.status.success(), "{said}");
    assert!(said.contains("is truncated") && said.contains("going on from the checkpoint before it"), "{said}");
}

/// Replaces `right` in the configuration of a run.
fn edit_config(run: &Path, right: &str, wrong: &str) {
    let path = run.join("config.yaml");
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(right), "{text}");
    fs::write(path, text.replace(right, wrong)).unwrap();
}

#[test]
fn a_run_whose_configuration_was_changed_is_refused_once() {
    let place = tempfile::tempdir().unwrap();
    let cases = [
        ("seed: 0", "seed: 5", "resume", "began with seed 0"),
        ("- 64\n", "- 32\n", "resume", "layers [29, 64, 64, 4]"),
        ("mass_fraction: 0.2", "mass_fraction: 0.1", "resume", "trained with `mass_fraction: 0.2`"),
        ("control_rate_hz: 50", "control_rate_hz: 40", "evaluate", "another control period"),
        ("fraction_of_hover: 0.95", "fraction_of_hover: 0.7", "evaluate", "another action"),
    ];
    for (index, (right, wrong, command, expected)) in cases.into_iter().enumerate() {
        let run = format!("run{index}");
        train_tiny(place.path(), &run, &[]);
        edit_config(&place.path().join(&run), right, wrong);
        let arguments = if command == "resume" { vec!["train", "--resume", &run] } else { vec![command, &run] };
        let message = refusal(&kestrel(place.path(), &arguments));
        assert_eq!(message.matches(expected).count(), 1, "{message}");
    }
}

#[test]
fn a_run_without_policies_says_how_to_make_them() {
    let place = tempfile::tempdir().unwrap();
    train_tiny(place.path(), "run", &[]);
    fs::remove_file(place.path().join("run/policy.kestrel")).unwrap();
    for command in ["evaluate", "fly"] {
        let message = refusal(&kestrel(place.path(), &[command, "run"]));
        assert!(message.contains("kestrel export"), "{message}");
    }
    assert!(kestrel(place.path(), &["export", "run"]).status.success());
}

#[cfg(target_os = "linux")]
#[test]
fn standard_output_on_a_full_disk_is_one_error() {
    let place = tempfile::tempdir().unwrap();
    for arguments in [&["schema"][..], &["completions", "zsh"]] {
        let full = fs::File::options().write(true).open("/dev/full").unwrap();
        let output = command(place.path()).args(arguments).stdout(full).output().unwrap();
        assert!(refusal(&output).contains("standard output"));
    }
}

#[test]
fn an_existing_run_is_not_overwritten() {
    let place = tempfile::tempdir().unwrap();
    train_tiny(place.path(), "run", &[]);
    let before = fs::read(place.path().join("run/metrics.jsonl")).unwrap();
    assert!(refusal(&train_tiny(place.path(), "run", &[])).contains("already holds a run"));
    assert!(fs::read(place.path().join("run/metrics.jsonl")).unwrap() == before);
}

#[test]
fn a_busy_port_is_named() {
    let place = tempfile::tempdir().unwrap();
    train_tiny(place.path(), "run", &[]);
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let message = refusal(&kestrel(place.path(), &["fly", "run", "--listen", &address, "--for-secs", "1"]));
    assert!(message.contains(&address), "{message}");
}

#[cfg(unix)]
#[test]
fn a_full_disk_is_one_error() {
    let place = tempfile::tempdir().unwrap();
    let hover = config("hover.yaml");
    // A limit on the size of files stands in for a disk on which a checkpoint has no room.
    let script = format!(
        "trap '' XFSZ; ulimit -f 64; exec '{}' train '{}' --run run --set training.total_steps=65536 \
         --set training.environments=256 --set training.minibatch=2048",
        env!("CARGO_BIN_EXE_kestrel"),
        hover.display()
    );
    let output = std::process::Command::new("bash").args(["-c", &script]).current_dir(place.path()).output();
    assert!(refusal(&output.unwrap()).contains("checkpoints"));
    assert!(checkpoints(&place.path().join("run")).is_empty(), "no half-written checkpoint stays behind");
}
