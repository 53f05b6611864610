//! Software in the loop: a policy flies as a MAVLink vehicle in the simulator.

mod camera;
mod node;
mod spectators;
mod team;

use std::cell::OnceCell;
use std::path::{Path, PathBuf};
use std::sync::mpsc::Sender;

use kestrel_core::action::ActionSpace;
use kestrel_core::airframe::{Airframe, CF2X};
use kestrel_core::dynamics::Integrator;
use kestrel_core::observation::ObservationLayout;
use kestrel_core::policy_file::{PolicyError, PolicyMetadata};
use kestrel_core::real::Real;
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::{Ground, State};
use kestrel_draw::viewer::Glimpse;
use kestrel_ros::rangers::Rangers;
use kestrel_shim::autopilot::Mode;
use kestrel_shim::endpoint::Counts;
use kestrel_shim::lockstep::{ControlPeriod, Next, Timing};
use kestrel_shim::message::sent::identity::PolicyIdentity;
use kestrel_shim::plant::{Plant, Ranges, TaskEnding};
use kestrel_shim::policy_backend::PolicyBackend;
use kestrel_shim::policy_bytes::PolicyBytes;
use kestrel_shim::session::{Session, SessionError, SessionOptions};
use kestrel_shim::true_state::{TrueStateLog, TrueStateLogError};
use kestrel_sim::flight::{Flight, NoRoom};
use kestrel_sim::latency::Latency;
use kestrel_sim::scenario::{Downwash, Physics, Preset, Scenario};
use kestrel_sim::seed::Seed;
use nalgebra::Vector3;

use self::camera::{CameraError, CameraOptions, OnboardCamera};
use self::spectators::Spectators;
use crate::processor::{ProcessorError, ProcessorOptions, RemoteProcessor};
use kestrel_experiments::atomic_file::check_writable;
use kestrel_experiments::evaluation::{EpisodeFlight, Flyer};
use kestrel_experiments::experiment_config::Experiment;
use kestrel_experiments::output::{OutputError, say};
use kestrel_experiments::recording::{RecordingError, SessionRecorder};
use kestrel_experiments::results::starts;
use kestrel_export::policy::Policy;

/// Longest integration step above the flat floor \[s\]; rotors and body rates of a Crazyflie settle in tens of milliseconds.
const SUBSTEP_LIMIT_SECS: f32 = 0.0025;

/// Options of `kestrel fly`.
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub(crate) struct FlyOptions {
    /// How the vehicle meets the world.
    #[command(flatten)]
    pub(crate) session: SessionOptions,

    /// Fly so many vehicles in one aviary, where they can collide: each listens one port and has one system number above the
    /// one before it
    #[arg(long, value_name = "NUMBER", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=250))]
    #[arg(conflicts_with_all = ["record", "ros2", "episode", "video", "ai_deck", "processor"])]
    pub(crate) vehicles: u8,

    /// Where the policy is computed.
    #[command(flatten)]
    pub(crate) processor: ProcessorOptions,

    /// What its camera sees.
    #[command(flatten)]
    pub(crate) camera: CameraOptions,

    /// Be a ROS 2 node of this name, too, with crazyswarm2's services; the variables of ROS 2 count
    #[arg(long, value_name = "NAME", num_args = 0..=1, default_missing_value = "cf1", conflicts_with = "signing_key")]
    pub(crate) ros2: Option<String>,

    /// Fly in the wind and with the drone of the episode that training draws with this seed [default: a nominal drone in
    /// still air]
    #[arg(long, value_name = "SEED")]
    pub(crate) episode: Option<u64>,

    /// Keep the flight of a run or a shipped pilot in this file, for `kestrel replay` (films, plots, tables, MCAP) and `kestrel
    /// view`
    #[arg(long, value_name = "FILE")]
    pub(crate) record: Option<PathBuf>,

    /// Write the true state in every control period to this file, one JSON object per line
    #[arg(long, value_name = "FILE")]
    pub(crate) true_state_log: Option<PathBuf>,
}

impl Default for FlyOptions {
    fn default() -> Self {
        Self {
            session: SessionOptions::default(),
            vehicles: 1,
            processor: ProcessorOptions::default(),
            camera: CameraOptions::default(),
            ros2: None,
            episode: None,
            record: None,
            true_state_log: None,
        }
    }
}

