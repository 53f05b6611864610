//! Plans of aviaries, and experiments that import one.

use std::fs;
use std::path::{Path, PathBuf};

use crate::kestrel::{config, kestrel, refusal};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

#[test]
fn aviaries_are_listed_and_drawn_by_name() {
    let list = kestrel(&repository(), &["aviary", "list"]);
    let text = String::from_utf8(list.stdout).unwrap();
    assert!(list.status.success() && text.lines().count() > 40, "{text}");
    let room = text.lines().find(|line| line.starts_with("room-2 ")).unwrap();
    assert!(room.contains("144") && room.contains("8.20 x 3.20 x 1.55 m"), "{room}");

    let place = tempfile::tempdir().unwrap();
    for (name, starts) in [("plan.svg", &b"<svg "[..]), ("plan.png", b"\x89PNG")] {
        let output = place.path().join(name);
        let shown = kestrel(&repository(), &["aviary", "show", "maze", "--output", output.to_str().unwrap()]);
        assert!(shown.status.success(), "{shown:?}");
        assert!(fs::read(&output).unwrap().starts_with(starts), "{name}");
    }
    let several = place.path().join("sheet.svg");
    let arguments = ["aviary", "show", "maze", "configs/cross.yaml", "-o", several.to_str().unwrap()];
    assert!(kestrel(&repository(), &arguments).status.success());
    let sheet = fs::read_to_string(several).unwrap();
    assert!(sheet.contains(">maze</text>") && sheet.contains(">cross</text>"));
}

#[test]
fn what_cannot_be_drawn_is_said() {
    let place = tempfile::tempdir().unwrap();
    let message = |arguments: &[&str]| refusal(&kestrel(place.path(), arguments));
    assert!(
        message(&["aviary", "show", "nowhere", "-o", "x.svg"]).contains("nowhere: found no such file or aviary")
    );
    assert!(message(&["aviary", "list"]).contains("found no YAML files"));
    assert!(message(&["aviary", "list", "none"]).contains("none: found no folder"));
    fs::write(place.path().join("world.yaml"), "solids: [{low_m: [0, 0, 0], high_m: [1, 1, 1]}]\n").unwrap();
    assert!(message(&["aviary", "show", "world.yaml", "-o", "x.gif"]).contains("expected .svg or .png"));
    let wrong = message(&["aviary", "show", "world.yaml", "-o", "x.svg", "--set", "import=none.yaml"]);
    assert!(wrong.contains("--set import=none.yaml: found no such file (none.yaml)"), "{wrong}");
    fs::write(place.path().join("broken.yaml"), "solids: [{}]\n").unwrap();
    let listed = kestrel(place.path(), &["aviary", "list", "."]);
    assert_eq!(listed.status.code(), Some(2));
    let errors = String::from_utf8(listed.stderr).unwrap();
    assert!(errors.contains("broken.yaml:1:10: solids.0: found no outline"), "{errors}");
    assert!(!place.path().join("x.svg").exists());
}

#[test]
fn a_wrong_world_is_blamed_on_its_own_file() {
    let place = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(config("hover.yaml")).unwrap();
    let text = text.replace("  aviary:\n", "  aviary:\n    import: worlds/here.yaml\n");
    fs::write(place.path().join("trial.yaml"), text).unwrap();
    fs::create_dir(place.path().join("worlds")).unwrap();
    fs::write(place.path().join("worlds/here.yaml"), "pillars: [[0, far]]\n").unwrap();
    let message = refusal(&kestrel(place.path(), &["train", "trial.yaml"]));
    assert!(
        message.contains("worlds/here.yaml:1:15: scenario.aviary.pillars.0.1: found the text \"far\""),
        "{message}"
    );
    assert!(message.contains("\n  imported by trial.yaml:16:13\n"), "{message}");
}
