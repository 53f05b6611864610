//! Recordings of the reference system against this program's physics, controllers, tasks and camera.
//!
//! A recording is a folder with an `index.json` and the tables that it names, as `tests/golden/README.md` describes;
//! [`verify`] flies each case in `f64` and keeps the worst deviation of each [`Kind`].

mod camera;
mod closed_loop;
mod contact;
mod error;
mod file;
mod fork;
mod index;
mod learning;
mod model;
mod motion;
mod one_step;
mod open_loop;
mod report;
mod table;
mod task;
#[cfg(test)]
mod tests;
mod thesis;
mod unit;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub use error::RecordingError;
pub use learning::{ActionKind as LearningAction, LearningEpisode, LearningObservation, LearningStep};
pub use model::{Models, Physics};
pub use motion::{Clock, Logged};
pub use open_loop::{Command, Run, Sample, StaticBox};
pub use report::{Finding, Kind, Report, Tolerances};
pub use thesis::{ActionKind as ThesisAction, ThesisEpisode, ThesisStep};

use index::Json;
use report::Ledger;

/// Compares everything that a folder holds: `index.json` with its tables, `unit`, `thesis` and `physics_golden.json`,
/// in it or in its folders `pybullet` and `fork`.
///
/// # Errors
/// The first file that is missing, malformed or contradicts another; or when there is nothing to compare.
pub fn verify(folder: &Path, models: &Models, tolerances: Tolerances) -> Result<Report, RecordingError> {
    let places: Vec<Place> = [folder.to_owned(), folder.join("pybullet"), folder.join("fork")]
        .into_iter()
        .map(Place)
        .filter(|place| !place.is_empty())
        .collect();
    if places.is_empty() {
        return Err(no_recording(folder));
    }
    let mut ledger = Ledger::new(tolerances);
    for place in &places {
        place.compare(models, &mut ledger)?;
    }
    let report = ledger.into_report();
    if report.rows() > 0 {
        return Ok(report);
    }
    Err(RecordingError::about(folder, "nothing that can be compared", "cases with rows"))
}

fn no_recording(folder: &Path) -> RecordingError {
    let found = if folder.is_dir() { "no recording" } else { "no folder" };
    RecordingError::about(folder, found, "a folder with index.json, unit, thesis or physics_golden.json")
}

/// A folder, and what it may hold.
struct Place(PathBuf);

/// Files and folders of a recording.
const PARTS: [&str; 4] = ["index.json", "unit", "thesis", "physics_golden.json"];

impl Place {
    fn part(&self, name: &str) -> Option<PathBuf> {
        Some(self.0.join(name)).filter(|path| path.exists())
    }

    fn is_empty(&self) -> bool {
        PARTS.iter().all(|name| self.part(name).is_none())
    }

    fn compare(&self, models: &Models, ledger: &mut Ledger) -> Result<(), RecordingError> {
        let [index, unit, thesis, golden] = PARTS.map(|name| self.part(name));
        if let Some(path) = index {
            compare_cases(&self.0, &path, models, ledger)?;
        }
        if let Some(folder) = unit {
            unit::compare(&folder, models, ledger)?;
        }
        if let Some(folder) = thesis {
            thesis::compare(&folder, models, ledger)?;
        }
        if let Some(path) = golden {
            fork::compare(&path, models, ledger)?;
        }
        Ok(())
    }
}

fn compare_cases(folder: &Path, index: &Path, models: &Models, ledger: &mut Ledger) -> Result<(), RecordingError> {
    let index = Json::read(index)?;
    let mut left_out: BTreeMap<String, usize> = BTreeMap::new();
    for case in index.cases()? {
        match case.kind.as_deref() {
            Some("one_step") => one_step::compare(folder, &case, models, ledger)?,
            Some("open_loop") => open_loop::compare(folder, &case, models, ledger)?,
            Some("closed_loop") => closed_loop::compare(folder, &case, models, ledger)?,
            Some("camera") => camera::compare(folder, &case, ledger)?,
            Some("rl") => learning::compare(folder, &case, models, ledger)?,
            Some(other) => *left_out.entry(other.to_owned()).or_default() += 1,
            None => return Err(case.part.refuse("no key `kind`", "one, such as `open_loop`")),
        }
    }
    for (kind, cases) in left_out {
        ledger.note(format!("{cases} cases of kind {kind} are not compared: the kind is not known"));
    }
    Ok(())
}
