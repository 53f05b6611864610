//! One episode as it was flown, in a file of its own: for films, for tables, for reports of bugs.
//!
//! A recording is a [sealed file](crate::sealed_file) and holds the whole configuration, so that it can be replayed
//! without anything else. Numbers are `f64`: those of a simulation in `f32` and of one in `f64` both fit exactly.

use std::path::{Path, PathBuf};

use kestrel_core::attitude::Attitude;
use kestrel_core::real::Real;
use kestrel_core::vehicle::State;
use kestrel_sim::config::ConfigError;
use kestrel_sim::world::Pose;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::atomic_file::{FileError, write_atomically};
use crate::experiment_config::{self, Experiment};
use crate::sealed_file::{Kind, SealError};
use kestrel_draw::recorded_flight::{DroneFlight, FlightRecording, Placement};

mod flown;
mod plot;
mod table;
#[cfg(test)]
mod tests;

pub(crate) use flown::fly_watched;
pub use flown::{SessionRecorder, at_start, fly};
pub use table::Table;

/// What every recording is.
const KIND: Kind = Kind { noun: "recording", magic: *b"KESTRELR", version: 1 };

/// One episode of every drone of one environment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// Who flew, such as `policy` or `scripted pilot`.
    pub pilot: String,
    /// The experiment with overrides applied, every default filled in and no import left, as YAML.
    pub config: String,
    /// What the starts follow from.
    pub seed: u64,
    /// Which of the seed's starts it is.
    pub start: u32,
    /// Names of the reward's components, in the order of [`Step::rewards`].
    pub components: Vec<String>,
    /// The drones.
    pub drones: Vec<Track>,
    /// Where the world's movable bodies were, `[moment][body]`, the start first; nothing in a world without.
    pub movables: Vec<Vec<Placed>>,
}

/// What one drone did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// Where it should go \[m, world\].
    pub goal: [f64; 3],
    /// True states at the start and after each step; that after the last step may be missing.
    pub moments: Vec<Moment>,
    /// What happened between them, one per control period.
    pub steps: Vec<Step>,
    /// How it ended, as in reports: `collision`, `time limit`.
    pub ending: String,
    /// Whether that was a success.
    pub success: bool,
}

/// The true state of a drone at one moment.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Moment {
    /// Where it is.
    pub placed: Placed,
    /// Linear velocity \[m/s\], world.
    pub velocity: [f64; 3],
    /// Angular velocity \[rad/s\], body.
    pub body_rates: [f64; 3],
    /// Rotor speeds \[rad/s\].
    pub rotor_speeds: [f64; 4],
}

/// A place and an orientation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Placed {
    /// \[m\], world.
    pub position: [f64; 3],
    /// Unit quaternion `world_from_body`: w, x, y, z.
    pub attitude: [f64; 4],
}

/// One control period.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// What the pilot commanded.
    pub action: Vec<f64>,
    /// What each component of the reward paid, weighted.
    pub rewards: Vec<f64>,
}

