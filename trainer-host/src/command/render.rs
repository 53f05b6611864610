//! `kestrel render`.

use std::path::PathBuf;

use anyhow::Result;
use kestrel_sim::camera::{Backend, Camera, Renderer, Scene, Shot, View};
use kestrel_sim::seed::Seed;
use kestrel_sim::simulation::Simulation;
use kestrel_sim::world::Pose;
use kestrel_train::atomic_file::write_atomically;
use kestrel_train::camera_strip::strip;
use kestrel_train::experiment_config;
use kestrel_train::output::{say, warn};

use super::Done;

/// Arguments of `kestrel render`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Experiment file, such as configs/aviaries/room-0.yaml
    config: PathBuf,

    /// Where to write the picture, as .png
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,

    /// What the start follows from
    #[arg(long, value_name = "NUMBER", default_value_t = 0, allow_negative_numbers = true)]
    seed: u64,

    /// Pixels of a row
    #[arg(long, value_name = "NUMBER", default_value_t = 320, value_parser = clap::value_parser!(u16).range(1..=4096))]
    columns: u16,

    /// Rows
    #[arg(long, value_name = "NUMBER", default_value_t = 240, value_parser = clap::value_parser!(u16).range(1..=4096))]
    rows: u16,

    /// Angle of view across, in degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 90.0, value_parser = view_angle, allow_negative_numbers = true)]
    view_angle: f64,

    /// What renders: auto (a GPU where there is one), cpu, gpu, or software (an adapter such as lavapipe)
    #[arg(long, value_name = "BACKEND", default_value_t = Backend::Auto)]
    backend: Backend,

    /// Change a value of the configuration, such as `scenario.episode_secs=5`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
}

fn view_angle(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(angle) if (1.0..=170.0).contains(&angle) => Ok(angle),
        Ok(_) | Err(_) => Err("expected 1 to 170 degrees".to_owned()),
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let experiment = experiment_config::load(&arguments.config, &arguments.overrides)?;
    let renderer = Renderer::open(arguments.backend)?;
    let scenario = &experiment.scenario;
    let simulation = Simulation::<1, f64>::new(scenario, Seed(arguments.seed), 0, 1);
    let state = simulation.state(0);
    let drone = Pose { position: state.position, world_from_body: state.world_from_body };
    let across = (0.5 * arguments.view_angle).to_radians().tan();
    let (columns, rows) = (usize::from(arguments.columns), usize::from(arguments.rows));
    let camera = Camera {
        columns,
        rows,
        tangents: [across, across * rows as f64 / columns as f64],
        sample: [0.5; 2],
        ..Camera::PAPER
    };
    let view = View::paper(&drone, scenario.airframe.arm);
    let scene = Scene::new(&scenario.aviary.world);
    let images = renderer.render(&camera, &[&scene], &[Shot { scene: 0, view }])?;
    write_atomically(&arguments.output, &strip(&images[0])?)?;
    warn(&renderer);
    say(arguments.output.display())?;
    Ok(Done::Finished)
}
