//! Real flights of Crazyflies that the project was measured on, and what must be true of them.

use std::fmt;
use std::path::Path;

use kestrel_core::airframe::Airframe;
use kestrel_core::crazyflie::StockController;
use kestrel_core::seed::Seed;

use crate::airframe_file::digits;
use crate::drone::drone_of;
use crate::error::LogError;
use crate::flight::{CommandRecord, Flight};
use crate::hold_out::{HoldOut, Span};
use crate::horizon::{Horizon, Predictor, Signal, flown_horizons, horizons};
use crate::identification::{Fit, IdentifyError};
use crate::least_squares::Estimate;
use crate::log::read;
use crate::report::HorizonTable;
use crate::residual_training::learned;
use crate::tracking::TrackingFinding;

/// Folder of the logs at 1 kHz (Eschmann 2024).
const LOGS: &str = "crazyflie-usd-logs";

/// Folder of the flights with motion capture (`NanoBench`, Ullah & Baca 2026).
const MOTION: &str = "nanobench";

/// Folder of the flights with motion capture and measured rotor speeds (IDSIA's nano-drone benchmark, Busetto et al. 2026),
/// as its tables are published, in `train` and `test`.
const SPEEDS: &str = "idsia-nanodrone";

/// Stretches of the logs that judge, and the signal that each was flown for.
const STRETCHES: [(&str, [f64; 2], Signal); 2] =
    [("log15", [75.0, 90.0], Signal::Tilting), ("log16", [45.0, 49.0], Signal::Yawing)];

/// A greatest mean error after some steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// Steps of the horizon.
    pub steps: usize,
    /// In the signal's unit.
    pub error: f64,
}

/// After half a second: a fit that other people's tools give, and what the flights say without any model of the air
/// (`RESULTS.md`).
const LIMITS: [(Signal, Limit); 4] = [
    (Signal::Tilting, Limit { steps: 50, error: 2.8 }),
    (Signal::Yawing, Limit { steps: 50, error: 0.6 }),
    (Signal::Velocity, Limit { steps: 50, error: 0.18 }),
    (Signal::Position, Limit { steps: 50, error: 0.048 }),
];

/// Share of the test flights whose error and lag must be those of ours in closed loop: six of eight.
const TRACKED: f64 = 0.75;

/// Least errors of each signal that the benchmark's authors published, whichever their model (their table of flights
/// "melon"), after 1, 10 and 50 steps.
const PUBLISHED: [(Signal, [f64; 3]); 4] = [
    (Signal::Position, [0.0013, 0.0126, 0.1119]),
    (Signal::Velocity, [0.0080, 0.0570, 0.5556]),
    (Signal::Attitude, [0.0011, 0.0205, 0.2268]),
    (Signal::BodyRates, [0.0796, 0.3596, 0.5979]),
];

/// Of the residual networks that are compared.
const SEED: Seed = Seed(0);

/// What must be true beside them of the airframe with its turning refitted, set with its errors in sight: within 3 % after
/// ten steps, and after fifty at least a tenth below, but for the position.
const FLOWN_LIMITS: [(Signal, [Limit; 2]); 4] = [
    (Signal::Position, [Limit { steps: 10, error: 1.03 * 0.0126 }, Limit { steps: 50, error: 0.1119 }]),
    (Signal::Velocity, [Limit { steps: 10, error: 1.03 * 0.0570 }, Limit { steps: 50, error: 0.9 * 0.5556 }]),
    (Signal::Attitude, [Limit { steps: 10, error: 1.03 * 0.0205 }, Limit { steps: 50, error: 0.9 * 0.2268 }]),
    (Signal::BodyRates, [Limit { steps: 10, error: 1.03 * 0.3596 }, Limit { steps: 50, error: 0.9 * 0.5979 }]),
];

/// One figure of the comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct RealFinding {
    /// Flights that it was measured in.
    pub flights: String,
    /// `hold`, then the models of the other curves.
    pub models: Vec<String>,
    /// Errors over time of each model.
    pub horizon: Horizon,
    /// Index of the model that is judged.
    pub judged: usize,
    /// Its greatest errors.
    pub limits: Vec<Limit>,
    /// Least errors that others published, after 1, 10 and 50 steps.
    pub published: Option<[f64; 3]>,
}

