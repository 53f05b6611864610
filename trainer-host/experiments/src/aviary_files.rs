//! Aviaries by name: world files, and the aviaries of experiments.

use std::fs;
use std::path::{Path, PathBuf};

use kestrel_draw::plan::Subject;
use kestrel_sim::config::{AviaryConfig, ConfigError, Document};

use crate::experiment_config;
use crate::study::config::multi_task::TASKS;

#[cfg(test)]
mod tests;

/// Where aviaries are looked for by name.
const FOLDERS: [&str; 3] = ["configs", "assets/worlds", "configs/aviaries"];

/// Why there is no such aviary.
#[derive(Debug, thiserror::Error)]
pub enum AviaryFileError {
    /// Neither a file nor a known name.
    #[error("{name}: found no such file or aviary, expected a YAML file or one of: {known}")]
    Unknown {
        /// What was asked for.
        name: String,
        /// Names that there are.
        known: String,
    },
    /// The file is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
}

/// The file called `name`: a path, or the name of a file in `configs` or `assets/worlds`.
///
/// # Errors
/// [`AviaryFileError::Unknown`], with the names that there are.
pub fn find(name: &str) -> Result<PathBuf, AviaryFileError> {
    let path = PathBuf::from(name);
    if path.is_file() {
        return Ok(path);
    }
    let paths = in_folders(&FOLDERS.map(PathBuf::from));
    let named = paths.iter().find(|path| stem(path) == name);
    named.cloned().ok_or_else(|| AviaryFileError::Unknown {
        name: name.to_owned(),
        known: paths.iter().map(|path| stem(path)).collect::<Vec<_>>().join(", "),
    })
}

/// The YAML files in these folders, or in those where aviaries are looked for by name, sorted in each; without those of
/// several tasks, which name the files of their aviaries.
pub fn in_folders(folders: &[PathBuf]) -> Vec<PathBuf> {
    let default = FOLDERS.map(PathBuf::from);
    let folders = if folders.is_empty() { &default[..] } else { folders };
    folders.iter().flat_map(|folder| yaml_files(folder)).collect()
}

fn yaml_files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "yaml") && !holds_tasks(path))
        .collect();
    paths.sort();
    paths
}

/// A file that cannot be read is no such file: who reads it next says what is wrong with it.
fn holds_tasks(path: &Path) -> bool {
    Document::read(path).is_ok_and(|document| document.holds(TASKS))
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The aviary in the file at `path`, an experiment or a world, after `overrides`.
///
/// # Errors
/// What is wrong with the file.
pub fn read(path: &Path, overrides: &[String]) -> Result<Subject, ConfigError> {
    let mut document = Document::read(path)?;
    if document.holds("scenario") {
        let experiment = experiment_config::load(path, overrides)?;
        return Ok(Subject::of_scenario(stem(path), &experiment.evaluation.scenario));
    }
    for assignment in overrides {
        document.set(assignment)?;
    }
    let place = document.decode::<AviaryConfig>()?.place(&document.root())?;
    Ok(Subject::of_place(stem(path), place))
}
