//! `kestrel view`.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use kestrel_draw::viewer::{CameraMode, Controls, Viewport};
use kestrel_experiments::atomic_file::write_atomically;
use kestrel_experiments::output::{say, warn};
use kestrel_sim::camera::Backend;

use super::Done;
use super::flight::FlightArguments;
use super::look::{Format, filmed};
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
    if arguments.headless.is_none() && !cfg!(feature = "viewer") {
        bail!(
            "this program was built without windows: build it with `--features viewer`, or use --headless FILE.gif"
        );
    }
    let headless = arguments.headless.as_deref();
    let file = headless.map(|output| Ok::<_, anyhow::Error>((output, Format::of(output)?))).transpose()?;
    let renderer = renderer::open(arguments.backend)?;
    let flown = arguments.flight.fly(false)?;
    let drone = arguments.drone;
    let scene = flown.scene(drone)?;
    let size = [arguments.columns, arguments.rows].map(usize::from);
    let viewport =
        Viewport::new(&scene, &flown.experiment.scenario, &*renderer, arguments.view_angle.to_radians(), size);
    let secs = arguments.at.min(viewport.extent().secs);
    let controls = Controls { secs, drone, camera: arguments.camera, ..Controls::default() };
    warn(&renderer);
    match file {
        Some(output) => written(&viewport, &controls, output),
        None => shown(viewport, controls, &format!("kestrel: {}", flown.path.display()), size),
    }
}

fn written(viewport: &Viewport<'_>, controls: &Controls, (output, format): (&Path, Format)) -> Result<Done> {
    let file = match format {
        Format::Png => Some(viewport.picture(controls)?.png()?),
        Format::Video(format) => filmed(viewport.pictures(), |goes_on| viewport.video(controls, format, goes_on))?,
    };
    let Some(file) = file else { return Ok(Done::Interrupted) };
    write_atomically(output, &file)?;
    say(output.display())?;
    Ok(Done::Finished)
}

#[cfg(feature = "viewer")]
fn shown(viewport: Viewport<'_>, controls: Controls, title: &str, size: [usize; 2]) -> Result<Done> {
    kestrel_draw::viewer::window::show(viewport, controls, title, size)?;
    Ok(Done::Finished)
}

#[cfg(not(feature = "viewer"))]
fn shown(_desk: Viewport<'_>, _controls: Controls, title: &str, _size: [usize; 2]) -> Result<Done> {
    bail!("{title}: this program was built without windows")
}
