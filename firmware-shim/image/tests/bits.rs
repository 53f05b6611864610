//! What the images compute is frozen: `BLESS=1 cargo test -p kestrel-image` writes `tests/golden/bits/image.txt` anew.

use std::fs;
use std::path::Path;
use std::process::Command;

#[test]
fn the_images_programs_compute_the_frozen_bits_on_this_machine() {
    let output = Command::new(env!("CARGO_BIN_EXE_conformance")).output().unwrap();
    assert!(output.status.success());
    let found = String::from_utf8(output.stdout).unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/bits/image.txt");
    if std::env::var_os("BLESS").is_some() {
        fs::write(&path, &found).unwrap();
    }
    assert_eq!(found, fs::read_to_string(&path).unwrap(), "bits have changed");
}
