//! Files of flights as users write them, and their conversion to checked [`Case`]s.

mod expect;
mod matrix;
mod script;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use kestrel_experiments::experiment_config::{ExperimentConfig, check_name};
use kestrel_shim::parameter::table::{Domain, Parameter};
use kestrel_shim::parameter::{ParameterRefusal, ParameterValue, Parameters};
use kestrel_shim::policy_bytes::PolicyBytes;
use kestrel_sim::config::{ConfigError, Document, Field, Limits, schema_of};
use kestrel_sim::scenario::{Preset, Scenario};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::case::{Case, CasePilot};
use super::fault::{EstimateFault, Fault, FaultKind, PolicyFault};
use super::station::VEHICLE;
use crate::shipped;
use expect::ExpectationConfig;
use matrix::{MatrixConfig, Variant};
use script::StepConfig;

/// Version of the file format that this program reads.
const VERSION: u32 = 1;

/// Longest flight \[s\]: an hour.
const SECS_LIMIT: f64 = 3600.0;

/// Fastest wind that is flown in \[m/s\]: a storm.
const WIND_LIMIT: f64 = 30.0;

/// The pilot that is no policy.
const CASCADE: &str = "cascade";

/// Policies are told from names by the ending of their files.
const POLICY_ENDING: &str = "kestrel";

/// Control periods of policy and task may differ by this share: both are written in decimal somewhere.
const PERIOD_TOLERANCE: f32 = 1e-5;

/// Flights with one drone in one place.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct FlightTestConfig {
    /// Version of this file format: 1.
    version: u32,
    /// Short name: letters, digits, `-` and `_`.
    name: String,
    /// What the flights show, in a sentence or two.
    #[serde(default)]
    about: String,
    /// The aviary, the drone and its physics: an experiment, usually imported. The drone begins on the floor or a pad below
    /// its starts.
    task: ExperimentConfig,
    /// Who flies: a pilot that comes with the program, `cascade`, or a policy file (`.kestrel`).
    pilot: String,
    /// Parameters of the autopilot that are not as usual, such as `COM_DL_LOSS_T: 3`.
    #[serde(default)]
    parameters: BTreeMap<String, f64>,
    /// The flights.
    flights: Vec<FlightConfig>,
}

/// One flight, or one for every combination of its matrix.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct FlightConfig {
    /// Short name: letters, digits, `-` and `_`.
    name: String,
    /// What the flight shows.
    #[serde(default)]
    about: String,
    /// How long it lasts.
    secs: f64,
    /// Parameters beside those of the file.
    #[serde(default)]
    parameters: BTreeMap<String, f64>,
    /// What differs between flights of the same script.
    #[serde(default)]
    matrix: MatrixConfig,
    /// What the ground station sends, in the order of time.
    script: Vec<StepConfig>,
    /// What goes wrong.
    #[serde(default)]
    faults: Vec<FaultConfig>,
    /// What is to come of it, by the true state.
    expect: Vec<ExpectationConfig>,
}

/// Something that goes wrong.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct FaultConfig {
    /// When it begins.
    at_secs: f64,
    /// How long it lasts; left out: to the end of the flight.
    #[serde(default)]
    for_secs: Option<f64>,
    /// What it is.
    fault: FaultKindConfig,
}

/// What goes wrong.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum FaultKindConfig {
    /// No message passes between the ground station and the vehicle.
    LinkLoss,
    /// What the vehicle knows of its state: the same again and again (`frozen`), or nothing (`lost`).
    Estimate(EstimateFault),
    /// A rotor turns no faster than a share of its greatest speed.
    Motor {
        /// Counted from 0, in the order of the airframe.
        rotor: u64,
        /// Of the greatest speed.
        share: f64,
    },
    /// A rotor makes a share of its thrust, as a worn propeller does.
    Thrust {
        /// Counted from 0, in the order of the airframe; left out, all of them do, as where the battery sags.
        #[serde(default)]
        rotor: Option<u64>,
        /// Of its thrust.
        share: f64,
    },
    /// The drone carries so much more, at its centre of mass.
    Load {
        /// At most the drone's own mass.
        mass_kg: f64,
    },
    /// The battery has so much left.
    Battery {
        /// Of one.
        left: f64,
    },
    /// Wind beside that of the flight.
    Gust {
        /// World.
        wind_m_per_s: [f64; 3],
    },
    /// The policy gives no answer (`silent`), none that is a number (`nan`), asks for full thrust (`saturated`), or fails
    /// its self-test (`damaged`).
    Policy(PolicyFault),
}

