//! The `kestrel` command line.

mod audience;
mod bench;
mod bridge;
mod command;
mod flight_test;
mod fly;
mod kind;
mod membership;
mod parquet_file;
mod processor;
mod renderer;
mod shipped;

use std::env;
use std::ffi::OsString;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::Parser;

use command::Command;
use kestrel_experiments::output;

/// Train small neural pilots for the Crazyflie, judge them, export them and fly them.
#[derive(Debug, Parser)]
#[command(name = "kestrel", version, max_term_width = 100, after_help = command::EXAMPLES)]
struct Arguments {
    #[command(flatten)]
    everywhere: Everywhere,

    #[command(subcommand)]
    command: Command,
}

/// Options of every command.
#[derive(Clone, Copy, Debug, clap::Args)]
struct Everywhere {
    /// Threads to use; no result depends on it [default: all cores]
    #[arg(long, global = true, value_name = "NUMBER", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,

    /// Show no progress and no notes
    #[arg(long, short, global = true)]
    quiet: bool,
}

impl Everywhere {
    /// Holds from now on.
    fn apply(self) -> Result<()> {
        if self.quiet {
            output::be_quiet();
        }
        let threads = self.threads.map_or(0, usize::from);
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("cannot start threads")
    }
}

/// Status of a run that the user stopped: 128 + SIGINT, as shells report it.
const INTERRUPTED: u8 = 130;

/// Status of a comparison beyond its tolerance.
const DEVIATING: u8 = 1;

fn main() -> ExitCode {
    command::completions::answer();
    shipped::LIBRARY.install();
    let Arguments { everywhere, command } = Arguments::parse();
    match everywhere.apply().and_then(|()| command.run()) {
        Ok(command::Done::Finished) => ExitCode::SUCCESS,
        Ok(command::Done::Deviating) => ExitCode::from(DEVIATING),
        Ok(command::Done::Interrupted) => ExitCode::from(INTERRUPTED),
        Err(error) => {
            let words: Vec<OsString> = env::args_os().skip(1).collect();
            let hint = kind::misplaced(words.iter().map(OsString::as_os_str));
            let hint = hint.map(|hint| format!("\n  {hint}")).unwrap_or_default();
            output::fail(format_args!("error: {error:#}{hint}"));
            ExitCode::from(2)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::{Path, PathBuf};

    use clap::CommandFactory;
    use clap::error::ErrorKind;

    use super::*;

    /// README and the pages of the book.
    fn pages() -> Vec<PathBuf> {
        let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let mut pages = vec![repository.join("README.md"), repository.join("firmware-shim/README.md")];
        let docs = fs::read_dir(repository.join("docs")).unwrap().map(|entry| entry.unwrap().path());
        pages.extend(docs.filter(|path| path.extension().is_some_and(|ending| ending == "md")));
        pages
    }

    /// Every `kestrel …` of a page, in its lines or between backticks.
    fn commands(text: &str) -> Vec<String> {
        let joined = text.replace("\\\n", " ");
        let of_line = |line: &str| {
            let quoted = line.split('`').skip(1).step_by(2).map(str::to_owned);
            let whole = line.trim_start().trim_start_matches("$ ").to_owned();
            let names = ["kestrel ", "cargo run --release -- "];
            let command = |text: String| {
                names.iter().find_map(|name| text.strip_prefix(name)).map(|rest| format!("kestrel {rest}"))
            };
            let whole = Some(whole).filter(|_| !line.contains('`'));
            quoted.chain(whole).filter_map(command).collect::<Vec<_>>()
        };
        joined.lines().flat_map(of_line).collect()
    }

    /// A command's words as a shell has them, up to a comment or a pipe.
    fn words(command: &str) -> Vec<String> {
        let (mut words, mut word, mut quote) = (Vec::new(), String::new(), None);
        for letter in command.chars() {
            match (quote, letter) {
                (Some(open), letter) if letter == open => quote = None,
                (None, '\'' | '"') => quote = Some(letter),
                (None, ' ') => words.extend(Some(std::mem::take(&mut word)).filter(|word| !word.is_empty())),
                (_, letter) => word.push(letter),
            }
        }
        words.extend(Some(word).filter(|word| !word.is_empty()));
        let end = words.iter().position(|word| word.starts_with(['#', '|', '>', '&', ';'])).unwrap_or(words.len());
        words.truncate(end);
        words
    }

    /// Placeholders such as `S` are no numbers, and a word of prose may be a part of a command.
    fn is_understood(words: &[String]) -> bool {
        let spread = ["…", "..."];
        let words = words.iter().filter(|word| !spread.contains(&word.as_str()) && !word.starts_with('['));
        match Arguments::try_parse_from(words) {
            Ok(_) => true,
            Err(error) => matches!(
                error.kind(),
                ErrorKind::ValueValidation
                    | ErrorKind::InvalidValue
                    | ErrorKind::MissingRequiredArgument
                    | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
            ),
        }
    }

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn every_command_of_the_pages_is_understood() {
        let mut found = 0;
        let mut refused = Vec::new();
        for page in pages() {
            for command in commands(&fs::read_to_string(&page).unwrap()) {
                found += 1;
                if !is_understood(&words(&command)) {
                    refused.push(format!("{}: {command}", page.display()));
                }
            }
        }
        assert!(refused.is_empty(), "{refused:#?}");
        assert!(found > 100, "{found} commands");
        assert!(
            !is_understood(&words("kestrel train hover --sed 1")) && !is_understood(&words("kestrel trian hover"))
        );
    }
}
