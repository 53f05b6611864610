//! Many flights side by side.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, Result};
use kestrel_experiments::atomic_file::write_atomically;
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::progress::Progress;
use rayon::prelude::*;

use super::case::Case;
use super::expectation::{Expectation, Failure};
use super::film::{file_name, film};
use super::flight::{FlownCase, fly};

/// What came of one flight.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Verdict {
    /// Name of the file's tests.
    pub(crate) suite: String,
    /// Of the flight.
    pub(crate) name: String,
    /// How long it was \[s, simulated\].
    pub(crate) secs: f64,
    /// Of every bit of it.
    pub(crate) hash: u64,
    /// What came instead of what was expected.
    pub(crate) failures: Vec<Failure>,
    /// What the vehicle said, and when.
    pub(crate) heard: Vec<String>,
}

/// How flights are flown.
#[derive(Clone, Debug)]
pub(crate) struct RunOptions {
    /// Side by side; of no influence on the results.
    pub(crate) threads: usize,
    /// Where films of failed flights go.
    pub(crate) films: Option<PathBuf>,
}

/// Flies all cases; the verdicts are in their order. Nothing if the user stops it.
///
/// # Errors
/// When a flight cannot begin, or a film cannot be written.
pub(crate) fn run(cases: &[Case], options: &RunOptions, interrupt: &Interrupt) -> Result<Option<Vec<Verdict>>> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build()?;
    let progress = Mutex::new((Progress::counting("flights", cases.len() as u64, 0), Count::default()));
    let verdict = |case: &Case| {
        if interrupt.requested() {
            return Ok(None);
        }
        let verdict = judge(case, options.films.as_deref()).with_context(|| case.full_name())?;
        // A panic elsewhere ends all of this: the bar is only for show.
        let (progress, count) = &mut *progress.lock().unwrap_or_else(PoisonError::into_inner);
        count.flown += 1;
        count.failed += u64::from(!verdict.failures.is_empty());
        let failed = count.failed;
        progress.show_steps(count.flown, || format!("{failed} failed"));
        Ok(Some(verdict))
    };
    let verdicts = pool.install(|| cases.par_iter().map(verdict).collect::<Result<Vec<_>>>());
    progress.lock().unwrap_or_else(PoisonError::into_inner).0.finish();
    Ok(verdicts?.into_iter().collect())
}

#[derive(Default)]
struct Count {
    flown: u64,
    failed: u64,
}

/// Flies a case and holds it against what is expected.
fn judge(case: &Case, films: Option<&Path>) -> Result<Verdict> {
    let flown = fly(case)?;
    let failures: Vec<Failure> = failures(&case.expectations, &flown);
    if let Some(folder) = films
        && !failures.is_empty()
    {
        write_atomically(&folder.join(file_name(case)), &film(case, &flown, &failures)?)?;
    }
    let FlownCase { moments, .. } = &flown;
    let heard = moments
        .iter()
        .flat_map(|moment| moment.heard.iter().map(|words| format!("{:.2} s: {words}", moment.secs)))
        .collect();
    Ok(Verdict {
        suite: case.suite.clone(),
        name: case.name.clone(),
        secs: flown.secs(),
        hash: flown.hash,
        failures,
        heard,
    })
}

/// What came of a flight instead of what was expected.
pub(crate) fn failures(expectations: &[Expectation], flown: &FlownCase) -> Vec<Failure> {
    expectations.iter().filter_map(|expectation| expectation.failure(flown)).collect()
}
