//! `kestrel inspect`.

use std::path::PathBuf;

use anyhow::{Context, Result};
use kestrel_export::inspection::Inspection;

use super::Done;
use super::json::Json;
use crate::shipped;

/// Arguments of `kestrel inspect`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// A policy file, directory of a run, or the name of a pilot that comes with the program
    #[arg(value_name = "POLICY|RUN|PILOT")]
    policy: PathBuf,

    #[command(flatten)]
    json: Json,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let path = &shipped::policy(&arguments.policy)?;
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let inspection = Inspection::of(&bytes).with_context(|| format!("cannot inspect {}", path.display()))?;
    arguments.json.tell(&inspection, &inspection.summary())?;
    Ok(Done::Finished)
}