/// Where to fly.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Place<'a> {
    /// The aviary, the airframe and the physics of a task, from the floor or a pad below its starts; the policy flies the
    /// task when a peer asks for it.
    Task(&'a Experiment),
    /// The aviary of another task, from below its starts.
    Aviary(&'a Experiment),
    /// An endless floor for a Crazyflie, when only the policy is known.
    FlatFloor,
}

/// What a flight was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FlightSummary {
    /// Simulated time \[s\].
    pub(crate) secs: f64,
    /// Where it ended \[m, world\].
    pub(crate) position: Vector3<f32>,
    /// What the autopilot was doing then.
    pub(crate) mode: Mode,
    /// Frames and garbage received.
    pub(crate) counts: Counts,
    /// How it kept its pace.
    pub(crate) timing: Timing,
}

/// Why there is no flight, or why it was cut short.
#[derive(Debug, thiserror::Error)]
pub(crate) enum FlyError {
    /// The policy file is damaged or of another version.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// The policy was trained at another pace.
    #[error(
        "the policy acts every {found_secs} s, but scenario \"{scenario}\" has a control period of {expected_secs} s"
    )]
    ControlPeriod {
        /// Name of the scenario.
        scenario: String,
        /// Of the policy \[s\].
        found_secs: f32,
        /// Of the scenario \[s\].
        expected_secs: f32,
    },
    /// The policy was trained for another task, whose sensors this one has not.
    #[error("the policy was trained for another {differing} than the task \"{task}\" has")]
    OtherTask {
        /// Name of the task.
        task: String,
        /// What differs.
        differing: String,
    },
    /// The policy fails its self-test, or the network refuses.
    #[error(transparent)]
    Session(Box<SessionError>),
    /// The other processor does not start, or refuses the policy.
    #[error(transparent)]
    Processor(#[from] ProcessorError),
    /// Nobody can be told how to connect.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// No ROS 2 node.
    #[error("{0}")]
    Node(String),
    /// The true-state log cannot be written.
    #[error(transparent)]
    Log(#[from] TrueStateLogError),
    /// The recording cannot be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// There is no place for so many vehicles.
    #[error(transparent)]
    NoRoom(#[from] NoRoom),
    /// There are no pictures of a camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// A recording holds the task in whose aviary it was flown.
    #[error("found --record for a policy file, expected the directory of a run or the name of a shipped pilot")]
    RecordWithoutTask,
}

impl FlyError {
    /// Whether it says something of the pilot, and not of links or files beside it.
    pub(crate) fn is_of_the_pilot(&self) -> bool {
        match self {
            Self::Policy(_) | Self::ControlPeriod { .. } | Self::OtherTask { .. } => true,
            Self::Session(error) => match **error {
                SessionError::Policy(_)
                | SessionError::SelfTest { .. }
                | SessionError::GoalUnseen { .. }
                | SessionError::SensorsMissing { .. } => true,
                SessionError::Link(_)
                | SessionError::Log(_)
                | SessionError::PersistentStore(_)
                | SessionError::Fleet { .. }
                | SessionError::Flight(_) => false,
            },
            Self::Processor(_)
            | Self::Output(_)
            | Self::Node(_)
            | Self::Log(_)
            | Self::Recording(_)
            | Self::Camera(_)
            | Self::NoRoom(_)
            | Self::RecordWithoutTask => false,
        }
    }
}

impl From<SessionError> for FlyError {
    fn from(error: SessionError) -> Self {
        Self::Session(Box::new(error))
    }
}

/// Flies the policy in `policy` until its time is up or `interrupted` says so, and tells `spectator` of it, if there is one.
///
/// Says on standard output how to connect, and nothing else.
///
/// # Errors
/// Before take-off: a bad policy, a wrong pace, a busy port, a log that cannot be created. Later: a full disk.
pub(crate) fn fly(
    place: Place,
    policy: &[u8],
    options: &FlyOptions,
    interrupted: &dyn Fn() -> bool,
    spectator: Option<Sender<Glimpse>>,
) -> Result<FlightSummary, FlyError> {
    let bytes = PolicyBytes::copy_of(policy);
    let flown = Policy::parse(bytes.bytes())?;
    let identity = PolicyIdentity::of(flown.metadata().name, bytes.bytes());
    let camera = OnboardCamera::open(&options.camera)?;
    let all = spectator.into_iter().chain(camera.as_ref().map(|camera| camera.spectator.clone())).collect();
    let spectators = Spectators::new(all, place.title(&identity));
    if options.vehicles > 1 {
        return team::fly(&bytes, &place.scenario(&flown)?, options, interrupted, spectators);
    }
    let mut plant = place.plant(&flown, options.episode)?;
    plant.flight.spectators = spectators;
    let means = Means { camera: camera.as_ref(), options, interrupted };
    if let Some(path) = &options.record {
        check_writable(path).map_err(RecordingError::File)?;
        let task = place.task().ok_or(FlyError::RecordWithoutTask)?;
        // A recording has the pace of its configuration.
        check_period(&task.scenario, &flown)?;
        plant.recorded_in = Some(task);
        plant.flight.recorder = Some(SessionRecorder::default());
    }
    let remote = options.processor.remote()?;
    if remote.is_none() && plant.task.is_some() && !flown.flies_anywhere() {
        let backend = TaskAlone::of(&flown)?;
        let session = Session::for_task(backend, &identity, place.airframe(), &options.session)?;
        return conduct(session, &mut plant, &means);
    }
    let policy = bytes.policy()?;
    let Some(remote) = remote else {
        let mut session = Session::open(&bytes, place.airframe(), &options.session)?;
        if plant.task.is_some() {
            session.offer_task();
        }
        return conduct(session, &mut plant, &means);
    };
    let processor = RemoteProcessor::start(remote, bytes.bytes(), policy.metadata())?;
    let session = Session::with(processor, &identity, place.airframe(), &options.session)?;
    conduct(session, &mut plant, &means)
}

/// With what a session is flown.
struct Means<'a> {
    camera: Option<&'a OnboardCamera>,
    options: &'a FlyOptions,
    interrupted: &'a dyn Fn() -> bool,
}

/// Flies a session to its end.
fn conduct<P: PolicyBackend>(
    mut session: Session<P>,
    plant: &mut TaskPlant<'_>,
    &Means { camera, options, interrupted }: &Means<'_>,
) -> Result<FlightSummary, FlyError> {
    if let Some(profile) = camera.and_then(|camera| camera.profile.clone()) {
        session.carry_camera(profile);
    }
    let mut log = TrueStateLog::create(options.true_state_log.as_deref())?;
    if let Some(name) = &options.ros2 {
        node::attach(&mut session, name, &options.session).map_err(FlyError::Node)?;
    }
    say(session.announcement())?;
    if let Some(address) = camera.and_then(|camera| camera.deck) {
        say(format_args!("Its AI-deck streams to whoever connects to {address}."))?;
    }
    let mut failure = None;
    let mut last = None;
    let mut watch = |period: &ControlPeriod| {
        last = Some((period.secs, period.state.position, period.mode));
        failure = log.write(period).err();
        if failure.is_some() || interrupted() { Next::End } else { Next::Fly }
    };
    let counts = session.fly(plant, &mut watch)?;
    if let Some(failure) = failure {
        return Err(failure.into());
    }
    plant.keep(options.record.as_deref())?;
    let (secs, position, mode) = last.unwrap_or((0.0, plant.state().position, Mode::Disarmed));
    Ok(FlightSummary { secs, position, mode, counts, timing: session.timing() })
}

impl Place<'_> {
    const fn airframe(&self) -> &Airframe {
        match self {
            Self::FlatFloor => &CF2X,
            Self::Task(experiment) | Self::Aviary(experiment) => &experiment.scenario.airframe,
        }
    }

    /// Of what is seen of a flight.
    fn title(&self, policy: &PolicyIdentity) -> String {
        let name = policy.name.as_str();
        match self.task() {
            Some(task) if task.name != name => format!("{}: {name}", task.name),
            Some(_) | None => name.to_owned(),
        }
    }

    const fn task(&self) -> Option<&Experiment> {
        match self {
            Self::FlatFloor => None,
            Self::Task(experiment) | Self::Aviary(experiment) => Some(experiment),
        }
    }

    /// Where a policy flies that is told where to.
    fn scenario(&self, policy: &Policy<'_>) -> Result<Scenario, FlyError> {
        match self {
            Self::FlatFloor => Ok(flat_floor(policy.metadata())),
            Self::Aviary(experiment) => Ok(at_pace(&experiment.scenario, policy.metadata())),
            Self::Task(experiment) => {
                check_period(&experiment.scenario, policy)?;
                Ok(experiment.scenario.clone())
            }
        }
    }

    fn plant<'b>(&'b self, policy: &'b Policy<'b>, episode: Option<u64>) -> Result<TaskPlant<'b>, FlyError> {
        match self {
            Self::FlatFloor => Ok(TaskPlant::new(Flight::landed(&self.scenario(policy)?), None)),
            Self::Aviary(_) => Ok(TaskPlant::new(launched(&self.scenario(policy)?, episode), None)),
            Self::Task(experiment) => {
                let flight = launched(&self.scenario(policy)?, episode);
                match policy.differing(&experiment.evaluation.scenario) {
                    None => Ok(TaskPlant::new(flight, Some(TaskOfPolicy { experiment, policy }))),
                    Some(_) if policy.flies_anywhere() => Ok(TaskPlant::new(flight, None)),
                    Some(differing) => Err(FlyError::OtherTask { task: experiment.name.clone(), differing }),
                }
            }
        }
    }
}

