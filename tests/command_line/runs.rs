//! Whole runs: what they leave behind, and that threads and interruptions leave no trace.

use std::fs;
#[cfg(unix)]
use std::fs::Permissions;
use std::io::{BufRead, BufReader};
#[cfg(unix)]
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;
use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

#[cfg(unix)]
use kestrel_core::processor_in_the_loop::{MessageKind, NO_POLICY, SerialPort, send};
use serde_json::Value;

use crate::kestrel::{TINY, command, config, kestrel, refusal, train_tiny};

/// The rows of a run's metrics without what a clock says.
fn metrics(run: &Path) -> Vec<Value> {
    let text = fs::read_to_string(run.join("metrics.jsonl")).unwrap();
    let rows = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    rows.map(|mut row| {
        let fields = row.as_object_mut().unwrap();
        fields.retain(|name, _| !name.ends_with("_secs") && name != "steps_per_second");
        row
    })
    .collect()
}

fn assert_same_run(one: &Path, other: &Path) {
    assert_eq!(metrics(one), metrics(other));
    for file in ["policy.kestrel", "policy-f32.kestrel", "evaluation.json", "flight.gif"] {
        assert!(fs::read(one.join(file)).unwrap() == fs::read(other.join(file)).unwrap(), "{file} differs");
    }
}