/// Why a recording cannot be written, read or replayed.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// It is no whole recording.
    #[error(transparent)]
    Sealed(#[from] SealError),
    /// It contradicts itself.
    #[error("{} contradicts itself: found {found}, expected {expected}", path.display())]
    Contradiction {
        /// The file.
        path: PathBuf,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// The configuration in it is none for this program.
    #[error("the configuration in {}", path.display())]
    Config {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: Box<ConfigError>,
    },
    /// The system refused a file operation.
    #[error(transparent)]
    File(#[from] FileError),
}

impl Recording {
    /// Writes it to `path`, whole or not at all.
    ///
    /// # Errors
    /// When it contradicts itself, or the system's reason.
    pub fn write(&self, path: &Path) -> Result<(), RecordingError> {
        self.check(path)?;
        Ok(write_atomically(path, &KIND.encode(self))?)
    }

    /// Reads the one at `path`.
    ///
    /// # Errors
    /// When the file is missing, damaged, something else, or contradicts itself.
    pub fn read(path: &Path) -> Result<Self, RecordingError> {
        let recording: Self = KIND.read(path)?;
        recording.check(path)?;
        Ok(recording)
    }

    /// The experiment in it; `path` is what messages call the file.
    ///
    /// # Errors
    /// When this program does not understand its configuration.
    pub fn experiment(&self, path: &Path) -> Result<Experiment, RecordingError> {
        let name = format!("{}: config", path.display());
        let parsed = experiment_config::parse(&name, &self.config, &[]);
        parsed.map_err(|source| RecordingError::Config { path: path.to_owned(), source: Box::new(source) })
    }

    /// What is needed to draw it, in the world of `experiment`.
    ///
    /// # Errors
    /// When its movable bodies are not those of the world.
    pub fn flight(&self, experiment: &Experiment, path: &Path) -> Result<FlightRecording, RecordingError> {
        let scenario = &experiment.evaluation.scenario;
        let world = &scenario.aviary.world;
        if let Some(bodies) = self.movables.first().filter(|bodies| bodies.len() != world.movables.len()) {
            let expected = format!("the {} of its world", world.movables.len());
            return Err(contradiction(path, format!("{} movable bodies", bodies.len()), expected));
        }
        let movables = world.movables.iter().enumerate().map(|(index, movable)| {
            let recorded: Vec<_> = self.movables.iter().map(|bodies| bodies[index].placement()).collect();
            if recorded.is_empty() { vec![Placed::of(&movable.solid.pose).placement()] } else { recorded }
        });
        Ok(FlightRecording {
            title: format!("{}: {}", experiment.name, self.pilot),
            control_secs: scenario.physics.control_secs(),
            drones: self.drones.iter().map(|track| track.flight(self.is_episode())).collect(),
            movables: movables.collect(),
        })
    }

    /// Whether it is an episode of a task, which has rewards and a goal; else a drone flew where it was told.
    pub fn is_episode(&self) -> bool {
        !self.components.is_empty()
    }

    /// The names of the reward's components, with a number behind those that were there before.
    pub fn terms(&self) -> Vec<String> {
        let numbered = |(index, name): (usize, &String)| {
            let before = self.components[..index].iter().filter(|other| *other == name).count();
            if before == 0 { name.clone() } else { format!("{name}_{}", before + 1) }
        };
        self.components.iter().enumerate().map(numbered).collect()
    }

    /// What everything paid, over the episode, of one drone, component by component.
    pub fn returns(&self, drone: &Track) -> Vec<f64> {
        let of = |component: usize| drone.steps.iter().map(|step| step.rewards[component]).sum();
        (0..self.components.len()).map(of).collect()
    }

    /// Refuses what could not have been flown.
    fn check(&self, path: &Path) -> Result<(), RecordingError> {
        let refuse = |found: String, expected: String| Err(contradiction(path, found, expected));
        if self.drones.is_empty() {
            return refuse("no drones".to_owned(), "at least one".to_owned());
        }
        for (index, track) in self.drones.iter().enumerate() {
            let (moments, steps) = (track.moments.len(), track.steps.len());
            if moments == 0 || (moments != steps && moments != steps + 1) {
                let expected = format!("{} for its {steps} steps", steps + 1);
                return refuse(format!("{moments} states of drone {index}"), expected);
            }
            let components = self.components.len();
            if let Some(step) = track.steps.iter().find(|step| step.rewards.len() != components) {
                let found = format!("{} rewards of drone {index} in one step", step.rewards.len());
                return refuse(found, format!("{components}, one per component"));
            }
        }
        let bodies = self.movables.first().map_or(0, Vec::len);
        match self.movables.iter().find(|moment| moment.len() != bodies) {
            Some(moment) => refuse(format!("{} movable bodies", moment.len()), format!("{bodies} at all times")),
            None => Ok(()),
        }
    }
}

fn contradiction(path: &Path, found: String, expected: String) -> RecordingError {
    RecordingError::Contradiction { path: path.to_owned(), found, expected }
}

impl Step {
    /// All that it paid.
    pub(crate) fn paid(&self) -> f64 {
        self.rewards.iter().sum()
    }
}

impl Track {
    /// A drone at its start.
    pub fn starting<R: Real + Into<f64>>(goal: [f64; 3], state: &State<R>) -> Self {
        let moments = vec![Moment::of(state)];
        Self { goal, moments, steps: Vec::new(), ending: String::new(), success: false }
    }

    /// Adds a control period: the action, what it paid, and the state that it led to, if that is known.
    pub fn push<R: Real + Into<f64>>(&mut self, action: &[R], rewards: &[f64], after: Option<&State<R>>) {
        let action = action.iter().map(|&value| value.into()).collect();
        self.steps.push(Step { action, rewards: rewards.to_vec() });
        self.moments.extend(after.map(Moment::of));
    }

    /// How it ended, in words; none of a flight that was no episode.
    pub fn outcome(&self) -> Option<String> {
        let verdict = if self.success { "success" } else { "no success" };
        (!self.ending.is_empty()).then(|| format!("{}, {verdict}", self.ending))
    }

    /// Says how it ended.
    pub fn finish(&mut self, ending: &str, success: bool) {
        ending.clone_into(&mut self.ending);
        self.success = success;
    }

    fn flight(&self, is_episode: bool) -> DroneFlight {
        DroneFlight {
            goal: is_episode.then(|| in_single(self.goal)),
            frames: self.moments.iter().map(|moment| moment.placed.placement()).collect(),
            rewards: if is_episode { self.steps.iter().map(Step::paid).collect() } else { Vec::new() },
            ending: self.ending.clone(),
            success: self.success,
        }
    }
}

impl Moment {
    /// The state as a recording keeps it.
    pub fn of<R: Real + Into<f64>>(state: &State<R>) -> Self {
        let three = |vector: &Vector3<R>| [vector.x.into(), vector.y.into(), vector.z.into()];
        let Attitude { w, x, y, z } = state.world_from_body;
        let attitude = [w, x, y, z].map(Into::into);
        Self {
            placed: Placed { position: three(&state.position), attitude },
            velocity: three(&state.velocity),
            body_rates: three(&state.body_rates),
            rotor_speeds: state.rotor_speeds.map(Into::into),
        }
    }
}

impl Placed {
    /// The pose as a recording keeps it.
    pub fn of(pose: &Pose) -> Self {
        let Attitude { w, x, y, z } = pose.world_from_body;
        Self { position: pose.position.into(), attitude: [w, x, y, z] }
    }

    pub(crate) fn placement(&self) -> Placement {
        let [w, x, y, z] = self.attitude.map(|part| part as f32);
        Placement { position: in_single(self.position), attitude: Attitude { w, x, y, z } }
    }
}

fn in_single(point: [f64; 3]) -> Vector3<f32> {
    Vector3::from(point).cast()
}