/// A drone at rest in an aviary, in the wind of an episode if one is meant.
fn launched(scenario: &Scenario, episode: Option<u64>) -> Flight {
    match episode {
        None => Flight::landed(scenario),
        Some(seed) => Flight::randomised(scenario, Seed(seed)),
    }
}

/// The aviary of a task, at the pace of a policy that was trained elsewhere.
fn at_pace(scenario: &Scenario, metadata: &PolicyMetadata<'_>) -> Scenario {
    let Physics { control_rate_hz, substeps, .. } = scenario.physics;
    let rate_hz = f64::from(metadata.control_period_secs.recip());
    // Steps stay at most as long.
    let substeps = (f64::from(substeps) * control_rate_hz / rate_hz).ceil().max(1.0) as u32;
    let physics = Physics { control_rate_hz: rate_hz, substeps, ..scenario.physics };
    let latency = within(scenario.latency, metadata.control_period_secs);
    with_actions_of(Scenario { physics, latency, ..scenario.clone() }, metadata)
}

/// Delays of at most a control period: a simulation remembers no more.
fn within(latency: Latency, control_secs: f32) -> Latency {
    let [state_secs, motor_secs] =
        [latency.state_secs, latency.motor_secs].map(|bounds| bounds.map(|secs| secs.min(control_secs)));
    Latency {
        state_secs,
        motor_secs,
        state_jitter_secs: latency.state_jitter_secs.min(control_secs - state_secs[1]),
        motor_jitter_secs: latency.motor_jitter_secs.min(control_secs - motor_secs[1]),
        ..latency
    }
}

