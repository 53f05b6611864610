//! `kestrel aviary obstruct`.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use kestrel_experiments::atomic_file::{self, write_atomically};
use kestrel_experiments::evaluation::{Flyer, Starts};
use kestrel_experiments::experiment_config;
use kestrel_experiments::obstruction::files::{Former, Sequel};
use kestrel_experiments::obstruction::{Spot, Traffic};
use kestrel_experiments::output::say;
use kestrel_experiments::run_directory::RunDirectory;
use kestrel_export::policy::Policy;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::{Purpose, Seed};

use crate::command::Done;

/// Most flights that are asked for.
const FLIGHTS_LIMIT: usize = 10_000;

/// Arguments of `kestrel aviary obstruct`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// A run, or a policy file
    policy: PathBuf,

    /// The task that it flies; the new one imports it
    #[arg(long, value_name = "FILE")]
    task: PathBuf,

    /// Where to write the new task; its file's name is its name
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,

    /// Where to write the new world
    #[arg(long, value_name = "FILE")]
    world: PathBuf,

    /// Flights that are watched
    #[arg(long, value_name = "NUMBER", default_value_t = 64, allow_negative_numbers = true)]
    flights: usize,

    /// What their starts follow from
    #[arg(long, value_name = "NUMBER", default_value_t = 0, allow_negative_numbers = true)]
    seed: u64,

    /// Replace files that are there
    #[arg(long, visible_alias = "replace")]
    force: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let Arguments { task, output, world, flights, .. } = arguments;
    ensure!(
        (1..=FLIGHTS_LIMIT).contains(flights),
        "found --flights {flights}, expected a number from 1 to {FLIGHTS_LIMIT}"
    );
    ensure!(output != world, "{}: found the same file for task and world, expected two", output.display());
    if !arguments.force {
        super::refuse_existing([output.clone(), world.clone()])?;
    }
    let former = Former::read(task)?;
    let Some(former_world) = &former.world else {
        bail!("{}: found no world file that it imports in `scenario.aviary`, expected one", task.display());
    };
    let name = output.file_stem().unwrap_or_default().to_string_lossy();
    let command = arguments.command();
    let sequel = Sequel { name: &name, world, task: output, command: &command };
    let task_text = sequel.task_text(&former);
    let (spot, traffic) = arguments.spot()?;
    write(world, &sequel.world_text(&former, former_world, &spot))?;
    write(output, &task_text)?;
    let [x, y] = spot.at;
    let flights = traffic.flights();
    say(format_args!("A pillar at [{x}, {y}], where {} of {flights} successful flights passed.", spot.passing))?;
    say(format_args!("{}\n{}", world.display(), output.display()))?;
    Ok(Done::Finished)
}

impl Arguments {
    /// Flies the policy and finds the pillar's place.
    fn spot(&self) -> Result<(Spot, Traffic)> {
        let scenario = experiment_config::load(&self.task, &[])?.evaluation.scenario;
        let path = self.policy_file()?;
        let bytes = atomic_file::read(&path)?;
        let policy = Policy::parse(&bytes).with_context(|| path.display().to_string())?;
        require_fit(&policy, &scenario).with_context(|| path.display().to_string())?;
        let starts = Starts { seed: Seed(self.seed), purpose: Purpose::Evaluation, episodes: self.flights };
        let found = Traffic::observe(&scenario, Flyer::Policy(&policy), starts)
            .and_then(|traffic| Ok((traffic.obstruct(&scenario)?, traffic)));
        found.with_context(|| self.task.display().to_string())
    }

    fn policy_file(&self) -> Result<PathBuf> {
        if !self.policy.is_dir() {
            return Ok(self.policy.clone());
        }
        let directory = RunDirectory::open(&self.policy)?;
        Ok(directory.exported_policy()?)
    }

    /// The command that writes the same files again.
    fn command(&self) -> String {
        let Self { policy, task, output, world, flights, seed, .. } = self;
        format!(
            "kestrel aviary obstruct {} --task {} --output {} --world {} --flights {flights} --seed {seed}",
            policy.display(),
            task.display(),
            output.display(),
            world.display()
        )
    }
}

/// Refuses a policy that was trained for something else.
fn require_fit(policy: &Policy<'_>, scenario: &Scenario) -> Result<()> {
    match policy.differing(scenario) {
        None => Ok(()),
        Some(differing) => {
            bail!("found a policy for another {differing}, expected one trained for --task or one like it")
        }
    }
}

fn write(path: &Path, text: &str) -> Result<()> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    Ok(write_atomically(path, text.as_bytes())?)
}
