//! `kestrel verify`.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use kestrel_core::airframe::Airframe;
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::output::say;
use kestrel_identify::{IdentifyError, RealDrones, verify_real};
use kestrel_sim::config::read_airframe;
use kestrel_verify::{Models, Tolerances, verify};

use super::Done;
use super::identify::airframe_called;

/// Arguments of `kestrel verify`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Folder with a recording: index.json and the tables that it names, or `physics_golden.json`
    #[arg(required_unless_present = "real")]
    recording: Option<PathBuf>,

    /// Folder with real flights: crazyflie-usd-logs, nanobench, idsia-nanodrone
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["recording", "tolerance"])]
    real: Option<PathBuf>,

    /// Greatest error that passes of a kind (`closed_loop.rpm`) or a group of them (`closed_loop`)
    #[arg(long, value_name = "KIND=X", value_parser = tolerance)]
    tolerance: Vec<(String, f64)>,

    /// A drone that the recording names, from its YAML or URDF file; its rotors keep their order. With --real: the drone
    /// that is judged in flights of the brushed Crazyflie [default: `crazyflie_2_1`], and under the name
    /// `crazyflie_2_1_brushless` in those of the Brushless
    #[arg(long, value_name = "NAME=FILE", value_parser = named_file)]
    airframe: Vec<(String, PathBuf)>,
}

fn named_file(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, file)) if !name.is_empty() && !file.is_empty() => Ok((name.to_owned(), file.into())),
        Some(_) | None => Err("expected NAME=FILE, such as mine=mine.urdf".to_owned()),
    }
}

fn tolerance(text: &str) -> Result<(String, f64), String> {
    let (kind, value) = text.split_once('=').ok_or("expected KIND=X, such as open_loop=1e-8")?;
    Tolerances::default().set(kind, 0.0)?;
    match value.parse() {
        Ok(value) if value >= 0.0 => Ok((kind.to_owned(), value)),
        Ok(_) | Err(_) => Err("expected a number, zero or more, after `=`".to_owned()),
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    match (&arguments.recording, &arguments.real) {
        (_, Some(flights)) => run_real(flights, arguments),
        (Some(recording), None) => run_recording(recording, arguments),
        (None, None) => bail!("found no folder, expected a recording or --real FOLDER"),
    }
}

fn run_recording(recording: &Path, arguments: &Arguments) -> Result<Done> {
    let mut tolerances = Tolerances::default();
    for (kind, value) in &arguments.tolerance {
        tolerances.set(kind, *value).map_err(anyhow::Error::msg)?;
    }
    let mut models = Models::default();
    for (name, file) in &arguments.airframe {
        models.insert(name.clone(), read_airframe(file)?);
    }
    let report = verify(recording, &models, tolerances)?;
    say(&report)?;
    Ok(if report.passed() { Done::Finished } else { Done::Deviating })
}

/// Name under which an airframe is judged in the flights of the Brushless.
const BRUSHLESS: &str = "crazyflie_2_1_brushless";

/// Of the brushed, the judged airframe first, then the one that gym-pybullet-drones has.
fn run_real(flights: &Path, arguments: &Arguments) -> Result<Done> {
    let mut airframes: Vec<(String, Airframe)> = Vec::new();
    let mut brushless = (BRUSHLESS.to_owned(), airframe_called(BRUSHLESS)?);
    for (name, file) in &arguments.airframe {
        let airframe = read_airframe(file)?;
        if name == BRUSHLESS {
            brushless.1 = airframe;
        } else {
            airframes.push((name.clone(), airframe));
        }
    }
    for name in ["crazyflie_2_1", "cf2x"] {
        airframes.push((name.to_owned(), airframe_called(name)?));
    }
    let interrupt = Interrupt::watch("Stopping: nothing is compared.")?;
    let drones = RealDrones { brushed: &airframes, brushless: &brushless };
    match verify_real(flights, drones, &|| !interrupt.requested()) {
        Ok(report) => {
            say(&report)?;
            Ok(if report.passed() { Done::Finished } else { Done::Deviating })
        }
        Err(IdentifyError::Interrupted) => Ok(Done::Interrupted),
        Err(IdentifyError::Log(error)) => Err(error.into()),
    }
}
