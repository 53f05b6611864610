//! What a run leaves behind: exported policies, an evaluation beside the baselines, a curve and a flight.

use std::fmt;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use kestrel_core::policy_file::{PolicyAirframe, PolicyError, PolicyMetadata};
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Purpose;
use serde::{Deserialize, Serialize};

use crate::atomic_file::{FileError, write_atomically};
use crate::evaluation::{Evaluation, Flyer, Sightings, Starts, evaluate, sightings_in_flight};
use crate::experiment_config::Experiment;
use crate::recording::{self, Recording, RecordingError};
use crate::run_config::Subject;
use crate::run_directory::metrics::read_rows;
use crate::run_directory::{RunDirectory, RunDirectoryError, write_json};
use kestrel_draw::curve::{CurveBaseline, CurvePoint, learning_curve};
use kestrel_draw::video::{VideoError, VideoFormat, flight_video};
use kestrel_export::exchange::{ExchangeError, onnx_model, safetensors_file};
use kestrel_export::policy::Policy;
use kestrel_export::px4::{Px4Error, px4_files};
use kestrel_export::recurrent::{RecurrentActor, export_recurrent};
use kestrel_export::seeing::{SeeingActor, SeeingCalibration, SeeingExport, SeeingReport, export_seeing};
use kestrel_export::source::{
    CSource, GUARD, SourceError, betaflight_controller, c_source, crazyflie_app, crazyflie_map_bytes, rust_module,
};
use kestrel_export::{DenseLayer, Export, ExportError, ExportReport, export};
use kestrel_learn::actor_critic::Actor;

/// `evaluation.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvaluationReport {
    /// Name of the experiment.
    pub name: String,
    /// What the starts follow from.
    pub seed: u64,
    /// The exported policies first, then the baselines.
    pub rows: Vec<Evaluation>,
    /// In which worlds, where every episode draws one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worlds: Option<WorldsReport>,
}

/// `evaluation.json` of one task or several.
#[derive(Deserialize)]
#[serde(untagged)]
enum Reports {
    One(EvaluationReport),
    Several(Vec<EvaluationReport>),
}

impl EvaluationReport {
    /// Those of each task in the file at `path`; none where there is no file.
    pub(crate) fn read(path: &Path) -> Result<Vec<Self>, serde_json::Error> {
        let Ok(text) = fs::read_to_string(path) else { return Ok(Vec::new()) };
        Ok(match serde_json::from_str(&text)? {
            Reports::One(report) => vec![report],
            Reports::Several(reports) => reports,
        })
    }
}

/// Worlds that training did not see, beside those that it did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorldsReport {
    /// How many worlds the rows of the report are about, none of which training saw.
    pub unseen: u32,
    /// How many training drew from.
    pub seen: u32,
    /// As the report's rows, in the worlds of training: the exported policy and the scripted pilot.
    pub rows_in_seen: Vec<Evaluation>,
}

/// Why a result cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ResultsError {
    /// The actor does not fit a policy file.
    #[error("cannot export the policy")]
    Export(#[from] ExportError),
    /// A policy file is damaged.
    #[error("{}", path.display())]
    Policy {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: PolicyError,
    },
    /// A policy was exported before the configuration was changed.
    #[error(
        "{} was exported for another {differing} than config.yaml has now: export it anew, or restore config.yaml",
        path.display()
    )]
    OtherTask {
        /// The file.
        path: PathBuf,
        /// What differs.
        differing: String,
    },
    /// A policy cannot fly a task.
    #[error("{}: found a policy for another {differing}, expected that of the task {task:?}", path.display())]
    OtherLayout {
        /// The file.
        path: PathBuf,
        /// Name of the task.
        task: String,
        /// What differs.
        differing: String,
    },
    /// The picture of the flight failed.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// The flight cannot be recorded.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The run directory refuses.
    #[error(transparent)]
    Directory(#[from] RunDirectoryError),
    /// The policy cannot be written as source code.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The policy cannot be written for other programs.
    #[error(transparent)]
    Exchange(#[from] ExchangeError),
    /// The policy cannot fly in PX4.
    #[error(transparent)]
    Px4(#[from] Px4Error),
    /// The system refused a file operation.
    #[error(transparent)]
    File(#[from] FileError),
}

/// Two policy files of one actor, and how they differ.
#[derive(Clone, Debug, PartialEq)]
pub struct Exported {
    /// With `f32` weights.
    pub float_policy: Vec<u8>,
    /// In fixed point.
    pub fixed_policy: Vec<u8>,
    /// How they differ.
    pub report: Report,
}

/// `export.json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Report {
    /// Of a policy without an eye.
    Blind(ExportReport),
    /// Of a policy with an eye.
    Seeing(SeeingReport),
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Blind(report) => report.fmt(f),
            Self::Seeing(report) => report.fmt(f),
        }
    }
}

