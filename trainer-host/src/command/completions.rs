//! `kestrel completions`.

use std::io;

use anyhow::Result;
use clap::CommandFactory;
use clap_complete::Shell;

use super::Done;

/// Arguments of `kestrel completions`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The shell
    shell: Shell,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    clap_complete::generate(arguments.shell, &mut crate::Arguments::command(), "kestrel", &mut io::stdout());
    Ok(Done::Finished)
}
