//! `kestrel completions`, and what a shell is told while somebody types.

mod keys;

use std::ffi::OsStr;
use std::path::Path;

use anyhow::{Context, Result};
use clap::builder::StyledStr;
use clap::{Arg, Command, CommandFactory};
use clap_complete::Shell;
use clap_complete::engine::{ArgValueCompleter, CompletionCandidate, PathCompleter, ValueCompleter};
use clap_complete::env::{CompleteEnv, Shells};
use kestrel_experiments::output::say;
use kestrel_experiments::run_summary::RunSummary;
use kestrel_experiments::{experiment_config, search, study};

use self::keys::Keys;
use crate::kind::Kind;
use crate::shipped;

/// Arguments of `kestrel completions`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The shell
    shell: Shell,
}

/// Says that a shell asks, and for which one.
const VARIABLE: &str = "COMPLETE";

/// Where runs are unless somebody says otherwise.
const RUNS: &str = "runs";

pub(crate) fn print(arguments: &Arguments) -> Result<()> {
    let shell = arguments.shell.to_string();
    let shells = Shells::builtins();
    let shell = shells.completer(&shell).with_context(|| format!("{shell} has no completions"))?;
    let mut script = Vec::new();
    shell.write_registration(VARIABLE, "kestrel", "kestrel", "kestrel", &mut script)?;
    Ok(say(String::from_utf8(script)?.trim_end())?)
}

/// Answers a shell that asks what a word can be, and ends the program then.
pub(crate) fn answer() {
    CompleteEnv::with_factory(|| completed(crate::Arguments::command())).var(VARIABLE).complete();
}

/// The commands, with what their words can be.
fn completed(commands: Command) -> Command {
    commands.mut_subcommands(|command| {
        let name = command.get_name().to_owned();
        with_names(command, &name)
    })
}

/// The arguments of a command and those below it.
fn with_names(command: Command, name: &str) -> Command {
    let name = name.to_owned();
    let below = name.clone();
    command.mut_subcommands(move |command| with_names(command, &below)).mut_args(move |arg| {
        let Some(names) = Names::of(&name, &arg) else { return arg };
        arg.add(ArgValueCompleter::new(names))
    })
}

/// What a word of a command line can be, beside a path.
#[derive(Clone, Debug)]
enum Names {
    /// What is of these kinds, and files.
    Of(Vec<Kind>),
    /// A task or an example, and no file.
    Templates,
    /// `KEY=VALUE` of the files that a command takes.
    Keys(fn() -> String),
}

impl Names {
    /// By the command, and what it says of the argument.
    fn of(command: &str, arg: &Arg) -> Option<Self> {
        let shown = arg.get_value_names().and_then(|names| names.first()).map_or("", |name| name.as_str());
        match (shown, arg.get_id().as_str()) {
            ("KEY=VALUE", _) => Some(Self::Keys(schema_of(command))),
            ("TASK", "from") => Some(Self::Templates),
            ("RUN", "resume") => Some(Self::Of(vec![Kind::Run])),
            ("FILE", "task" | "tasks") => Some(Self::Of(vec![Kind::Task])),
            _ if arg.is_positional() && !Kind::taken_by(command).is_empty() => {
                Some(Self::Of(Kind::taken_by(command).to_vec()))
            }
            _ => None,
        }
    }
}

/// What a command's overrides change.
fn schema_of(command: &str) -> fn() -> String {
    match command {
        "study" => study::config::schema,
        "search" => search::config::schema,
        "test" => crate::flight_test::config::schema,
        _ => experiment_config::schema,
    }
}

impl ValueCompleter for Names {
    fn complete(&self, current: &OsStr) -> Vec<CompletionCandidate> {
        let typed = current.to_string_lossy();
        let named = |names: Vec<String>| {
            let fitting = names.into_iter().filter(|name| name.starts_with(&*typed));
            fitting.map(CompletionCandidate::new).collect::<Vec<_>>()
        };
        match self {
            Self::Templates => named(
                shipped::tasks().map(|(name, _)| name).chain(shipped::examples()).map(str::to_owned).collect(),
            ),
            Self::Of(kinds) => {
                let mut candidates = named(kinds.iter().flat_map(|kind| names_of(*kind)).collect());
                candidates.extend(PathCompleter::any().complete(current));
                candidates
            }
            Self::Keys(schema) => {
                let Some(keys) = Keys::parse(&schema()) else { return Vec::new() };
                let candidate = |(word, about): (String, Option<String>)| {
                    CompletionCandidate::new(word).help(about.map(StyledStr::from))
                };
                keys.after(&typed).into_iter().map(candidate).collect()
            }
        }
    }
}

/// Names of what comes with the program, and of runs here.
fn names_of(kind: Kind) -> Vec<String> {
    let in_folder = |folder: &str| shipped::names_in(folder).map(str::to_owned).collect();
    match kind {
        Kind::Task => shipped::tasks().map(|(name, _)| name.to_owned()).collect(),
        Kind::Policy => shipped::pilots().map(|(name, _)| name.to_owned()).collect(),
        Kind::Study => in_folder("studies"),
        Kind::Search => in_folder("searches"),
        Kind::Tests => in_folder("tests"),
        Kind::World => shipped::worlds().map(str::to_owned).collect(),
        Kind::Run => RunSummary::found(Path::new(RUNS)).iter().map(|path| path.display().to_string()).collect(),
        Kind::Airframe
        | Kind::StudyDirectory
        | Kind::SearchDirectory
        | Kind::Recording
        | Kind::Checkpoint
        | Kind::Network => Vec::new(),
    }
}