/// What all flights of a file have in common.
struct Setting {
    suite: String,
    scenario: Arc<Scenario>,
}

/// The flights in the file at `path`, after `overrides` such as `pilot=cascade`.
///
/// # Errors
/// The first thing that is wrong, with its line or override, what was found and what was expected.
pub(crate) fn load(path: &Path, overrides: &[String]) -> Result<Vec<Case>, ConfigError> {
    from_document(Document::read(path)?, overrides)
}

fn from_document(mut document: Document, overrides: &[String]) -> Result<Vec<Case>, ConfigError> {
    document.require_version(VERSION)?;
    for assignment in overrides {
        document.set(assignment)?;
    }
    document.require_version(VERSION)?;
    document.decode::<FlightTestConfig>()?.check(&document.root())
}

/// The JSON schema of files of flights, for editors.
pub(crate) fn schema() -> String {
    schema_of::<FlightTestConfig>()
}

impl FlightTestConfig {
    fn check(&self, root: &Field<'_>) -> Result<Vec<Case>, ConfigError> {
        check_name(&self.name, &root.at("name"))?;
        let scenario = Arc::new(self.task.check(&root.at("task"))?.scenario);
        let setting = Setting { suite: self.name.clone(), scenario };
        setting.pilot(&self.pilot, &root.at("pilot"))?;
        let parameters = with_parameters(Parameters::new(VEHICLE), &self.parameters, &root.at("parameters"))?;
        if self.flights.is_empty() {
            return Err(root.at("flights").reject("an empty list", "at least one flight"));
        }
        let mut cases: Vec<Case> = Vec::new();
        for (index, flight) in self.flights.iter().enumerate() {
            let field = root.at("flights").at(index);
            check_name(&flight.name, &field.at("name"))?;
            if self.flights[..index].iter().any(|other| other.name == flight.name) {
                return Err(field.at("name").refuse(&flight.name, "a name that no other flight of the file has"));
            }
            let parameters = with_parameters(parameters.clone(), &flight.parameters, &field.at("parameters"))?;
            flight.matrix.check(&field.at("matrix"))?;
            for variant in flight.matrix.variants(&self.pilot) {
                let pilot = setting.pilot(variant.pilot, &variant.field_of_pilot(root, &field))?;
                cases.push(flight.check(&setting, &variant, pilot, &field)?.with(&parameters));
            }
        }
        Ok(cases)
    }
}

impl Case {
    fn with(self, parameters: &Parameters) -> Self {
        Self { parameters: parameters.clone(), ..self }
    }
}

impl Setting {
    /// The pilot of this name, or in this file, if it flies the task's drone where it is told to.
    fn pilot(&self, name: &str, field: &Field<'_>) -> Result<CasePilot, ConfigError> {
        if name == CASCADE {
            return Ok(CasePilot::Cascade);
        }
        let path = Path::new(name);
        let bytes = if let Some(shipped) = shipped::pilot(name) {
            PolicyBytes::copy_of(shipped)
        } else if path.extension().is_some_and(|ending| ending == POLICY_ENDING) {
            PolicyBytes::read(path).map_err(|error| field.reject(error, "a policy file"))?
        } else {
            let expected = format!(
                "a pilot ({}), `{CASCADE}`, or a policy file (.{POLICY_ENDING})",
                shipped::pilots_like(name)
            );
            return Err(field.refuse(name, expected));
        };
        self.check_policy(&bytes, field)?;
        Ok(CasePilot::Policy(Arc::new(bytes)))
    }