#[test]
fn one_command_leaves_the_whole_result() {
    let place = tempfile::tempdir().unwrap();
    let output = train_tiny(place.path(), "run", &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let run = place.path().join("run");
    let expected = [
        "config.yaml",
        "metrics.jsonl",
        "checkpoints",
        "learning-curve.svg",
        "policy.kestrel",
        "policy-f32.kestrel",
        "export.json",
        "evaluation.json",
        "flight.gif",
    ];
    for name in expected {
        assert!(run.join(name).exists(), "{name} is missing");
    }
    let mut paths = fs::read_dir(&run).unwrap().map(|entry| entry.unwrap().path());
    let events = paths.find(|path| path.to_string_lossy().contains("events.out.tfevents.")).unwrap();
    // Weights & Biases takes the files of this machine alone.
    let machine = Command::new("uname").arg("-n").output().unwrap().stdout;
    let machine = String::from_utf8(machine).unwrap();
    assert!(events.to_string_lossy().contains(&format!(".{}.", machine.trim())), "{}", events.display());
    let curve = fs::read_to_string(run.join("learning-curve.svg")).unwrap();
    assert_eq!(curve.matches(">scripted pilot<").count(), 2, "a line in each panel");
    let events = String::from_utf8_lossy(&fs::read(events).unwrap()).into_owned();
    for tag in ["rollout/ep_rew_mean", "train/approx_kl", "time/fps", "eval/success_rate", "reward/proximity"] {
        assert!(events.contains(tag), "TensorBoard is not told {tag}");
    }
    let rows = metrics(&run);
    let tested: Vec<&Value> = rows.iter().filter(|row| row.get("eval_success_rate").is_some()).collect();
    assert_eq!((rows.len(), tested.len()), (4, 4));
    assert_eq!(tested[0]["eval_kept"], true, "the first is the best so far");
    assert!(tested.iter().all(|row| row["eval_success_interval"].as_array().is_some_and(|ends| ends.len() == 2)));
    let text = String::from_utf8(output.stdout).unwrap();
    for word in ["multiply-accumulates", "do nothing", "random", "scripted pilot", "flight.gif"] {
        assert!(text.contains(word), "no {word} in:\n{text}");
    }
}

#[test]
fn policies_are_exported_without_a_run() {
    let place = tempfile::tempdir().unwrap();
    let output = kestrel(place.path(), &["export", "hover", "--target", "c"]);
    let printed = String::from_utf8(output.stdout).unwrap();
    let page = include_str!("../../docs/microcontrollers.md");
    let cost = printed.lines().find(|line| line.starts_with("It will take about ")).unwrap();
    assert!(page.contains(cost), "docs/microcontrollers.md does not say: {cost}");
    assert!(place.path().join("hover/policy.c").is_file());
    // The folder of its name is no run.
    assert!(kestrel(place.path(), &["export", "hover", "--target", "rust"]).status.success());
    assert!(place.path().join("hover/policy.rs").is_file());
    let file = ["export", "hover/policy.kestrel", "-o", "app", "--target", "crazyflie"];
    assert!(kestrel(place.path(), &file).status.success());
    let [again, first] = ["app", "hover"].map(|folder| fs::read(place.path().join(folder).join("policy.kestrel")));
    assert!(again.unwrap() == first.unwrap() && place.path().join("app/crazyflie/kestrel_guard.h").is_file());
    let wrong = refusal(&kestrel(place.path(), &["export", "hover", "--target", "onnx"]));
    assert!(wrong.contains("hover is in fixed16, expected a policy in float32 for this target"), "{wrong}");
    fs::write(place.path().join("other.kestrel"), "no policy").unwrap();
    let other = refusal(&kestrel(place.path(), &["export", "other.kestrel"]));
    assert!(other.contains("cannot export other.kestrel"), "{other}");
}

#[test]
fn the_run_can_be_evaluated_and_exported_again() {
    let place = tempfile::tempdir().unwrap();
    train_tiny(place.path(), "run", &[]);
    let policy = fs::read(place.path().join("run/policy.kestrel")).unwrap();
    let report = fs::read(place.path().join("run/evaluation.json")).unwrap();
    assert!(kestrel(place.path(), &["export", "run"]).status.success());
    assert!(fs::read(place.path().join("run/policy.kestrel")).unwrap() == policy);
    for (target, files) in [("rust", &["policy.rs"][..]), ("c", &["policy.h", "policy.c"])] {
        let output = kestrel(place.path(), &["export", "run", "--target", target]);
        let printed = String::from_utf8(output.stdout).unwrap();
        for file in files {
            let text = fs::read_to_string(place.path().join("run").join(file)).unwrap();
            assert!(text.contains(&format!("ritten by `kestrel export --target {target}`")), "{file}");
            assert!(printed.contains(file), "no {file} in:\n{printed}");
        }
    }
    for (target, written) in [
        ("crazyflie", "crazyflie/policy.c"),
        ("betaflight", "betaflight/policy.c"),
        ("onnx", "policy.onnx"),
        ("safetensors", "policy.safetensors"),
    ] {
        let output = kestrel(place.path(), &["export", "run", "--target", target]);
        let printed = String::from_utf8(output.stdout).unwrap();
        assert!(place.path().join("run").join(written).is_file(), "{written}");
        let named = written.trim_end_matches("/policy.c");
        assert!(printed.lines().any(|line| line.ends_with(named)), "no {named} in:\n{printed}");
    }
    assert!(kestrel(place.path(), &["evaluate", "run"]).status.success());
    assert!(fs::read(place.path().join("run/evaluation.json")).unwrap() == report);
    assert!(kestrel(place.path(), &["evaluate", "run", "--episodes", "5", "--seed", "9"]).status.success());
    let both = ["evaluate", "run", "--processor", "qemu", "--record", "flight.kestrel"];
    assert!(refusal(&kestrel(place.path(), &both)).contains("found --record beside --processor qemu"));
    for command in ["evaluate", "fly"] {
        let missing = kestrel(place.path(), &[command, "run", "--processor", "qemu", "--image", "none.elf"]);
        let message = refusal(&missing);
        assert!(
            message.contains("cannot read the image none.elf") && message.contains("cargo build"),
            "{message}"
        );
    }
}

/// A line that keeps what is sent.
#[cfg(unix)]
struct Written(Vec<u8>);

#[cfg(unix)]
impl SerialPort for Written {
    fn read(&mut self) -> Option<u8> {
        None
    }

    fn write(&mut self, byte: u8) {
        self.0.push(byte);
    }
}

/// A program that says these codes of the processor-in-the-loop protocol at once, then runs `ending`.
#[cfg(unix)]
fn program_that_says(place: &Path, codes: &[i32], ending: &str) {
    let mut frames = Written(Vec::new());
    for code in codes {
        send(&mut frames, MessageKind::Code, &[&code.to_le_bytes()]);
    }
    fs::write(place.join("frames"), frames.0).unwrap();
    fs::write(place.join("program"), format!("#!/bin/sh\ncat frames\n{ending}\n")).unwrap();
    fs::set_permissions(place.join("program"), Permissions::from_mode(0o755)).unwrap();
}

#[cfg(unix)]
#[test]
fn a_program_that_cannot_fly_is_refused_with_a_reason() {
    let place = tempfile::tempdir().unwrap();
    train_tiny(place.path(), "run", &[]);
    let message = |command: &str, image: &[&str]| {
        let arguments = [&[command, "run", "--processor", "program"], image].concat();
        refusal(&kestrel(place.path(), &arguments))
    };
    let program = ["--image", "program"];
    for command in ["evaluate", "fly"] {
        let unnamed = message(command, &[]);
        assert!(unnamed.contains("found --processor program alone, expected the program too"), "{unnamed}");
        let missing = message(command, &["--image", "none"]);
        assert!(missing.contains("cannot start none: No such file"), "{missing}");
    }
    fs::write(place.path().join("program"), "#!/bin/sh\n").unwrap();
    let not_executable = message("evaluate", &program);
    assert!(not_executable.contains("cannot start program: Permission denied"), "{not_executable}");
    program_that_says(place.path(), &[], "exit 3");
    let ended = message("evaluate", &program);
    assert!(ended.contains("program ended before it was told to, with exit status: 3"), "{ended}");
    program_that_says(place.path(), &[NO_POLICY, 17], "exec sleep 60");
    let refused = message("evaluate", &program);
    assert!(refused.contains("refuses the policy with code 17"), "{refused}");
    program_that_says(place.path(), &[NO_POLICY, 0, 0, 104], "exec sleep 60");
    let stopped = message("evaluate", &program);
    assert!(stopped.contains("refuses a control period with code 104"), "{stopped}");
    program_that_says(place.path(), &[NO_POLICY + 1], "exec sleep 60");
    let nonsense = message("evaluate", &program);
    assert!(
        nonsense.contains("program does not answer within 20 s: expected the processor-in-the-loop"),
        "{nonsense}"
    );
}

#[test]
fn the_number_of_threads_leaves_no_trace() {
    let place = tempfile::tempdir().unwrap();
    for threads in ["1", "2", "7"] {
        let output = train_tiny(place.path(), threads, &["--threads", threads]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    assert_same_run(&place.path().join("1"), &place.path().join("2"));
    assert_same_run(&place.path().join("1"), &place.path().join("7"));
}

/// Waits until the run has logged an update.
fn wait_for_update(run: &Path) {
    let start = Instant::now();
    while fs::read_to_string(run.join("metrics.jsonl")).unwrap_or_default().lines().count() < 1 {
        assert!(start.elapsed() < Duration::from_secs(60), "no update within a minute");
        sleep(Duration::from_millis(5));
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_goes_on_to_the_same_bits() {
    assert_goes_on(&[&TINY[..], &["--set", "training.total_steps=81920"]].concat());
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_by_gradients_goes_on_to_the_same_bits() {
    assert_goes_on(&["--set", "training.analytic.total_steps=819200", "--set", "evaluation.episodes=32"]);
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_that_remembers_goes_on_to_the_same_bits() {
    let memory = ["--set", "training.memory.units=8", "--set", "training.memory.steps_per_window=4"];
    let longer = ["--set", "training.total_steps=65536"];
    assert_goes_on(&[&TINY[..], &memory, &longer].concat());
}

#[test]
fn a_recurrent_policy_is_exported_to_what_takes_it_and_refused_by_name_elsewhere() {
    let place = tempfile::tempdir().unwrap();
    let memory = ["--set", "training.memory.units=8", "--set", "training.memory.steps_per_window=4"];
    assert!(train_tiny(place.path(), "run", &memory).status.success());
    let inspected = kestrel(place.path(), &["inspect", "run/policy.kestrel"]);
    let said = String::from_utf8(inspected.stdout).unwrap();
    assert!(said.contains("memory of 8 units: 888 multiply-accumulates per step, "), "{said}");
    for target in ["file", "rust", "onnx", "safetensors", "c", "crazyflie"] {
        assert!(kestrel(place.path(), &["export", "run", "--target", target]).status.success(), "{target}");
    }
    let module = fs::read_to_string(place.path().join("run/policy.rs")).unwrap();
    assert!(module.contains("Pilot::with_memory(RecurrentPolicy::parse(&POLICY.0)?)"), "{module}");
    let said = refusal(&kestrel(place.path(), &["export", "run", "--target", "betaflight"]));
    assert!(said.contains("found a policy with a memory, expected one without"), "{said}");
}

/// That a training with these arguments leaves the same files, whether it is interrupted or not.
#[cfg(unix)]
fn assert_goes_on(more: &[&str]) {
    let place = tempfile::tempdir().unwrap();
    let config = config("hover.yaml");
    let arguments = |run| [&["train", config.to_str().unwrap(), "--run", run], more].concat();
    assert!(kestrel(place.path(), &arguments("whole")).status.success());
    let mut child = command(place.path()).args(arguments("halves")).stdout(Stdio::piped()).spawn().unwrap();
    let run = place.path().join("halves");
    wait_for_update(&run);
    let signal = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(signal.success());
    let status = child.wait().unwrap();
    if status.code() == Some(130) {
        let output = kestrel(place.path(), &["train", "--resume", "halves"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    } else {
        // The signal came in the last moment: nothing was left to interrupt.
        assert!(status.success());
    }
    assert_same_run(&place.path().join("whole"), &run);
}

#[cfg(unix)]
#[test]
fn a_run_killed_before_its_first_update_goes_on() {
    let place = tempfile::tempdir().unwrap();
    let config = config("hover.yaml");
    let arguments = [&["train", config.to_str().unwrap(), "--run", "run"], &TINY[..]].concat();
    let mut child = command(place.path()).args(arguments).stdout(Stdio::piped()).spawn().unwrap();
    let run = place.path().join("run");
    let start = Instant::now();
    while !run.join("checkpoints/update-00000000.checkpoint").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no checkpoint within a minute");
        sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(kestrel(place.path(), &["train", "--resume", "run"]).status.success());
    train_tiny(place.path(), "whole", &[]);
    assert_same_run(&place.path().join("whole"), &run);
}

#[cfg(unix)]
#[test]
fn an_interrupted_evaluation_is_made_up_for() {
    let place = tempfile::tempdir().unwrap();
    let config = config("hover.yaml");
    let many = ["--set", "evaluation.episodes=8192"];
    let arguments = [&["train", config.to_str().unwrap(), "--run", "a run"], &TINY[..], &many].concat();
    let mut child = command(place.path()).args(arguments).stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.any(|line| line.starts_with("Trained")));
    let signal = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(signal.success());
    assert_eq!(lines.last().unwrap().trim(), "kestrel train --resume 'a run'");
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(kestrel(place.path(), &["train", "--resume", "a run"]).status.success());
    assert!(place.path().join("a run/flight.gif").exists());
}

#[cfg(unix)]
#[test]
fn a_reader_that_goes_away_does_not_cost_the_results() {
    let place = tempfile::tempdir().unwrap();
    let config = config("hover.yaml");
    let arguments = [&["train", config.to_str().unwrap(), "--run", "run"], &TINY[..]].concat();
    let mut child = command(place.path()).args(arguments).stdout(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    assert!(child.wait().unwrap().success());
    assert!(place.path().join("run/flight.gif").exists());
}

#[test]
fn a_finished_run_can_be_resumed_without_harm() {
    let place = tempfile::tempdir().unwrap();
    train_tiny(place.path(), "run", &[]);
    let policy = fs::read(place.path().join("run/policy.kestrel")).unwrap();
    assert!(kestrel(place.path(), &["train", "--resume", "run"]).status.success());
    assert!(fs::read(place.path().join("run/policy.kestrel")).unwrap() == policy);
    assert_eq!(metrics(&place.path().join("run")).len(), 4);
}

#[test]
fn help_schema_and_completions_print() {
    let place = tempfile::tempdir().unwrap();
    for arguments in [&["--help"][..], &["train", "--help"], &["schema"], &["completions", "bash"]] {
        let output = kestrel(place.path(), arguments);
        assert!(output.status.success() && output.stdout.len() > 300);
    }
    let schema = kestrel(place.path(), &["schema"]).stdout;
    assert!(
        schema == fs::read(config("schema.json")).unwrap(),
        "configs/schema.json is not what the program prints"
    );
}

#[test]
fn a_benchmark_measures_the_rows_that_are_asked_for() {
    let place = tempfile::tempdir().unwrap();
    let hover = config("hover.yaml");
    let output =
        kestrel(place.path(), &["bench", hover.to_str().unwrap(), "--secs", "0.001", "--rows", "vehicle"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let printed = String::from_utf8(output.stdout).unwrap();
    assert_eq!(printed.matches("vehicle steps").count(), 4, "{printed}");
    assert_eq!(printed.lines().count(), 5, "a heading and these: {printed}");
    let aviaries = config("aviaries");
    let tasks = ["bench", "hover", "--secs", "0.001", "--rows", "tasks", "--aviaries", aviaries.to_str().unwrap()];
    let output = kestrel(place.path(), &tasks);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let printed = String::from_utf8(output.stdout).unwrap();
    assert_eq!((printed.matches("one per episode").count(), printed.lines().count()), (2, 9), "{printed}");
}
