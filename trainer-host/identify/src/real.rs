//! Real flights of a Crazyflie 2.1 that the project was measured on, and what must be true of them.

use std::fmt;
use std::path::Path;

use kestrel_core::airframe::Airframe;
use kestrel_core::crazyflie::StockController;

use crate::drone::drone_of;
use crate::error::LogError;
use crate::flight::Flight;
use crate::hold_out::{HoldOut, Span};
use crate::horizon::{Horizon, Signal, horizons};
use crate::identification::{Fit, IdentifyError};
use crate::least_squares::Estimate;
use crate::log::read;
use crate::report::HorizonTable;
use crate::tracking::TrackingFinding;

/// Folder of the logs at 1 kHz (Eschmann 2024).
const LOGS: &str = "crazyflie-usd-logs";

/// Folder of the flights with motion capture (`NanoBench`, Ullah & Baca 2026).
const MOTION: &str = "nanobench";

/// Stretches of the logs that judge, and the signal that each was flown for.
const STRETCHES: [(&str, [f64; 2], Signal); 2] =
    [("log15", [75.0, 90.0], Signal::Tilting), ("log16", [45.0, 49.0], Signal::Yawing)];

/// Greatest mean errors after half a second: a fit that other people's tools give, and what the flights say without any
/// model of the air (`RESULTS.md`).
const LIMITS: [(Signal, f64); 4] =
    [(Signal::Tilting, 2.8), (Signal::Yawing, 0.6), (Signal::Velocity, 0.18), (Signal::Position, 0.048)];

/// Share of the test flights whose error and lag must be those of ours in closed loop: six of eight.
const TRACKED: f64 = 0.75;

/// Steps of half a second.
const JUDGED_STEPS: usize = 50;

/// One figure of the comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct RealFinding {
    /// Flights that it was measured in.
    pub flights: String,
    /// Errors over time: holding the state, then each airframe.
    pub horizon: Horizon,
    /// Greatest error of the first airframe after half a second.
    pub limit: f64,
}

impl RealFinding {
    /// Whether the first airframe's error is within the limit.
    pub fn passed(&self) -> bool {
        self.horizon.after(1, JUDGED_STEPS) <= self.limit
    }
}

/// What airframes predict of real flights.
#[derive(Clone, Debug, PartialEq)]
pub struct RealReport {
    /// `hold`, then the airframes.
    models: Vec<String>,
    /// Each signal.
    pub findings: Vec<RealFinding>,
    /// Each test flight in closed loop, by the first airframe.
    pub tracking: Vec<TrackingFinding>,
}

impl RealReport {
    /// Whether the first airframe is within every limit.
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

/// Compares airframes with the real flights in `folder`; the motors' answer to a command and the trims are fitted to the
/// other parts of the flights, for each airframe alike. The first airframe is judged.
///
/// # Errors
/// When the flights are missing or damaged, or `go_on` says no.
pub fn verify_real(
    folder: &Path,
    airframes: &[(String, Airframe)],
    go_on: &dyn Fn() -> bool,
) -> Result<RealReport, IdentifyError> {
    let (mut findings, mut tracking) = (Vec::new(), Vec::new());
    let (logs, motion) = (folder.join(LOGS), folder.join(MOTION));
    if !logs.is_dir() && !motion.is_dir() {
        let expected = format!("a folder with {LOGS} or {MOTION}");
        return Err(LogError::at(folder.display(), "no real flights", expected).into());
    }
    if logs.is_dir() {
        findings.extend(turning(&logs, airframes, go_on)?);
    }
    if motion.is_dir() {
        let (moved, tracked) = moving(&motion, airframes, go_on)?;
        findings.extend(moved);
        tracking = tracked;
    }
    let models = std::iter::once("hold".to_owned()).chain(airframes.iter().map(|(name, _)| name.clone()));
    Ok(RealReport { models: models.collect(), findings, tracking })
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
            findings.extend(judged(horizons(&courses, &estimates.iter().collect::<Vec<_>>()), &label, &[signal]));
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
    let mut flights = flights(&motion.join("train"))?;
    let tests = self::flights(&motion.join("test"))?;
    let first_test = flights.len();
    let spans = tests.iter().map(|flight| Span { name: flight.name.clone(), secs: None }).collect();
    let label = format!("{} test flights of {MOTION}", tests.len());
    flights.extend(tests);
    let courses = HoldOut::Spans(spans).courses(&flights)?;
    let fit = Fit::new(&courses)?;
    let estimates = estimates(&fit, airframes, go_on)?;
    let horizons = horizons(&courses, &estimates.iter().collect::<Vec<_>>());
    let mut tracking = Vec::new();
    if let Some((_, airframe)) = airframes.first() {
        let Estimate { drone, .. } = fit.with_voltage_alone(&drone_of(airframe), go_on)?;
        tracking.extend(flights[first_test..].iter().filter_map(|flight| TrackingFinding::of(flight, &drone)));
    }
    Ok((judged(horizons, &label, &[Signal::Velocity, Signal::Position]), tracking))
}

fn estimates(
    fit: &Fit<'_>,
    airframes: &[(String, Airframe)],
    go_on: &dyn Fn() -> bool,
) -> Result<Vec<Estimate>, IdentifyError> {
    airframes.iter().map(|(_, airframe)| fit.with_curve_alone(&drone_of(airframe), go_on)).collect()
}

fn judged(horizons: Vec<Horizon>, flights: &str, signals: &[Signal]) -> Vec<RealFinding> {
    let limit = |signal: Signal| LIMITS.iter().find(|(of, _)| *of == signal).map(|(_, limit)| *limit);
    let wanted = horizons.into_iter().filter(|horizon| signals.contains(&horizon.signal));
    let finding = |horizon: Horizon| {
        Some(RealFinding { flights: flights.to_owned(), limit: limit(horizon.signal)?, horizon })
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

impl fmt::Display for RealReport {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let models: Vec<&str> = self.models.iter().map(String::as_str).collect();
        for (index, finding) in self.findings.iter().enumerate() {
            let RealFinding { flights, horizon, limit } = finding;
            let verdict = if finding.passed() { "ok" } else { "FAIL" };
            let gap = if index == 0 { "" } else { "\n\n" };
            write!(formatter, "{gap}{flights}\n{}", HorizonTable { horizon, models: &models })?;
            write!(formatter, "\n  {verdict}: {} after 500 ms, at most {limit}", self.models[1])?;
        }
        if self.tracking.is_empty() { Ok(()) } else { self.write_tracking(formatter) }
    }
}

impl RealReport {
    fn write_tracking(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.tracking.len();
        let name = &self.models[1];
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
