//! From flights to a drone: what is searched, what is kept, and how certain the rest is.

use kestrel_core::airframe::Airframe;
use kestrel_core::seed::Seed;
use rayon::prelude::*;

use crate::balance;
use crate::course::{Air, Course, Part};
use crate::drone::{Drone, Trim, drone_of};
use crate::error::LogError;
use crate::flight::{CommandRecord, Flight};
use crate::hold_out::HoldOut;
use crate::horizon::{Horizon, Predictor, horizons};
use crate::least_squares::{Estimate, Interrupted, Prior, Search, Uncertainty};
use crate::moments;
use crate::parameter::Parameter;
use crate::residual::Residuals;
use crate::residual_network::ResidualNetwork;
use crate::residual_training::learned;

/// Correlation beyond which two numbers only count together, unless both are known well all the same.
const ENTANGLED: f64 = 0.98;

/// Numbers that say what turns the drone.
const TURNING: [Parameter; 8] = [
    Parameter::InertiaX,
    Parameter::InertiaY,
    Parameter::TorqueCoefficient,
    Parameter::RotorInertia,
    Parameter::FlappingMoment,
    Parameter::RateDampingX,
    Parameter::RateDampingY,
    Parameter::RateDampingZ,
];

/// Share of the deviation that makes a number untold within which it is known well.
const KNOWN_WELL: f64 = 0.5;

/// Searches, each with the sizes of the errors that the one before left.
const REFINEMENTS: usize = 3;

/// Fewest rows of errors from which anything is identified.
const FEWEST_ROWS: usize = 100;

/// What is asked of an identification.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The drone as it was believed to be: where the search begins, and what is kept.
    pub airframe: Airframe,
    /// What is kept for the report.
    pub hold_out: HoldOut,
    /// Numbers that stay the airframe's.
    pub kept: Vec<Parameter>,
    /// Seed of a small network that learns what the airframe lacks; none is learned without.
    pub residual: Option<Seed>,
}

/// Why a number is still the airframe's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kept {
    /// The user said so.
    Asked,
    /// No flight has the signals that tell it.
    Unseen,
    /// Its standard deviation is too large: relative, or in its unit where it may be zero.
    Uncertain(f64),
    /// It only counts together with another one.
    Entangled(Parameter),
}

/// What the flights say of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// They tell it, with this standard deviation: of the logarithm, or in its unit where it may be zero.
    Told(f64),
    /// They do not.
    Kept(Kept),
}

/// A number of the drone, before and after.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finding {
    /// Which.
    pub parameter: Parameter,
    /// Before.
    pub given: f64,
    /// After.
    pub value: f64,
    /// What the flights say.
    pub verdict: Verdict,
}

impl Finding {
    /// Bounds of its 95 % interval, if the flights tell it.
    pub fn interval(&self) -> Option<[f64; 2]> {
        match self.verdict {
            Verdict::Told(deviation) => Some(self.parameter.interval(self.value, deviation)),
            Verdict::Kept(_) => None,
        }
    }
}

/// A drone as its flights show it.
#[derive(Clone, Debug)]
pub struct Identification {
    /// The drone.
    pub drone: Drone,
    /// Each number.
    pub findings: Vec<Finding>,
    /// Trim of each flight.
    pub trims: Vec<Trim>,
    /// What was asked to be learned beside.
    pub residual: Option<ResidualNetwork>,
    /// Errors of the held-out windows over the horizon, a curve each of [`Self::models`].
    pub horizons: Vec<Horizon>,
}

/// Why there is no identification.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IdentifyError {
    /// Nothing can be identified from these flights.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The user asked to stop.
    #[error("interrupted")]
    Interrupted,
}

impl From<Interrupted> for IdentifyError {
    fn from(_: Interrupted) -> Self {
        Self::Interrupted
    }
}

