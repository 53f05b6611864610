//! A run that exists on disk.

use std::path::Path;

use anyhow::Result;
use kestrel_experiments::run_config::RunConfig;
use kestrel_experiments::run_directory::RunDirectory;

use crate::shipped;

/// Opens the run at `path` and reads its configuration.
pub(crate) fn open(path: &Path, overrides: &[String]) -> Result<(RunDirectory, RunConfig)> {
    let directory = RunDirectory::open(path)?;
    let config = RunConfig::load(&directory.config(), overrides)?;
    Ok((directory, config))
}

/// The configuration in an experiment file, of a shipped task by its name, or of the run in a directory.
pub(crate) fn task_config(path: &Path, overrides: &[String]) -> Result<RunConfig> {
    let path = &shipped::task(path)?;
    if path.is_dir() { Ok(open(path, overrides)?.1) } else { Ok(RunConfig::load(path, overrides)?) }
}
