//! The directory of a study that runs: opened by one process, whole after every interruption.
//!
//! `study.yaml` is the resolved study, `study.json` what reports read, `rows/` and `curves/` what finished jobs have
//! left, `policies/` their policies, `unfinished/` the checkpoints of the others.

mod manifest;
#[cfg(test)]
mod tests;

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::config::{StudyConfig, multi_task};
use super::data::{MethodKind, StudyError, StudyManifest};
use super::job::{JobResult, JobRun, JobState};
use super::rows::{Job, write_boundaries, write_curve, write_episodes};
use super::{JobId, Study};
use manifest::Baselines;

use crate::atomic_file::{FileError, read, remove_unfinished, replace_atomically, write_atomically};
use crate::checkpoint::{CheckpointError, Checkpoints};
use crate::config_file::ConfigFile;
use crate::output::warn;
use crate::results::{self, ResultsError};
use crate::run_directory::lock::RunLock;
use crate::run_directory::{RunDirectory, RunDirectoryError};
use crate::sealed_file::SealError;
use kestrel_learn::actor_critic::Actor;
use kestrel_learn::ranks::UnequalShares;
use kestrel_sim::config::ConfigError;

/// The resolved study in its directory.
const CONFIG: &str = "study.yaml";

/// Folder of the checkpoints, a folder a job.
const UNFINISHED: &str = "unfinished";

/// What may change while a study runs: how many seeds, and what is said and claimed about it.
const FREE: &[&[&str]] = &[&["seeds", "count"], &["about"], &["claims"], &["published"]];

