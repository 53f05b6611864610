//! Lists the tasks and pilots, with all that they import, for the program to carry.

use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

/// Folders of the repository.
const FOLDERS: [&str; 7] = include!("shipped_folders.rs");

fn main() -> Result<(), Box<dyn Error>> {
    let repository = PathBuf::from(env::var("CARGO_MANIFEST_DIR")?).join("..");
    let mut source = String::from("&[\n");
    for folder in FOLDERS {
        println!("cargo::rerun-if-changed={}", repository.join(folder).display());
        list(&repository, folder, &mut source)?;
    }
    source.push_str("]\n");
    fs::write(PathBuf::from(env::var("OUT_DIR")?).join("shipped.rs"), source)?;
    Ok(())
}

/// Adds every file below `folder` that a task may need, with its path in the repository.
fn list(repository: &Path, folder: &str, source: &mut String) -> Result<(), Box<dyn Error>> {
    let mut entries = fs::read_dir(repository.join(folder))?.collect::<Result<Vec<_>, _>>()?;
    entries.sort_by_key(fs::DirEntry::file_name);
    for entry in entries {
        let name = format!("{folder}/{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            list(repository, &name, source)?;
        } else if Path::new(&name).extension().is_none_or(|ending| ending != "json") {
            let path = entry.path().canonicalize()?;
            let path = path.to_str().ok_or("the repository lies at a path that is no Unicode")?;
            writeln!(source, "    ({name:?}, include_bytes!({path:?})),")?;
        }
    }
    Ok(())
}
