//! Suites that look at several crates at once.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on should panic")]

mod clean_and_bullet;
mod diagnosis;
mod goldens;
mod layering;
mod learning;
mod pages;
mod plot;
mod readme;
mod reference;
mod source;
mod tune;

use std::fs;
use std::path::Path;

/// That a committed file is what the code makes; with `BLESS=1` it becomes that.
fn assert_blessed(path: &Path, text: &str) {
    if std::env::var_os("BLESS").is_some() {
        fs::write(path, text).unwrap();
    }
    let committed = fs::read_to_string(path).unwrap();
    assert!(committed == text, "{} is out of date: BLESS=1 and look at the change", path.display());
}