    /// Refuses a policy that sees no goal, needs sensors, or acts at another pace.
    fn check_policy(&self, bytes: &PolicyBytes, field: &Field<'_>) -> Result<(), ConfigError> {
        let mut policy = bytes.policy().map_err(|error| field.reject(error, "a policy without images"))?;
        let metadata = *policy.metadata();
        let layout = &metadata.observation;
        if !layout.shows_goal() || layout.measured_len() > 0 {
            let found = format!("a policy with the observation `{}`", layout.name());
            return Err(field.reject(found, "one that sees its own motion and a goal, and nothing else"));
        }
        let (found, wanted) = (metadata.control_period_secs, self.scenario.physics.control_secs());
        if (found - wanted).abs() > PERIOD_TOLERANCE * wanted {
            let found = format!("a policy that acts every {found} s");
            return Err(field.reject(found, format!("one that acts every {wanted} s, as the task does")));
        }
        policy.self_test().map_err(|error| field.reject(error, "a policy that computes here what it did before"))
    }
}

impl FlightConfig {
    /// The flight of a variant; its parameters are still as usual.
    fn check(
        &self,
        setting: &Setting,
        variant: &Variant<'_>,
        pilot: CasePilot,
        field: &Field<'_>,
    ) -> Result<Case, ConfigError> {
        let secs = field.at("secs").real(self.secs, &Limits::above(0.0, SECS_LIMIT, "s"))?;
        let faults = checked(&self.faults, &field.at("faults"), |fault, field| {
            fault.check(secs, &pilot, &setting.scenario, field)
        })?;
        if self.expect.is_empty() {
            return Err(field.at("expect").reject("an empty list", "at least one expectation"));
        }
        let height_m = variant.height_m;
        let script = checked(&self.script, &field.at("script"), |step, field| step.check(secs, height_m, field))?;
        if let Some(index) = (1..script.len()).find(|index| script[*index].at_secs < script[index - 1].at_secs) {
            let field = field.at("script").at(index).at("at_secs");
            return Err(field.refuse(script[index].at_secs, "a time that is not before that of the step above"));
        }
        let expectations = checked(&self.expect, &field.at("expect"), |expectation, field| {
            expectation.check(secs, height_m, field)
        })?;
        if variant.wind != Vector3::zeros() {
            check_air(&setting.scenario, &field.at("matrix").at("winds_m_per_s"))?;
        }
        Ok(Case {
            suite: setting.suite.clone(),
            name: format!("{}{}", self.name, variant.suffix),
            airframe: setting.scenario.airframe,
            parameters: Parameters::new(VEHICLE),
            seed: variant.seed,
            wind: variant.wind,
            goal: script::goal(&script).unwrap_or(setting.scenario.aviary.goal),
            scenario: Arc::clone(&setting.scenario),
            pilot,
            secs,
            script,
            faults,
            expectations,
        })
    }
}

