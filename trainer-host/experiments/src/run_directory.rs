//! One run on disk: what lies where, who may write to it, and how it begins and goes on.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::atomic_file::{FileError, remove_unfinished, write_atomically};

pub mod metrics;

pub(crate) mod lock;

/// A directory that holds one training run.
///
/// | path | what |
/// |---|---|
/// | `config.yaml` | the resolved configuration, seed included |
/// | `metrics.jsonl` | one JSON object per update |
/// | `events.out.tfevents.*` | the same for TensorBoard |
/// | `checkpoints/` | all that the run needs to go on; the last two |
/// | `learning-curve.svg` | return and success over environment steps |
/// | `policy.kestrel`, `policy-f32.kestrel` | the exported policy, fixed point and float |
/// | `export.json`, `evaluation.json` | reports |
/// | `flight.gif` | one evaluated flight; `flight-TASK.gif` where there are several tasks |
#[derive(Debug)]
pub struct RunDirectory {
    path: PathBuf,
    // Held for its drop: whoever trains in the directory is its only writer.
    _lock: Option<lock::RunLock>,
}

/// Why a directory cannot be used for a run.
#[derive(Debug, thiserror::Error)]
pub enum RunDirectoryError {
    /// A new run was asked for where one exists.
    #[error("{} already holds a run: continue it with --resume, begin anew with --force, or choose another directory", .0.display())]
    HoldsRun(PathBuf),
    /// A new run was asked for in a directory with other things in it.
    #[error("{} is not empty (it holds {found}): choose a new or an empty directory", path.display())]
    NotEmpty {
        /// The directory.
        path: PathBuf,
        /// One of the things in it.
        found: String,
    },
    /// A run was expected and none is there.
    #[error("{} holds no run: expected a directory made by `kestrel train`, found {}", .0.display(), in_its_place(.0))]
    NoRun(PathBuf),
    /// The run's policies are wanted, and it has exported none yet.
    #[error("{} holds no exported policy yet: make it with `kestrel export`, or let the training finish", .0.display())]
    NoPolicy(PathBuf),
    /// Another process trains in the directory.
    #[error("{} is in use by {owner}: wait for it to end, or stop it first", path.display())]
    InUse {
        /// The directory.
        path: PathBuf,
        /// Who uses it, as `process 1234`.
        owner: String,
    },
    /// A name that would leave the directory of runs.
    #[error("a run cannot be named {0:?}: expected letters, digits, '-', '_' and '.'")]
    Name(String),
    /// A row of the metrics that is no row.
    #[error("{} line {line}: expected a JSON object with the metrics of an update, found {found}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What is wrong with it.
        found: String,
    },
    /// The system refused a file operation.
    #[error(transparent)]
    File(#[from] FileError),
}

/// What is where a run was expected.
fn in_its_place(path: &Path) -> &'static str {
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => "no config.yaml",
        Ok(_) => "a file",
        Err(_) => "nothing",
    }
}

impl RunDirectory {
    /// Begins a run in a new or empty directory at `path`, for this process alone; `config` becomes `config.yaml`.
    ///
    /// # Errors
    /// [`RunDirectoryError`]: the directory holds a run or anything else, is in use, or cannot be written.
    pub fn create(path: &Path, config: &str) -> Result<Self, RunDirectoryError> {
        let run = Self::create_untrained(path, config)?;
        let checkpoints = run.checkpoints();
        fs::create_dir(&checkpoints).map_err(|cause| FileError::new("create", &checkpoints, cause))?;
        Ok(run)
    }

    /// As [`Self::create`], for a policy that was trained elsewhere: without a place for checkpoints.
    ///
    /// # Errors
    /// As [`Self::create`].
    pub fn create_untrained(path: &Path, config: &str) -> Result<Self, RunDirectoryError> {
        fs::create_dir_all(path).map_err(|cause| FileError::new("create", path, cause))?;
        let lock = lock::RunLock::acquire(path)?;
        refuse_contents(path)?;
        let run = Self { path: path.to_owned(), _lock: Some(lock) };
        write_atomically(&run.config(), config.as_bytes())?;
        Ok(run)
    }