/// Why a study cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The directory is in use.
    #[error(transparent)]
    Directory(#[from] RunDirectoryError),
    /// The directory holds something else.
    #[error("{} is not empty and holds no study: choose a new directory", .0.display())]
    NotEmpty(PathBuf),
    /// The directory holds another study.
    #[error("{}:{line}: found `{found}`, expected `{expected}` as the study now says: choose another directory, or change it back", path.display())]
    Changed {
        /// The study in the directory.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// There.
        found: String,
        /// Now.
        expected: String,
    },
    /// A manifest or rows.
    #[error(transparent)]
    Study(#[from] StudyError),
    /// Too many processes.
    #[error(transparent)]
    Ranks(#[from] UnequalShares),
    /// A checkpoint cannot be written.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A policy cannot be kept.
    #[error(transparent)]
    Results(#[from] Box<ResultsError>),
    /// The configuration of a job is none.
    #[error(transparent)]
    Config(#[from] Box<ConfigError>),
    /// The system refused a file operation.
    #[error(transparent)]
    File(#[from] FileError),
    /// The system refused threads.
    #[error("cannot start threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// A study in its directory, open to be run.
#[derive(Debug)]
pub struct StudyDirectory<'a> {
    study: &'a Study,
    path: PathBuf,
    manifest: Mutex<StudyManifest>,
    baselines: Baselines,
    _lock: RunLock,
}

impl<'a> StudyDirectory<'a> {
    /// Opens a new or an unfinished study at `path`, for this process alone; trivial pilots have flown its tasks then.
    ///
    /// # Errors
    /// When the directory is in use, holds anything else or another study, or cannot be written.
    pub fn open(study: &'a Study, path: &Path) -> Result<Self, RunError> {
        Self::prepare(study, path, Baselines::Flown)
    }

    /// As [`Self::open`], without trivial pilots, and no policies are kept: nobody reports on a trial of a search.
    ///
    /// # Errors
    /// As there.
    pub fn open_trial(study: &'a Study, path: &Path) -> Result<Self, RunError> {
        Self::prepare(study, path, Baselines::LeftOut)
    }

    fn prepare(study: &'a Study, path: &Path, baselines: Baselines) -> Result<Self, RunError> {
        create(path)?;
        let config = path.join(CONFIG);
        let is_new = !config.is_file();
        if is_new && !is_empty(path)? {
            return Err(RunError::NotEmpty(path.to_owned()));
        }
        let lock = RunLock::acquire(path)?;
        if !is_new {
            refuse_changes::<StudyConfig>(&config, &study.resolved_yaml, FREE)?;
        }
        let known = path.join("study.json").exists().then(|| StudyManifest::load(path)).transpose()?;
        // The study first: a directory that has nothing else yet is still recognised as its own.
        write_atomically(&config, study.resolved_yaml.as_bytes())?;
        let manifest = manifest::of(study, known, baselines);
        manifest.save(path)?;
        let directory =
            Self { study, path: path.to_owned(), manifest: Mutex::new(manifest), baselines, _lock: lock };
        directory.tidy()?;
        Ok(directory)
    }

    /// Where the study is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The study.
    pub fn study(&self) -> &'a Study {
        self.study
    }

    /// Whether a job has left its rows.
    pub fn is_done(&self, id: JobId) -> bool {
        self.job(id).rows_path(&self.path).is_file()
    }

    /// A job where it was interrupted, or at its beginning.
    ///
    /// A damaged checkpoint costs only time, since a job goes the same way again; so does one of another version of the
    /// program, which is set aside. That is said, and no error.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn open_job(&self, id: JobId) -> Result<JobRun<'a>, RunError> {
        let path = self.checkpoints(id);
        create(&path)?;
        let restored = match Checkpoints::in_directory(&path).load_newest::<JobState>() {
            Ok(restored) => restored,
            Err(CheckpointError::None(_)) => return Ok(JobRun::begin(self.study, id)),
            Err(cause) if is_foreign(&cause) => return self.begin_again(id, &cause),
            Err(CheckpointError::File(cause)) => return Err(cause.into()),
            Err(damage @ CheckpointError::Sealed(_)) => {
                warn(format_args!("warning: {damage}; beginning this job again"));
                return Ok(JobRun::begin(self.study, id));
            }
        };
        JobRun::restore(self.study, id, restored.state).or_else(|cause| self.begin_again(id, &cause))
    }

    /// A job at its beginning, because its checkpoints are whole and not ours: another version can still use them.
    fn begin_again(&self, id: JobId, cause: &dyn std::fmt::Display) -> Result<JobRun<'a>, RunError> {
        let path = self.checkpoints(id);
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let aside = |number: u32| path.with_file_name(format!("{name}.former-{number}"));
        let aside = (1..=u32::MAX).map(aside).find(|aside| !aside.exists()).expect("a number is free");
        fs::rename(&path, &aside).map_err(|cause| FileError::new("rename", &path, cause))?;
        create(&path)?;
        warn(format_args!(
            "warning: {name} was saved by another version ({cause}); beginning this job again, and keeping that in {}",
            aside.display()
        ));
        Ok(JobRun::begin(self.study, id))
    }

    /// Saves an unfinished job.
    ///
    /// # Errors
    /// The system's reason; what was saved before is still there.
    pub fn save_job(&self, id: JobId, run: &JobRun<'_>) -> Result<(), RunError> {
        Checkpoints::in_directory(&self.checkpoints(id)).save(run.steps(), &run.save())?;
        Ok(())
    }

    /// Keeps the policy of a job after its last stage, beside the configuration that trains it again; where each task has a
    /// policy of its own, after every stage.
    ///
    /// # Errors
    /// The system's reason, or why the policy fits no file.
    pub fn leave_policy(&self, id: JobId, stage: usize, (actor, steps): (&Actor, u64)) -> Result<(), RunError> {
        let order = &self.study.orders[id.order];
        let procedure = &self.study.methods[id.method].procedure;
        let (folder, config) = match (self.baselines, procedure.kind()) {
            (Baselines::LeftOut, _) => return Ok(()),
            (Baselines::Flown, MethodKind::Experts) => {
                let task = &self.study.tasks[order[stage]].name;
                (self.policies(id).join(task), multi_task::expert_of_job(self.study, id, stage))
            }
            (Baselines::Flown, MethodKind::Sequential | MethodKind::Joint | MethodKind::Averaged) => {
                if stage + 1 < procedure.stages(order.len()) {
                    return Ok(());
                }
                (self.policies(id), multi_task::of_job(self.study, id))
            }
        };
        let config = config.map_err(Box::new)?;
        let run = RunDirectory::keep(&folder, config.resolved_yaml())?;
        results::export_policy(&config.subject(), &run, actor, steps).map_err(Box::new)?;
        Ok(())
    }

    /// Where the policies of a job are.
    fn policies(&self, id: JobId) -> PathBuf {
        self.job(id).policies_path(&self.path)
    }

    /// Writes what a job found, rows last, because they say that it is done; then its checkpoints go.
    ///
    /// # Errors
    /// The system's reason; the job is then not done, or done and whole.
    pub fn leave_job(&self, id: JobId, result: &JobResult) -> Result<(), RunError> {
        let job = self.job(id);
        let manifest = self.noted(id, result)?;
        let (rows, curve) = (job.rows_path(&self.path), job.curve_path(&self.path));
        for file in [&rows, &curve] {
            create(file.parent().unwrap_or(&self.path))?;
        }
        replace_atomically(&curve, |file| write_curve(file, &job, &result.curve))?;
        if self.study.methods[id.method].procedure.finds_boundaries() {
            let file = job.boundaries_path(&self.path);
            create(file.parent().unwrap_or(&self.path))?;
            replace_atomically(&file, |file| write_boundaries(file, &job, &result.boundaries))?;
        }
        replace_atomically(&rows, |file| {
            write_episodes(&mut std::io::BufWriter::new(file), &manifest, &job, &result.rows)
        })?;
        drop(manifest);
        remove(&self.checkpoints(id))
    }

    /// The manifest with the memory that a job needed. Orders may differ in length: the most of all jobs counts,
    /// whichever ends first.
    fn noted(&self, id: JobId, result: &JobResult) -> Result<MutexGuard<'_, StudyManifest>, RunError> {
        let mut manifest = lock(&self.manifest);
        let method = &mut manifest.methods[id.method];
        let known = method.clone();
        method.stored_bytes = method.stored_bytes.max(result.stored_bytes as u64);
        method.training_bytes = method.training_bytes.max(result.training_bytes as u64);
        method.parameters = method.parameters.max(result.parameters as u64);
        if *method != known {
            manifest.save(&self.path)?;
        }
        Ok(manifest)
    }

    /// Removes what killed processes have left behind: half-written files, and checkpoints of jobs that are done.
    fn tidy(&self) -> Result<(), RunError> {
        let of_methods =
            self.study.methods.iter().flat_map(|method| ["rows", "curves"].map(|kind| (kind, &method.name)));
        let folders = of_methods.map(|(kind, method)| self.path.join(kind).join(method));
        for folder in folders.chain([self.path.clone(), self.path.join("report")]).filter(|folder| folder.is_dir())
        {
            remove_unfinished(&folder)?;
        }
        let checkpoints = self.path.join(UNFINISHED);
        if !checkpoints.is_dir() {
            return Ok(());
        }
        for entry in entries(&checkpoints)?.into_iter().filter(|path| path.is_dir()) {
            remove_unfinished(&entry)?;
        }
        for id in self.study.jobs().into_iter().filter(|id| self.is_done(*id)) {
            remove(&self.checkpoints(id))?;
        }
        self.remove_empty();
        Ok(())
    }

    /// Removes the folder of checkpoints once there are none; not while jobs run, which make folders in it.
    pub(super) fn remove_empty(&self) {
        // Checkpoints that are there are no failure.
        let _not_empty = fs::remove_dir(self.path.join(UNFINISHED));
    }

    fn job(&self, id: JobId) -> Job {
        let method = self.study.methods[id.method].name.clone();
        Job { method, order: id.order, seed: self.study.seeds[id.seed].0 }
    }

    fn checkpoints(&self, id: JobId) -> PathBuf {
        let Job { method, order, seed } = self.job(id);
        self.path.join(UNFINISHED).join(format!("{method}-{order}-{seed}"))
    }
}

/// Whole, and not ours.
fn is_foreign(error: &CheckpointError) -> bool {
    match error {
        CheckpointError::Sealed(error) => matches!(error, SealError::Version { .. } | SealError::Content { .. }),
        CheckpointError::None(_) | CheckpointError::File(_) => false,
    }
}

/// Whatever a thread that panicked left behind is whole: it is replaced at once.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

pub(crate) fn create(folder: &Path) -> Result<(), FileError> {
    fs::create_dir_all(folder).map_err(|cause| FileError::new("create", folder, cause))
}

/// Removes a folder of checkpoints, if there is one.
fn remove(folder: &Path) -> Result<(), RunError> {
    match fs::remove_dir_all(folder) {
        Err(cause) if cause.kind() != ErrorKind::NotFound => Err(FileError::new("remove", folder, cause).into()),
        Ok(()) | Err(_) => Ok(()),
    }
}

fn entries(directory: &Path) -> Result<Vec<PathBuf>, FileError> {
    let entries = fs::read_dir(directory).map_err(|cause| FileError::new("read", directory, cause))?;
    Ok(entries.flatten().map(|entry| entry.path()).collect())
}

/// Whether there is nothing but what a process leaves that is killed as it begins.
pub(crate) fn is_empty(directory: &Path) -> Result<bool, FileError> {
    let begun = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name == ".lock" || name.starts_with(".unfinished-")
    };
    Ok(entries(directory)?.iter().all(begun))
}

