//! Episodes of upstream's learning environments: their actions, and the physics under what became of them.

use std::path::Path;

use kestrel_core::action::Setpoint;
use kestrel_core::airframe::Airframe;
use kestrel_core::reference::bullet::{Bullet, BulletState, Quirks};
use kestrel_core::reference::controller::{DslPid, DslPidMemory, command};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;
use serde::Deserialize;

use super::error::RecordingError;
use super::index::Case;
use super::model::{Models, Physics, Publisher};
use super::motion::{Clock, Logged, apart, free_of_floor, largest, rotor_speeds, rpm};
use super::report::{Kind, Ledger, Worst};
use super::table::{RPM, Table};
use super::task::{Flown, Recorded, scenario};

/// The drone of a recording that names none.
const MODEL: &str = "cf2x";

#[derive(Deserialize)]
struct Settings {
    env: String,
    act: ActionKind,
    num_drones: usize,
    pyb_freq: u64,
    ctrl_freq: u64,
    first_done_step: Option<usize>,
    model: Option<String>,
    physics: Option<Physics>,
    init_xyz: Option<Vec<[f64; 3]>>,
}

/// What the numbers of an action mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActionKind {
    /// Rotor speeds around hover.
    Rpm,
    /// An absolute position, approached in strides.
    Pid,
    /// Direction and speed.
    Vel,
    /// One rotor speed for all.
    OneDRpm,
    /// A height relative to the drone's.
    OneDPid,
}

/// A recorded episode.
#[derive(Clone, Debug)]
pub struct LearningEpisode {
    /// Its name.
    pub id: String,
    /// The environment's name, such as `HoverAviary`.
    pub environment: String,
    /// What was commanded.
    pub action: ActionKind,
    /// The drones.
    pub airframe: Airframe,
    /// Its physics.
    pub physics: Physics,
    /// Its rates.
    pub clock: Clock,
    /// Where the drones start, level and at rest \[m, world\].
    pub starts: Vec<[f64; 3]>,
    /// First control step that ended the episode.
    pub first_done_step: Option<usize>,
    /// Control steps, each with all drones.
    pub steps: Vec<Vec<LearningStep>>,
    /// After some control steps.
    pub observations: Vec<LearningObservation>,
}

/// What all drones observe at one time.
#[derive(Clone, Debug)]
pub struct LearningObservation {
    /// The control step that it follows; none is the reset.
    pub after: Option<usize>,
    /// Drone by drone: 12 kinematic values, then the past actions, oldest first.
    pub values: Vec<f64>,
}

/// One drone's part in a control step, and the state after it.
#[derive(Clone, Debug)]
pub struct LearningStep {
    /// Its line, for messages.
    pub row: String,
    /// As many numbers as the action kind has.
    pub action: Vec<f64>,
    /// Of the environment, the same for all drones.
    pub reward: f64,
    /// Of the environment.
    pub terminated: bool,
    /// Of the environment.
    pub truncated: bool,
    /// Afterwards.
    pub motion: Logged,
    /// Held during the step \[RPM\].
    pub rpm: [f64; 4],
}

/// Compares a case.
pub(super) fn compare(
    folder: &Path,
    case: &Case<'_>,
    models: &Models,
    ledger: &mut Ledger,
) -> Result<(), RecordingError> {
    let episode = LearningEpisode::read(folder, case, models)?;
    // Upstream gives the controller of `cf2x` to every drone.
    let controlled = models.find(MODEL, Publisher::Upstream).unwrap_or(episode.airframe);
    ledger.add(Kind::RlRpm, &episode.id, &episode.worst_command(&DslPid::new(&controlled)));
    ledger.add(Kind::RlStates, &episode.id, &episode.worst_state());
    match episode.task() {
        Some(text) => ledger.add(Kind::RlTask, &episode.id, &episode.worst_task(&text)?),
        None => ledger.note(format!("the task {} of {} is not known", episode.environment, episode.id)),
    }
    Ok(())
}

impl ActionKind {
    const fn len(self) -> usize {
        match self {
            Self::Rpm | Self::Vel => 4,
            Self::Pid => 3,
            Self::OneDRpm | Self::OneDPid => 1,
        }
    }

    /// The same in a configuration.
    const fn published(self) -> &'static str {
        match self {
            Self::Rpm => "rpm",
            Self::Pid => "waypoint",
            Self::Vel => "vel",
            Self::OneDRpm => "one_d_rpm",
            Self::OneDPid => "one_d_pid",
        }
    }

    /// Rotor speeds \[rad/s\] of an action.
    fn rotor_speeds(
        self,
        airframe: &Airframe,
        mut control: impl FnMut(&Setpoint<f64>) -> [f64; 4],
        state: &State<f64>,
        action: &[f64],
    ) -> [f64; 4] {
        let value = |index: usize| action[index];
        let setpoint = match self {
            Self::Rpm => return command::rotor_speeds_in_single(airframe, &core::array::from_fn(value)),
            Self::OneDRpm => return command::rotor_speeds_in_single(airframe, &[value(0); 4]),
            Self::Pid => command::waypoint(state, Vector3::from_fn(|index, _| value(index))),
            Self::OneDPid => command::vertical_offset(state, value(0)),
            Self::Vel => command::velocity_in_single(airframe, state, &core::array::from_fn(value)),
        };
        control(&setpoint)
    }
}