impl RealFinding {
    /// Whether the judged model's errors are within their limits.
    pub fn passed(&self) -> bool {
        self.is_within(self.judged)
    }

    fn is_within(&self, model: usize) -> bool {
        self.limits.iter().all(|limit| self.keeps(model, limit))
    }

    fn keeps(&self, model: usize, limit: &Limit) -> bool {
        self.horizon.after(model, limit.steps) <= limit.error
    }
}

/// What airframes predict of real flights.
#[derive(Clone, Debug, PartialEq)]
pub struct RealReport {
    /// Each signal.
    pub findings: Vec<RealFinding>,
    /// Each test flight in closed loop, by the airframe of that name.
    pub tracking: Vec<TrackingFinding>,
    tracked_airframe: String,
    /// Folders of flights that were not there.
    pub skipped: Vec<&'static str>,
}

impl RealReport {
    /// Whether every judged model is within its limits.
    pub fn passed(&self) -> bool {
        self.findings.iter().all(RealFinding::passed) && self.tracked() >= self.tracked_at_least()
    }

    /// How many flights pass in closed loop.
    fn tracked(&self) -> usize {
        self.tracking.iter().filter(|finding| finding.passed()).count()
    }

    fn tracked_at_least(&self) -> usize {
        (TRACKED * self.tracking.len() as f64).ceil() as usize
    }
}

/// Airframes under their names, for each drone that flew; the first is judged, and the Brushless's alone is compared.
#[derive(Clone, Copy, Debug)]
pub struct RealDrones<'a> {
    /// For the flights of the brushed Crazyflie.
    pub brushed: &'a [(String, Airframe)],
    /// For those of the Brushless.
    pub brushless: &'a (String, Airframe),
}

/// Compares airframes with the real flights in `folder`; the motors' answer to a command and the trims are fitted to the
/// other parts of the flights, for each airframe alike.
///
/// # Errors
/// When the flights are missing or damaged, or `go_on` says no.
pub fn verify_real(
    folder: &Path,
    drones: RealDrones<'_>,
    go_on: &dyn Fn() -> bool,
) -> Result<RealReport, IdentifyError> {
    let (mut findings, mut tracking) = (Vec::new(), Vec::new());
    let [logs, motion, speeds] = [LOGS, MOTION, SPEEDS].map(|name| folder.join(name));
    if ![&logs, &motion, &speeds].iter().any(|place| place.is_dir()) {
        let expected = format!("a folder with {LOGS}, {MOTION} or {SPEEDS}");
        return Err(LogError::at(folder.display(), "no real flights", expected).into());
    }
    if logs.is_dir() {
        findings.extend(turning(&logs, drones.brushed, go_on)?);
    }
    if motion.is_dir() {
        let (moved, tracked) = moving(&motion, drones.brushed, go_on)?;
        findings.extend(moved);
        tracking = tracked;
    }
    if speeds.is_dir() {
        findings.extend(flying(&speeds, drones.brushless, go_on)?);
    }
    let skipped = [LOGS, MOTION, SPEEDS].into_iter().filter(|name| !folder.join(name).is_dir()).collect();
    let tracked_airframe = drones.brushed.first().map(|(name, _)| name.clone()).unwrap_or_default();
    Ok(RealReport { findings, tracking, tracked_airframe, skipped })
}

/// Body rates in the stretches of the logs, with the air speed that the accelerometer's drag tells, and in still air. No
/// log has a voltage, so that each tells by its other parts what charge its motors had.
fn turning(
    logs: &Path,
    airframes: &[(String, Airframe)],
    go_on: &dyn Fn() -> bool,
) -> Result<Vec<RealFinding>, IdentifyError> {
    let mut findings = Vec::new();
    for (name, [from, to], signal) in STRETCHES {
        let measured = read(&logs.join(name))?;
        let still = Flight { specific_forces: None, ..measured.clone() };
        for (flight, air) in [(measured, "air speed by the accelerometer"), (still, "air taken as still")] {
            let label = format!("{name}, {from} to {to} s, {air}");
            let flights = [flight];
            let span = Span { name: name.to_owned(), secs: Some([from, to]) };
            let courses = HoldOut::Spans(vec![span]).courses(&flights)?;
            let estimates = estimates(&Fit::new(&courses)?, airframes, go_on)?;
            let horizons = horizons(&courses, &estimates.iter().map(Predictor::from).collect::<Vec<_>>());
            findings.extend(judged(horizons, &label, airframes, &[signal]));
        }
    }
    Ok(findings)
}

