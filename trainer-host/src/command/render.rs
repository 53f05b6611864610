//! `kestrel render`.

use std::path::PathBuf;

use anyhow::Result;
use kestrel_draw::video::{Panel, Style, Video};
use kestrel_experiments::atomic_file::write_atomically;
use kestrel_experiments::output::{say, warn};
use kestrel_sim::camera::Backend;

use super::Done;
use super::flight::FlightArguments;
use super::look::{Format, filmed_unless_stopped, seconds, view_angle};
use crate::renderer;

/// Arguments of `kestrel render`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    flight: FlightArguments,

    /// Where to write: .png for one moment, .gif or .mp4 for the whole flight
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,

    /// What is beside each other, in that order [default: all in a video, without the chase in a picture]
    #[arg(long, value_enum, value_delimiter = ',', value_name = "PANEL,...")]
    panels: Vec<Panel>,

    /// Moment of a picture, in seconds since the start
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, value_parser = seconds, allow_negative_numbers = true)]
    at: f32,

    /// Which drone is followed, counted from 0
    #[arg(long, value_name = "NUMBER", default_value_t = 0, allow_negative_numbers = true)]
    drone: usize,

    /// Pixels of a row of each panel [default: 320, in a video 240]
    #[arg(long, value_name = "NUMBER", value_parser = clap::value_parser!(u16).range(1..=4096))]
    columns: Option<u16>,

    /// Rows of each panel [default: three quarters of the columns]
    #[arg(long, value_name = "NUMBER", value_parser = clap::value_parser!(u16).range(1..=4096))]
    rows: Option<u16>,

    /// Angle of view across, in degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 90.0, value_parser = view_angle, allow_negative_numbers = true)]
    view_angle: f64,

    /// Rays across a pixel and down it, for smooth edges; 1 shows what a policy sees
    #[arg(long, value_name = "NUMBER", default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=8))]
    samples: u8,

    /// What renders: auto (a GPU where there is one), cpu, gpu, or software (an adapter such as lavapipe)
    #[arg(long, value_name = "BACKEND", default_value_t = Backend::Auto)]
    backend: Backend,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let output = &arguments.output;
    let format = Format::of(output)?;
    let renderer = renderer::open(arguments.backend)?;
    let start_alone = format == Format::Png && arguments.at == 0.0;
    let flown = arguments.flight.fly(start_alone)?;
    let scene = flown.scene(arguments.drone)?;
    let style = arguments.style(format);
    let video = Video::new(&scene, &style, &*renderer);
    let file = match format {
        Format::Png => Some(video.at(arguments.at)?.png()?),
        Format::Video(format) => {
            format.check(video.size())?;
            filmed_unless_stopped(video.pictures(), |goes_on| video.file(format, goes_on))?
        }
    };
    let Some(file) = file else { return Ok(Done::Interrupted) };
    write_atomically(output, &file)?;
    warn(&renderer);
    say(output.display())?;
    Ok(Done::Finished)
}

impl Arguments {
    fn style(&self, format: Format) -> Style {
        let (panels, columns) = match format {
            Format::Png => (&Panel::ALL[1..], 320),
            Format::Video(_) => (&Panel::ALL[..], 240),
        };
        let columns = self.columns.map_or(columns, usize::from);
        let rows = self.rows.map_or((columns * 3 / 4).max(1), usize::from);
        Style {
            panels: if self.panels.is_empty() { panels.to_vec() } else { self.panels.clone() },
            size: [columns, rows],
            view_angle: self.view_angle.to_radians(),
            samples: usize::from(self.samples),
            drone: self.drone,
        }
    }
}