/// The drone that flew these flights; `go_on` is asked before each step of a search.
///
/// # Errors
/// When no flight can be followed, or `go_on` says no.
pub fn identify(
    flights: &[Flight],
    settings: &Settings,
    go_on: &dyn Fn() -> bool,
) -> Result<Identification, IdentifyError> {
    let timed: Vec<Flight> = flights.par_iter().map(|flight| moments::timed(flight, &settings.airframe)).collect();
    let courses = settings.hold_out.courses(&timed)?;
    let mut fit = Fit::new(&courses)?;
    let given = drone_of(&settings.airframe);
    let (estimate, findings) = fit.search(&given, &settings.kept, go_on)?;
    let before = fit.with_curve_alone(&given, go_on)?;
    let learn = |seed| learned(&courses, &estimate, seed, go_on);
    let residual = settings.residual.map(learn).transpose()?;
    let mut predictors = vec![Predictor::from(&before), Predictor::from(&estimate)];
    predictors.extend(residual.as_ref().map(|network| Predictor { residual: Some(network), ..predictors[1] }));
    let horizons = horizons(&courses, &predictors);
    Ok(Identification { drone: estimate.drone, findings, trims: estimate.trims, residual, horizons })
}

/// Flights that are fitted.
pub(crate) struct Fit<'a> {
    residuals: Vec<Residuals<'a>>,
}