/// Velocity and position in the test flights, and their closed loops.
fn moving(
    motion: &Path,
    airframes: &[(String, Airframe)],
    go_on: &dyn Fn() -> bool,
) -> Result<(Vec<RealFinding>, Vec<TrackingFinding>), IdentifyError> {
    let Parts { flights, hold_out, tests } = parts(motion)?;
    let label = format!("{tests} test flights of {MOTION}");
    let courses = hold_out.courses(&flights)?;
    let fit = Fit::new(&courses)?;
    let estimates = estimates(&fit, airframes, go_on)?;
    let horizons = horizons(&courses, &estimates.iter().map(Predictor::from).collect::<Vec<_>>());
    let mut tracking = Vec::new();
    if let Some((_, airframe)) = airframes.first() {
        let Estimate { drone, .. } = fit.with_voltage_alone(&drone_of(airframe), go_on)?;
        let tested = &flights[flights.len() - tests..];
        tracking.extend(tested.iter().filter_map(|flight| TrackingFinding::of(flight, &drone)));
    }
    Ok((judged(horizons, &label, airframes, &[Signal::Velocity, Signal::Position]), tracking))
}

/// The whole state in the test flights, from every row of them, where nothing is given but the state at the start and the
/// measured rotor speeds. The trims are the mean of the flights in `train`.
fn flying(
    speeds: &Path,
    airframe: &(String, Airframe),
    go_on: &dyn Fn() -> bool,
) -> Result<Vec<RealFinding>, IdentifyError> {
    let Parts { mut flights, hold_out, tests } = parts(speeds)?;
    for flight in &mut flights {
        // Their turning is followed here, however noisy the speeds.
        flight.command_record = CommandRecord::Complete;
    }
    let courses = hold_out.courses(&flights)?;
    let fit = Fit::new(&courses)?;
    let (name, airframe) = airframe;
    let alone = fit.with_curve_alone(&drone_of(airframe), go_on)?;
    let predicting = fit.with_turning_as_it_predicts(&alone.drone, go_on)?;
    let [beside_alone, beside_predicting] =
        [&alone, &predicting].map(|estimate| learned(&courses, estimate, SEED, go_on));
    let (beside_alone, beside_predicting) = (beside_alone?, beside_predicting?);
    let models = ["hold", name, "turning refitted", "alone, with network", "refitted, with network"];
    let predictors = [
        Predictor::from(&alone),
        Predictor::from(&predicting),
        Predictor { estimate: &alone, residual: Some(&beside_alone) },
        Predictor { estimate: &predicting, residual: Some(&beside_predicting) },
    ];
    let finding = |horizon: Horizon| {
        let of = |signal: Signal| horizon.signal == signal;
        Some(RealFinding {
            flights: format!("{tests} test flights of {SPEEDS}, open loop"),
            models: models.map(str::to_owned).to_vec(),
            judged: 2,
            limits: FLOWN_LIMITS.iter().find(|(signal, _)| of(*signal))?.1.to_vec(),
            published: PUBLISHED.iter().find(|(signal, _)| of(*signal)).map(|(_, errors)| *errors),
            horizon,
        })
    };
    Ok(flown_horizons(&courses, &predictors).into_iter().filter_map(finding).collect())
}

/// The flights of a data set, and which of them are for testing.
struct Parts {
    flights: Vec<Flight>,
    hold_out: HoldOut,
    tests: usize,
}

fn parts(folder: &Path) -> Result<Parts, LogError> {
    let mut flights = flights(&folder.join("train"))?;
    let tests = self::flights(&folder.join("test"))?;
    let spans = tests.iter().map(|flight| Span { name: flight.name.clone(), secs: None }).collect();
    let count = tests.len();
    flights.extend(tests);
    Ok(Parts { flights, hold_out: HoldOut::Spans(spans), tests: count })
}

fn estimates(
    fit: &Fit<'_>,
    airframes: &[(String, Airframe)],
    go_on: &dyn Fn() -> bool,
) -> Result<Vec<Estimate>, IdentifyError> {
    airframes.iter().map(|(_, airframe)| fit.with_curve_alone(&drone_of(airframe), go_on)).collect()
}

