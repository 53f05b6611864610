//! Runs the jobs of a study on all cores, until all are done or the user stops it.
//!
//! A worker is a thread with a pool of its own; each takes the next job when it is done with one. What a finished job
//! leaves is written at once, whole or not at all; of an unfinished one there is a checkpoint.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use kestrel_sim::seed::Purpose;

use super::data::{Baseline, Method, Published, PublishedRow, PublishedValue, StudyError, StudyManifest, Task};
use super::job::{JobResult, JobRun, JobState};
use super::rows::{Job, write_curve, write_episodes};
use super::{JobId, Study};
use crate::atomic_file::{FileError, replace_atomically, write_atomically};
use crate::checkpoint::{CheckpointError, Checkpoints};
use crate::evaluation::{Flyer, Starts, evaluate};
use crate::interrupt::Interrupt;
use crate::ppo::RestoreError;
use crate::progress::Progress;
use crate::run_directory::RunDirectoryError;
use crate::run_directory::lock::RunLock;
use crate::training_run::End;

/// Time between checkpoints of a job; a kill costs no more.
const CHECKPOINT_INTERVAL: Duration = Duration::from_secs(10);

/// Success rate from which a task counts as learned, where the study does not stop there.
const SUCCESS_THRESHOLD: f64 = 0.9;

/// Flights of each trivial pilot in each task.
const BASELINE_EPISODES: usize = 256;

/// The resolved study in its directory.
const CONFIG: &str = "study.yaml";

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
    #[error("{}: line {line} says `{found}`, the study now says `{expected}`: choose another directory, or change it back", path.display())]
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
    /// A checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A checkpoint of another study.
    #[error("{}: {cause}: remove this directory to begin the job again", path.display())]
    Restore {
        /// The checkpoints of the job.
        path: PathBuf,
        /// What does not fit.
        cause: RestoreError,
    },
    /// The system refused a file operation.
    #[error(transparent)]
    File(#[from] FileError),
    /// The system refused threads.
    #[error("cannot start threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// A study in its directory, open to be run.
#[derive(Debug)]
pub struct StudyRun<'a> {
    study: &'a Study,
    directory: PathBuf,
    manifest: Mutex<StudyManifest>,
    _lock: RunLock,
}

/// What workers share.
struct Shared<'a> {
    pending: Vec<JobId>,
    next: AtomicUsize,
    /// Steps that need not be done any more.
    steps: AtomicU64,
    progress: Mutex<Progress>,
    failure: Mutex<Option<RunError>>,
    interrupt: &'a Interrupt,
}

impl<'a> StudyRun<'a> {
    /// Opens a new or an unfinished study in `directory`, for this process alone.
    ///
    /// # Errors
    /// When the directory is in use, holds anything else or another study, or cannot be written.
    pub fn open(study: &'a Study, directory: &Path) -> Result<Self, RunError> {
        fs::create_dir_all(directory).map_err(|cause| FileError::new("create", directory, cause))?;
        let config = directory.join(CONFIG);
        let is_new = !config.is_file();
        if is_new && !is_empty(directory)? {
            return Err(RunError::NotEmpty(directory.to_owned()));
        }
        let lock = RunLock::acquire(directory)?;
        let mut known = None;
        if !is_new {
            refuse_changes(&config, &study.resolved_yaml)?;
            known = StudyManifest::load(directory).ok();
        }
        let manifest = manifest(study, known);
        manifest.save(directory)?;
        write_atomically(&config, study.resolved_yaml.as_bytes())?;
        Ok(Self { study, directory: directory.to_owned(), manifest: Mutex::new(manifest), _lock: lock })
    }

