//! `kestrel check`.

use std::fs;

use crate::kestrel::{kestrel, refusal};

#[test]
fn a_right_file_is_said_to_be_right_and_a_wrong_one_what_is_wrong() {
    let place = tempfile::tempdir().unwrap();
    let said = kestrel(place.path(), &["check", "hover", "crosses"]);
    let words = String::from_utf8(said.stdout).unwrap();
    let expected = "hover: right: 29 observed values, 4 actions at 50 Hz, trained by gradients through the physics\n\
                    crosses: right: 13 tasks, each with 38 observed values, 4 actions at 50 Hz\n";
    assert_eq!(words, expected);
    let wrong = refusal(&kestrel(place.path(), &["check", "hover", "--set", "training.epochs=none"]));
    assert!(wrong.contains("training.epochs"), "{wrong}");
    let several = refusal(&kestrel(place.path(), &["check", "hover", "land", "--resolved"]));
    assert!(several.contains("--resolved: found 2 tasks, expected one"), "{several}");
}

#[test]
fn what_is_resolved_needs_no_other_file_and_is_the_same_task() {
    let place = tempfile::tempdir().unwrap();
    let resolved = kestrel(place.path(), &["check", "room-1", "--resolved", "--set", "training.seed=7"]).stdout;
    fs::write(place.path().join("alone.yaml"), &resolved).unwrap();
    let again = kestrel(place.path(), &["check", "alone.yaml", "--resolved"]).stdout;
    assert!(resolved == again && String::from_utf8(resolved).unwrap().contains("seed: 7"));
}
