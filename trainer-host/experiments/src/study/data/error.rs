//! What can be wrong with a study's directory.

use std::path::PathBuf;

use crate::atomic_file::FileError;

/// A study cannot be loaded or reported.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// `study.json` is not what a study looks like.
    #[error("{}:{line}: {message}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// What the parser found and expected.
        message: String,
    },
    /// A value of `study.json` contradicts another or itself.
    #[error("{}: {field}: found {found}, expected {expected}", path.display())]
    Manifest {
        /// The file.
        path: PathBuf,
        /// Where in it.
        field: String,
        /// What it says.
        found: String,
        /// What it could say.
        expected: String,
    },
    /// A row is wrong, or one is missing or there twice.
    #[error("{}:{line}: {field}: found {found}, expected {expected}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// The column.
        field: &'static str,
        /// What it says.
        found: String,
        /// What it could say.
        expected: String,
    },
}
