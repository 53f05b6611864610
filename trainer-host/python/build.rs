//! Puts the shipped tasks, with all that they import, where maturin takes them into the wheel.

use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// Folders of the repository; the wheel has them in `kestrel_drones/shipped`.
const FOLDERS: [&str; 7] = include!("../shipped_folders.rs");

fn main() -> io::Result<()> {
    // Where it runs, not where it was compiled: a copied target folder must not bring another clone's files.
    let folder = |name| PathBuf::from(env::var_os(name).unwrap_or_default());
    let (repository, shipped) = (folder("CARGO_MANIFEST_DIR").join("../.."), folder("OUT_DIR").join("shipped"));
    if shipped.exists() {
        fs::remove_dir_all(&shipped)?;
    }
    for folder in FOLDERS {
        println!("cargo::rerun-if-changed={}", repository.join(folder).display());
        copy(&repository.join(folder), &shipped.join(folder))?;
    }
    Ok(())
}

fn copy(from: &Path, to: &Path) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}
