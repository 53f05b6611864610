//! The thesis's fork: single steps, and episodes of its environments.

use std::fs;
use std::path::{Path, PathBuf};

use kestrel_core::airframe::Airframe;
use kestrel_core::reference::bullet::{Bullet, BulletMode, Quirks, RotorPrecision};
use kestrel_core::reference::controller::{DslPid, DslPidMemory, command};
use kestrel_core::vehicle::State;
use kestrel_sim::contact::{Arena, ContactReport};
use kestrel_sim::scenario::Scenario;
use serde::Deserialize;
use serde_json::Value;

use super::error::RecordingError;
use super::index::{Case, Json};
use super::model::{Models, Physics, Publisher};
use super::motion::{Clock, Logged, flown, largest, rotor_speeds, rpm};
use super::one_step::worst_row;
use super::report::{Kind, Ledger, Worst};
use super::table::{RPM, Row, Table};
use super::task::{Components, Flown, Recorded, scenario, worlds};

/// The drone of the thesis.
const MODEL: &str = "cf2x";

/// Deviation from free flight \[SI\] that is none of rounding; an impact has a thousand times as much.
const IMPACT: f64 = 1e-6;

/// The fork's physics step \[s\] in its single steps.
const STEP_SECS: f64 = 1.0 / 240.0;

#[derive(Deserialize)]
struct Settings {
    env: String,
    act: ActionKind,
    init_xyz: Vec<[f64; 3]>,
    freq: u64,
    aggregate_phy_steps: u64,
    first_done_step: Option<usize>,
    #[serde(default)]
    env_kwargs: Value,
}

/// What the numbers of an action mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActionKind {
    /// Rotor speeds around hover.
    Rpm,
    /// Direction and speed.
    Vel,
}

/// A recorded episode of one drone under PYB.
#[derive(Clone, Debug)]
pub struct ThesisEpisode {
    /// Its name.
    pub id: String,
    /// `long` or `room`.
    pub environment: String,
    /// What was commanded.
    pub action: ActionKind,
    /// The drone.
    pub airframe: Airframe,
    /// Its rates.
    pub clock: Clock,
    /// Where it starts, level and at rest \[m, world\].
    pub start: [f64; 3],
    /// First control step that ended the episode.
    pub first_done_step: Option<usize>,
    /// What the environment was made with: difficulty, bounds, components of reward and termination.
    pub settings: Value,
    /// Names of [`ThesisStep::components`].
    pub components: Vec<String>,
    /// In the order of time; long hovers leave steps out.
    pub steps: Vec<ThesisStep>,
}

/// One control step and the state after it.
#[derive(Clone, Debug)]
pub struct ThesisStep {
    /// Its line, for messages.
    pub row: String,
    /// Counted from zero.
    pub control_step: usize,
    /// As the policy gave it.
    pub action: [f64; 4],
    /// Sum of the components.
    pub reward: f64,
    /// Whether the episode is over.
    pub done: bool,
    /// Whether only because its time is.
    pub time_limit: bool,
    /// Each component of the reward.
    pub components: Vec<f64>,
    /// The paper's 12 numbers.
    pub observation: Vec<f64>,
    /// Afterwards.
    pub motion: Logged,
    /// Held during the step \[RPM\].
    pub rpm: [f64; 4],
    /// Contact points.
    pub contacts: usize,
}

/// Compares the folder `thesis`.
pub(super) fn compare(folder: &Path, models: &Models, ledger: &mut Ledger) -> Result<(), RecordingError> {
    for path in single_steps(folder)? {
        compare_single_steps(&path, models, ledger)?;
    }
    let index = folder.join("index.json");
    if !index.exists() {
        return Ok(());
    }
    for case in Json::read(&index)?.cases()? {
        compare_episode(&ThesisEpisode::read(folder, &case, models)?, ledger)?;
    }
    Ok(())
}

fn compare_episode(episode: &ThesisEpisode, ledger: &mut Ledger) -> Result<(), RecordingError> {
    let mut task = None;
    match worlds() {
        Some(worlds) => match episode.task(&worlds)? {
            Some(text) => task = Some(scenario(&episode.id, &text)?),
            None => ledger.note(format!("the aviary {} of {} is not known", episode.environment, episode.id)),
        },
        None => ledger.note(format!("the task of {} needs the folder assets/worlds", episode.id)),
    }
    let arena = task.as_ref().map(|task| Arena::new(&task.aviary.world, &episode.airframe, ContactReport::Bullet));
    let (states, impact) = episode.worst_state(arena.as_ref());
    let free = &episode.steps[..episode.whole_steps().min(impact.unwrap_or(usize::MAX))];
    ledger.add(Kind::ThesisStates, &episode.id, &states);
    ledger.add(Kind::ThesisRpm, &episode.id, &episode.worst_command(free));
    if let Some(task) = task {
        let [free, touching] = episode.worst_task(&task, impact);
        ledger.add(Kind::ThesisTask, &episode.id, &free);
        if !touching.is_empty() {
            ledger.add(Kind::ThesisContact, &episode.id, &touching);
        }
    }
    Ok(())
}

