//! A run directory: trained, evaluated, exported, as `kestrel train`, `evaluate` and `export` do.

use std::path::PathBuf;
use std::slice;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

use kestrel_experiments::experiment_config::{self, Experiment};
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::results::{self, ResultsError};
use kestrel_experiments::run_config::Subject;
use kestrel_experiments::run_directory::RunDirectory;
use kestrel_experiments::training_run::{End, TrainingError, TrainingRun, best_policy};
use pyo3::prelude::*;
use rayon::ThreadPoolBuilder;

use crate::error::{expected, refused};

/// How often Python is asked whether somebody pressed Ctrl-C.
const SIGNALS_PERIOD: Duration = Duration::from_millis(50);

/// How often whoever watches a training is told.
const WATCH_PERIOD: Duration = Duration::from_millis(500);

/// Python code that is called with a run's directory now and then, in the thread that called us.
pub(crate) struct Watch {
    callable: Py<PyAny>,
    directory: PathBuf,
}

/// Trains on the experiment in the YAML file at the path `name`, or in `text` that messages call `name`, in a fresh
/// directory `out`, or the next one in `runs`, by so many threads; returns the directory, with which `watch` is called meanwhile. Ctrl-C stops after
/// the update in progress, with a checkpoint.
#[pyfunction]
pub(crate) fn train(
    py: Python<'_>,
    source: (String, Option<String>),
    overrides: Vec<String>,
    out_and_threads: (Option<PathBuf>, Option<usize>),
    watch: Option<Py<PyAny>>,
) -> PyResult<PathBuf> {
    let (out, threads) = out_and_threads;
    let (name, text) = source;
    let experiment = match text {
        Some(text) => experiment_config::parse_to_train(&name, &text, &overrides),
        None => experiment_config::load_to_train(name.as_ref(), &overrides),
    };
    let experiment = experiment.map_err(refused)?;
    let directory = if let Some(path) = out {
        RunDirectory::create(&path, &experiment.resolved_yaml)
    } else {
        let stem = format!("{}-seed{}", experiment.name, experiment.seed.0);
        RunDirectory::create_next("runs".as_ref(), &stem, &experiment.resolved_yaml)
    };
    let directory = directory.map_err(refused)?;
    let watch = watch.map(|callable| Watch { callable, directory: directory.path().to_owned() });
    work(py, threads, watch, |interrupt| finish(TrainingRun::begin(experiment, directory)?, interrupt))
}

/// Goes on with the run in a directory, as after Ctrl-C.
#[pyfunction]
pub(crate) fn resume(py: Python<'_>, path: PathBuf, threads: Option<usize>) -> PyResult<PathBuf> {
    let directory = RunDirectory::resume(&path).map_err(refused)?;
    let experiment = experiment_config::load_to_train(&directory.config(), &[]).map_err(refused)?;
    work(py, threads, None, |interrupt| finish(TrainingRun::resume(experiment, directory)?, interrupt))
}

/// Flies the policies of a run and the baselines, and writes `evaluation.json`.
#[pyfunction]
pub(crate) fn evaluate(
    py: Python<'_>,
    path: PathBuf,
    overrides: Vec<String>,
    threads: Option<usize>,
) -> PyResult<PathBuf> {
    let (directory, experiment) = open(&path, &overrides)?;
    directory.exported_policy().map_err(refused)?;
    work(py, threads, None, |_| {
        results::evaluate_run(&Subject::of(&experiment), &directory)?;
        Ok(directory.evaluation_report())
    })
}

