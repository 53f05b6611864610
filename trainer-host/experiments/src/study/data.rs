//! What the jobs of a study found, as far as they are finished.

mod error;
mod manifest;
#[cfg(test)]
pub(crate) mod synthetic;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::Path;

use rayon::prelude::*;

use super::rows::{CurveRow, EpisodeRow, Job, read_curve, read_episodes};

pub use error::StudyError;
pub use manifest::{Baseline, Method, MethodKind, Published, PublishedRow, PublishedValue, StudyManifest, Task};

/// A study as loaded from its directory.
#[derive(Clone, Debug)]
pub struct StudyData {
    /// What was to be run.
    pub manifest: StudyManifest,
    /// The jobs that are finished, by method, order and seed as the manifest lists them.
    pub runs: Vec<Run>,
    /// Jobs of the manifest that have left no rows.
    pub missing: Vec<Job>,
    /// Jobs that have left rows and no curve.
    pub without_curve: Vec<Job>,
}

/// One finished job.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Which of the manifest's methods.
    pub method: usize,
    /// Which of the manifest's orders.
    pub order: usize,
    /// Which of the manifest's seeds.
    pub seed: usize,
    /// By stage and task.
    cells: BTreeMap<(usize, usize), Cell>,
    /// Training progress, stage by stage, each by rising steps.
    pub curve: Vec<CurveRow>,
}

/// Means over the flights of one policy in one task.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cell {
    /// Share of flights that were a success.
    pub success: f64,
    /// Mean return.
    pub episode_return: f64,
    /// Mean length \[s\].
    pub length_secs: f64,
    /// Number of flights.
    pub episodes: usize,
}

impl StudyData {
    /// Loads a study; jobs that are not finished are listed as missing.
    ///
    /// # Errors
    /// When `study.json` or a file of rows is unreadable or wrong; the message names file, line, found and expected.
    pub fn load(directory: &Path) -> Result<Self, StudyError> {
        let manifest = StudyManifest::load(directory)?;
        let jobs: Vec<(Job, [usize; 3])> = manifest.possible_jobs();
        let loaded: Vec<Result<Option<Run>, StudyError>> =
            jobs.par_iter().map(|(job, place)| load_run(directory, &manifest, job, *place)).collect();
        let loaded: Vec<Option<Run>> = loaded.into_iter().collect::<Result<_, _>>()?;
        let expected = manifest.jobs();
        let absent = jobs.iter().zip(&loaded).filter(|((job, _), run)| run.is_none() && expected.contains(job));
        let missing = absent.map(|((job, _), _)| job.clone()).collect();
        let flat =
            jobs.iter().zip(&loaded).filter(|(_, run)| run.as_ref().is_some_and(|run| run.curve.is_empty()));
        let without_curve = flat.map(|((job, _), _)| job.clone()).collect();
        Ok(Self { runs: loaded.into_iter().flatten().collect(), manifest, missing, without_curve })
    }

    /// The finished runs of a method.
    pub fn runs_of(&self, method: usize) -> impl Iterator<Item = &Run> {
        self.runs.iter().filter(move |run| run.method == method)
    }

    /// The tasks of a run's order, first trained first.
    pub fn order(&self, run: &Run) -> &[usize] {
        &self.manifest.orders[run.order]
    }

    /// The flights that a finished run ends with on `task`: of the last policy, or of the task's own expert.
    pub fn final_cell<'a>(&self, run: &'a Run, task: usize) -> Option<&'a Cell> {
        let order = self.order(run);
        let stage = match self.manifest.methods[run.method].kind {
            MethodKind::Sequential => order.len(),
            MethodKind::Joint | MethodKind::Averaged => 1,
            MethodKind::Experts => 1 + order.iter().position(|trained| *trained == task)?,
        };
        run.cell(stage, task)
    }
}

impl Run {
    /// The flights in `task` after `stage`; none when that was not flown.
    pub fn cell(&self, stage: usize, task: usize) -> Option<&Cell> {
        self.cells.get(&(stage, task))
    }

    /// The training progress of one stage, by rising steps.
    pub fn curve_of(&self, stage: usize) -> impl Iterator<Item = &CurveRow> {
        self.curve.iter().filter(move |row| row.stage == stage)
    }
}

fn load_run(
    directory: &Path,
    manifest: &StudyManifest,
    job: &Job,
    [method, order, seed]: [usize; 3],
) -> Result<Option<Run>, StudyError> {
    if !job.rows_path(directory).exists() {
        return Ok(None);
    }
    let cells = cells(&read_episodes(directory, manifest, job)?);
    let has_curve = job.curve_path(directory).exists();
    let curve = if has_curve { read_curve(directory, manifest, job)? } else { Vec::new() };
    Ok(Some(Run { method, order, seed, cells, curve }))
}

fn cells(rows: &[EpisodeRow]) -> BTreeMap<(usize, usize), Cell> {
    let groups = rows.chunk_by(|first, second| (first.stage, first.task) == (second.stage, second.task));
    groups.map(|group| ((group[0].stage, group[0].task), cell(group))).collect()
}

fn cell(flights: &[EpisodeRow]) -> Cell {
    let count = flights.len() as f64;
    let mean = |value: fn(&EpisodeRow) -> f64| flights.iter().map(value).sum::<f64>() / count;
    Cell {
        success: mean(|flight| f64::from(u8::from(flight.success))),
        episode_return: mean(|flight| f64::from(flight.episode_return)),
        length_secs: mean(|flight| f64::from(flight.length_secs)),
        episodes: flights.len(),
    }
}
