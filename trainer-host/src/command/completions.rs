//! `kestrel completions`.

use anyhow::Result;
use clap::CommandFactory;
use clap_complete::Shell;
use kestrel_experiments::output::say;

/// Arguments of `kestrel completions`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The shell
    shell: Shell,
}

pub(crate) fn print(arguments: &Arguments) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut crate::Arguments::command(), "kestrel", &mut script);
    Ok(say(String::from_utf8(script)?.trim_end())?)
}