    /// Makes a directory at `path` that keeps a policy and the configuration `config` that made it, without checkpoints.
    ///
    /// # Errors
    /// The system's reason.
    pub fn keep(path: &Path, config: &str) -> Result<Self, RunDirectoryError> {
        fs::create_dir_all(path).map_err(|cause| FileError::new("create", path, cause))?;
        remove_unfinished(path)?;
        let kept = Self { path: path.to_owned(), _lock: None };
        write_atomically(&kept.config(), config.as_bytes())?;
        Ok(kept)
    }

    /// Makes a directory at `path` for policies alone: no run is in it.
    ///
    /// # Errors
    /// The system's reason.
    pub fn of_policies(path: &Path) -> Result<Self, RunDirectoryError> {
        fs::create_dir_all(path).map_err(|cause| FileError::new("create", path, cause))?;
        remove_unfinished(path)?;
        Ok(Self { path: path.to_owned(), _lock: None })
    }

    /// Begins a run in `runs/stem-1`, or in the first higher number that nobody has taken.
    ///
    /// # Errors
    /// As [`Self::create`], and for a `stem` that is no file name.
    pub fn create_next(runs: &Path, stem: &str, config: &str) -> Result<Self, RunDirectoryError> {
        check_name(stem)?;
        fs::create_dir_all(runs).map_err(|cause| FileError::new("create", runs, cause))?;
        let mut number = highest_number(runs, stem)? + 1;
        loop {
            let path = runs.join(format!("{stem}-{number}"));
            match fs::create_dir(&path) {
                Ok(()) => return Self::create(&path, config),
                // Another process was faster: the next number is ours.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => number += 1,
                Err(cause) => return Err(FileError::new("create", &path, cause).into()),
            }
        }
    }

    /// Goes on with the run at `path`, for this process alone.
    ///
    /// # Errors
    /// [`RunDirectoryError`]: no run there, in use, or not writable.
    pub fn resume(path: &Path) -> Result<Self, RunDirectoryError> {
        let Self { path, .. } = Self::open(path)?;
        let lock = lock::RunLock::acquire(&path)?;
        let run = Self { path, _lock: Some(lock) };
        let checkpoints = run.checkpoints();
        fs::create_dir_all(&checkpoints).map_err(|cause| FileError::new("create", &checkpoints, cause))?;
        remove_unfinished(&run.path)?;
        remove_unfinished(&checkpoints)?;
        Ok(run)
    }

    /// Removes the run at `path` with all that it holds.
    ///
    /// # Errors
    /// [`RunDirectoryError`]: no run there, in use, or not to be removed.
    pub fn remove(path: &Path) -> Result<(), RunDirectoryError> {
        let Self { path, .. } = Self::open(path)?;
        let _lock = lock::RunLock::acquire(&path)?;
        fs::remove_dir_all(&path).map_err(|cause| FileError::new("remove", &path, cause).into())
    }

    /// Opens the run at `path` to read it and to add reports; a training process may be at work in it.
    ///
    /// # Errors
    /// [`RunDirectoryError::NoRun`] when there is none.
    pub fn open(path: &Path) -> Result<Self, RunDirectoryError> {
        let run = Self { path: path.to_owned(), _lock: None };
        if run.config().is_file() { Ok(run) } else { Err(RunDirectoryError::NoRun(path.to_owned())) }
    }

    /// The fixed-point policy, which is there. That in float is beside it in a run, but not in what came without training.
    ///
    /// # Errors
    /// [`RunDirectoryError::NoPolicy`] when it is not.
    pub fn exported_policy(&self) -> Result<PathBuf, RunDirectoryError> {
        let policy = self.policy();
        if policy.exists() { Ok(policy) } else { Err(RunDirectoryError::NoPolicy(self.path.clone())) }
    }

    /// The directory itself.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Last part of the path, for titles.
    pub fn name(&self) -> String {
        let whole = fs::canonicalize(&self.path).unwrap_or_else(|_| self.path.clone());
        whole.file_name().unwrap_or(whole.as_os_str()).to_string_lossy().into_owned()
    }

