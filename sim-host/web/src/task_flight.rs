//! The episodes of a task, flown one after the other.

use kestrel_core::vehicle::State;
use kestrel_draw::live::LiveScene;
use kestrel_experiments::evaluation::{EpisodeFlight, Flyer};
use kestrel_experiments::experiment_config::Experiment;
use kestrel_experiments::results::starts;
use kestrel_sim::config::ConfigError;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::world::Pose;
use nalgebra::Vector3;
use wasm_bindgen::Clamped;
use wasm_bindgen::prelude::*;

use crate::free_flight::between;
use crate::policy::WebPolicy;
use crate::stage::{Look, Stage, telemetry};

/// Why a policy does not fly a task.
#[derive(Debug, thiserror::Error)]
pub(crate) enum TaskFlightError {
    /// The task is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The policy is for something else.
    #[error("the policy \"{policy}\" is for another {differing} than the task \"{task}\" has")]
    Other {
        /// Name of its experiment.
        policy: String,
        /// Name of the task.
        task: String,
        /// What differs.
        differing: String,
    },
    /// Nobody of that name.
    #[error("found the pilot \"{0}\", expected policy, scripted or nothing")]
    Pilot(String),
}

/// The episodes by which `kestrel evaluate` judges a policy, with all of their drones.
#[wasm_bindgen]
pub struct TaskFlight {
    policy: WebPolicy,
    flyer: Flyer<'static>,
    task: Experiment,
    flight: EpisodeFlight<'static>,
    start: u32,
    /// Before the last control period, of each drone.
    before: Vec<State<f32>>,
    /// And now.
    states: Vec<State<f32>>,
    ending: Option<String>,
    stage: Stage,
}

#[wasm_bindgen]
impl TaskFlight {
    /// The first of the evaluation's episodes of a task, flown by the policy, by the task's script (`scripted`) or by nobody
    /// (`nothing`). The task is YAML with resolved imports.
    ///
    /// # Errors
    /// When the task is wrong, the policy is for another one, or nobody has that name.
    #[wasm_bindgen(constructor)]
    pub fn new(policy: &WebPolicy, task: &str, pilot: &str) -> Result<Self, JsError> {
        Ok(Self::begin(policy, task, pilot)?)
    }

    /// From one control period to the next \[s\].
    #[wasm_bindgen(getter)]
    pub fn control_secs(&self) -> f32 {
        self.scenario().physics.control_secs()
    }

    /// Drones in the air.
    #[wasm_bindgen(getter)]
    pub fn drones(&self) -> usize {
        self.flight.simulation().rows()
    }

    /// Number of the episode.
    #[wasm_bindgen(getter)]
    pub fn start(&self) -> u32 {
        self.start
    }

    /// How the episode ended, once it has.
    #[wasm_bindgen(getter)]
    pub fn ending(&self) -> Option<String> {
        self.ending.clone()
    }

    /// Flies one control period of the episode; after its end nothing moves.
    pub fn step(&mut self) {
        if self.ending.is_some() {
            return;
        }
        let ended = self.flight.step();
        self.before.clone_from(&self.states);
        if let Some(episode) = ended {
            // The drones stand at another start by now.
            let secs = episode.steps as f32 * self.control_secs();
            let verdict = if episode.success { "success" } else { "failure" };
            self.ending = Some(format!("{verdict} after {secs:.1} s: {}", episode.ending.name()));
            return;
        }
        self.states = states(&self.flight);
        self.stage.follow(self.states.iter().map(|state| state.position.cast()));
    }

    /// Begins the next episode.
    pub fn next(&mut self) {
        self.start = (self.start + 1) % self.task.evaluation.episodes.max(1) as u32;
        self.flight = flight(&self.task, self.flyer, self.start);
        self.states = states(&self.flight);
        self.before.clone_from(&self.states);
        self.ending = None;
        self.stage = stage(&self.flight);
    }

    /// Colours of the picture, `share` of a control period after the one before the last.
    pub fn draw(&mut self, share: f32, look: &Look) -> Clamped<Vec<u8>> {
        if self.ending.is_none() {
            let simulation = self.flight.simulation();
            let goals: Vec<Vector3<f64>> = (0..simulation.rows()).map(|row| simulation.goal(row).cast()).collect();
            self.stage.scene.show_goals(&goals);
        }
        let states = self.before.iter().zip(&self.states);
        let poses: Vec<Pose> = states.map(|(before, after)| between(before, after, share)).collect();
        Clamped(self.stage.draw(&poses, &self.flight.simulation().movables(0), look))
    }

    /// The way of a drone in the last picture \[px\]: x and y of each point, NaN where it is hidden.
    pub fn trail(&self, drone: usize) -> Vec<f32> {
        self.stage.trail(drone)
    }

    /// Position \[m, world\], speed \[m/s\], tilt \[rad\], distance to the goal \[m\], rotor speeds as shares of the greatest; of
    /// the first drone.
    pub fn telemetry(&self) -> Vec<f32> {
        telemetry(&self.states[0], &self.flight.simulation().goal(0), &self.scenario().airframe)
    }

