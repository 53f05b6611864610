//! The next room as files: a world that imports the one before, and a task that imports the task before.

use std::path::{Path, PathBuf};

use kestrel_sim::config::{AviaryConfig, ConfigError, Document};
use serde::Deserialize;

use super::{Spot, pillars};
use crate::aviary_generator::text::{point, relative};
use crate::experiment_config::ExperimentConfig;

/// Longest chain of tasks that import each other, as in the configuration's reader.
const DEPTH_LIMIT: usize = 8;

/// Pillars in one line of a file.
const PER_LINE: usize = 6;

/// The room before.
#[derive(Clone, Debug)]
pub struct Former {
    /// The task's file.
    pub task: PathBuf,
    /// The world file that it imports, if it imports one.
    pub world: Option<PathBuf>,
    /// What stands there.
    pub aviary: AviaryConfig,
}

/// What a task's file says about its world, and nothing else.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Skeleton {
    import: Option<String>,
    scenario: Scene,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Scene {
    aviary: Imported,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Imported {
    import: Option<String>,
}

impl Former {
    /// The room of the task at `path`.
    ///
    /// # Errors
    /// What is wrong with the file.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let config: ExperimentConfig = Document::read(path)?.decode()?;
        Ok(Self { task: path.to_owned(), world: world_of(path), aviary: config.scenario.aviary })
    }
}

/// The world file that a task imports, itself or through the task that it imports.
fn world_of(task: &Path) -> Option<PathBuf> {
    let mut task = task.to_owned();
    for _ in 0..=DEPTH_LIMIT {
        let text = std::fs::read_to_string(&task).ok()?;
        let Skeleton { import, scenario } = serde_yaml::from_str(&text).ok()?;
        let folder = task.parent().unwrap_or(Path::new("")).to_owned();
        if let Some(world) = scenario.aviary.import {
            return Some(folder.join(world));
        }
        task = folder.join(import?);
    }
    None
}

/// Where the next room is written, and by which command.
#[derive(Clone, Copy, Debug)]
pub struct Sequel<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its world file.
    pub world: &'a Path,
    /// Its task.
    pub task: &'a Path,
    /// The command that writes them, for the files' comments.
    pub command: &'a str,
}

impl Sequel<'_> {
    /// The world file: the former world, the pillars in it and the new one, and the way that is left.
    pub fn world_text(&self, former: &Former, former_world: &Path, spot: &Spot) -> String {
        let Self { name, command, .. } = self;
        let all = pillars(&former.aviary, spot);
        let lines: Vec<String> = all
            .chunks(PER_LINE)
            .map(|line| line.iter().map(|[x, y]| format!("[{x}, {y}],")).collect::<Vec<_>>().join(" "))
            .map(|line| format!("  {line}\n"))
            .collect();
        let route: Vec<String> = spot.route.iter().map(|&at| point(&at.into())).collect();
        format!(
            "# Written by: {command}\n#\n# The last pillar stands where {} flights passed.\n\nimport: {}\nabout: {} \
             pillars, the last where a policy flew ({name})\nroute_m: [{}]\npillars: [\n{}]\n",
            spot.passing,
            relative(folder(self.world), former_world),
            all.len(),
            route.join(", "),
            lines.concat(),
        )
    }

    /// The task: the former task in this world; `goal_m` is said again, for the world may have one of its own.
    pub fn task_text(&self, former: &Former) -> String {
        let Self { name, command, .. } = self;
        let import = |file: &Path| relative(folder(self.task), file);
        let goal = former.aviary.goal_m.map(|goal| format!(", goal_m: {}", point(&goal))).unwrap_or_default();
        format!(
            "# Written by: {command}\n\nversion: 1\nname: {name}\nimport: {}\nscenario:\n  aviary: {{ import: {}{goal} }}\n",
            import(&former.task),
            import(self.world),
        )
    }
}

fn folder(file: &Path) -> &Path {
    file.parent().unwrap_or(Path::new(""))
}
