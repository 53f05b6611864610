//! `kestrel schema`.

use anyhow::Result;
use kestrel_experiments::output::say;
use kestrel_experiments::{experiment_config, search, study};

use super::Done;

/// Arguments of `kestrel schema`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Kind of file
    #[arg(value_enum, default_value_t = Kind::Experiment)]
    kind: Kind,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Kind {
    /// What `kestrel train` reads
    Experiment,
    /// What `kestrel train` reads where one policy learns several tasks
    Tasks,
    /// What `kestrel study` reads
    Study,
    /// What `kestrel search` reads
    Search,
    /// What `kestrel test` reads
    Test,
}

pub(crate) fn print(arguments: &Arguments) -> Result<Done> {
    let schema = match arguments.kind {
        Kind::Experiment => experiment_config::schema(),
        Kind::Tasks => study::config::multi_task::schema(),
        Kind::Study => study::config::schema(),
        Kind::Search => search::config::schema(),
        Kind::Test => crate::flight_test::config::schema(),
    };
    say(schema.trim_end())?;
    Ok(Done::Finished)
}
