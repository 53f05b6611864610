//! The `kestrel` command line.

mod bench;
mod bridge;
mod command;
mod flight_test;
mod fly;
mod membership;
mod processor;
mod renderer;
mod shipped;

use std::process::ExitCode;

use clap::Parser;

use command::Command;
use kestrel_experiments::output::warn;

/// Train small neural pilots for the Crazyflie, judge them, export them and fly them.
#[derive(Debug, Parser)]
#[command(name = "kestrel", version, max_term_width = 100, after_help = command::EXAMPLES)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

/// Status of a run that the user stopped: 128 + SIGINT, as shells report it.
const INTERRUPTED: u8 = 130;

/// Status of a comparison beyond its tolerance.
const DEVIATING: u8 = 1;

fn main() -> ExitCode {
    match Arguments::parse().command.run() {
        Ok(command::Done::Finished) => ExitCode::SUCCESS,
        Ok(command::Done::Deviating) => ExitCode::from(DEVIATING),
        Ok(command::Done::Interrupted) => ExitCode::from(INTERRUPTED),
        Err(error) => {
            warn(format_args!("error: {error:#}"));
            ExitCode::from(2)
        }
    }
}
