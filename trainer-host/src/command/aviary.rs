//! `kestrel aviary`.

mod generate;
mod obstruct;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Subcommand;
use kestrel_draw::plan::{Drawing, Subject, plan, seen_sheet, sheet};
use kestrel_experiments::atomic_file::write_atomically;
use kestrel_experiments::aviary_files::{find, in_folders, read};
use kestrel_experiments::output::{fail, say};
use serde_json::{Value, json};

use super::Done;
use super::json::Json;
use crate::shipped;

/// Arguments of `kestrel aviary`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// List the aviaries: world files and the experiments' own
    List {
        /// Folders to look in [default: configs, assets/worlds and configs/aviaries]
        folders: Vec<PathBuf>,

        #[command(flatten)]
        json: Json,
    },
    /// Draw an aviary from above and from the side; several become a contact sheet
    Show {
        /// World or experiment files, or their names, such as room-0
        #[arg(required = true)]
        aviaries: Vec<String>,

        /// Where to write the picture, as .svg or .png
        #[arg(long, short, value_name = "FILE")]
        output: PathBuf,

        /// Replace a value, such as floor=false (repeatable)
        #[arg(long, value_name = "KEY=VALUE")]
        set: Vec<String>,
    },
    /// Draw what a drone sees of aviaries at its start, beside each other
    Look {
        /// World or experiment files, or their names [default: all in assets/worlds]
        aviaries: Vec<String>,

        /// Where to write the picture, as .png
        #[arg(long, short, value_name = "FILE")]
        output: PathBuf,
    },
    /// Make random rooms: world files, and a task for each
    Generate(generate::Arguments),
    /// Put a pillar where a policy flies: the next task of a curriculum
    Obstruct(obstruct::Arguments),
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    match &arguments.action {
        Action::List { folders, json } => list(folders, *json),
        Action::Show { aviaries, output, set } => show(aviaries, output, set),
        Action::Look { aviaries, output } => look(aviaries, output),
        Action::Generate(arguments) => generate::run(arguments),
        Action::Obstruct(arguments) => obstruct::run(arguments),
    }
}

fn list(folders: &[PathBuf], json: Json) -> Result<Done> {
    if let Some(folder) = folders.iter().find(|folder| !folder.is_dir()) {
        bail!("{}: found no folder, expected one with YAML files", folder.display());
    }
    let paths = in_folders(folders);
    if paths.is_empty() {
        bail!(
            "found no YAML files, expected some in configs, assets/worlds or configs/aviaries, or in a folder that is named"
        );
    }
    let mut subjects = Vec::new();
    for path in &paths {
        match read(path, &[]) {
            Ok(subject) => subjects.push(subject),
            Err(error) => fail(format_args!("error: {error}")),
        }
    }
    let heading = format!("{:<34} {:>6} {:>8}  {:<24} what", "aviary", "solids", "movables", "size");
    let words = subjects.iter().fold(heading, |text, subject| text + "\n" + &row(subject));
    json.tell(words, &subjects.iter().map(found_there).collect::<Vec<_>>())?;
    let broken = paths.len() - subjects.len();
    if broken > 0 {
        bail!("{broken} of {} files are not aviaries", paths.len());
    }
    Ok(Done::Finished)
}

fn row(subject: &Subject) -> String {
    let size = subject.solid_extent().map_or_else(String::new, |(low, high)| {
        let size = high - low;
        format!("{:.2} x {:.2} x {:.2} m", size.x, size.y, size.z)
    });
    let (solids, movables) = (subject.world.solids.len(), subject.world.movables.len());
    format!("{:<34} {solids:>6} {movables:>8}  {size:<24} {}", subject.name, subject.about)
}

/// The same as a row for programs.
fn found_there(subject: &Subject) -> Value {
    let size = subject.solid_extent().map(|(low, high)| <[f64; 3]>::from(high - low));
    let (solids, movables) = (subject.world.solids.len(), subject.world.movables.len());
    json!({ "name": subject.name, "solids": solids, "movables": movables, "size_m": size, "about": subject.about })
}

fn show(aviaries: &[String], output: &Path, overrides: &[String]) -> Result<Done> {
    let subjects = aviaries.iter().map(|name| Ok(read(&found(name)?, overrides)?));
    let subjects: Vec<Subject> = subjects.collect::<Result<_>>()?;
    let drawing = if let [only] = subjects.as_slice() { plan(only) } else { sheet(&subjects) };
    write_atomically(output, &encoded(&drawing, output)?)?;
    say(output.display())?;
    Ok(Done::Finished)
}

fn look(aviaries: &[String], output: &Path) -> Result<Done> {
    if output.extension().is_none_or(|ending| ending != "png") {
        bail!("{}: found another ending, expected .png", output.display());
    }
    let paths = match aviaries {
        [] => in_folders(&[PathBuf::from("assets/worlds")]),
        named => named.iter().map(|name| found(name)).collect::<Result<_>>()?,
    };
    if paths.is_empty() {
        bail!("found no YAML files in assets/worlds, expected some, or aviaries that are named");
    }
    let subjects: Vec<Subject> = paths.iter().map(|path| read(path, &[])).collect::<Result<_, _>>()?;
    write_atomically(output, &seen_sheet(&subjects).png()?)?;
    say(output.display())?;
    Ok(Done::Finished)
}

/// The file of an aviary: here, or one that the program carries.
fn found(name: &str) -> Result<PathBuf> {
    find(name).or_else(|_| shipped::aviary(name))
}

/// The picture in the format that the file's name asks for.
fn encoded(drawing: &Drawing, output: &Path) -> Result<Vec<u8>> {
    match output.extension().and_then(|ending| ending.to_str()) {
        Some("svg") => Ok(drawing.svg().into_bytes()),
        Some("png") => drawing.png().with_context(|| format!("cannot write {}", output.display())),
        Some(_) | None => bail!("{}: found another ending, expected .svg or .png", output.display()),
    }
}

/// Refuses to write over files.
fn refuse_existing(paths: impl IntoIterator<Item = PathBuf>) -> Result<()> {
    match paths.into_iter().find(|path| path.exists()) {
        None => Ok(()),
        Some(path) => {
            bail!(
                "{}: found a file, expected none: --force writes over it, or choose another name",
                path.display()
            )
        }
    }
}
