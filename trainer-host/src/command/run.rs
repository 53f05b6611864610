//! A run that exists on disk.

use std::path::Path;

use anyhow::Result;
use kestrel_experiments::experiment_config::{self, Experiment};
use kestrel_experiments::run_directory::RunDirectory;

/// Opens the run at `path` and reads its configuration.
pub(crate) fn open(path: &Path, overrides: &[String]) -> Result<(RunDirectory, Experiment)> {
    let directory = RunDirectory::open(path)?;
    let experiment = experiment_config::load(&directory.config(), overrides)?;
    Ok((directory, experiment))
}