    /// Runs what is left.
    ///
    /// # Errors
    /// The first thing that went wrong; all finished jobs and all checkpoints are kept.
    pub fn run(&self, threads: usize, interrupt: &Interrupt) -> Result<End, RunError> {
        let (pending, done): (Vec<JobId>, Vec<JobId>) =
            self.study.jobs().into_iter().partition(|job| !self.job(*job).rows_path(&self.directory).is_file());
        let steps = |jobs: &[JobId]| jobs.iter().map(|job| self.study.steps_of(*job)).sum::<u64>();
        let shared = Shared {
            next: AtomicUsize::new(0),
            steps: AtomicU64::new(steps(&done)),
            progress: Mutex::new(Progress::new(steps(&done) + steps(&pending), steps(&done))),
            failure: Mutex::new(None),
            pending,
            interrupt,
        };
        let workers = threads.min(shared.pending.len()).max(1);
        std::thread::scope(|scope| -> Result<(), RunError> {
            for worker in 0..workers {
                // Where there are fewer jobs than cores, a job has several.
                let cores = threads / workers + usize::from(worker < threads % workers);
                let pool = rayon::ThreadPoolBuilder::new().num_threads(cores.max(1)).build()?;
                let shared = &shared;
                scope.spawn(move || pool.install(|| self.work(shared)));
            }
            Ok(())
        })?;
        lock(&shared.progress).finish();
        match shared.failure.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
            Some(failure) => Err(failure),
            None if interrupt.requested() => Ok(End::Interrupted),
            None => Ok(End::Finished),
        }
    }

    /// Where the study is.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    fn work(&self, shared: &Shared<'_>) {
        while !shared.interrupt.requested() && lock(&shared.failure).is_none() {
            let Some(id) = shared.pending.get(shared.next.fetch_add(1, Ordering::Relaxed)) else { return };
            if let Err(failure) = self.work_on(*id, shared) {
                lock(&shared.failure).get_or_insert(failure);
            }
        }
    }

    fn work_on(&self, id: JobId, shared: &Shared<'_>) -> Result<(), RunError> {
        let path = self.checkpoints(id);
        fs::create_dir_all(&path).map_err(|cause| FileError::new("create", &path, cause))?;
        let checkpoints = Checkpoints::in_directory(&path);
        let mut run = self.open_job(id, &checkpoints)?;
        let mut known = 0;
        let mut saved_at = Instant::now();
        let mut advance = |steps: u64| {
            let all = shared.steps.fetch_add(steps - known, Ordering::Relaxed) + steps - known;
            known = steps;
            let begun = shared.next.load(Ordering::Relaxed).min(shared.pending.len());
            lock(&shared.progress).show_steps(all, || format!("job {begun} of {}", shared.pending.len()));
        };
        advance(run.steps());
        while !run.is_finished() {
            if shared.interrupt.requested() || lock(&shared.failure).is_some() {
                checkpoints.save(run.steps(), &run.save())?;
                return Ok(());
            }
            run.advance();
            advance(run.steps());
            if saved_at.elapsed() > CHECKPOINT_INTERVAL {
                checkpoints.save(run.steps(), &run.save())?;
                saved_at = Instant::now();
            }
        }
        self.leave(id, &run.into_result())?;
        fs::remove_dir_all(&path).map_err(|cause| FileError::new("remove", &path, cause).into())
    }

    fn open_job(&self, id: JobId, checkpoints: &Checkpoints) -> Result<JobRun<'a>, RunError> {
        if checkpoints.saved()?.is_empty() {
            return Ok(JobRun::begin(self.study, id));
        }
        let restored = checkpoints.load_newest::<JobState>()?;
        JobRun::restore(self.study, id, restored.state)
            .map_err(|cause| RunError::Restore { path: self.checkpoints(id), cause })
    }

    /// Writes what a job found: rows last, because they say that it is done.
    fn leave(&self, id: JobId, result: &JobResult) -> Result<(), RunError> {
        let job = self.job(id);
        let mut manifest = lock(&self.manifest);
        let method = &mut manifest.methods[id.method];
        method.stored_bytes = result.stored_bytes as u64;
        method.training_bytes = result.training_bytes as u64;
        method.parameters = result.parameters as u64;
        manifest.save(&self.directory)?;
        let (rows, curve) = (job.rows_path(&self.directory), job.curve_path(&self.directory));
        for path in [&rows, &curve] {
            let folder = path.parent().unwrap_or(&self.directory);
            fs::create_dir_all(folder).map_err(|cause| FileError::new("create", folder, cause))?;
        }
        replace_atomically(&curve, |file| write_curve(file, &job, &result.curve))?;
        replace_atomically(&rows, |file| {
            write_episodes(&mut std::io::BufWriter::new(file), &manifest, &job, &result.rows)
        })?;
        Ok(())
    }

    fn job(&self, id: JobId) -> Job {
        let method = self.study.methods[id.method].name.clone();
        Job { method, order: id.order, seed: self.study.seeds[id.seed].0 }
    }

    fn checkpoints(&self, id: JobId) -> PathBuf {
        let Job { method, order, seed } = self.job(id);
        self.directory.join("unfinished").join(format!("{method}-{order}-{seed}"))
    }
}