/// Every item of a list, checked at its place.
fn checked<I, O>(
    items: &[I],
    field: &Field<'_>,
    check: impl Fn(&I, &Field<'_>) -> Result<O, ConfigError>,
) -> Result<Vec<O>, ConfigError> {
    items.iter().enumerate().map(|(index, item)| check(item, &field.at(index))).collect()
}

impl FaultConfig {
    fn check(
        &self,
        secs: f64,
        pilot: &CasePilot,
        scenario: &Scenario,
        field: &Field<'_>,
    ) -> Result<Fault, ConfigError> {
        let at_secs = time(self.at_secs, secs, &field.at("at_secs"))?;
        let longest = Limits::above(0.0, SECS_LIMIT, "s");
        let for_secs = self.for_secs.map(|for_secs| field.at("for_secs").real(for_secs, &longest)).transpose()?;
        let inner = field.at("fault");
        let kind = match &self.fault {
            FaultKindConfig::LinkLoss => FaultKind::LinkLoss,
            FaultKindConfig::Estimate(fault) => FaultKind::Estimate(*fault),
            FaultKindConfig::Motor { rotor, share } => {
                let field = inner.at("motor");
                let rotor = field.at("rotor").whole(*rotor, 0..=3)? as usize;
                FaultKind::Motor { rotor, share: field.at("share").number(*share, &Limits::from(0.0, 1.0, ""))? }
            }
            FaultKindConfig::Thrust { rotor, share } => {
                let field = inner.at("thrust");
                let rotor = rotor.map(|rotor| field.at("rotor").whole(rotor, 0..=3)).transpose()?;
                let share = field.at("share").number(*share, &Limits::from(0.0, 1.0, ""))?;
                FaultKind::Thrust { rotor: rotor.map(|rotor| rotor as usize), share }
            }
            FaultKindConfig::Load { mass_kg } => {
                let limits = Limits::from(0.0, scenario.airframe.mass, "kg, the mass of the drone");
                FaultKind::Load(inner.at("load").at("mass_kg").real(*mass_kg, &limits)?)
            }
            FaultKindConfig::Battery { left } => {
                if let Some(for_secs) = self.for_secs {
                    let expected = "none: no battery recharges in flight";
                    return Err(field.at("for_secs").refuse(for_secs, expected));
                }
                FaultKind::Battery(inner.at("battery").at("left").number(*left, &Limits::from(0.0, 1.0, ""))?)
            }
            FaultKindConfig::Gust { wind_m_per_s } => {
                let field = inner.at("gust").at("wind_m_per_s");
                check_air(scenario, &field)?;
                FaultKind::Gust(wind(*wind_m_per_s, &field)?)
            }
            FaultKindConfig::Policy(fault) => match pilot {
                CasePilot::Policy(_) => FaultKind::Policy(*fault),
                CasePilot::Cascade => {
                    let expected = "a fault of what flies, which is the cascade";
                    return Err(inner.at("policy").reject("a fault of a policy", expected));
                }
            },
        };
        Ok(Fault { at_secs, until_secs: for_secs.map_or(f64::INFINITY, |for_secs| at_secs + for_secs), kind })
    }
}

/// A time of a flight of `secs` \[s\].
fn time(value: f64, secs: f64, field: &Field<'_>) -> Result<f64, ConfigError> {
    field.real(value, &Limits::from(0.0, secs, "s, the length of the flight"))
}

fn wind(values: [f64; 3], field: &Field<'_>) -> Result<Vector3<f64>, ConfigError> {
    field.reals(values, &Limits::from(-WIND_LIMIT, WIND_LIMIT, "m/s"))
}

/// Refuses wind in the reference's physics, which has none.
fn check_air(scenario: &Scenario, field: &Field<'_>) -> Result<(), ConfigError> {
    match scenario.physics.preset {
        Preset::Clean { .. } => Ok(()),
        Preset::Bullet { .. } => Err(field.reject("wind", "none, because the physics `bullet` has still air")),
    }
}

/// Parameters after some were set by name.
fn with_parameters(
    mut parameters: Parameters,
    values: &BTreeMap<String, f64>,
    field: &Field<'_>,
) -> Result<Parameters, ConfigError> {
    for (name, value) in values {
        let field = field.at(name);
        let Some(parameter) = Parameter::named(name) else {
            let found = format!("the unknown parameter `{name}`");
            return Err(field.reject(found, "one of docs/software-in-the-loop.md, such as `COM_DL_LOSS_T`"));
        };
        let domain = parameter.definition().domain;
        let typed = match domain {
            Domain::Real { .. } => ParameterValue::Real(*value as f32),
            Domain::Integer { .. } | Domain::Choice { .. } if value.fract() == 0.0 => {
                ParameterValue::Integer(*value as i32)
            }
            Domain::Integer { .. } | Domain::Choice { .. } => return Err(field.refuse(value, domain)),
        };
        parameters.set(parameter, typed).map_err(|refusal| match refusal {
            ParameterRefusal::ReadOnly { .. } => field.refuse(value, "another parameter: this one is read-only"),
            ParameterRefusal::Type { .. } | ParameterRefusal::Range { .. } => field.refuse(value, domain),
        })?;
    }
    Ok(parameters)
}