/// Writes `policy.kestrel`, `policy-f32.kestrel` and `export.json`.
///
/// # Errors
/// When the actor does not fit, or a file cannot be written.
pub fn export_policy(
    subject: &Subject<'_>,
    directory: &RunDirectory,
    actor: &Actor,
    training_steps: u64,
) -> Result<Report, ResultsError> {
    let Exported { float_policy, fixed_policy, report } = exported(subject, actor, training_steps)?;
    write_atomically(&directory.policy_f32(), &float_policy)?;
    write_atomically(&directory.policy(), &fixed_policy)?;
    write_json(&directory.export_report(), &report)?;
    Ok(report)
}

/// Writes the run's fixed-point policy as `policy.rs`, for firmwares that link `kestrel-core`, and returns its path.
///
/// # Errors
/// When the policy file is missing or damaged, or a file cannot be written.
pub fn export_rust(directory: &RunDirectory) -> Result<PathBuf, ResultsError> {
    let path = directory.policy().with_extension("rs");
    write_atomically(&path, rust_module(&read(&directory.policy())?)?.as_bytes())?;
    Ok(path)
}

/// Writes the run's fixed-point policy as `policy.h` and `policy.c`, and `kestrel_guard.h` beside them, and returns their paths.
///
/// # Errors
/// As [`export_rust`].
pub fn export_c(directory: &RunDirectory) -> Result<[PathBuf; 3], ResultsError> {
    let paths = ["policy.h", "policy.c", "kestrel_guard.h"].map(|name| directory.policy().with_file_name(name));
    let CSource { header, source } = c_source(&read(&directory.policy())?)?;
    write_atomically(&paths[0], header.as_bytes())?;
    write_atomically(&paths[1], source.as_bytes())?;
    write_atomically(&paths[2], GUARD.as_bytes())?;
    Ok(paths)
}

/// Writes an app for crazyflie-firmware with the run's fixed-point policy into the folder `crazyflie`, and returns its path.
/// `tasks` are those of the run, none where they are not known.
///
/// # Errors
/// As [`export_rust`]; also when the policy sees what an app cannot show it.
pub fn export_crazyflie(directory: &RunDirectory, tasks: &[Experiment]) -> Result<PathBuf, ResultsError> {
    write_folder(directory, "crazyflie", crazyflie_app(&read(&directory.policy())?, &named(tasks))?)
}

/// Flash that the maps of that app will take \[bytes\].
///
/// # Errors
/// As [`export_crazyflie`].
pub fn crazyflie_maps(directory: &RunDirectory, tasks: &[Experiment]) -> Result<usize, ResultsError> {
    Ok(crazyflie_map_bytes(&read(&directory.policy())?, &named(tasks))?)
}

fn named(tasks: &[Experiment]) -> Vec<(&str, &Scenario)> {
    tasks.iter().map(|task| (task.name.as_str(), &task.scenario)).collect()
}

/// Writes a controller for Betaflight's neural forks with the run's fixed-point policy into the folder `betaflight`, and returns its
/// path.
///
/// # Errors
/// As [`export_rust`]; also when the policy sees anything but the drone's motion and the goal.
pub fn export_betaflight(directory: &RunDirectory) -> Result<PathBuf, ResultsError> {
    write_folder(directory, "betaflight", betaflight_controller(&read(&directory.policy())?)?)
}