/// Whatever a thread that panicked left behind is whole: it is replaced at once.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn is_empty(directory: &Path) -> Result<bool, FileError> {
    let mut entries = fs::read_dir(directory).map_err(|cause| FileError::new("read", directory, cause))?;
    Ok(entries.all(|entry| entry.is_ok_and(|entry| entry.file_name() == ".lock")))
}

/// More seeds may be asked for; all else must be as it was.
fn refuse_changes(path: &Path, now: &str) -> Result<(), RunError> {
    let bytes = crate::atomic_file::read(path)?;
    let saved = String::from_utf8_lossy(&bytes);
    let may_differ = |line: &str| line.trim_start().starts_with("count:");
    let longest = saved.lines().count().max(now.lines().count());
    let padded = |text: &'static str| std::iter::repeat(text);
    let pairs = saved.lines().chain(padded("")).zip(now.lines().chain(padded(""))).take(longest);
    let change =
        pairs.enumerate().find(|(_, (saved, now))| saved != now && !(may_differ(saved) && may_differ(now)));
    change.map_or(Ok(()), |(index, (found, expected))| {
        let [found, expected] = [found, expected].map(|line| line.trim().to_owned());
        Err(RunError::Changed { path: path.to_owned(), line: index + 1, found, expected })
    })
}

/// The study for whoever reads its directory; what an earlier run has measured is taken over.
fn manifest(study: &Study, known: Option<StudyManifest>) -> StudyManifest {
    let method = |method: &super::procedure::Method| {
        let earlier = known.as_ref().and_then(|known| known.method(&method.name));
        Method {
            name: method.name.clone(),
            label: method.name.clone(),
            kind: method.procedure.kind(),
            training_bytes: earlier.map_or(0, |earlier| earlier.training_bytes),
            stored_bytes: earlier.map_or(0, |earlier| earlier.stored_bytes),
            parameters: earlier.map_or(0, |earlier| earlier.parameters),
            description: method.about.clone(),
        }
    };
    StudyManifest {
        name: study.name.clone(),
        about: study.about.clone(),
        tasks: study
            .tasks
            .iter()
            .map(|task| Task {
                name: task.name.clone(),
                episode_secs: f64::from(task.evaluation.scenario.episode_secs),
            })
            .collect(),
        orders: study.orders.clone(),
        methods: study.methods.iter().map(method).collect(),
        seeds: study.seeds.iter().map(|seed| seed.0).collect(),
        steps_per_stage: study.training.total_steps,
        success_threshold: study.evaluation.stop_at_success.unwrap_or(SUCCESS_THRESHOLD),
        published: study.published.as_ref().map(published),
        baselines: match &known {
            Some(known) => known.baselines.clone(),
            None => baselines(study),
        },
    }
}

fn published(table: &super::config::PublishedTable) -> Published {
    let value = |text: &String| text.parse().map_or(PublishedValue::NeverReached, PublishedValue::Number);
    Published {
        title: table.title.clone(),
        columns: table.columns.clone(),
        rows: table
            .rows
            .iter()
            .map(|row| PublishedRow { label: row.name.clone(), values: row.cells.iter().map(value).collect() })
            .collect(),
        notes: if table.notes.is_empty() { Vec::new() } else { vec![table.notes.clone()] },
    }
}

/// What trivial pilots achieve in each task.
fn baselines(study: &Study) -> Vec<Baseline> {
    let starts = Starts { seed: study.evaluation.seed, purpose: Purpose::Evaluation, episodes: BASELINE_EPISODES };
    let fly = |task: &crate::experiment_config::Experiment| {
        [Flyer::Nothing, Flyer::Random, Flyer::Scripted].map(|flyer| {
            let found = evaluate(&task.evaluation.scenario, flyer, starts);
            Baseline {
                task: task.name.clone(),
                pilot: found.pilot,
                success_rate: found.success_rate,
                episode_return: found.episode_return,
                episodes: found.episodes,
            }
        })
    };
    study.tasks.iter().flat_map(fly).collect()
}
