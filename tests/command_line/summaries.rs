//! `kestrel runs`.

use std::fs;

use crate::kestrel::{kestrel, printed, refusal, train_tiny};

#[test]
fn runs_are_listed_and_what_differs_is_named() {
    let place = tempfile::tempdir().unwrap();
    for (run, seed) in [("runs/one", "training.seed=1"), ("runs/two", "training.seed=2")] {
        assert!(train_tiny(place.path(), run, &["--set", seed]).status.success());
    }
    let listed = printed(&kestrel(place.path(), &["runs"]));
    let lines: Vec<&str> = listed.lines().collect();
    assert!(lines[0].starts_with("run ") && lines[1].starts_with("runs/one") && lines[2].starts_with("runs/two"));
    assert!(lines[1].contains("hover") && lines[1].contains("16.4 k") && lines[1].contains(" % "), "{listed}");
    assert!(lines.iter().any(|line| line.split_whitespace().eq(["training.seed", "1", "2"])), "{listed}");
    let one = printed(&kestrel(place.path(), &["runs", "runs/one"]));
    assert_eq!(one.lines().count(), 2, "{one}");

    fs::write(place.path().join("runs/two/evaluation.json"), "[{").unwrap();
    let damaged = kestrel(place.path(), &["runs"]);
    let warned = String::from_utf8_lossy(&damaged.stderr).into_owned();
    assert!(damaged.status.success() && warned.contains("evaluation.json: found no report"), "{warned}");
    fs::remove_file(place.path().join("runs/two/evaluation.json")).unwrap();
    assert!(printed(&kestrel(place.path(), &["runs", "runs/two"])).contains("not judged"));
    let nothing = refusal(&kestrel(place.path(), &["runs", "elsewhere"]));
    assert!(nothing.contains("elsewhere: found no run, expected a run or a folder of runs"), "{nothing}");
}