    /// What each layer of the first drone's network reads, as shares of one, layer after layer, and the action.
    pub fn activations(&self) -> Vec<f32> {
        let simulation = self.flight.simulation();
        let columns = simulation.observations().chunks_exact(simulation.rows());
        let observation: Vec<f32> = columns.map(|column| column[0]).collect();
        self.policy.activations(&observation)
    }

    /// Columns, rows and channels of what the first drone's camera sees; nothing without one.
    #[wasm_bindgen(getter)]
    pub fn image_shape(&self) -> Vec<usize> {
        let camera = self.scenario().camera.as_ref();
        camera.map_or_else(Vec::new, |onboard| {
            vec![onboard.camera.columns, onboard.camera.rows, onboard.pixel_len()]
        })
    }

    /// What the first drone's camera sees, `[rows][columns][channels]`.
    pub fn image(&self) -> Vec<u8> {
        let len = self.image_shape().iter().product::<usize>();
        self.flight.simulation().images().get(..len).unwrap_or_default().to_vec()
    }
}

impl TaskFlight {
    /// As [`Self::new`].
    ///
    /// # Errors
    /// When the task is wrong, the policy is for another one, or nobody has that name.
    pub(crate) fn begin(policy: &WebPolicy, task: &str, pilot: &str) -> Result<Self, TaskFlightError> {
        let task = crate::experiment(task)?;
        if let Some(differing) = policy.file().differing(&task.evaluation.scenario) {
            return Err(TaskFlightError::Other { policy: policy.name(), task: task.name, differing });
        }
        let flyer = match pilot {
            "policy" => Flyer::Policy(policy.file()),
            "scripted" => Flyer::Scripted,
            "nothing" => Flyer::Nothing,
            other => return Err(TaskFlightError::Pilot(other.to_owned())),
        };
        let flight = flight(&task, flyer, 0);
        let (states, stage) = (states(&flight), stage(&flight));
        Ok(Self {
            policy: *policy,
            flyer,
            task,
            flight,
            start: 0,
            before: states.clone(),
            states,
            ending: None,
            stage,
        })
    }

    fn scenario(&self) -> &Scenario {
        &self.task.evaluation.scenario
    }
}

fn flight(task: &Experiment, flyer: Flyer<'static>, start: u32) -> EpisodeFlight<'static> {
    EpisodeFlight::begin(&task.evaluation.scenario, flyer, starts(task), start)
}

fn states(flight: &EpisodeFlight<'_>) -> Vec<State<f32>> {
    (0..flight.simulation().rows()).map(|row| flight.simulation().state(row)).collect()
}

/// The room of the episode.
fn stage(flight: &EpisodeFlight<'_>) -> Stage {
    let simulation = flight.simulation();
    let scenario = simulation.scenario();
    let world = &scenario.aviary_of(simulation.room(0)).world;
    Stage::new(LiveScene::new(world, &scenario.airframe, simulation.rows()), simulation.rows())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{pilot, task};

    fn begun(name: &str, flyer: &str) -> TaskFlight {
        TaskFlight::begin(&pilot(name), &task(name), flyer).unwrap()
    }

    #[test]
    fn episodes_end_with_a_word_and_the_next_one_is_another() {
        let mut flight = begun("land", "policy");
        let first = flight.telemetry();
        (0..2_000).for_each(|_| flight.step());
        assert!(
            flight.ending().is_some_and(|ending| ending.starts_with("success after ")),
            "{:?}",
            flight.ending()
        );
        let (landed, periods) = (flight.telemetry(), flight.stage.trail(0).len());
        flight.step();
        assert_eq!(
            (flight.telemetry(), flight.stage.trail(0).len()),
            (landed, periods),
            "nothing moves behind the end"
        );
        flight.next();
        assert_eq!((flight.start(), flight.ending()), (1, None));
        assert_ne!(flight.telemetry(), first);
    }

    #[test]
    fn whoever_does_nothing_fails() {
        let mut flight = begun("land", "nothing");
        (0..2_000).for_each(|_| flight.step());
        assert!(
            flight.ending().is_some_and(|ending| ending.starts_with("failure after ")),
            "{:?}",
            flight.ending()
        );
    }

    #[test]
    fn a_team_flies_and_a_camera_sees() {
        let mut team = begun("crossing-3", "policy");
        let look = Look { columns: 64, rows: 36, ..Look::new(0.0, 0.3, 5.0) };
        assert_eq!((team.drones(), team.draw(0.5, &look).len(), team.image().len()), (3, 4 * 64 * 36, 0));
        let seeing = begun("harder-cross-11-vision", "policy");
        assert!(!seeing.image().is_empty());
        assert_eq!(seeing.image().len(), seeing.image_shape().iter().product::<usize>());
        assert!(seeing.activations().is_empty(), "what it reads is more than its observation");
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let refused = |task_name, flyer: &str| {
            TaskFlight::begin(&pilot("land"), &task(task_name), flyer).map(drop).unwrap_err().to_string()
        };
        assert!(
            refused("room-1", "policy").contains("is for another observation"),
            "{}",
            refused("room-1", "policy")
        );
        assert_eq!(refused("land", "me"), "found the pilot \"me\", expected policy, scripted or nothing");
    }
}
