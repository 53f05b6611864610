//! `kestrel verify`.

use std::path::PathBuf;

use anyhow::Result;
use kestrel_experiments::output::say;
use kestrel_sim::config::read_airframe;
use kestrel_verify::{Models, Tolerances, verify};

use super::Done;

/// Arguments of `kestrel verify`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Folder with a recording: index.json and the tables that it names, or `physics_golden.json`
    recording: PathBuf,

    /// Greatest error that passes of a kind (`closed_loop.rpm`) or a group of them (`closed_loop`)
    #[arg(long, value_name = "KIND=X", value_parser = tolerance)]
    tolerance: Vec<(String, f64)>,

    /// A drone that the recording names, from its YAML or URDF file; its rotors keep their order
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
    let mut tolerances = Tolerances::default();
    for (kind, value) in &arguments.tolerance {
        tolerances.set(kind, *value).map_err(anyhow::Error::msg)?;
    }
    let mut models = Models::default();
    for (name, file) in &arguments.airframe {
        models.insert(name.clone(), read_airframe(file)?);
    }
    let report = verify(&arguments.recording, &models, tolerances)?;
    say(&report)?;
    Ok(if report.passed() { Done::Finished } else { Done::Deviating })
}