/// Writes files into a folder beside the policy, whose path it returns.
fn write_folder(
    directory: &RunDirectory,
    name: &str,
    files: Vec<(&'static str, impl AsRef<[u8]>)>,
) -> Result<PathBuf, ResultsError> {
    let folder = directory.policy().with_file_name(name);
    fs::create_dir_all(&folder).map_err(|cause| FileError::new("create", &folder, cause))?;
    for (name, contents) in files {
        write_atomically(&folder.join(name), contents.as_ref())?;
    }
    Ok(folder)
}

/// Writes the run's float policy for PX4's neural control into the folder `px4`, and returns its path. `rotors` are those that
/// PX4's motors 1 to 4 turn.
///
/// # Errors
/// As [`export_rust`]; also when PX4 cannot show the policy what it sees, or do what it commands.
pub fn export_px4(directory: &RunDirectory, rotors: [usize; 4]) -> Result<PathBuf, ResultsError> {
    write_folder(directory, "px4", px4_files(&read(&directory.policy_f32())?, rotors)?)
}

/// Writes the run's float policy as `policy.onnx` and returns its path.
///
/// # Errors
/// As [`export_rust`].
pub fn export_onnx(directory: &RunDirectory) -> Result<PathBuf, ResultsError> {
    let path = directory.policy().with_extension("onnx");
    write_atomically(&path, &onnx_model(&read(&directory.policy_f32())?)?)?;
    Ok(path)
}

/// Writes the run's float policy as `policy.safetensors` and returns its path.
///
/// # Errors
/// As [`export_rust`].
pub fn export_safetensors(directory: &RunDirectory) -> Result<PathBuf, ResultsError> {
    let path = directory.policy().with_extension("safetensors");
    write_atomically(&path, &safetensors_file(&read(&directory.policy_f32())?)?)?;
    Ok(path)
}

/// The policy files of `actor`, in memory, with Q formats calibrated on its flights in every task.
///
/// # Errors
/// When the actor does not fit.
pub fn exported(subject: &Subject<'_>, actor: &Actor, training_steps: u64) -> Result<Exported, ResultsError> {
    let scenario = &subject.tasks[0].scenario;
    let metadata = PolicyMetadata {
        name: subject.name,
        observation: scenario.observation,
        action: scenario.action,
        control_period_secs: scenario.physics.control_secs(),
        seed: subject.seed.0,
        training_steps,
        airframe: Some(PolicyAirframe::from(&scenario.airframe)),
    };
    let layers: Vec<DenseLayer<'_>> = actor.layers().into_iter().map(DenseLayer::from).collect();
    let mut met = Sightings::default();
    for task in subject.tasks {
        // Ranges come from the starts that selected the policy: those that judge it stay unseen.
        let starts = Starts { purpose: Purpose::Selection, ..starts(task) };
        let Sightings { observations, images } = sightings_in_flight(task.evaluation.selection(), actor, starts);
        met.observations.extend(observations);
        met.images.extend(images);
    }
    let (Some(encoder), Some(camera)) = (actor.encoder(), &scenario.camera) else {
        let export = match actor.memory() {
            None => export(&layers, &metadata, &met.observations),
            Some(memory) => {
                let [gates, candidate] = memory.layers(actor.memory_parameters()).map(DenseLayer::from);
                let actor = RecurrentActor { gates, candidate, layers: &layers };
                export_recurrent(&actor, &metadata, &met.observations)
            }
        };
        let Export { float_policy, fixed_policy, report } = export?;
        return Ok(Exported { float_policy, fixed_policy, report: Report::Blind(report) });
    };
    let actor = SeeingActor {
        shape: *encoder.cnn().shape(),
        encoder_parameters: encoder.cnn_parameters(actor.front_parameters()),
        memory: actor.memory().map(|memory| memory.layers(actor.memory_parameters()).map(DenseLayer::from)),
        layers: &layers,
        control_periods_per_image: camera.control_periods_per_image as u16,
    };
    let calibration = SeeingCalibration { observations: &met.observations, images: &met.images };
    let SeeingExport { float_policy, fixed_policy, report } = export_seeing(&actor, &metadata, calibration)?;
    Ok(Exported { float_policy, fixed_policy, report: Report::Seeing(report) })
}

/// Flies the run's exported policies and the baselines in each task, and writes `evaluation.json`.
///
/// # Errors
/// When a policy file is missing or damaged, or the report cannot be written.
pub fn evaluate_run(
    subject: &Subject<'_>,
    directory: &RunDirectory,
) -> Result<Vec<EvaluationReport>, ResultsError> {
    let paths = [directory.exported_policy()?, directory.policy_f32()];
    let paths = if paths[1].exists() { &paths[..] } else { &paths[..1] };
    let files = paths.iter().map(|path| read(path)).collect::<Result<Vec<_>, _>>()?;
    let policies = files.iter().zip(paths).map(|(file, path)| parse(file, path)).collect::<Result<Vec<_>, _>>()?;
    let report = |task: &Experiment| {
        let scenario = &task.evaluation.scenario;
        policies.iter().zip(paths).try_for_each(|(policy, path)| refuse_other_task(policy, path, scenario))?;
        let flyers = policies.iter().map(Flyer::Policy).chain([Flyer::Scripted, Flyer::Nothing, Flyer::Random]);
        let flyers = flyers.chain(Flyer::stock(scenario));
        let rows = flyers.map(|flyer| evaluate(scenario, flyer, starts(task))).collect();
        let worlds = task.evaluation.seen.as_ref().map(|seen| WorldsReport {
            unseen: scenario.rooms(),
            seen: seen.rooms(),
            rows_in_seen: [Flyer::Policy(&policies[0]), Flyer::Scripted]
                .map(|flyer| evaluate(seen, flyer, starts(task)))
                .into(),
        });
        Ok(EvaluationReport { name: task.name.clone(), seed: task.evaluation.seed.0, rows, worlds })
    };
    let reports = subject.tasks.iter().map(report).collect::<Result<Vec<_>, ResultsError>>()?;
    match reports.as_slice() {
        [report] => write_json(&directory.evaluation_report(), report)?,
        reports => write_json(&directory.evaluation_report(), &reports)?,
    }
    Ok(reports)
}

/// A policy file, read to be flown in any task that it fits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JudgedPolicy {
    /// Where it is.
    pub path: PathBuf,
    bytes: Vec<u8>,
}

