//! `kestrel verify` on whole, deviating and damaged recordings.

use std::fs;
use std::path::{Path, PathBuf};

use crate::kestrel::{kestrel, refusal};

fn golden(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(path)
}

/// The settings of a small recording, one case of each kind.
const INDEX: &str = r#"{
  "cases": [
    {"id": "one_step_cf2x_pyb", "kind": "one_step", "model": "cf2x", "physics": "pyb", "rows": 64},
    {"id": "rand20_cf2x_pyb", "kind": "open_loop", "model": "cf2x", "physics": "pyb", "pyb_freq": 240, "ctrl_freq": 48,
     "phys_steps": 720, "first_contact_step": null, "num_drones": 1},
    {"id": "circle_cf2p_pyb_48", "kind": "closed_loop", "model": "cf2p", "controller_model": "cf2p", "physics": "pyb",
     "pyb_freq": 240, "ctrl_freq": 48},
    {"id": "hover_rpm", "kind": "rl", "env": "HoverAviary", "act": "rpm", "num_drones": 1, "pyb_freq": 240,
     "ctrl_freq": 30}
  ]
}
"#;

/// The tables of [`INDEX`], and some more.
const TABLES: [&str; 7] = [
    "one_step/cf2x_pyb.csv",
    "open_loop/rand20_cf2x_pyb.state.csv",
    "open_loop/rand20_cf2x_pyb.rpm.csv",
    "closed_loop/circle_cf2p_pyb_48.csv",
    "rl/hover_rpm.csv",
    "unit/attitude.csv",
    "unit/dslpid_calls.csv",
];

/// A small recording in the folder `recording` of a new directory.
fn recording() -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("recording");
    for table in TABLES {
        fs::create_dir_all(folder.join(table).parent().unwrap()).unwrap();
        fs::copy(golden("pybullet").join(table), folder.join(table)).unwrap();
    }
    fs::write(folder.join("index.json"), INDEX).unwrap();
    place
}

fn edit(place: &Path, file: &str, change: impl FnOnce(String) -> String) {
    let path = place.join("recording").join(file);
    let text = change(fs::read_to_string(&path).unwrap());
    fs::write(path, text).unwrap();
}

/// Replaces a cell, counted from zero, in a line, counted from one.
fn with_cell(text: &str, line: usize, column: usize, cell: &str) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut cells: Vec<&str> = lines[line - 1].split(',').collect();
    cells[column] = cell;
    lines[line - 1] = cells.join(",");
    lines.join("\n") + "\n"
}