    /// The resolved configuration.
    pub fn config(&self) -> PathBuf {
        Self::config_in(&self.path)
    }

    /// The resolved configuration of the run in a directory, whoever has that open.
    pub fn config_in(directory: &Path) -> PathBuf {
        directory.join("config.yaml")
    }

    /// One JSON object per update.
    pub fn metrics(&self) -> PathBuf {
        self.path.join("metrics.jsonl")
    }

    /// Where the checkpoints are.
    pub fn checkpoints(&self) -> PathBuf {
        self.path.join("checkpoints")
    }

    /// Whether it has a place for checkpoints: the directory of a study's job has none.
    pub fn holds_checkpoints(&self) -> bool {
        self.checkpoints().is_dir()
    }

    /// The learning curve.
    pub fn learning_curve(&self) -> PathBuf {
        self.path.join("learning-curve.svg")
    }

    /// The fixed-point policy.
    pub fn policy(&self) -> PathBuf {
        self.path.join("policy.kestrel")
    }

    /// The float policy.
    pub fn policy_f32(&self) -> PathBuf {
        self.path.join("policy-f32.kestrel")
    }

    /// What the export found.
    pub fn export_report(&self) -> PathBuf {
        self.path.join("export.json")
    }

    /// What the evaluation found.
    pub fn evaluation_report(&self) -> PathBuf {
        self.path.join("evaluation.json")
    }

    /// The animated flight.
    pub fn flight(&self) -> PathBuf {
        self.path.join("flight.gif")
    }

    /// The animated flight in one of several tasks.
    pub fn flight_in(&self, task: &str) -> PathBuf {
        self.path.join(format!("flight-{task}.gif"))
    }
}

/// Writes a report as indented JSON with a final newline.
///
/// # Errors
/// The system's reason; whatever was there before is then still there, whole.
///
/// # Panics
/// When `report` is no JSON value, such as a map whose keys are no strings.
pub fn write_json(path: &Path, report: &impl Serialize) -> Result<(), FileError> {
    let mut text = serde_json::to_string_pretty(report).expect("reports are JSON values");
    text.push('\n');
    write_atomically(path, text.as_bytes())
}

fn refuse_contents(path: &Path) -> Result<(), RunDirectoryError> {
    let names = names_in(path)?;
    if names.iter().any(|name| name == "config.yaml") {
        return Err(RunDirectoryError::HoldsRun(path.to_owned()));
    }
    match names.into_iter().find(|name| name != lock::FILE_NAME) {
        Some(found) => Err(RunDirectoryError::NotEmpty { path: path.to_owned(), found }),
        None => Ok(()),
    }
}

fn check_name(stem: &str) -> Result<(), RunDirectoryError> {
    let allowed = |letter: char| letter.is_alphanumeric() || "-_.".contains(letter);
    let usable = stem.chars().all(allowed) && stem.chars().any(char::is_alphanumeric);
    if usable { Ok(()) } else { Err(RunDirectoryError::Name(stem.to_owned())) }
}

fn highest_number(runs: &Path, stem: &str) -> Result<u64, FileError> {
    let number = |name: &String| name.strip_prefix(stem)?.strip_prefix('-')?.parse::<u64>().ok();
    Ok(names_in(runs)?.iter().filter_map(number).max().unwrap_or(0))
}