fn judged(
    horizons: Vec<Horizon>,
    flights: &str,
    airframes: &[(String, Airframe)],
    signals: &[Signal],
) -> Vec<RealFinding> {
    let names = airframes.iter().map(|(name, _)| name.clone());
    let models: Vec<String> = std::iter::once("hold".to_owned()).chain(names).collect();
    let wanted = horizons.into_iter().filter(|horizon| signals.contains(&horizon.signal));
    let finding = |horizon: Horizon| {
        let (_, limit) = LIMITS.iter().find(|(signal, _)| *signal == horizon.signal)?;
        let (flights, models) = (flights.to_owned(), models.clone());
        Some(RealFinding { flights, models, horizon, judged: 1, limits: vec![*limit], published: None })
    };
    wanted.filter_map(finding).collect()
}

/// Every log of a folder, in the order of their names.
fn flights(folder: &Path) -> Result<Vec<Flight>, LogError> {
    let refuse = |error: std::io::Error| LogError::at(folder.display(), error, "a readable folder of flights");
    let entries = std::fs::read_dir(folder).map_err(refuse)?;
    let mut paths = entries.map(|entry| Ok(entry.map_err(refuse)?.path())).collect::<Result<Vec<_>, _>>()?;
    paths.sort();
    paths.iter().map(|path| read(path)).collect()
}

impl fmt::Display for RealFinding {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let models: Vec<&str> = self.models.iter().map(String::as_str).collect();
        write!(formatter, "{}\n{}", self.flights, HorizonTable { horizon: &self.horizon, models: &models })?;
        if let Some(published) = self.published {
            write!(formatter, "\n  {:<26}", "best published")?;
            for error in published {
                write!(formatter, " {error:>9.4}")?;
            }
        }
        for limit in &self.limits {
            let verdict = if self.keeps(self.judged, limit) { "ok" } else { "FAIL" };
            let Limit { steps, error } = limit;
            let model = models[self.judged];
            write!(formatter, "\n  {verdict}: {model} after {} ms, at most {}", 10 * steps, digits(*error))?;
        }
        for (model, name) in models.iter().enumerate().take(self.judged).skip(1) {
            let found = if self.is_within(model) { "within" } else { "beyond" };
            write!(formatter, "\n  not judged: {name} by itself, {found} these limits")?;
        }
        Ok(())
    }
}

impl fmt::Display for RealReport {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, finding) in self.findings.iter().enumerate() {
            let gap = if index == 0 { "" } else { "\n\n" };
            write!(formatter, "{gap}{finding}")?;
        }
        for name in &self.skipped {
            write!(formatter, "\n\nskipped: no folder {name}")?;
        }
        if self.tracking.is_empty() { Ok(()) } else { self.write_tracking(formatter) }
    }
}

impl RealReport {
    fn write_tracking(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.tracking.len();
        let name = &self.tracked_airframe;
        writeln!(
            formatter,
            "\n\n{count} test flights of {MOTION} in closed loop: {name} with Bitcraze's controllers"
        )?;
        let heading = "distance [m]: real    ours   ratio   lag [s]: real    ours   stamps [ms]";
        write!(formatter, "\n  {:28}{:11}{heading}", "", "flown by")?;
        for finding in &self.tracking {
            let TrackingFinding { flight, controller, early_secs, real, ours } = finding;
            let verdict = if finding.passed() { "ok" } else { "FAIL" };
            write!(
                formatter,
                "\n  {:28}{:11}{:>18.3}{:>8.3}{:>8.2}{:>16.3}{:>8.3}{:>+14.0}  {verdict}",
                short_name(flight),
                flown_by(*controller),
                real.rms_m,
                ours.rms_m,
                finding.ratio(),
                real.lag_secs,
                ours.lag_secs,
                early_secs * 1e3,
            )?;
        }
        let (tracked, least) = (self.tracked(), self.tracked_at_least());
        let verdict = if tracked >= least { "ok" } else { "FAIL" };
        write!(formatter, "\n  {verdict}: {tracked} of {count} within 20 % and 30 ms, at least {least}")
    }
}

const fn flown_by(controller: StockController) -> &'static str {
    match controller {
        StockController::Cascade => "cascade",
        StockController::Mellinger => "Mellinger",
    }
}

/// Of a file, without folder and ending.
fn short_name(path: &str) -> &str {
    let name = path.rsplit('/').next().unwrap_or(path);
    name.split('.').next().unwrap_or(name)
}