/// With the rate loop between policy and motors, if the policy commands one.
fn with_actions_of(mut scenario: Scenario, metadata: &PolicyMetadata<'_>) -> Scenario {
    if let ActionSpace::RateLoop(_) = metadata.action {
        scenario.action = metadata.action;
    }
    scenario
}

/// An endless floor, whose effect on rotors is felt.
fn flat_floor(metadata: &PolicyMetadata<'_>) -> Scenario {
    let control_secs = metadata.control_period_secs;
    let substeps = (control_secs / SUBSTEP_LIMIT_SECS).ceil().max(1.0) as u32;
    let (integrator, ground, downwash) = (Integrator::SemiImplicitEuler, Ground::Near, Downwash::Absent);
    let preset = Preset::Clean { integrator, ground, ceiling: None, downwash };
    let physics = Physics { preset, ..Physics::clean(integrator, substeps, 1.0 / f64::from(control_secs)) };
    with_actions_of(Scenario::hover(&CF2X, physics), metadata)
}

fn check_period(scenario: &Scenario, policy: &Policy<'_>) -> Result<(), FlyError> {
    let (found_secs, expected_secs) = (policy.metadata().control_period_secs, scenario.physics.control_secs());
    if policy.keeps_pace(expected_secs) {
        return Ok(());
    }
    Err(FlyError::ControlPeriod { scenario: scenario.name.clone(), found_secs, expected_secs })
}

/// [`Flight`] as a plant, with rangers.
pub(crate) struct SimulatedFlight {
    pub(crate) flight: Flight,
    rangers: OnceCell<Rangers>,
    /// Keeps the flight, if it is to be kept.
    recorder: Option<SessionRecorder>,
    spectators: Spectators,
}

impl SimulatedFlight {
    pub(crate) fn new(flight: Flight) -> Self {
        Self { flight, rangers: OnceCell::new(), recorder: None, spectators: Spectators::default() }
    }

    /// Keeps and tells of the control period that begins now.
    fn note(&mut self, rotor_targets: &[f32; 4]) {
        let Self { flight, spectators, .. } = self;
        spectators.tell(&[*flight.state()], || flight.movables(), flight.scenario());
        if let Some(recorder) = &mut self.recorder {
            recorder.note(self.flight.state(), rotor_targets, &self.flight.movables());
        }
    }
}

impl Plant for SimulatedFlight {
    fn state(&self) -> &State<f32> {
        self.flight.state()
    }

    fn known_state(&self) -> &State<f32> {
        self.flight.known_state()
    }

    fn ranges(&self) -> Option<Ranges> {
        let rangers = self.rangers.get_or_init(|| Rangers::new(self.flight.scenario()));
        Some(measured(rangers, self.state()))
    }

