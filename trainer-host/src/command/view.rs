//! `kestrel view`.

use std::path::{Path, PathBuf};

use anyhow::Result;
use kestrel_draw::viewer::{CameraMode, Controls, Viewport};
use kestrel_experiments::atomic_file::write_atomically;
use kestrel_experiments::output::{say, warn};
use kestrel_sim::camera::Backend;

use super::Done;
use super::flight::FlightArguments;
use super::look::{Format, filmed_unless_stopped};
use crate::audience::Desktop;
use crate::renderer;

/// Arguments of `kestrel view`.
#[derive(Debug, clap::Args)]
#[command(after_help = KEYS)]
pub(crate) struct Arguments {
    #[command(flatten)]
    flight: FlightArguments,

    /// Write to a file instead of opening a window: .png for one moment, .gif or .mp4 for the whole flight
    #[arg(long, value_name = "FILE")]
    headless: Option<PathBuf>,

    /// Where to begin, in seconds since the start; the moment of a .png
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, value_parser = super::look::seconds, allow_negative_numbers = true)]
    at: f32,

    /// From where the large picture is taken
    #[arg(long, value_enum, default_value_t = CameraMode::Chase)]
    camera: CameraMode,

    /// Which drone is followed, counted from 0
    #[arg(long, value_name = "NUMBER", default_value_t = 0, allow_negative_numbers = true)]
    drone: usize,

    /// Width of the window, in pixels
    #[arg(long, value_name = "NUMBER", default_value_t = 960, value_parser = clap::value_parser!(u16).range(320..=4096))]
    columns: u16,

    /// Height of the window, in pixels
    #[arg(long, value_name = "NUMBER", default_value_t = 540, value_parser = clap::value_parser!(u16).range(240..=4096))]
    rows: u16,

    /// Angle of view of the drone's camera across, in degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 90.0, value_parser = super::look::view_angle, allow_negative_numbers = true)]
    view_angle: f64,

    /// What renders: auto (a GPU where there is one), cpu, gpu, or software (an adapter such as lavapipe)
    #[arg(long, value_name = "BACKEND", default_value_t = Backend::Auto)]
    backend: Backend,
}

/// Shown below the help.
const KEYS: &str = "\
Keys:
  space, p            pause, go on; at the end, start again
  left, right         a picture back, on (25 a second); page up, page down: a second
  up, down            twice, half as fast
  c                   the next camera: chase, orbit, on board
  n, tab              the next drone
  r, home             everything as at first
  q, escape           quit
  mouse               drag to turn around the drone, wheel to come nearer";

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let target = match &arguments.headless {
        Some(output) => Target::File(output, Format::of(output)?),
        None => Target::Window(Desktop::open()?),
    };
    let renderer = renderer::open(arguments.backend)?;
    let flown = arguments.flight.fly(false)?;
    let drone = arguments.drone;
    let scene = flown.scene(drone)?;
    let size = [arguments.columns, arguments.rows].map(usize::from);
    let mut viewport =
        Viewport::new(scene, &flown.experiment.scenario, &*renderer, arguments.view_angle.to_radians(), size);
    let secs = arguments.at.min(viewport.extent().secs);
    let controls = Controls { secs, drone, camera: arguments.camera, ..Controls::default() };
    warn(&renderer);
    match target {
        Target::File(output, format) => written(&viewport, &controls, output, format),
        Target::Window(desktop) => {
            desktop.show(&mut viewport, controls, &format!("kestrel: {}", flown.path.display()), size)?;
            Ok(Done::Finished)
        }
    }
}

/// Where the flight is seen.
enum Target<'a> {
    File(&'a Path, Format),
    Window(Desktop),
}

fn written(viewport: &Viewport<'_>, controls: &Controls, output: &Path, format: Format) -> Result<Done> {
    let file = match format {
        Format::Png => Some(viewport.picture(controls)?.png()?),
        Format::Video(format) => {
            filmed_unless_stopped(viewport.pictures(), |goes_on| viewport.video(controls, format, goes_on))?
        }
    };
    let Some(file) = file else { return Ok(Done::Interrupted) };
    write_atomically(output, &file)?;
    say(output.display())?;
    Ok(Done::Finished)
}