/// Names in the directory, sorted.
fn names_in(directory: &Path) -> Result<Vec<String>, FileError> {
    let entries = fs::read_dir(directory).map_err(|cause| FileError::new("read", directory, cause))?;
    let mut names: Vec<_> =
        entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: &str = "name: hover\nseed: 0\n";

    fn message(result: Result<RunDirectory, RunDirectoryError>) -> String {
        result.unwrap_err().to_string()
    }

    #[test]
    fn a_new_run_holds_its_config_and_a_place_for_checkpoints() {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("deep/er/first");
        let run = RunDirectory::create(&path, CONFIG).unwrap();
        assert_eq!(fs::read_to_string(run.config()).unwrap(), CONFIG);
        assert!(run.checkpoints().is_dir());
        assert_eq!(run.name(), "first");
        assert_eq!(run.path(), path);
    }

    #[test]
    fn an_existing_run_is_never_overwritten() {
        let parent = tempfile::tempdir().unwrap();
        drop(RunDirectory::create(parent.path(), CONFIG).unwrap());
        let error = message(RunDirectory::create(parent.path(), "name: other"));
        let path = parent.path().display();
        let expected = format!(
            "{path} already holds a run: continue it with --resume, begin anew with --force, or choose another directory"
        );
        assert_eq!(error, expected);
        assert_eq!(fs::read_to_string(parent.path().join("config.yaml")).unwrap(), CONFIG);
    }

    #[test]
    fn foreign_files_are_never_mixed_with_a_run() {
        let parent = tempfile::tempdir().unwrap();
        fs::write(parent.path().join("thesis.tex"), "").unwrap();
        let error = message(RunDirectory::create(parent.path(), CONFIG));
        assert!(error.ends_with("is not empty (it holds thesis.tex): choose a new or an empty directory"));
        let file = parent.path().join("thesis.tex");
        let error = message(RunDirectory::create(&file, CONFIG));
        assert!(error.starts_with(&format!("cannot create {}: ", file.display())), "{error}");
    }

    #[test]
    fn numbers_go_on_after_the_highest_and_names_are_kept_apart() {
        let runs = tempfile::tempdir().unwrap();
        for taken in ["hover-seed0-1", "hover-seed0-9", "hover-seed0-x", "hover-seed01-70", "cross-seed0-80"] {
            fs::create_dir(runs.path().join(taken)).unwrap();
        }
        let next = |stem| RunDirectory::create_next(runs.path(), stem, CONFIG).unwrap().name();
        assert_eq!(next("hover-seed0"), "hover-seed0-10");
        assert_eq!(next("hover-seed0"), "hover-seed0-11");
        assert_eq!(next("hover-seed2"), "hover-seed2-1");
    }

    #[test]
    fn runs_that_begin_at_the_same_moment_get_numbers_of_their_own() {
        let runs = tempfile::tempdir().unwrap();
        let begin = || RunDirectory::create_next(runs.path(), "hover", CONFIG).unwrap().name();
        let mut names: Vec<String> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(begin)).collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).collect()
        });
        names.sort();
        assert_eq!(names, (1..=8).map(|number| format!("hover-{number}")).collect::<Vec<_>>());
    }

    #[test]
    fn a_name_cannot_leave_the_directory_of_runs() {
        let runs = tempfile::tempdir().unwrap();
        for stem in ["../hover", "/hover", "", ".."] {
            let error = message(RunDirectory::create_next(runs.path(), stem, CONFIG));
            assert!(error.starts_with(&format!("a run cannot be named {stem:?}")), "{error}");
        }
    }

    #[test]
    fn only_a_run_can_be_opened_or_resumed() {
        let directory = tempfile::tempdir().unwrap();
        for result in [RunDirectory::open(directory.path()), RunDirectory::resume(directory.path())] {
            assert!(message(result).contains("holds no run: expected a directory made by `kestrel train`"));
        }
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0);
    }

    #[test]
    fn resuming_clears_what_a_killed_process_left() {
        let directory = tempfile::tempdir().unwrap();
        let run = RunDirectory::create(directory.path(), CONFIG).unwrap();
        let litter = [run.path().join(".unfinished-a1"), run.checkpoints().join(".unfinished-b2")];
        for path in &litter {
            fs::write(path, "half").unwrap();
        }
        drop(run);
        let run = RunDirectory::resume(directory.path()).unwrap();
        assert!(litter.iter().all(|path| !path.exists()));
        assert_eq!(fs::read_to_string(run.config()).unwrap(), CONFIG);
    }

    #[test]
    fn reports_are_readable_json() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("evaluation.json");
        write_json(&path, &serde_json::json!({"success_rate": 0.995})).unwrap();
        assert_eq!(fs::read_to_string(path).unwrap(), "{\n  \"success_rate\": 0.995\n}\n");
    }
}
