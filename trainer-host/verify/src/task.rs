//! The task of a recorded episode, flown by the simulator: rewards, endings, observations, step by step.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use kestrel_sim::config::Document;
use kestrel_sim::outcome::Outcome;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;
use kestrel_sim::simulation::Simulation;
use serde_json::Value;

use super::error::RecordingError;
use super::motion::{largest, rotor_speeds};
use super::report::Worst;

/// What the reference says about one control step of all drones of an environment.
pub(super) struct Recorded<'a> {
    /// How messages call it.
    pub(super) row: &'a str,
    /// Of each drone.
    pub(super) actions: Vec<&'a [f64]>,
    /// Of each drone, held during the step \[RPM\]: a flight under its own controller would amplify every rounding.
    pub(super) rpm: Vec<[f64; 4]>,
    /// Of each drone.
    pub(super) reward: f64,
    /// Of the first drone; may be empty.
    pub(super) components: &'a [f64],
    /// Whether the episode ended, and whether only because it was cut off, where that is known.
    pub(super) done: bool,
    /// As before.
    pub(super) truncated: Option<bool>,
    /// All drones' observations, one after the other; may be empty.
    pub(super) observation: &'a [f64],
    /// Whether the rest of the row is worth comparing; the flight goes on in any case.
    pub(super) compared: bool,
}

/// A task as it was recorded, ready to fly.
pub(super) struct Flown {
    simulation: Simulation<1, f64>,
    actions: Vec<f64>,
}

impl Flown {
    pub(super) fn new(scenario: &Scenario) -> Self {
        Self { simulation: Simulation::new(scenario, Seed(0), 0, 1), actions: Vec::new() }
    }

    /// Compares the observation before the first step.
    pub(super) fn compare_start(&self, recorded: &[f64], worst: &mut Worst) {
        worst.add(largest(&by_drone(self.simulation.observations(), self.simulation.rows()), recorded), "reset");
    }

    /// Flies a step and compares what it brings; false when the episode is over.
    pub(super) fn step(&mut self, recorded: &Recorded<'_>, worst: &mut Worst) -> bool {
        let (rows, len) = (self.simulation.rows(), self.simulation.scenario().action.len());
        self.actions.clear();
        for index in 0..len {
            self.actions.extend(recorded.actions.iter().map(|action| action[index]));
        }
        let speeds: Vec<[f64; 4]> = recorded.rpm.iter().map(|rpm| rotor_speeds(*rpm)).collect();
        self.simulation.step_with_rotor_speeds(&self.actions, &speeds);
        let outcome = self.simulation.outcomes()[0];
        if recorded.compared {
            worst.add(self.deviation(recorded, rows, outcome), recorded.row);
        }
        outcome == Outcome::Running
    }

    fn deviation(&self, recorded: &Recorded<'_>, rows: usize, outcome: Outcome) -> f64 {
        let truncated = recorded.truncated.unwrap_or(outcome == Outcome::Truncated);
        let expected = match (recorded.done, truncated) {
            (false, _) => Outcome::Running,
            (true, true) => Outcome::Truncated,
            (true, false) => Outcome::Terminated,
        };
        if outcome != expected {
            return f64::INFINITY;
        }
        let mut error = (self.simulation.rewards()[0] - recorded.reward).abs();
        if !recorded.components.is_empty() {
            error = error.max(largest(&self.simulation.terms(0), recorded.components));
        }
        if !recorded.observation.is_empty() {
            let observed = match outcome {
                Outcome::Running => self.simulation.observations(),
                Outcome::Terminated | Outcome::Truncated => self.simulation.final_observations(),
            };
            error = error.max(largest(&by_drone(observed, rows), recorded.observation));
        }
        error
    }
}

/// Columns as the rows that recordings have.
fn by_drone(columns: &[f64], rows: usize) -> Vec<f64> {
    (0..rows).flat_map(|row| columns.iter().skip(row).step_by(rows).copied()).collect()
}

/// The scenario in a text that this program wrote; `case` is what messages call it.
pub(super) fn scenario(case: &str, text: &str) -> Result<Scenario, RecordingError> {
    let refuse = |error: kestrel_sim::config::ConfigError| {
        RecordingError::at(case, format_args!("a task that cannot be flown ({error})"), "one that can")
    };
    let document = Document::parse(case, text).map_err(refuse)?;
    Scenario::of(case, &document).map_err(refuse)
}

/// The folder with the aviaries' world files, where there is one: below the present directory, or where the program
/// was built.
pub(super) fn worlds() -> Option<PathBuf> {
    const WORLDS: &str = "assets/worlds";
    let built = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(WORLDS);
    [PathBuf::from(WORLDS), built].into_iter().find(|path| path.is_dir())
}

/// Reward and termination components of the fork as YAML of this program.
pub(super) struct Components<'a> {
    case: &'a str,
}

impl<'a> Components<'a> {
    pub(super) fn of(case: &'a str) -> Self {
        Self { case }
    }

    /// The list under `rewards`, in the order of `names`.
    pub(super) fn rewards(&self, settings: &Value, names: &[String]) -> Result<String, RecordingError> {
        let mut text = String::from("rewards:\n");
        for name in names {
            let line = self.reward(name, &settings["reward_components"][name])?;
            writeln!(text, "  - {line}").expect("strings take text");
        }
        Ok(text)
    }

