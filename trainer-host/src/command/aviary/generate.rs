//! `kestrel aviary generate`.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use kestrel_experiments::atomic_file::write_atomically;
use kestrel_experiments::aviary_generator::{Files, Order, generate};
use kestrel_experiments::output::say;
use kestrel_sim::seed::Seed;

use crate::command::Done;

/// Most rooms of one command.
const ROOMS_LIMIT: usize = 1000;

/// Most pieces that may be asked for: far fewer find a place.
const PIECES_LIMIT: usize = 100;

/// Where the repository has the furniture, and what its rooms have in common.
const FURNITURE: &str = "assets/furniture";
const BASE: &str = "configs/aviaries/parts/room.yaml";

/// Arguments of `kestrel aviary generate`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// What the names of the rooms begin with
    #[arg(long, value_name = "NAME")]
    name: String,

    /// How many rooms
    #[arg(long, value_name = "NUMBER", default_value_t = 20, allow_negative_numbers = true)]
    count: usize,

    /// What everything random follows from
    #[arg(long, value_name = "NUMBER", default_value_t = 0, allow_negative_numbers = true)]
    seed: u64,

    /// Most things in a room beside the table; there are at least half as many, as far as they find a place
    #[arg(long, value_name = "NUMBER", default_value_t = 14, allow_negative_numbers = true)]
    pieces: usize,

    /// Folder for the world files
    #[arg(long, value_name = "FOLDER")]
    worlds: PathBuf,

    /// Folder for the tasks
    #[arg(long, value_name = "FOLDER")]
    tasks: PathBuf,

    /// Folder of the furniture
    #[arg(long, value_name = "FOLDER", default_value = FURNITURE)]
    furniture: PathBuf,

    /// What every task imports: all of it but name and aviary
    #[arg(long, value_name = "FILE", default_value = BASE)]
    base: PathBuf,

    /// Replace files that are there
    #[arg(long, visible_alias = "replace")]
    force: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let order = arguments.order()?;
    if !arguments.force {
        let paths = (0..order.count).flat_map(|index| order.paths(index));
        super::refuse_existing(paths)?;
    }
    let rooms = generate(&order)?;
    for folder in [&order.worlds, &order.tasks] {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    for Files { world, task } in &rooms {
        for (path, text) in [world, task] {
            write_atomically(path, text.as_bytes())?;
        }
        say(task.0.display())?;
    }
    Ok(Done::Finished)
}

impl Arguments {
    fn order(&self) -> Result<Order> {
        let Self { name, count, seed, pieces, worlds, tasks, furniture, base, .. } = self;
        let within = |key: &str, found: usize, limit: usize| {
            ensure!((1..=limit).contains(&found), "found --{key} {found}, expected a number from 1 to {limit}");
            Ok(())
        };
        within("count", *count, ROOMS_LIMIT)?;
        within("pieces", *pieces, PIECES_LIMIT)?;
        require_folder(furniture)?;
        Ok(Order {
            name: name.clone(),
            count: *count,
            seed: Seed(*seed),
            pieces: *pieces,
            furniture: furniture.clone(),
            base: base.clone(),
            worlds: worlds.clone(),
            tasks: tasks.clone(),
            command: self.command(),
        })
    }

    /// The command that makes the same rooms again.
    fn command(&self) -> String {
        let Self { name, count, seed, pieces, .. } = self;
        let mut command =
            format!("kestrel aviary generate --name {name} --count {count} --seed {seed} --pieces {pieces}");
        let folders = [("worlds", &self.worlds), ("tasks", &self.tasks)];
        let parts = [("furniture", &self.furniture, FURNITURE), ("base", &self.base, BASE)];
        let parts = parts.into_iter().filter(|(_, path, default)| *path != Path::new(default));
        for (key, path) in folders.into_iter().chain(parts.map(|(key, path, _)| (key, path))) {
            write!(command, " --{key} {}", path.display()).expect("strings take all text");
        }
        command
    }
}

fn require_folder(path: &Path) -> Result<()> {
    if path.is_dir() {
        return Ok(());
    }
    bail!("--furniture {}: found no folder, expected one with files such as couch.yaml", path.display())
}
