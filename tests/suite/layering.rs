//! The arrows between the crates, as `cargo metadata` sees them.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Which package may name which of the others.
const ARROWS: [(&str, &[&str]); 18] = [
    ("kestrel-core", &[]),
    ("kestrel-onboard", &["kestrel-core"]),
    ("kestrel-config", &[]),
    ("kestrel-sim", &["kestrel-config", "kestrel-core"]),
    ("kestrel-gpu", &["kestrel-core", "kestrel-sim"]),
    ("kestrel-shim", &["kestrel-core", "kestrel-onboard"]),
    ("kestrel-image", &["kestrel-core", "kestrel-onboard"]),
    ("kestrel-crazyflie", &["kestrel-core"]),
    ("kestrel-learn", &["kestrel-core", "kestrel-config"]),
    ("kestrel-export", &["kestrel-core", "kestrel-sim"]),
    ("kestrel-draw", &["kestrel-core", "kestrel-sim"]),
    ("kestrel-verify", &["kestrel-core", "kestrel-sim"]),
    ("kestrel-identify", &["kestrel-core", "kestrel-onboard", "kestrel-learn"]),
    ("kestrel-experiments", &["kestrel-core", "kestrel-sim", "kestrel-learn", "kestrel-export", "kestrel-draw"]),
    (
        "kestrel-ros",
        &["kestrel-core", "kestrel-onboard", "kestrel-sim", "kestrel-shim", "kestrel-draw", "kestrel-experiments"],
    ),
    ("kestrel-python", &["kestrel-core", "kestrel-sim", "kestrel-learn", "kestrel-export", "kestrel-experiments"]),
    (
        "kestrel-web",
        &[
            "kestrel-core",
            "kestrel-onboard",
            "kestrel-sim",
            "kestrel-draw",
            "kestrel-export",
            "kestrel-experiments",
        ],
    ),
    (
        "kestrel",
        &[
            "kestrel-core",
            "kestrel-sim",
            "kestrel-shim",
            "kestrel-learn",
            "kestrel-export",
            "kestrel-draw",
            "kestrel-gpu",
            "kestrel-experiments",
            "kestrel-verify",
            "kestrel-identify",
            "kestrel-ros",
        ],
    ),
];

/// The files that may lift the ban on unsafe code, each because a machine leaves no other way.
const UNSAFE: [&str; 8] = [
    "core-nostd/src/fixed/smlad.rs",
    "firmware-shim/crazyflie/src/lib.rs",
    "firmware-shim/image/src/bin/conformance.rs",
    "firmware-shim/image/src/machine/page.rs",
    "firmware-shim/image/src/machine/panic.rs",
    "firmware-shim/image/src/machine/semihosting.rs",
    "firmware-shim/image/src/machine/usart.rs",
    "firmware-shim/image/src/probe.rs",
];

fn metadata() -> Value {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".into());
    let output = Command::new(cargo)
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .output()
        .unwrap();
    serde_json::from_slice(&output.stdout).unwrap()
}

fn packages() -> Vec<Value> {
    metadata()["packages"].as_array().unwrap().clone()
}

fn dependencies(package: &Value) -> BTreeSet<String> {
    let all = package["dependencies"].as_array().unwrap().iter();
    let shipped = all.filter(|dependency| dependency["kind"].is_null());
    shipped.map(|dependency| dependency["name"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn crates_name_only_those_below_them() {
    let packages = packages();
    for (name, allowed) in ARROWS {
        let package = packages.iter().find(|package| package["name"] == name).unwrap();
        let kestrel = dependencies(package).into_iter().filter(|name| name.starts_with("kestrel-"));
        let unexpected: Vec<String> = kestrel.filter(|name| !allowed.contains(&name.as_str())).collect();
        assert!(unexpected.is_empty(), "{name} names {unexpected:?}, which it may not know");
    }
}

#[test]
fn the_core_needs_no_operating_system() {
    let core = packages().into_iter().find(|package| package["name"] == "kestrel-core").unwrap();
    let expected =
        ["bytemuck", "heapless", "libm", "nalgebra", "postcard", "serde", "thiserror"].map(String::from);
    assert!(dependencies(&core).is_subset(&BTreeSet::from(expected)));
    assert_eq!(core["features"]["default"], serde_json::json!(["float"]), "inference alone, in both arithmetics");
}

#[test]
fn what_is_on_board_needs_no_operating_system() {
    let onboard = packages().into_iter().find(|package| package["name"] == "kestrel-onboard").unwrap();
    let expected =
        ["heapless", "kestrel-core", "libm", "mavlink", "nalgebra", "sha2", "thiserror"].map(String::from);
    assert!(dependencies(&onboard).is_subset(&BTreeSet::from(expected)));
    let all = onboard["dependencies"].as_array().unwrap();
    let shipped = |name| all.iter().find(|found| found["name"] == name && found["kind"].is_null()).unwrap();
    assert_eq!(shipped("mavlink")["optional"], Value::Bool(true), "hosts only");
    assert_eq!(shipped("kestrel-core")["features"], Value::Array(Vec::new()), "without the standard library");
    assert_eq!(onboard["features"]["default"], Value::Null);
}

/// Files below `directory` that end with `.rs`.
fn sources(directory: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn unsafe_code_stands_where_the_list_says() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let mut files = Vec::new();
    for package in ["core-nostd", "sim-host", "trainer-host", "firmware-shim"] {
        sources(&root.join(package), &mut files);
    }
    let lifts_the_ban = |path: &&PathBuf| {
        let source = fs::read_to_string(path).unwrap();
        source.contains("allow(unsafe_code") || source.contains("expect(unsafe_code")
    };
    let mut lifted: Vec<_> = files
        .iter()
        .filter(lifts_the_ban)
        .map(|path| path.strip_prefix(root).unwrap().to_str().unwrap())
        .collect();
    lifted.sort_unstable();
    assert_eq!(lifted, UNSAFE);
}

#[test]
fn cargo_run_means_kestrel() {
    let metadata = metadata();
    let members = metadata["workspace_default_members"].as_array().unwrap();
    assert!(members.len() == 1 && members[0].as_str().unwrap().contains("trainer-host#kestrel@"), "{members:?}");
}
