//! What the program computes is frozen: digests in `tests/golden/bits` of trainings, studies and flights.
//!
//! `BLESS=1 cargo test -p kestrel --test command_line bits` writes them anew. Only numbers are digested where names may
//! change: of tables and reports, in an order that does not depend on the names of their columns.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use kestrel_core::crc32::crc32;
use kestrel_core::policy_file::{ENCODER_HEADER_LEN, HEADER_LEN};
use serde_json::Value;
use sha2::{Digest, Sha256};

use crate::kestrel::{TINY, config, kestrel};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/bits").join(name)
}

fn digest(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().fold(String::new(), |mut digits, byte| {
        let _infallible = write!(digits, "{byte:02x}");
        digits
    })
}

/// A policy file as it was before such files knew their drone: without the 56 bytes at the end of the metadata.
fn without_airframe(mut file: Vec<u8>) -> Vec<u8> {
    const AIRFRAME_LEN: usize = 56;
    let metadata = match file[8] {
        1 => HEADER_LEN,
        2 => HEADER_LEN + ENCODER_HEADER_LEN,
        other => panic!("no family has policy files of version {other}"),
    };
    let metadata_len = usize::from(u16::from_le_bytes([file[20], file[21]]));
    let end = metadata + metadata_len;
    file.drain(end - AIRFRAME_LEN..end);
    file[20..22].copy_from_slice(&((metadata_len - AIRFRAME_LEN) as u16).to_le_bytes());
    let len = file.len();
    file[12..16].copy_from_slice(&(len as u32).to_le_bytes());
    let checksum = crc32(&file[..len - 4]);
    file[len - 4..].copy_from_slice(&checksum.to_le_bytes());
    file
}

/// Compares `found` with the frozen file of that name, or writes it.
fn assert_frozen(name: &str, found: &str) {
    let path = golden(name);
    if std::env::var_os("BLESS").is_some() {
        fs::write(&path, found).unwrap();
    }
    let expected = fs::read_to_string(&path).unwrap();
    for (found, expected) in found.lines().zip(expected.lines()) {
        assert_eq!(found, expected, "{name}: bits have changed");
    }
    assert_eq!(found.lines().count(), expected.lines().count(), "{name}");
}

/// The numbers of a report, sorted, so that names of fields may change; those of `hits` are newer than the frozen bits.
fn numbers_of_json(text: &str) -> String {
    fn collect(value: &Value, into: &mut Vec<String>) {
        match value {
            Value::Number(number) => into.push(number.to_string()),
            Value::Array(values) => values.iter().for_each(|value| collect(value, into)),
            Value::Object(fields) => {
                let known = fields.iter().filter(|(name, _)| *name != "hits");
                known.for_each(|(_, value)| collect(value, into));
            }
            Value::Null | Value::Bool(_) | Value::String(_) => {}
        }
    }
    let mut numbers = Vec::new();
    collect(&serde_json::from_str(text).unwrap(), &mut numbers);
    numbers.sort();
    numbers.join(" ")
}

/// The numbers of a table, in order; what collisions were with is newer than the frozen bits.
fn numbers_of_text(text: &str) -> String {
    let lines = text.lines().filter(|line| !line.starts_with("collisions of "));
    let apart = |character: char| character.is_whitespace() || ",|[]()%".contains(character);
    let words = lines.flat_map(|line| line.split(apart));
    words.filter(|word| word.parse::<f64>().is_ok()).collect::<Vec<_>>().join(" ")
}