impl JudgedPolicy {
    /// The policy file at `path`, or the fixed-point policy of the run directory there.
    ///
    /// # Errors
    /// When there is none, or it is damaged.
    pub fn read(path: &Path) -> Result<Self, ResultsError> {
        let path = if path.is_dir() { RunDirectory::open(path)?.exported_policy()? } else { path.to_owned() };
        let bytes = read(&path)?;
        parse(&bytes, &path)?;
        Ok(Self { path, bytes })
    }

    /// Whether it fits a task.
    ///
    /// # Errors
    /// When it has another observation, action, camera or control rate than the task.
    pub fn check(&self, task: &Experiment) -> Result<(), ResultsError> {
        match parse(&self.bytes, &self.path)?.differing(&task.evaluation.scenario) {
            None => Ok(()),
            Some(differing) => {
                let (path, task) = (self.path.clone(), task.name.clone());
                Err(ResultsError::OtherLayout { path, task, differing })
            }
        }
    }

    /// How it flies a task from the starts of its evaluation.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn evaluate(&self, task: &Experiment) -> Result<Evaluation, ResultsError> {
        self.check(task)?;
        let policy = parse(&self.bytes, &self.path)?;
        Ok(evaluate(&task.evaluation.scenario, Flyer::Policy(&policy), starts(task)))
    }
}

/// The bytes of the run's fixed-point policy, which is one of the experiment's task.
///
/// # Errors
/// When the policy file is missing, damaged or of another task.
pub fn checked_policy(experiment: &Experiment, directory: &RunDirectory) -> Result<Vec<u8>, ResultsError> {
    let path = directory.policy();
    let bytes = read(&path)?;
    refuse_other_task(&parse(&bytes, &path)?, &path, &experiment.evaluation.scenario)?;
    Ok(bytes)
}

/// The first episode that [`evaluate_run`] flies with the fixed-point policy, again and kept, in double precision.
///
/// # Errors
/// When the policy is damaged or of another task.
pub fn record_run(experiment: &Experiment, directory: &RunDirectory) -> Result<Recording, ResultsError> {
    record_policy(experiment, &directory.policy())
}