/// Writes the policy files of a run, and its policy for a `target` of `kestrel export`; returns the paths.
#[pyfunction]
pub(crate) fn export(py: Python<'_>, path: PathBuf, target: &str) -> PyResult<Vec<PathBuf>> {
    let (directory, experiment) = open(&path, &[])?;
    let write: fn(&RunDirectory, &Experiment) -> Result<Vec<PathBuf>, ResultsError> = match target {
        "file" => |directory, _| Ok(vec![directory.policy(), directory.policy_f32()]),
        "rust" => |directory, _| Ok(vec![results::export_rust(directory)?]),
        "c" => |directory, _| Ok(results::export_c(directory)?.into()),
        "crazyflie" => |directory, task| Ok(vec![results::export_crazyflie(directory, slice::from_ref(task))?]),
        "betaflight" => |directory, _| Ok(vec![results::export_betaflight(directory)?]),
        "onnx" => |directory, _| Ok(vec![results::export_onnx(directory)?]),
        "safetensors" => |directory, _| Ok(vec![results::export_safetensors(directory)?]),
        other => {
            return Err(expected("target", other, "file, rust, c, crazyflie, betaflight, onnx or safetensors"));
        }
    };
    work(py, None, None, |_| {
        let (actor, steps) = best_policy(&experiment, &directory)?;
        results::export_policy(&Subject::of(&experiment), &directory, &actor, steps)?;
        Ok(write(&directory, &experiment)?)
    })
}

impl Watch {
    fn tell(&self, py: Python<'_>) -> PyResult<()> {
        self.callable.call1(py, (&self.directory,)).map(drop)
    }
}

/// Why a run fails.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RunError {
    #[error(transparent)]
    Training(#[from] TrainingError),
    #[error(transparent)]
    Results(#[from] ResultsError),
}

fn open(path: &std::path::Path, overrides: &[String]) -> PyResult<(RunDirectory, Experiment)> {
    let directory = RunDirectory::open(path).map_err(refused)?;
    let experiment = experiment_config::load(&directory.config(), overrides).map_err(refused)?;
    Ok((directory, experiment))
}

/// Trains to the end, exports, evaluates and draws; between these steps it may be interrupted.
fn finish(mut run: TrainingRun, interrupt: &Interrupt) -> Result<PathBuf, RunError> {
    let end = run.train(interrupt)?;
    let (subject, directory) = (Subject::of(run.experiment()), run.directory());
    if end == End::Finished {
        let (actor, steps) = run.best();
        results::export_policy(&subject, directory, actor, steps)?;
        if !interrupt.requested() {
            results::evaluate_run(&subject, directory)?;
        }
        if !interrupt.requested() {
            results::draw(&subject, directory)?;
        }
    }
    Ok(directory.path().to_owned())
}

/// The learning curve of a run so far, as SVG.
#[pyfunction]
pub(crate) fn learning_curve(path: PathBuf) -> PyResult<String> {
    let directory = RunDirectory::open(&path).map_err(refused)?;
    results::curve(&directory).map_err(refused)
}

/// Works in threads of its own, while this one asks Python for signals and tells whoever watches.
pub(crate) fn work<T: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    watch: Option<Watch>,
    task: impl FnOnce(&Interrupt) -> Result<T, RunError> + Send,
) -> PyResult<T> {
    let pool = ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).build().map_err(refused)?;
    let interrupt = Interrupt::default();
    let (done, signal) = py.detach(|| {
        let (sender, receiver) = channel();
        thread::scope(|scope| {
            let worker = scope.spawn(|| {
                let done = pool.install(|| task(&interrupt));
                drop(sender);
                done
            });
            let (mut signal, mut told) = (None, Instant::now());
            while receiver.recv_timeout(SIGNALS_PERIOD) == Err::<(), _>(RecvTimeoutError::Timeout) {
                let is_due = signal.is_none() && told.elapsed() >= WATCH_PERIOD;
                let heard = Python::attach(|py| {
                    py.check_signals()?;
                    watch.iter().filter(|_| is_due).try_for_each(|watch| watch.tell(py))
                });
                if is_due {
                    told = Instant::now();
                }
                if let Err(error) = heard {
                    interrupt.request();
                    signal = Some(error);
                }
            }
            (worker.join(), signal)
        })
    });
    if let Some(signal) = signal {
        return Err(signal);
    }
    match done {
        Ok(done) => done.map_err(refused),
        Err(panic) => std::panic::resume_unwind(panic),
    }
}