    fn reward(&self, name: &str, settings: &Value) -> Result<String, RecordingError> {
        let weight = settings["scale"].as_f64();
        let scaled =
            |rest: String| Ok(format!("{} }}", rest.replace("WEIGHT", &weight.unwrap_or(0.0).to_string())));
        let zone = || self.list(name, &settings["landing_zone_xyz"]);
        let bounds = || self.bounds(name, &settings["bounds"]);
        match name {
            // The long room adds it by itself, with these numbers.
            "CollisionReward" if settings.is_null() => {
                Ok("collision: { weight: 0.2, allowed: { x_m: [4, 5], y_m: [-1, 1] } }".to_owned())
            }
            "CollisionReward" => scaled(format!("collision: {{ weight: WEIGHT{}", self.allowed(settings)?)),
            "NoCollisionReward" => scaled(format!("no_collision: {{ weight: WEIGHT{}", self.allowed(settings)?)),
            "BoundsReward" => scaled(format!("bounds: {{ weight: WEIGHT, bounds: {}", bounds()?)),
            "OrientationReward" => scaled("orientation: { weight: WEIGHT".to_owned()),
            "TouchLandingZoneReward" => scaled("touch_landing_zone: { weight: WEIGHT".to_owned()),
            "EnterAreaReward" => {
                scaled(format!("enter_area: {{ weight: WEIGHT, area: {}", self.area(name, &settings["area"])?))
            }
            "IncreaseXReward" => scaled("increase_x: { weight: WEIGHT".to_owned()),
            "IncreaseXRewardV2" => {
                let delta = settings["delta"].as_f64().unwrap_or(0.2);
                scaled(format!("increase_x_v2: {{ weight: WEIGHT, delta_m: {delta}, as_published: true"))
            }
            "SafeDistanceReward" => {
                let reach = settings["max_dist"].as_f64().unwrap_or(20.0);
                scaled(format!("safe_distance: {{ weight: WEIGHT, landing_zone_m: {}, reach_m: {reach}", zone()?))
            }
            "SafeDeltaDistanceReward" => scaled(format!(
                "safe_delta_distance: {{ weight: WEIGHT, landing_zone_m: {}, as_published: true",
                zone()?
            )),
            "DistanceReward" => scaled(format!("distance_root: {{ weight: WEIGHT, landing_zone_m: {}", zone()?)),
            "LandingRewardV2" => {
                scaled(format!("landing_v2: {{ weight: WEIGHT, landing_zone_m: {}, as_published: true", zone()?))
            }
            "SlowdownReward" => {
                let near = settings["slowdown_dist"].as_f64().unwrap_or(1.0);
                let zone = zone()?;
                scaled(format!("slowdown: {{ weight: WEIGHT, landing_zone_m: {zone}, slowdown_distance_m: {near}"))
            }
            other => Err(self.refuse(format_args!("the reward {other}"), "one of the fork's that is known")),
        }
    }

    /// The list under `terminations`; `forced` are those that the environment adds.
    pub(super) fn terminations(&self, settings: &Value, forced: &[&str]) -> Result<String, RecordingError> {
        let mut text = String::from("terminations:\n");
        let none = serde_json::Map::new();
        for (name, settings) in settings["term_components"].as_object().unwrap_or(&none) {
            let line = match name.as_str() {
                "BoundsTerm" => format!("out_of_bounds: {}", self.bounds(name, &settings["bounds"])?),
                "OrientationTerm" => format!("roll_pitch: {{ limit_deg: {} }}", 1.0_f64.to_degrees()),
                "TouchLandingZoneTerm" => "landing".to_owned(),
                "CollisionTerm" if settings["area"].is_null() => "collision".to_owned(),
                "CollisionTerm" => {
                    format!("collision_outside: {{ allowed: {} }}", self.area(name, &settings["area"])?)
                }
                other => {
                    return Err(
                        self.refuse(format_args!("the termination {other}"), "one of the fork's that is known")
                    );
                }
            };
            writeln!(text, "  - {line}").expect("strings take text");
        }
        for line in forced {
            writeln!(text, "  - {line}").expect("strings take text");
        }
        Ok(text)
    }

    fn allowed(&self, settings: &Value) -> Result<String, RecordingError> {
        if settings["area"].is_null() {
            return Ok(String::new());
        }
        Ok(format!(", allowed: {}", self.area("area", &settings["area"])?))
    }

    fn area(&self, name: &str, area: &Value) -> Result<String, RecordingError> {
        Ok(format!("{{ x_m: {}, y_m: {} }}", self.list(name, &area[0])?, self.list(name, &area[1])?))
    }

    /// The reference names the high corner first.
    fn bounds(&self, name: &str, bounds: &Value) -> Result<String, RecordingError> {
        Ok(format!("{{ low_m: {}, high_m: {} }}", self.list(name, &bounds[1])?, self.list(name, &bounds[0])?))
    }

    /// A list of numbers, as YAML.
    fn list(&self, name: &str, list: &Value) -> Result<String, RecordingError> {
        let numbers = list.as_array().filter(|numbers| numbers.iter().all(Value::is_number));
        match numbers {
            Some(_) => Ok(list.to_string()),
            None => Err(self.refuse(format_args!("{list} in {name}"), "a list of numbers")),
        }
    }

    fn refuse(&self, found: impl std::fmt::Display, expected: &str) -> RecordingError {
        RecordingError::at(self.case, found, expected)
    }
}
