//! `kestrel identify`.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use kestrel_core::airframe::Airframe;
use kestrel_core::seed::Seed;
use kestrel_draw::horizon::{HorizonPanel, horizon_chart};
use kestrel_experiments::atomic_file::write_atomically;
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::output::{say, warn};
use kestrel_experiments::progress::Progress;
use kestrel_identify::flight::{CommandRecord, Flight};
use kestrel_identify::horizon::STEP_SECS;
use kestrel_identify::{
    HoldOut, Identification, IdentifyError, Parameter, Settings, Span, airframe_file, identify, log,
};
use kestrel_sim::config::{Document, VehicleConfig, read_airframe};

use super::Done;

/// Steps of the searches that the progress bar expects; most drones take so many.
const EXPECTED_STEPS: u64 = 60;

/// The same of what a residual network takes: twenty checks of each half.
const EXPECTED_CHECKS: u64 = 40;

/// Arguments of `kestrel identify`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Flight logs: Crazyflie's µSD card, PX4's ULog, ArduPilot's .bin, tables (CSV), each packed with gzip or not
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,

    /// The airframe's file; a picture of the errors is written beside it, ending in .svg
    #[arg(short, long, value_name = "FILE", default_value = "airframe.yaml")]
    output: PathBuf,

    /// The airframe as believed so far, by name or file: it gives mass, lever and whatever the flights do not tell
    #[arg(long, value_name = "NAME|FILE", default_value = "cf2x")]
    airframe: String,

    /// Take-off mass, weighed [default: the airframe's]
    #[arg(long, value_name = "KILOGRAMS", value_parser = mass)]
    mass_kg: Option<f64>,

    /// Flight that is not fitted but predicted, or a stretch of it [default: the last quarter of each]
    #[arg(long, value_name = "NAME[:FROM-TO]")]
    hold_out: Vec<Span>,

    /// Number that stays the airframe's, by its name or the beginning of it, such as `delay`
    #[arg(long, value_name = "NUMBER", value_parser = parameters)]
    keep: Vec<Parameters>,

    /// Learn what the airframe lacks by a small, bounded network, and say what it is worth in what was not fitted
    #[arg(long)]
    residual: bool,

    /// Seed of the residual network [default: 0]
    #[arg(long, value_name = "NUMBER", requires = "residual")]
    seed: Option<u64>,

    /// The logs hold every command that reached the motors, however few there are per second
    #[arg(long)]
    complete_commands: bool,
}

/// Numbers whose names begin alike.
#[derive(Clone, Debug)]
struct Parameters(Vec<Parameter>);

fn parameters(text: &str) -> Result<Parameters, String> {
    let named: Vec<Parameter> =
        Parameter::ALL.into_iter().filter(|parameter| parameter.name().starts_with(text)).collect();
    if named.is_empty() {
        return Err(format!("expected one of {}", Parameter::ALL.map(Parameter::name).join(", ")));
    }
    Ok(Parameters(named))
}

fn mass(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(mass) if (0.001..=100.0).contains(&mass) => Ok(mass),
        Ok(_) | Err(_) => Err("expected 0.001 to 100 kg".to_owned()),
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let settings = settings(arguments)?;
    let flights: Vec<Flight> = arguments.logs.iter().map(|path| flight(path, arguments)).collect::<Result<_>>()?;
    let Some(found) = identified(&flights, &settings)? else { return Ok(Done::Interrupted) };
    say(&found)?;
    say(format_args!("\n{}", found.thrust_curve_line()))?;
    write(&found, arguments)?;
    Ok(Done::Finished)
}

fn settings(arguments: &Arguments) -> Result<Settings> {
    let airframe = airframe_called(&arguments.airframe)?;
    let airframe = Airframe { mass: arguments.mass_kg.unwrap_or(airframe.mass), ..airframe };
    let spans = arguments.hold_out.clone();
    let hold_out = if spans.is_empty() { HoldOut::LastQuarter } else { HoldOut::Spans(spans) };
    let kept = arguments.keep.iter().flat_map(|Parameters(kept)| kept.clone()).collect();
    let residual = arguments.residual.then_some(Seed(arguments.seed.unwrap_or(0)));
    Ok(Settings { airframe, hold_out, kept, residual })
}

/// The airframe of a file, or the known one of that name.
pub(super) fn airframe_called(name: &str) -> Result<Airframe> {
    let file = Path::new(name);
    if file.is_file() {
        return Ok(read_airframe(file)?);
    }
    let document = Document::parse("--airframe", &format!("airframe: {name}"))?;
    let field = document.root().at("airframe");
    Ok(document.decode::<VehicleConfig>()?.airframe.check(None, &field, &field)?)
}

fn flight(path: &Path, arguments: &Arguments) -> Result<Flight> {
    let mut flight = log::read(path)?;
    if arguments.complete_commands {
        flight.command_record = CommandRecord::Complete;
    }
    Ok(flight)
}

/// `None` if the user stopped it.
fn identified(flights: &[Flight], settings: &Settings) -> Result<Option<Identification>> {
    let interrupt = Interrupt::watch("Stopping: nothing is written.")?;
    let expected = EXPECTED_STEPS + if settings.residual.is_some() { EXPECTED_CHECKS } else { 0 };
    let progress = std::cell::RefCell::new((Progress::counting("steps", expected, 0), 0));
    let found = identify(flights, settings, &|| {
        let (progress, done) = &mut *progress.borrow_mut();
        *done += 1;
        // Searches that need more steps than most stay just before the end.
        progress.show_steps((*done).min(expected - 1), String::new);
        !interrupt.requested()
    });
    let (mut progress, _) = progress.into_inner();
    progress.show_steps(expected, String::new);
    progress.finish();
    match found {
        Ok(found) => Ok(Some(found)),
        Err(IdentifyError::Interrupted) => Ok(None),
        Err(IdentifyError::Log(error)) => Err(error.into()),
    }
}

fn write(found: &Identification, arguments: &Arguments) -> Result<()> {
    let file_name = |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let logs: Vec<String> = arguments.logs.iter().map(file_name).collect();
    let sources = [
        format!("Flights: {}.", logs.join(", ")),
        format!(
            "What they do not tell, and what no flight tells (mass, lever, thrust per speed): {}.",
            arguments.airframe
        ),
        found.thrust_curve_line(),
    ];
    let file = airframe_file(found, &sources);
    let picture = arguments.output.with_extension("svg");
    let panels: Vec<HorizonPanel> = found
        .horizons
        .iter()
        .map(|horizon| HorizonPanel {
            name: horizon.signal.name().to_owned(),
            models: found.models().iter().map(ToString::to_string).zip(horizon.curves.clone()).collect(),
        })
        .collect();
    let title = format!("Predictions of {} by its flights", arguments.airframe);
    let summary = "mean error of windows that were not fitted";
    write_atomically(&arguments.output, file.as_bytes())?;
    write_atomically(&picture, horizon_chart(&title, summary, STEP_SECS, &panels).svg().as_bytes())?;
    if let Err(error) = read_airframe(&arguments.output) {
        warn(format_args!("warning: this is no airframe that a scenario accepts: {error}"));
    }
    let written = format!("{} and {}", arguments.output.display(), picture.display());
    say(format_args!("\nWritten: {written}")).context("the table")
}