impl<'a> Fit<'a> {
    pub(crate) fn new(courses: &'a [Course<'a>]) -> Result<Self, LogError> {
        let residuals: Vec<Residuals<'a>> =
            courses.iter().map(|course| Residuals::new(course, Part::Fitted)).collect();
        if residuals.iter().map(Residuals::rows).sum::<usize>() >= FEWEST_ROWS {
            return Ok(Self { residuals });
        }
        let names: Vec<&str> = courses.iter().map(|course| course.flight.name.as_str()).collect();
        let expected = "all motor commands and a gyroscope, or motor commands, position, attitude and velocity, \
                        for some seconds in the air";
        Err(LogError::at(names.join(", "), "no stretch that can be followed", expected))
    }

    /// Searches all numbers that the flights may tell, and again without those that they do not.
    fn search(
        &mut self,
        given: &Drone,
        kept: &[Parameter],
        go_on: &dyn Fn() -> bool,
    ) -> Result<(Estimate, Vec<Finding>), IdentifyError> {
        let mut verdicts: Vec<(Parameter, Verdict)> = Parameter::ALL
            .into_iter()
            .map(|parameter| (parameter, self.verdict_beforehand(parameter, kept)))
            .collect();
        let mut estimate = self.start(given, &searched(&verdicts));
        let mut refinements = REFINEMENTS;
        loop {
            let parameters = searched(&verdicts);
            let mut known = priors(given, &parameters);
            for _ in 0..refinements {
                Residuals::resize_all(&mut self.residuals, &estimate.drone, &estimate.trims);
                self.weigh_moments(&mut estimate, &mut known);
                estimate = Search::new(&self.residuals, &known).run(estimate, go_on)?;
            }
            let uncertainty = Search::new(&self.residuals, &known).uncertainty(&estimate);
            let Some(untold) = untold(&parameters, uncertainty.as_ref()) else {
                note_deviations(&mut verdicts, uncertainty.as_ref());
                break;
            };
            untold.0.set(&mut estimate.drone, untold.0.value(given));
            for (_, verdict) in verdicts.iter_mut().filter(|(parameter, _)| *parameter == untold.0) {
                *verdict = Verdict::Kept(untold.1);
            }
            refinements = 1;
        }
        let finding = |(parameter, verdict): (Parameter, Verdict)| Finding {
            parameter,
            given: parameter.value(given),
            value: parameter.value(&estimate.drone),
            verdict,
        };
        let findings = verdicts.into_iter().map(finding).collect();
        Ok((estimate, findings))
    }

    /// The airframe as given, with the motors' answer to commands and the trims fitted.
    pub(crate) fn with_curve_alone(
        &self,
        given: &Drone,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Estimate, IdentifyError> {
        let mut parameters = if self.any(commanded) { vec![Parameter::IdleShare] } else { Vec::new() };
        // Logs of all commands were written on board, with one clock: what is late there is the airframe's lag.
        let sampled = |residuals: &Residuals<'_>| {
            commanded(residuals) && residuals.course.flight.command_record == CommandRecord::Sampled
        };
        if self.any(sampled) {
            parameters.push(Parameter::Delay);
        }
        if self.any(has_volts) {
            parameters.push(Parameter::FullVolts);
        }
        self.with(&parameters, given, go_on)
    }

    /// The same with a curve through zero. Radio logs some of the commands only, which makes a curve look flatter than it
    /// is; the thrust of a brushed motor grows with the square of its voltage and more (Bitcraze 2025).
    pub(crate) fn with_voltage_alone(
        &self,
        given: &Drone,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Estimate, IdentifyError> {
        self.with(&[Parameter::Delay, Parameter::FullVolts], given, go_on)
    }

    /// The airframe with its answer to moments such as predicts the windows best, not as the drone has it: moments that
    /// are noisy, or held against air that the model does not know, are worth a part of themselves.
    pub(crate) fn with_turning_as_it_predicts(
        &self,
        given: &Drone,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Estimate, IdentifyError> {
        self.with(&TURNING, given, go_on)
    }

    /// The airframe as given, with these numbers and the trims fitted.
    fn with(
        &self,
        parameters: &[Parameter],
        given: &Drone,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Estimate, IdentifyError> {
        let mut residuals: Vec<Residuals<'_>> =
            self.residuals.iter().map(|residuals| Residuals::new(residuals.course, Part::Fitted)).collect();
        let mut estimate = self.start(given, parameters);
        for _ in 0..2 {
            Residuals::resize_all(&mut residuals, &estimate.drone, &estimate.trims);
            estimate = Search::new(&residuals, &priors(given, parameters)).run(estimate, go_on)?;
        }
        Ok(estimate)
    }

    fn start(&self, given: &Drone, parameters: &[Parameter]) -> Estimate {
        let mut drone = *given;
        for parameter in parameters {
            parameter.set(&mut drone, parameter.start(given));
        }
        Estimate { drone, trims: vec![Trim::default(); self.residuals.len()] }
    }

    /// What moments tell where turning cannot be followed, as something known beforehand: those of measured rotor speeds,
    /// and the mean ones of sampled commands.
    fn weigh_moments(&self, estimate: &mut Estimate, known: &mut [(Parameter, Prior)]) {
        let courses: Vec<&Course<'_>> = self.residuals.iter().map(|residuals| residuals.course).collect();
        let balanced = balance::flapping_moment(&courses, estimate);
        let told = moments::told(&courses, estimate);
        for (parameter, prior) in known {
            if *parameter == Parameter::FlappingMoment {
                *prior = balanced.unwrap_or(*prior);
            }
            // A number of the wrong sign is what noise tells.
            let possible = |told: &&(Parameter, Prior)| {
                told.0 == *parameter
                    && parameter.distance(told.1.value, parameter.value(&estimate.drone)).is_finite()
            };
            if let Some((_, told)) = told.iter().find(possible) {
                *prior = *told;
                parameter.set(&mut estimate.drone, told.value);
            }
        }
    }

    fn any(&self, has: impl Fn(&Residuals<'_>) -> bool) -> bool {
        self.residuals.iter().any(|residuals| residuals.rows() > 0 && has(residuals))
    }

    /// Whether the flights have the signals that tell a number.
    fn verdict_beforehand(&self, parameter: Parameter, kept: &[Parameter]) -> Verdict {
        if kept.contains(&parameter) {
            return Verdict::Kept(Kept::Asked);
        }
        if parameter == Parameter::InertiaZ {
            // Torque, rotor inertia and damping about z count over it alone; what it does besides, at high rates about
            // two axes at once, is less than what the model lacks there.
            return Verdict::Kept(Kept::Entangled(Parameter::TorqueCoefficient));
        }
        let complete =
            |residuals: &Residuals<'_>| residuals.course.flight.command_record == CommandRecord::Complete;
        let moving = |residuals: &Residuals<'_>| residuals.course.flight.motion.is_some();
        // Turning is told by the windows of complete records, and by the moments of measured rotor speeds.
        let turning =
            |residuals: &Residuals<'_>| complete(residuals) || (!commanded(residuals) && moving(residuals));
        let windy =
            |residuals: &Residuals<'_>| complete(residuals) && !matches!(residuals.course.air, Air::Unknown);
        let seen = match parameter {
            Parameter::RotorSpeedLimit
            | Parameter::IdleShare
            | Parameter::RotorRise
            | Parameter::RotorFall
            | Parameter::Delay => self.any(commanded),
            Parameter::ThrustCoefficient => self.any(|residuals| !commanded(residuals) && moving(residuals)),
            // Where all flights have a voltage, or none, it only says what the speed limit says.
            Parameter::FullVolts => {
                self.any(has_volts) && self.any(|residuals| commanded(residuals) && !has_volts(residuals))
            }
            Parameter::AxialDrag | Parameter::PlanarDrag | Parameter::BodyDrag => self.any(moving),
            Parameter::FlappingMoment => self.any(windy) || self.any(moving),
            Parameter::InertiaX
            | Parameter::InertiaY
            | Parameter::InertiaZ
            | Parameter::TorqueCoefficient
            | Parameter::RotorInertia
            | Parameter::RateDampingX
            | Parameter::RateDampingY
            | Parameter::RateDampingZ => self.any(turning),
        };
        if seen { Verdict::Told(f64::NAN) } else { Verdict::Kept(Kept::Unseen) }
    }
}

/// Whether the flight's rotors follow commands, since their speeds were not measured.
fn commanded(residuals: &Residuals<'_>) -> bool {
    residuals.course.flight.rotor_speeds.is_none()
}

/// Whether a voltage says what the commands of the flight came to.
fn has_volts(residuals: &Residuals<'_>) -> bool {
    commanded(residuals) && residuals.course.flight.battery_volts.is_some()
}

fn searched(verdicts: &[(Parameter, Verdict)]) -> Vec<Parameter> {
    let told = |(parameter, verdict): &(Parameter, Verdict)| match verdict {
        Verdict::Told(_) => Some(*parameter),
        Verdict::Kept(_) => None,
    };
    verdicts.iter().filter_map(told).collect()
}

fn priors(given: &Drone, parameters: &[Parameter]) -> Vec<(Parameter, Prior)> {
    let prior = |parameter: &Parameter| {
        (*parameter, Prior { value: parameter.start(given), deviation: parameter.scale().spread() })
    };
    parameters.iter().map(prior).collect()
}

/// The last of the numbers that are too uncertain, or that only count together with another one.
fn untold(parameters: &[Parameter], uncertainty: Option<&Uncertainty>) -> Option<(Parameter, Kept)> {
    let Some(uncertainty) = uncertainty else {
        return parameters.last().map(|last| (*last, Kept::Uncertain(f64::INFINITY)));
    };
    for (index, parameter) in parameters.iter().enumerate().rev() {
        let row = &uncertainty.correlations[index];
        let deviation = uncertainty.deviations[index];
        let known_well = deviation < KNOWN_WELL * parameter.told_within();
        if let Some(other) = (0..index).find(|other| row[*other].abs() > ENTANGLED && !known_well) {
            return Some((*parameter, Kept::Entangled(parameters[other])));
        }
        if deviation.is_nan() || deviation > parameter.told_within() {
            return Some((*parameter, Kept::Uncertain(deviation)));
        }
    }
    None
}

fn note_deviations(verdicts: &mut [(Parameter, Verdict)], uncertainty: Option<&Uncertainty>) {
    let deviations = uncertainty.map(|uncertainty| uncertainty.deviations.as_slice()).unwrap_or_default();
    let told = verdicts.iter_mut().filter(|(_, verdict)| matches!(verdict, Verdict::Told(_)));
    for ((_, verdict), deviation) in told.zip(deviations) {
        *verdict = Verdict::Told(*deviation);
    }
}