    fn step(&mut self, rotor_targets: &[f32; 4]) {
        self.note(rotor_targets);
        self.flight.step(rotor_targets);
    }
}

/// What rangers on a drone see of an aviary.
fn measured(rangers: &Rangers, state: &State<f32>) -> Ranges {
    let state = state.map(Real::to_f64);
    let [front, back, left, right, up, down] = rangers
        .measure(state.position, &state.world_from_body)
        .map(|distance| distance.map(|metres| metres as f32));
    Ranges { front, back, left, right, up, down }
}

/// In place of a policy that flies its task alone: the plant has it. Peers who select it get no answer of it, and the
/// autopilot's fallback.
struct TaskAlone {
    control_secs: f32,
    observation: ObservationLayout,
}

impl TaskAlone {
    fn of(policy: &Policy<'_>) -> Result<Self, FlyError> {
        let &PolicyMetadata { name, control_period_secs, observation, .. } = policy.metadata();
        policy.self_test().map_err(|reason| SessionError::SelfTest { name: name.to_owned(), reason })?;
        Ok(Self { control_secs: control_period_secs, observation })
    }
}

impl PolicyBackend for TaskAlone {
    fn control_secs(&self) -> f32 {
        self.control_secs
    }

    fn observation(&self) -> &ObservationLayout {
        &self.observation
    }

    fn healthy(&mut self) -> bool {
        true
    }

    fn reset(&mut self) {}

    fn tick(&mut self, _state: &State<f32>, _setpoint: &Setpoint<f32>) -> Option<[f32; 4]> {
        None
    }
}

/// The task that a policy was trained for.
#[derive(Clone, Copy)]
struct TaskOfPolicy<'a> {
    experiment: &'a Experiment,
    policy: &'a Policy<'a>,
}

/// A flight that now and then is an episode of a task: the same that `kestrel evaluate` flies, sensors, noise and team mates
/// included.
struct TaskPlant<'a> {
    flight: SimulatedFlight,
    launch: State<f32>,
    task: Option<TaskOfPolicy<'a>>,
    episode: Option<EpisodeFlight<'a>>,
    ending: Option<TaskEnding>,
    /// The task whose aviary it is, if the flight is kept.
    recorded_in: Option<&'a Experiment>,
}

impl<'a> TaskPlant<'a> {
    fn new(flight: Flight, task: Option<TaskOfPolicy<'a>>) -> Self {
        Self {
            launch: *flight.state(),
            flight: SimulatedFlight::new(flight),
            task,
            episode: None,
            ending: None,
            recorded_in: None,
        }
    }

    /// Writes the flight to a file, if there was one.
    fn keep(&mut self, path: Option<&Path>) -> Result<(), FlyError> {
        let (Some(path), Some(experiment)) = (path, self.recorded_in) else { return Ok(()) };
        let recorder = self.flight.recorder.take().unwrap_or_default();
        if let Some(recording) = recorder.recording(experiment, "behind MAVLink") {
            recording.write(path)?;
            say(format_args!("{}: kestrel replay it, or view it", path.display()))?;
        }
        Ok(())
    }
}

impl Plant for TaskPlant<'_> {
    fn state(&self) -> &State<f32> {
        self.flight.state()
    }

    fn known_state(&self) -> &State<f32> {
        self.flight.known_state()
    }

    fn ranges(&self) -> Option<Ranges> {
        self.flight.ranges()
    }

    fn step(&mut self, rotor_targets: &[f32; 4]) {
        let Some(episode) = &mut self.episode else { return self.flight.step(rotor_targets) };
        self.flight.note(rotor_targets);
        match episode.step() {
            None => self.flight.flight.put(&episode.state()),
            Some(ended) => {
                let secs = ended.steps as f32 * self.flight.flight.scenario().physics.control_secs();
                self.ending = Some(TaskEnding { success: ended.success, cause: ended.ending.name(), secs });
                self.episode = None;
            }
        }
    }

    fn reset(&mut self) {
        self.flight.flight.put(&self.launch);
    }

    fn begin_task(&mut self, start: u32) {
        let Some(TaskOfPolicy { experiment, policy }) = self.task else { return };
        let scenario = &experiment.evaluation.scenario;
        let episode = EpisodeFlight::begin(scenario, Flyer::Policy(policy), starts(experiment), start);
        self.flight.flight.put(&episode.state());
        (self.episode, self.ending) = (Some(episode), None);
    }

    fn end_task(&mut self) {
        self.episode = None;
    }

    fn take_ending(&mut self) -> Option<TaskEnding> {
        self.ending.take()
    }
}

#[cfg(test)]
mod tests;