/// The files `one_step_MODEL_PHYSICS.csv`, by name.
fn single_steps(folder: &Path) -> Result<Vec<PathBuf>, RecordingError> {
    let broken =
        |error| RecordingError::about(folder, format_args!("a folder that cannot be read ({error})"), "one");
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(broken)? {
        let path = entry.map_err(broken)?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if name.starts_with("one_step_") && path.extension().is_some_and(|extension| extension == "csv") {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

fn compare_single_steps(path: &Path, models: &Models, ledger: &mut Ledger) -> Result<(), RecordingError> {
    let name = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
    let settings = name.strip_prefix("one_step_").unwrap_or_default();
    let known = Physics::ALL.into_iter().find_map(|physics| {
        let model = settings.strip_suffix(physics.name())?.strip_suffix('_')?;
        Some((models.find(model, Publisher::Fork)?, physics))
    });
    let (airframe, physics) = known.ok_or_else(|| {
        RecordingError::about(
            path,
            format_args!("the name {name}"),
            "one_step_MODEL_PHYSICS with names that are known",
        )
    })?;
    let bullet = Bullet::new(&airframe, physics.mode(), Quirks::fork());
    ledger.add(Kind::ThesisOneStep, settings, &worst_row(&Table::read(path)?, &bullet, STEP_SECS)?);
    Ok(())
}

impl ThesisEpisode {
    /// Reads a case and its table.
    ///
    /// # Errors
    /// When something is missing or contradicts the index.
    pub(super) fn read(folder: &Path, case: &Case<'_>, models: &Models) -> Result<Self, RecordingError> {
        let settings: Settings = case.part.decode()?;
        let control = settings.freq.checked_div(settings.aggregate_phy_steps).unwrap_or(0);
        let [start] = settings.init_xyz[..] else {
            return Err(case.part.refuse(format_args!("{} starts", settings.init_xyz.len()), "one"));
        };
        let airframe = models.find(MODEL, Publisher::Fork).expect("the thesis's drone is known");
        let table = Table::read(&folder.join(format!("{}.csv", case.id)))?;
        Ok(Self {
            id: case.id.clone(),
            environment: settings.env,
            action: settings.act,
            airframe,
            clock: case.part.clock(settings.freq, control)?,
            start,
            first_done_step: settings.first_done_step,
            settings: settings.env_kwargs,
            components: table.prefixed("r_").into_iter().map(|(_, name)| name.to_owned()).collect(),
            steps: steps(&table)?,
        })
    }

    /// How many steps there are before one with a contact at its end, and before steps are left out.
    fn whole_steps(&self) -> usize {
        let ending = |(index, step): (usize, &ThesisStep)| step.contacts > 0 || step.control_step != index;
        self.steps.iter().enumerate().position(ending).unwrap_or(self.steps.len())
    }

    /// The task as YAML, if its aviary is known.
    fn task(&self, worlds: &Path) -> Result<Option<String>, RecordingError> {
        let difficulty = self.settings["difficulty"].as_u64().unwrap_or(0);
        let forced = ["collision_outside: { allowed: { x_m: [11, 12], y_m: [-1, 1] } }"];
        let (world, secs, forced): (String, u32, &[&str]) = match self.environment.as_str() {
            "long" => (format!("long-cross-{difficulty}-as-published"), 20, &forced),
            "room" if difficulty == 2 => ("room-2-as-published".to_owned(), 10, &[]),
            "room" => (format!("room-{difficulty}"), 10, &[]),
            _ => return Ok(None),
        };
        let components = Components::of(&self.id);
        let single = self.action == ActionKind::Rpm;
        let (kind, precision) = if single { ("rpm", "all_single") } else { ("vel", "single") };
        Ok(Some(format!(
            "aviary: {{ import: \"{}\", goal_m: [6.5, 0, 0.75] }}
vehicle: {{ airframe: cf2x, rotor_order: fork }}
physics:
  substeps: {}
  control_rate_hz: {}
  contacts: solved
  bullet: {{ mode: pyb, version: fork, quirks: {{ single_precision_rotors: {single} }} }}
action: {{ published: {{ kind: {kind}, precision: {precision}, controller: own }} }}
observation: {{ paper: {{ episode_secs: {secs} }} }}
critic: observation
episode_secs: {secs}
clock: {{ as_published: true }}
start: {{ position: {{ exactly: [{{ position_m: {:?} }}] }} }}
{}{}success: {{ settle: {{ radius_m: 0.1, within_secs: 6 }} }}
",
            worlds.join(format!("{world}.yaml")).display(),
            self.clock.substeps,
            1.0 / self.clock.control_secs(),
            self.start,
            components.rewards(&self.settings, &self.components)?,
            components.terminations(&self.settings, forced)?,
        )))
    }

    /// Until the episode is over or the first impact, in whose step contact is judged apart if the recording shows it; the
    /// recording goes on beyond that. Of steps that it leaves out the actions are those of the step before.
    fn worst_task(&self, task: &Scenario, impact: Option<usize>) -> [Worst; 2] {
        let mut worst = [Worst::default(), Worst::default()];
        let mut flown = Flown::new(task);
        let mut control_step = 0;
        let (mut action, mut rpm) = ([0.0; 4], [0.0; 4]);
        let end = impact.unwrap_or(self.steps.len());
        let shown = self.steps.get(end).filter(|step| step.contacts > 0);
        for step in self.steps[..end].iter().chain(shown) {
            let compared = |control_step| control_step == step.control_step;
            while control_step <= step.control_step {
                if compared(control_step) {
                    (action, rpm) = (step.action, step.rpm);
                }
                let recorded = Recorded {
                    row: &step.row,
                    actions: vec![&action],
                    rpm: vec![rpm],
                    reward: step.reward,
                    components: &step.components,
                    done: step.done,
                    truncated: Some(step.time_limit),
                    // An impact multiplies what little the walls are off.
                    observation: if step.contacts > 0 { &[] } else { &step.observation },
                    compared: compared(control_step),
                };
                if !flown.step(&recorded, &mut worst[usize::from(step.contacts > 0)]) {
                    return worst;
                }
                control_step += 1;
            }
        }
        worst
    }

    fn worst_command(&self, free: &[ThesisStep]) -> Worst {
        let controller = DslPid::new(&self.airframe);
        let mut memory = DslPidMemory::new();
        let mut state = Logged::at_rest(self.start).placed().motion;
        let mut worst = Worst::default();
        for step in free {
            let speeds = match self.action {
                ActionKind::Rpm => command::rotor_speeds_all_in_single(&self.airframe, &step.action),
                ActionKind::Vel => {
                    let setpoint = command::velocity_in_single(&self.airframe, &state, &step.action);
                    controller.command(&mut memory, &state, &setpoint, self.clock.control_secs()).rotor_speeds
                }
            };
            worst.add(largest(&rpm(speeds), &step.rpm), &step.row);
            state = step.motion.placed().motion;
        }
        worst
    }

    /// Up to the first impact, and in which step that is. It may be over when the control step is, and the recording shows no
    /// contact: then free flight does not lead to where the drone was.
    fn worst_state(&self, arena: Option<&Arena>) -> (Worst, Option<usize>) {
        // numpy 1 keeps rotor speeds, and with them thrusts, in the precision of the action.
        let rotor_precision = match self.action {
            ActionKind::Rpm => RotorPrecision::Single,
            ActionKind::Vel => RotorPrecision::Full,
        };
        let bullet = Bullet::new(&self.airframe, BulletMode::Pyb, Quirks { rotor_precision, ..Quirks::fork() });
        let mut drone = Logged::at_rest(self.start).placed();
        let mut worst = Worst::default();
        for (index, step) in self.steps[..self.whole_steps()].iter().enumerate() {
            let speeds = rotor_speeds(step.rpm);
            let Some(after) = flown(&bullet, &self.airframe, &self.clock, drone, &speeds) else { break };
            let deviation = step.motion.deviation(&after);
            if deviation > IMPACT && arena.is_some_and(|arena| self.can_touch(arena, &drone.motion)) {
                return (worst, Some(index));
            }
            worst.add(deviation, &step.row);
            drone = after;
        }
        (worst, self.steps.iter().position(|step| step.contacts > 0))
    }

    /// Whether a drone can touch anything within the coming control step.
    fn can_touch(&self, arena: &Arena, drone: &State<f64>) -> bool {
        let [x, y, z] = [drone.position.x, drone.position.y, drone.position.z].map(|coordinate| coordinate as f32);
        let way = drone.velocity.norm() * self.clock.control_secs();
        f64::from(arena.clearance(x, y, z)) < f64::from(arena.reach()) + way
    }
}

fn steps(table: &Table) -> Result<Vec<ThesisStep>, RecordingError> {
    let [k, reward, done, time_limit, contacts] = table.columns(["k", "reward", "done", "time_limit", "nc"])?;
    let action = table.columns(["a0", "a1", "a2", "a3"])?;
    let (motion, rpm) = (table.motion("")?, table.columns(RPM)?);
    let components: Vec<usize> = table.prefixed("r_").into_iter().map(|(column, _)| column).collect();
    let observation = table.numbered("vec");
    let of_row = |row: &Row| {
        Ok(ThesisStep {
            row: row.name(),
            control_step: table.whole(row, k)?,
            action: table.given(row, &action)?,
            reward: row.pick(&[reward])[0],
            done: table.truth(row, done)?,
            time_limit: table.truth(row, time_limit)?,
            components: row.list(&components),
            observation: row.list(&observation),
            motion: row.motion(&motion),
            rpm: table.given(row, &rpm)?,
            contacts: table.whole(row, contacts)?,
        })
    };
    table.rows().iter().map(of_row).collect()
}
