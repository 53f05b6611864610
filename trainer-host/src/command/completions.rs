//! `kestrel completions`.

use std::io;

use clap::CommandFactory;
use clap_complete::Shell;

/// Arguments of `kestrel completions`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The shell
    shell: Shell,
}

pub(crate) fn print(arguments: &Arguments) {
    clap_complete::generate(arguments.shell, &mut crate::Arguments::command(), "kestrel", &mut io::stdout());
}