/// Refuses another configuration than that in the file at `path`; only what is at the keys `free` may differ. Both are
/// compared with every default filled in.
pub(crate) fn refuse_changes<C: ConfigFile>(path: &Path, now: &str, free: &[&[&str]]) -> Result<(), RunError> {
    let bytes = read(path)?;
    let saved = C::resolved_again(&String::from_utf8_lossy(&bytes));
    let (saved, now) = (fixed_lines(&saved, free), fixed_lines(now, free));
    let text = |line: Option<&(usize, &str)>| line.map_or(String::new(), |(_, line)| line.trim().to_owned());
    let mut indices = 0..saved.len().max(now.len());
    let is_changed = |index: &usize| saved.get(*index).map(|line| line.1) != now.get(*index).map(|line| line.1);
    match indices.find(is_changed) {
        None => Ok(()),
        Some(index) => Err(RunError::Changed {
            path: path.to_owned(),
            line: saved.get(index).map_or(saved.len() + 1, |(number, _)| *number),
            found: text(saved.get(index)),
            expected: text(now.get(index)),
        }),
    }
}

/// The lines of resolved YAML with their numbers, without those of the keys `free`: top-level keys with all that is
/// below them, or keys right below one.
fn fixed_lines<'a>(yaml: &'a str, free: &[&[&str]]) -> Vec<(usize, &'a str)> {
    let mut section = "";
    let mut lines = Vec::new();
    for (index, line) in yaml.lines().enumerate() {
        let key = line.split(':').next().unwrap_or_default();
        if !key.starts_with([' ', '-', '#']) {
            section = key;
        }
        let is_free = free.iter().any(|path| match **path {
            [top] => section == top,
            [top, inner] => section == top && key.strip_prefix("  ") == Some(inner),
            _ => false,
        });
        if !is_free {
            lines.push((index + 1, line));
        }
    }
    lines
}