/// Standard output of a command that must succeed.
fn output(place: &Path, arguments: &[&str]) -> String {
    let output = kestrel(place, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// A family of tasks: its experiment, and what makes its training a short one.
struct Family {
    config: &'static str,
    sets: &'static [&'static str],
}

const FAMILIES: [Family; 8] = [
    Family { config: "hover-cf2x.yaml", sets: &["name=hover"] },
    Family { config: "cross.yaml", sets: &["training.quantised_from=0.5", "training.value_scale=popart"] },
    Family { config: "aviaries/land.yaml", sets: &[] },
    Family { config: "aviaries/land-as-published.yaml", sets: &["evaluation.episodes=8"] },
    Family { config: "aviaries/maze.yaml", sets: &["evaluation.episodes=8"] },
    Family {
        config: "aviaries/room-0-vision.yaml",
        sets: &["training.steps_per_rollout=4", "training.total_steps=2048", "evaluation.episodes=4"],
    },
    Family {
        config: "aviaries/crossing-3.yaml",
        sets: &[
            "training.environments=768",
            "training.steps_per_rollout=8",
            "training.minibatch=1536",
            "evaluation.episodes=8",
        ],
    },
    Family { config: "aviaries/flock.yaml", sets: &["evaluation.episodes=8"] },
];

/// A line for each file of the run: the policies and their evaluation.
fn trained(place: &Path, family: &Family) -> String {
    let name = Path::new(family.config).file_stem().unwrap().to_str().unwrap();
    let experiment = config(family.config);
    let mut arguments = vec!["train", experiment.to_str().unwrap(), "--run", name];
    arguments.extend(TINY);
    arguments.extend(family.sets.iter().flat_map(|set| ["--set", set]));
    output(place, &arguments);
    let read = |file: &str| fs::read(place.join(name).join(file)).unwrap();
    let evaluation = numbers_of_json(&String::from_utf8(read("evaluation.json")).unwrap());
    format!(
        "{name} fixed {}\n{name} float {}\n{name} evaluation {}\n",
        digest(&without_airframe(read("policy.kestrel"))),
        digest(&without_airframe(read("policy-f32.kestrel"))),
        digest(evaluation.as_bytes())
    )
}

#[test]
fn a_short_training_of_every_family_of_tasks_computes_the_frozen_bits() {
    let place = tempfile::tempdir().unwrap();
    let lines: String = FAMILIES.iter().map(|family| trained(place.path(), family)).collect();
    assert_frozen("trainings.txt", &lines);
}

#[test]
fn the_pilots_of_the_assets_fly_the_frozen_flights() {
    let place = tempfile::tempdir().unwrap();
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/pilots");
    let mut lines = String::new();
    for (name, episodes) in [("hover-cf2x", "64"), ("cross", "32")] {
        let experiment = config(&format!("{name}.yaml"));
        let run = ["train", experiment.to_str().unwrap(), "--run", name];
        output(place.path(), &[&run[..], &TINY[..]].concat());
        fs::copy(assets.join(name).with_extension("kestrel"), place.path().join(name).join("policy.kestrel"))
            .unwrap();
        output(place.path(), &["evaluate", name, "--episodes", episodes]);
        let report = fs::read_to_string(place.path().join(name).join("evaluation.json")).unwrap();
        writeln!(lines, "{name} {}", digest(numbers_of_json(&report).as_bytes())).unwrap();
    }
    assert_frozen("pilots.txt", &lines);
}

/// A line for every file of rows and of curves.
fn studied(place: &Path, name: &str, study: &str) -> String {
    fs::write(place.join(format!("{name}.yaml")), study).unwrap();
    output(place, &["study", "run", &format!("{name}.yaml"), "--directory", name]);
    let files = crate::study::files(&place.join(name));
    let tables = files.iter().filter(|(path, _)| path.extension().is_some_and(|extension| extension == "csv"));
    let mut lines = String::new();
    for (path, content) in tables {
        let numbers = numbers_of_text(std::str::from_utf8(content).unwrap());
        writeln!(lines, "{name} {} {}", path.display(), digest(numbers.as_bytes())).unwrap();
    }
    lines
}

#[test]
fn every_method_of_continual_learning_leaves_the_frozen_rows() {
    let place = tempfile::tempdir().unwrap();
    let tiny = studied(place.path(), "tiny", include_str!("tiny-study.yaml"));
    let methods = studied(place.path(), "methods", include_str!("../golden/bits/methods.yaml"));
    assert_frozen("study.txt", &(tiny + &methods));
}

#[test]
fn every_task_flies_its_baselines_as_frozen() {
    let place = tempfile::tempdir().unwrap();
    let tasks = fs::read_dir(config("aviaries")).unwrap().map(|entry| entry.unwrap().path());
    let mut tasks: Vec<_> = tasks.filter(|path| path.is_file()).collect();
    tasks.sort();
    let lines = tasks.iter().map(|task| {
        let arguments = ["baseline", task.to_str().unwrap(), "--episodes", "2"];
        let numbers = numbers_of_text(&output(place.path(), &arguments));
        format!("{} {}\n", task.file_stem().unwrap().to_str().unwrap(), digest(numbers.as_bytes()))
    });
    assert_frozen("baselines.txt", &lines.collect::<String>());
}