/// The first episode of an experiment's evaluation, flown by the policy in a file, in double precision.
///
/// # Errors
/// When the policy is damaged or of another task.
pub fn record_policy(experiment: &Experiment, path: &Path) -> Result<Recording, ResultsError> {
    let bytes = read(path)?;
    let policy = parse(&bytes, path)?;
    refuse_other_task(&policy, path, &experiment.evaluation.scenario)?;
    Ok(recording::fly(experiment, Flyer::Policy(&policy), starts(experiment), 0))
}

/// The first episode of an experiment's evaluation, flown by a pilot that needs no file.
pub fn record_pilot(experiment: &Experiment, flyer: Flyer<'_>) -> Recording {
    recording::fly(experiment, flyer, starts(experiment), 0)
}

/// The drones at the first start of an experiment's evaluation, before anything has happened.
pub fn record_start(experiment: &Experiment) -> Recording {
    recording::at_start(experiment, starts(experiment), 0)
}

/// A policy flown on what it was not trained for would look bad through no fault of its own.
fn refuse_other_task(policy: &Policy<'_>, path: &Path, scenario: &Scenario) -> Result<(), ResultsError> {
    match policy.differing(scenario) {
        None => Ok(()),
        Some(differing) => Err(ResultsError::OtherTask { path: path.to_owned(), differing }),
    }
}

/// Draws `learning-curve.svg`, and the flight in each task; the paths of what it drew.
///
/// # Errors
/// When the metrics or the policy are damaged, or a file cannot be written.
pub fn draw(subject: &Subject<'_>, directory: &RunDirectory) -> Result<Vec<PathBuf>, ResultsError> {
    write_atomically(&directory.learning_curve(), curve(directory)?.as_bytes())?;
    let mut drawn = vec![directory.learning_curve()];
    drawn.extend(draw_flights(subject, directory)?);
    Ok(drawn)
}

/// The learning curve of a run, as far as it has come, as SVG; once it has been judged, beside the scripted pilot.
///
/// # Errors
/// When the metrics are damaged.
pub fn curve(directory: &RunDirectory) -> Result<String, ResultsError> {
    let points: Vec<CurvePoint> = read_rows(&directory.metrics())?;
    Ok(learning_curve(&directory.name(), &points, scripted_pilot(directory).as_ref()).svg())
}

/// How the scripted pilot flew the task of a run, if it has one task and was judged in it.
fn scripted_pilot(directory: &RunDirectory) -> Option<CurveBaseline> {
    let reports = EvaluationReport::read(&directory.evaluation_report()).ok()?;
    let [report] = reports.as_slice() else { return None };
    let flown = report.rows.iter().find(|row| row.pilot == Flyer::Scripted.name())?;
    let Evaluation { episode_return, success_rate, .. } = *flown;
    Some(CurveBaseline { pilot: flown.pilot.clone(), episode_return, success_rate })
}

/// Draws the flight in each task alone; the paths of what it drew.
///
/// # Errors
/// As [`draw`].
pub fn draw_flights(subject: &Subject<'_>, directory: &RunDirectory) -> Result<Vec<PathBuf>, ResultsError> {
    let mut drawn = Vec::new();
    for task in subject.tasks {
        let name = match subject.tasks {
            [_] => directory.flight(),
            _ => directory.flight_in(&task.name),
        };
        let recording = record_run(task, directory)?;
        let flight = recording.flight(task, &name)?;
        let title = name.display().to_string();
        let gif = flight_video(flight, &task.evaluation.scenario, &title, VideoFormat::Gif)?;
        write_atomically(&name, &gif)?;
        drawn.push(name);
    }
    Ok(drawn)
}

/// The starts of an experiment's evaluation.
pub fn starts(experiment: &Experiment) -> Starts {
    let evaluation = &experiment.evaluation;
    Starts { seed: evaluation.seed, purpose: Purpose::Evaluation, episodes: evaluation.episodes }
}

fn read(path: &Path) -> Result<Vec<u8>, ResultsError> {
    fs::read(path).map_err(|cause: io::Error| FileError::new("read", path, cause).into())
}

fn parse<'a>(bytes: &'a [u8], path: &Path) -> Result<Policy<'a>, ResultsError> {
    Policy::parse(bytes).map_err(|source| ResultsError::Policy { path: path.to_owned(), source })
}