#[test]
fn recordings_of_the_reference_are_reproduced() {
    let output = kestrel(Path::new("."), &["verify", golden("").to_str().unwrap()]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{text}");
    for kind in ["one_step ", "open_loop ", "closed_loop.flight ", "unit.dslpid_calls ", "fork.states "] {
        assert!(text.lines().any(|line| line.starts_with(kind) && line.contains("  ok ")), "{kind}: {text}");
    }
    assert!(!text.contains("FAIL"), "{text}");
}

#[test]
fn a_deviation_is_a_failure_that_names_the_case_and_its_row() {
    let place = recording();
    edit(place.path(), "open_loop/rand20_cf2x_pyb.state.csv", |text| with_cell(&text, 12, 4, "40.000001"));
    let output = kestrel(place.path(), &["verify", "recording"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(1), "{text}");
    let line = text.lines().find(|line| line.starts_with("open_loop")).unwrap();
    assert!(line.contains("FAIL") && line.contains("rand20_cf2x_pyb, step "), "{line}");
    let tolerant = kestrel(place.path(), &["verify", "recording", "--tolerance", "open_loop=1e9"]);
    assert_eq!(tolerant.status.code(), Some(0));
    let strict = kestrel(place.path(), &["verify", "recording", "--tolerance", "closed_loop=0"]);
    assert_eq!(strict.status.code(), Some(1));
}

#[test]
fn absent_numbers_and_kinds_are_left_out() {
    let place = recording();
    edit(place.path(), "open_loop/rand20_cf2x_pyb.state.csv", |text| with_cell(&text, 12, 4, "nan"));
    edit(place.path(), "index.json", |text| text.replace("\"rl\"", "\"sonar\""));
    fs::remove_dir_all(place.path().join("recording/unit")).unwrap();
    let output = kestrel(place.path(), &["verify", "recording"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains("note: 1 cases of kind sonar are not compared") && !text.contains("unit"), "{text}");
}

#[test]
fn another_drone_is_known_by_its_file() {
    let place = recording();
    let cf2x = golden("../../assets/airframes/cf2x.yaml");
    edit(place.path(), "index.json", |text| text.replace("\"model\": \"cf2x\"", "\"model\": \"mine\""));
    fs::rename(
        place.path().join("recording/one_step/cf2x_pyb.csv"),
        place.path().join("recording/one_step/mine_pyb.csv"),
    )
    .unwrap();
    assert!(refusal(&kestrel(place.path(), &["verify", "recording"])).contains("--airframe NAME=FILE"));
    let mine = format!("mine={}", cf2x.display());
    let output = kestrel(place.path(), &["verify", "recording", "--airframe", &mine]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8(output.stdout).unwrap());
}

/// A file of the recording, what is wrong with it, and what the message says.
type Damage = (&'static str, fn(String) -> String, &'static str);

const DAMAGES: [Damage; 24] = [
    ("index.json", |_| String::new(), "index.json:1: found a syntax error"),
    ("index.json", |text| text[..text.len() / 2].to_owned(), "index.json:"),
    ("index.json", |_| "[]".to_owned(), "index.json:1: found"),
    ("index.json", |_| "{}".to_owned(), "found no key `cases`, expected one"),
    ("index.json", |_| "{\"cases\": []}".to_owned(), "recording: found nothing that can be compared"),
    (
        "index.json",
        |text| text.replace("\"cf2x\"", "\"cf3x\""),
        "index.json:3 (case `one_step_cf2x_pyb`): found the model",
    ),
    (
        "index.json",
        |text| text.replacen("\"pyb\"", "\"pib\"", 1),
        "index.json:3 (case `one_step_cf2x_pyb`): found `pib`",
    ),
    ("index.json", |text| text.replace("\"rows\": 64", "\"rows\": 65"), "found 64 rows, expected 65"),
    ("index.json", |text| text.replace("\"kind\": \"rl\", ", ""), "(case `hover_rpm`): found no key `kind`"),
    ("index.json", |text| text.replace("\"hover_rpm\"", "\"../hover_rpm\""), "found the id \"../hover_rpm\""),
    (
        "index.json",
        |text| text.replace("\"ctrl_freq\": 48", "\"ctrl_freq\": 50"),
        "240 physics and 50 control steps",
    ),
    (
        "index.json",
        |text| text.replace("\"ctrl_freq\": 48", "\"ctrl_freq\": 0"),
        "240 physics and 0 control steps",
    ),
    (
        "index.json",
        |text| text.replace("\"phys_steps\": 720", "\"phys_steps\": \"all\""),
        "found string \"all\", expected usize",
    ),
    (
        "index.json",
        |text| text.replacen("\"num_drones\": 1", "\"num_drones\": 2", 1),
        "found 1 rows of step 0, expected 2",
    ),
    ("one_step/cf2x_pyb.csv", |text| with_cell(&text, 7, 2, "high"), "cf2x_pyb.csv:7: found `high` in column pz0"),
    ("one_step/cf2x_pyb.csv", |text| with_cell(&text, 7, 2, "inf"), "cf2x_pyb.csv:7: found `inf` in column pz0"),
    ("one_step/cf2x_pyb.csv", |text| with_cell(&text, 7, 2, "nan"), "cf2x_pyb.csv:7: found `nan` in column pz0"),
    ("one_step/cf2x_pyb.csv", |text| with_cell(&text, 7, 6, "3"), "cf2x_pyb.csv:7: found a quaternion of norm"),
    ("one_step/cf2x_pyb.csv", |text| text.replace("m0,", "n0,"), "cf2x_pyb.csv:1: found no column `m0`"),
    ("one_step/cf2x_pyb.csv", |text| text.replace("m1,", "m0,"), "found the column `m0` a second time"),
    (
        "open_loop/rand20_cf2x_pyb.state.csv",
        |text| text.trim_end()[..text.len() - 40].to_owned(),
        ".state.csv:76: found",
    ),
    (
        "open_loop/rand20_cf2x_pyb.rpm.csv",
        |text| with_cell(&text, 2, 1, "7"),
        "rpm.csv:2: found drone 7, expected less than 1",
    ),
    (
        "open_loop/rand20_cf2x_pyb.rpm.csv",
        |text| with_cell(&text, 2, 0, "1"),
        "found no rotor speeds of drone 0 at",
    ),
    (
        "rl/hover_rpm.csv",
        |text| text.replacen("terminated", "ended", 1),
        "hover_rpm.csv:1: found no column `terminated`",
    ),
];

#[test]
fn damaged_recordings_are_refused_with_file_line_found_and_expected() {
    for (file, damage, expected) in DAMAGES {
        let place = recording();
        fs::remove_dir_all(place.path().join("recording/unit")).unwrap();
        edit(place.path(), file, damage);
        let message = refusal(&kestrel(place.path(), &["verify", "recording"]));
        assert!(message.contains(expected), "{file}: {message}instead of {expected}");
        assert!(message.contains(": found ") && message.contains(", expected "), "{message}");
    }
}

#[test]
fn missing_and_odd_files_are_named() {
    let place = recording();
    let folder = place.path().join("recording");
    let verify = |path: &str| refusal(&kestrel(place.path(), &["verify", path]));
    assert!(verify("nowhere").contains("nowhere: found no folder, expected a folder with index.json"));
    fs::create_dir(place.path().join("empty")).unwrap();
    assert!(verify("empty").contains("empty: found no recording"));
    let table = folder.join("rl/hover_rpm.csv");
    fs::remove_file(&table).unwrap();
    assert!(verify("recording").contains("hover_rpm.csv: found no such file"));
    fs::create_dir(&table).unwrap();
    assert!(verify("recording").contains("hover_rpm.csv: found no plain file"));
    fs::remove_dir(&table).unwrap();
    fs::write(&table, b"k,drone\n0,\xff\n").unwrap();
    assert!(verify("recording").contains("hover_rpm.csv:2: found the byte 0xff, expected UTF-8"));
    fs::write(&table, "").unwrap();
    assert!(verify("recording").contains("hover_rpm.csv:1: found"));
}

#[test]
fn a_damaged_golden_file_of_the_fork_is_named() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("physics_golden.json");
    let whole = fs::read_to_string(golden("fork/physics_golden.json")).unwrap();
    let verify = |text: String| {
        fs::write(&path, text).unwrap();
        refusal(&kestrel(place.path(), &["verify", "."]))
    };
    assert!(verify(whole[..whole.len() / 2].to_owned()).contains("physics_golden.json:"));
    assert!(verify("[1]".to_owned()).contains("physics_golden.json:1: found"));
    let message = verify("{\"roll_a_PYB\": {\"state16\": [[1, 2]], \"rpm\": []}}".to_owned());
    assert!(message.contains("(case `roll_a_PYB`): found a length of 2"), "{message}");
    let message = verify("{\"roll_a_PIB\": {\"state16\": [], \"rpm\": []}}".to_owned());
    assert!(message.contains("found a flight whose name ends in no mode"), "{message}");
    let message = verify("{\"roll_a_PYB\": {\"state16\": [], \"rpm\": []}}".to_owned());
    assert!(message.contains("found 0 states and 0 rotor speeds"), "{message}");
}

#[test]
fn wrong_options_are_explained() {
    let place = recording();
    for (options, expected) in [
        (["--tolerance", "open_lop=1"], "expected one of one_step, open_loop"),
        (["--tolerance", "open_loop"], "expected KIND=X"),
        (["--tolerance", "open_loop=-1"], "zero or more"),
        (["--tolerance", "open_loop=nan"], "zero or more"),
        (["--airframe", "mine"], "expected NAME=FILE"),
        (["--airframe", "mine=nowhere.yaml"], "nowhere.yaml: found no such file"),
    ] {
        let arguments = [&["verify", "recording"][..], &options].concat();
        let message = refusal(&kestrel(place.path(), &arguments));
        assert!(message.contains(expected), "{message}");
    }
}