impl LearningEpisode {
    /// Reads a case, its table and its observations.
    ///
    /// # Errors
    /// When something is missing or contradicts the index.
    pub(super) fn read(folder: &Path, case: &Case<'_>, models: &Models) -> Result<Self, RecordingError> {
        let settings: Settings = case.part.decode()?;
        let airframe = models.of_case(settings.model.as_deref().unwrap_or(MODEL), &case.part)?;
        let file = |ending: &str| folder.join("rl").join(format!("{}{ending}", case.id));
        let starts = settings.init_xyz.clone().unwrap_or_else(|| default_starts(&airframe, settings.num_drones));
        if starts.len() != settings.num_drones || starts.is_empty() {
            let found = format!("{} starts of {} drones", starts.len(), settings.num_drones);
            return Err(case.part.refuse(found, "one a drone"));
        }
        let observations = file(".obs.csv");
        Ok(Self {
            id: case.id.clone(),
            environment: settings.env,
            action: settings.act,
            airframe,
            physics: settings.physics.unwrap_or(Physics::Pyb),
            clock: case.part.clock(settings.pyb_freq, settings.ctrl_freq)?,
            starts,
            first_done_step: settings.first_done_step,
            steps: steps(&Table::read(&file(".csv"))?, settings.act, settings.num_drones)?,
            observations: if observations.exists() { observed(&Table::read(&observations)?)? } else { Vec::new() },
        })
    }

    /// The task as YAML, if it is one of upstream's under plain PYB.
    fn task(&self) -> Option<String> {
        let bound = match self.environment.as_str() {
            "HoverAviary" => 1.5,
            "MultiHoverAviary" => 2.0,
            _ => return None,
        };
        if self.physics != Physics::Pyb {
            return None;
        }
        let rate = 1.0 / self.clock.control_secs();
        let drones = self.starts.len();
        let place = |start: &[f64; 3]| format!("{{ position_m: {start:?} }}");
        let goal = |(drone, start): (usize, &[f64; 3])| match self.environment.as_str() {
            "HoverAviary" => [0.0, 0.0, 1.0],
            _ => [start[0], start[1], start[2] + 1.0 / (drone + 1) as f64],
        };
        let places: Vec<String> = self.starts.iter().map(place).collect();
        let goals: Vec<[f64; 3]> = self.starts.iter().enumerate().map(goal).collect();
        Some(format!(
            "aviary: {{ goal_m: {:?} }}
agents: {{ count: {drones}, rewards: shared }}
goals: {{ per_agent: {{ points_m: {goals:?} }} }}
vehicle: {{ airframe: cf2x, rotor_order: upstream }}
physics: {{ substeps: {}, control_rate_hz: {rate}, bullet: {{ mode: pyb, version: upstream }} }}
action: {{ published: {{ kind: {}, precision: single }} }}
observation: {{ kinematic: {{ past_actions: {} }} }}
critic: observation
episode_secs: 8
clock: {{ as_published: true }}
start: {{ position: {{ exactly: [{}] }} }}
rewards: [quartic_distance: {{ weight: 1 }}]
terminations:
  - cut_out_of_bounds: {{ low_m: [-{bound}, -{bound}, -1000], high_m: [{bound}, {bound}, 2] }}
  - roll_pitch: {{ limit_deg: {}, truncates: true }}
success: {{ settle: {{ radius_m: 0.1, within_secs: 6 }} }}
",
            goals[0],
            self.clock.substeps,
            self.action.published(),
            (rate / 2.0).floor(),
            places.join(", "),
            0.4_f64.to_degrees(),
        ))
    }

    /// Until the episode is over; the recording goes on beyond that.
    fn worst_task(&self, text: &str) -> Result<Worst, RecordingError> {
        let mut worst = Worst::default();
        let mut flown = Flown::new(&scenario(&self.id, text)?);
        let observed = |after: Option<usize>| {
            let found = self.observations.iter().find(|observation| observation.after == after);
            found.map_or(&[][..], |observation| &observation.values)
        };
        if !observed(None).is_empty() {
            flown.compare_start(observed(None), &mut worst);
        }
        for (index, step) in self.steps.iter().enumerate() {
            let recorded = Recorded {
                row: &step[0].row,
                actions: step.iter().map(|drone| &drone.action[..]).collect(),
                rpm: step.iter().map(|drone| drone.rpm).collect(),
                reward: step[0].reward,
                components: &[],
                done: step[0].terminated || step[0].truncated,
                truncated: Some(step[0].truncated),
                observation: observed(Some(index)),
                compared: true,
            };
            if !flown.step(&recorded, &mut worst) {
                break;
            }
        }
        Ok(worst)
    }

