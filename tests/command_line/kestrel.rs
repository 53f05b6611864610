//! Running the binary.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A training by PPO that takes a moment: four updates.
pub(crate) const TINY: [&str; 14] = [
    "--set",
    "training.analytic=null",
    "--set",
    "training.environments=256",
    "--set",
    "training.steps_per_rollout=16",
    "--set",
    "training.minibatch=1024",
    "--set",
    "training.total_steps=16384",
    "--set",
    "evaluation.episodes=32",
    "--set",
    "training.epochs=2",
];

/// The example experiment of that name.
pub(crate) fn config(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs").join(name)
}

/// `kestrel` in a directory of its own.
pub(crate) fn command(directory: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kestrel"));
    command.current_dir(directory).env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"));
    command
}

/// Runs `kestrel` to its end.
pub(crate) fn kestrel(directory: &Path, arguments: &[&str]) -> Output {
    command(directory).args(arguments).output().unwrap()
}

/// Trains `hover.yaml` for a moment into the directory `run`.
pub(crate) fn train_tiny(directory: &Path, run: &str, more: &[&str]) -> Output {
    let config = config("hover.yaml");
    let arguments = [&["train", config.to_str().unwrap(), "--run", run], &TINY[..], more].concat();
    kestrel(directory, &arguments)
}

/// Standard error of a command that must have failed as a user's mistake: status 2 and one message.
pub(crate) fn refusal(output: &Output) -> String {
    let text = String::from_utf8(output.stderr.clone()).unwrap();
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert_eq!(text.matches("error:").count(), 1, "{text}");
    assert!(!text.contains("panicked"), "{text}");
    text
}

/// Standard output of a command that must have succeeded.
pub(crate) fn printed(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout.clone()).unwrap()
}
