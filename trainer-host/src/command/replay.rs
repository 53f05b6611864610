//! `kestrel replay`.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use kestrel_draw::video::{VideoFormat, flight_video};
use kestrel_experiments::atomic_file::write_atomically;
use kestrel_experiments::output::say;

use super::Done;
use super::flight::{FlightArguments, Flown, is_yaml};
use crate::parquet_file;

/// Arguments of `kestrel replay`.
#[derive(Debug, clap::Args)]
#[command(after_help = ENDINGS)]
pub(crate) struct Arguments {
    #[command(flatten)]
    flight: FlightArguments,

    /// Where to write, several if wanted: .gif, .mp4, .svg, .png, .csv, .parquet, .mcap [default: beside a recording, ending in .gif]
    #[arg(long, short, value_name = "FILE", num_args = 1..)]
    output: Vec<PathBuf>,

    /// Whose plots are drawn, counted from 0
    #[arg(long, value_name = "NUMBER", default_value_t = 0, allow_negative_numbers = true)]
    drone: usize,
}

/// Shown below the help.
const ENDINGS: &str = "\
Files:
  .gif, .mp4      the flight from behind, with trails
  .svg, .png      plots: position, velocity, attitude, rates, rotor speeds, actions, reward terms
  .csv, .parquet  the same numbers as a table
  .mcap           ROS 2 messages, for Foxglove, rerun, PlotJuggler and ros2 bag";

/// What a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Film(VideoFormat),
    Svg,
    Png,
    Csv,
    Parquet,
    Mcap,
}

impl Kind {
    /// By the ending of a file's name.
    fn of(path: &Path) -> Result<Self> {
        if let Some(format) = VideoFormat::of(path) {
            return Ok(Self::Film(format));
        }
        match path.extension().and_then(|ending| ending.to_str()) {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            Some("csv") => Ok(Self::Csv),
            Some("parquet") => Ok(Self::Parquet),
            Some("mcap") => Ok(Self::Mcap),
            Some(_) | None => {
                let endings = ".gif, .mp4, .svg, .png, .csv, .parquet or .mcap";
                bail!("{}: found another ending, expected {endings}", path.display())
            }
        }
    }

    fn file(self, flown: &Flown, drone: usize) -> Result<Vec<u8>> {
        let Flown { recording, experiment, path } = flown;
        let scenario = &experiment.scenario;
        let control_secs = scenario.physics.control_secs().into();
        Ok(match self {
            Self::Film(format) => {
                let name = path.display().to_string();
                flight_video(recording.flight(experiment, path)?, scenario, &name, format)?
            }
            Self::Svg => recording.plot(experiment, drone).svg().into_bytes(),
            Self::Png => recording.plot(experiment, drone).png()?,
            Self::Csv => recording.table(control_secs).csv().into_bytes(),
            Self::Parquet => parquet_file::parquet(&recording.table(control_secs))?,
            Self::Mcap => kestrel_ros::mcap(recording, experiment, path)?,
        })
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let Arguments { flight, drone, output } = arguments;
    let kinds = output.iter().map(|output| Kind::of(output)).collect::<Result<Vec<_>>>()?;
    let flown = flight.fly(false)?;
    let drones = flown.recording.drones.len();
    let path = flown.path.display();
    ensure!(*drone < drones, "found --drone {drone}, expected a number below {drones}, the drones of {path}");
    let wanted = if output.is_empty() {
        vec![(Kind::Film(VideoFormat::Gif), beside(&flown.path)?)]
    } else {
        kinds.into_iter().zip(output.iter().cloned()).collect()
    };
    if wanted.iter().any(|(_, output)| *output == flown.path) {
        bail!("{path} is the recording itself: choose another file to write to");
    }
    let files = wanted.iter().map(|(kind, _)| kind.file(&flown, *drone)).collect::<Result<Vec<_>>>()?;
    for ((_, output), file) in wanted.iter().zip(&files) {
        write_atomically(output, file)?;
    }
    say(flown.recording.summary(&flown.experiment))?;
    wanted.iter().try_for_each(|(_, output)| say(output.display()))?;
    Ok(Done::Finished)
}

/// Where the film of a recording goes when nobody says so.
fn beside(recording: &Path) -> Result<PathBuf> {
    ensure!(
        recording.is_file() && !is_yaml(recording),
        "{}: found no --output, which only a recording can do without",
        recording.display()
    );
    Ok(recording.with_extension("gif"))
}