    fn start(&self) -> Vec<BulletState<f64>> {
        self.starts.iter().map(|start| Logged::at_rest(*start).placed()).collect()
    }

    fn worst_command(&self, controller: &DslPid<f64>) -> Worst {
        let mut worst = Worst::default();
        let mut memories = vec![DslPidMemory::new(); self.starts.len()];
        let mut states = self.start();
        for step in &self.steps {
            for ((memory, state), drone) in memories.iter_mut().zip(&mut states).zip(step) {
                let present = state.motion;
                let control = |setpoint: &_| {
                    controller.command(memory, &present, setpoint, self.clock.control_secs()).rotor_speeds
                };
                let speeds = self.action.rotor_speeds(&self.airframe, control, &present, &drone.action);
                worst.add(largest(&rpm(speeds), &drone.rpm), &drone.row);
                *state = drone.motion.placed();
            }
        }
        worst
    }

    /// Up to the first chance of a contact.
    fn worst_state(&self) -> Worst {
        let bullet = Bullet::new(&self.airframe, self.physics.mode(), Quirks::upstream());
        let mut worst = Worst::default();
        let mut drones = self.start();
        for step in &self.steps {
            if !self.advance(&bullet, &mut drones, step) {
                break;
            }
            for (drone, recorded) in drones.iter().zip(step) {
                worst.add(recorded.motion.deviation(drone), &recorded.row);
            }
        }
        worst
    }

    /// One control step of all drones; false if anything could have touched anything.
    fn advance(&self, bullet: &Bullet<f64>, drones: &mut [BulletState<f64>], step: &[LearningStep]) -> bool {
        for _ in 0..self.clock.substeps {
            let swarm: Vec<Vector3<f64>> = drones.iter().map(|drone| drone.motion.position).collect();
            for (drone, recorded) in drones.iter_mut().zip(step) {
                *drone = bullet.step(drone, &rotor_speeds(recorded.rpm), &swarm, self.clock.step_secs);
            }
            if self.physics != Physics::Dyn && !self.is_free(drones) {
                return false;
            }
        }
        true
    }

    fn is_free(&self, drones: &[BulletState<f64>]) -> bool {
        let above = drones.iter().all(|drone| free_of_floor(&self.airframe, &drone.motion));
        let place = |index: usize| &drones[index].motion.position;
        let pairs = || (0..drones.len()).flat_map(|one| (0..one).map(move |other| (one, other)));
        above && pairs().all(|(one, other)| apart(&self.airframe, place(one), place(other)))
    }
}

/// Where upstream puts its drones: four arms apart.
fn default_starts(airframe: &Airframe, drones: usize) -> Vec<[f64; 3]> {
    let along = |drone: usize| 4.0 * airframe.arm * drone as f64;
    (0..drones.min(1000)).map(|drone| [along(drone), along(drone), airframe.start_height()]).collect()
}

fn steps(table: &Table, action: ActionKind, drones: usize) -> Result<Vec<Vec<LearningStep>>, RecordingError> {
    let [step_column, drone_column, reward] = table.columns(["k", "drone", "reward"])?;
    let [terminated, truncated] = table.columns(["terminated", "truncated"])?;
    let (motion, rpm) = (table.motion("")?, table.columns(RPM)?);
    let actions = table.numbered("a");
    if actions.len() != action.len() {
        let expected = format!("{}, as the action {action:?} has", action.len());
        return Err(table.refuse(1, format_args!("{} columns of actions", actions.len()), expected));
    }
    let mut steps: Vec<Vec<LearningStep>> = Vec::new();
    for (index, row) in table.rows().iter().enumerate() {
        let (step, drone) = (table.whole(row, step_column)?, table.whole(row, drone_column)?);
        if [step, drone] != [index / drones, index % drones] {
            let expected = format!("step {} of drone {}", index / drones, index % drones);
            return Err(table.refuse_row(row, format_args!("step {step} of drone {drone}"), expected));
        }
        if drone == 0 {
            steps.push(Vec::with_capacity(drones));
        }
        let recorded = LearningStep {
            row: row.name(),
            action: table.given_list(row, &actions)?,
            reward: row.pick(&[reward])[0],
            terminated: table.truth(row, terminated)?,
            truncated: table.truth(row, truncated)?,
            motion: row.motion(&motion),
            rpm: table.given(row, &rpm)?,
        };
        steps.last_mut().expect("drone 0 comes first").push(recorded);
    }
    match steps.last().map_or(0, Vec::len) {
        found if found == drones => Ok(steps),
        found => Err(table.refuse(table.rows().len() + 1, format_args!("{found} rows of the last step"), drones)),
    }
}

/// Observations by the control step that they follow.
fn observed(table: &Table) -> Result<Vec<LearningObservation>, RecordingError> {
    let step = table.column("k")?;
    let values = table.numbered("o");
    let mut observed = Vec::new();
    for row in table.rows() {
        let reset = row.pick(&[step]) == [-1.0];
        let after = if reset { None } else { Some(table.whole(row, step)?) };
        observed.push(LearningObservation { after, values: row.list(&values) });
    }
    Ok(observed)
}
