//! Runs a search: batch by batch, rung by rung, all trials of a rung together on all cores.
//!
//! Each trial is a study of its own; to climb a rung is to have more seeds. What was done before is found in the
//! trials' directories, so that a search that goes on makes the same decisions as one that was never interrupted.

use std::path::{Path, PathBuf};

use kestrel_sim::config::ConfigError;

use super::config::SearchConfig;
use super::log;
use super::{Search, Trial, halving};
use crate::atomic_file::{FileError, remove_unfinished, write_atomically};
use crate::interrupt::Interrupt;
use crate::run_directory::lock::RunLock;
use crate::study::Study;
use crate::study::data::{StudyData, StudyError};
use crate::study::directory::{RunError, StudyDirectory, refuse_changes};
use crate::study::runner;
use crate::training_run::End;
use kestrel_learn::ranks;

/// The resolved search in its directory.
pub const CONFIG: &str = "search.yaml";

/// Why a search cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum SearchError {
    /// A point that the study file does not take.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A directory or a job.
    #[error(transparent)]
    Run(#[from] RunError),
    /// Rows of a trial.
    #[error(transparent)]
    Study(#[from] StudyError),
    /// The system refused a file operation.
    #[error(transparent)]
    File(#[from] FileError),
    /// The directory holds something else.
    #[error("{} is not empty and holds no search: choose a new directory", .0.display())]
    NotEmpty(PathBuf),
}

/// A search in its directory, open to be run.
#[derive(Debug)]
pub struct SearchRun<'a> {
    search: &'a Search,
    directory: PathBuf,
    _lock: RunLock,
}

impl<'a> SearchRun<'a> {
    /// Opens a new or an unfinished search in `directory`, for this process alone.
    ///
    /// # Errors
    /// When the directory is in use, holds anything else or another search, or cannot be written.
    pub fn open(search: &'a Search, directory: &Path) -> Result<Self, SearchError> {
        crate::study::directory::create(directory)?;
        let config = directory.join(CONFIG);
        let is_new = !config.is_file();
        if is_new && !crate::study::directory::is_empty(directory)? {
            return Err(SearchError::NotEmpty(directory.to_owned()));
        }
        let lock = RunLock::acquire(directory).map_err(RunError::from)?;
        if !is_new {
            refuse_changes::<SearchConfig>(&config, &search.resolved_yaml, &[&["trials"]])?;
        }
        remove_unfinished(directory)?;
        write_atomically(&config, search.resolved_yaml.as_bytes())?;
        Ok(Self { search, directory: directory.to_owned(), _lock: lock })
    }

    /// Runs what is left; `tell` hears of all trials after every batch.
    ///
    /// # Errors
    /// The first thing that went wrong; what is done is kept.
    pub fn run(
        &self,
        threads: usize,
        interrupt: &Interrupt,
        mut tell: impl FnMut(&[Trial]),
    ) -> Result<End, SearchError> {
        let Search { space, seed, algorithm, .. } = self.search;
        let mut trials: Vec<Trial> = Vec::new();
        while trials.len() < self.search.trials {
            let count = self.search.batch.min(self.search.trials - trials.len());
            let begun = |number| {
                let point = algorithm.propose(space, &trials, *seed, number);
                Trial { number, point, rungs: 0, seeds: 0, objective: 0.0 }
            };
            let batch: Vec<Trial> = (trials.len()..trials.len() + count).map(begun).collect();
            let first = trials.len();
            trials.extend(batch);
            if self.climb(&mut trials, first, threads, interrupt)? == End::Interrupted {
                return Ok(End::Interrupted);
            }
            tell(&trials);
        }
        Ok(End::Finished)
    }

    /// Takes the trials from `first` on up the rungs, as far as each gets.
    fn climb(
        &self,
        trials: &mut [Trial],
        first: usize,
        threads: usize,
        interrupt: &Interrupt,
    ) -> Result<End, SearchError> {
        let mut climbing: Vec<usize> = (first..trials.len()).collect();
        for (rung, &seeds) in self.search.rungs.iter().enumerate() {
            if rung > 0 {
                let contenders: Vec<&Trial> = climbing.iter().map(|&number| &trials[number]).collect();
                climbing = halving::promoted(&contenders, self.search.keep);
            }
            let points = climbing.iter().map(|&number| self.search.study(&trials[number].point, seeds));
            let studies: Vec<Study> = points.collect::<Result<_, _>>()?;
            if self.learn(&studies, &climbing, threads, interrupt)? == End::Interrupted {
                return Ok(End::Interrupted);
            }
            for (&number, study) in climbing.iter().zip(&studies) {
                let objective = self.search.objective.of(study, &StudyData::load(&self.path(number))?);
                trials[number] = Trial { rungs: rung + 1, seeds, objective, ..trials[number].clone() };
            }
            log::write(&self.directory, self.search, trials)?;
        }
        Ok(End::Finished)
    }

    fn learn(
        &self,
        studies: &[Study],
        numbers: &[usize],
        threads: usize,
        interrupt: &Interrupt,
    ) -> Result<End, SearchError> {
        let open = |(study, number): (_, &usize)| StudyDirectory::open_trial(study, &self.path(*number));
        let directories: Vec<StudyDirectory<'_>> =
            studies.iter().zip(numbers).map(open).collect::<Result<_, _>>()?;
        let is_done =
            |directory: &StudyDirectory<'_>| directory.study().jobs().iter().all(|job| directory.is_done(*job));
        if directories.iter().all(is_done) {
            return Ok(End::Finished);
        }
        Ok(runner::run(&directories, threads, interrupt, &ranks::alone())?)
    }

    /// Where a trial is.
    fn path(&self, number: usize) -> PathBuf {
        self.directory.join("trials").join(format!("{number:04}"))
    }
}

#[cfg(test)]
mod tests;
