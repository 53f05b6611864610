//! `kestrel replay`.

use std::path::PathBuf;

use anyhow::{Result, bail};
use kestrel_draw::video::flight_gif;
use kestrel_experiments::atomic_file::write_atomically;
use kestrel_experiments::output::say;
use kestrel_experiments::recording::Recording;

use super::Done;

/// Arguments of `kestrel replay`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// A recorded episode, from `--record`
    recording: PathBuf,

    /// Where the video goes [default: beside the recording, ending in .gif]
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,

    /// Also write states, actions and rewards as comma-separated values
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let path = &arguments.recording;
    let output = arguments.output.clone().unwrap_or_else(|| path.with_extension("gif"));
    if [Some(&output), arguments.table.as_ref()].contains(&Some(path)) {
        bail!("{} is the recording itself: choose another file to write to", path.display());
    }
    let recording = Recording::read(path)?;
    let experiment = recording.experiment(path)?;
    let flight = recording.flight(&experiment, path)?;
    if let Some(table) = &arguments.table {
        write_atomically(table, recording.table(experiment.scenario.physics.control_secs().into()).as_bytes())?;
    }
    write_atomically(&output, &flight_gif(flight, &experiment.scenario, &path.display().to_string())?)?;
    say(recording.summary(&experiment))?;
    say(output.display())?;
    Ok(Done::Finished)
}
