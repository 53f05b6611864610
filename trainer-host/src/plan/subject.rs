//! What a plan shows: a world file, or the aviary of an experiment.

use std::fs;
use std::path::{Path, PathBuf};

use kestrel_sim::config::{AviaryConfig, ConfigError, Document, Place};
use kestrel_sim::scenario::{FreeSpace, Scenario, StartPosition};
use kestrel_sim::world::{Cuboid, Solid, World};
use nalgebra::Vector3;

use crate::experiment_config;

/// Where aviaries are looked for by name.
const FOLDERS: [&str; 3] = ["configs", "assets/worlds", "configs/aviaries"];

/// Air around what is drawn \[m\].
const MARGIN: f64 = 0.25;

/// Least width, depth and height that is drawn \[m\].
const LEAST_SIZE: Vector3<f64> = Vector3::new(2.0, 1.0, 1.0);

/// An aviary that can be drawn.
#[derive(Clone, Debug)]
pub struct Subject {
    /// Name of its file, without its ending.
    pub name: String,
    /// What it is, in one line; may be empty.
    pub about: String,
    /// What stands there.
    pub world: World,
    /// Where drones shall go \[m, world\].
    pub goals: Vec<Vector3<f64>>,
    /// Where drones start \[m, world\].
    pub starts: Vec<Vector3<f64>>,
    /// Points on the way to each goal \[m, world\]; there may be fewer routes than goals, and empty ones.
    pub routes: Vec<Vec<Vector3<f64>>>,
    /// The box of random starts, of an experiment.
    pub start_region: Option<Cuboid>,
}

/// Why there is nothing to draw.
#[derive(Debug, thiserror::Error)]
pub enum SubjectError {
    /// Neither a file nor a known name.
    #[error("{name}: found no such file or aviary, expected a YAML file or one of: {known}")]
    Unknown {
        /// What was asked for.
        name: String,
        /// Names that there are.
        known: String,
    },
    /// The file is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
}

/// The file called `name`: a path, or the name of a file in `configs` or `assets/worlds`.
///
/// # Errors
/// [`SubjectError::Unknown`], with the names that there are.
pub fn find(name: &str) -> Result<PathBuf, SubjectError> {
    let path = PathBuf::from(name);
    if path.is_file() {
        return Ok(path);
    }
    let paths = in_folders(&FOLDERS.map(PathBuf::from));
    let named = paths.iter().find(|path| stem(path) == name);
    named.cloned().ok_or_else(|| SubjectError::Unknown {
        name: name.to_owned(),
        known: paths.iter().map(|path| stem(path)).collect::<Vec<_>>().join(", "),
    })
}

/// The YAML files in these folders, or in those where aviaries are looked for by name, sorted in each.
pub fn in_folders(folders: &[PathBuf]) -> Vec<PathBuf> {
    let default = FOLDERS.map(PathBuf::from);
    let folders = if folders.is_empty() { &default[..] } else { folders };
    folders.iter().flat_map(|folder| yaml_files(folder)).collect()
}

fn yaml_files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "yaml"))
        .collect();
    paths.sort();
    paths
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

impl Subject {
    /// The aviary in the file at `path`, an experiment or a world, after `overrides`.
    ///
    /// # Errors
    /// What is wrong with the file.
    pub fn read(path: &Path, overrides: &[String]) -> Result<Self, ConfigError> {
        let mut document = Document::read(path)?;
        if document.holds("scenario") {
            let experiment = experiment_config::load(path, overrides)?;
            return Ok(Self::of_scenario(stem(path), &experiment.evaluation.scenario));
        }
        for assignment in overrides {
            document.set(assignment)?;
        }
        let Place { about, goals, starts, routes, world } =
            document.decode::<AviaryConfig>()?.place(&document.root())?;
        Ok(Self { name: stem(path), about, world, goals, starts, routes, start_region: None })
    }

    /// The aviary of a scenario.
    pub(crate) fn of_scenario(name: String, scenario: &Scenario) -> Self {
        let drones = 0..scenario.agents.count as usize;
        let route = |drone: usize| scenario.aviary.route(drone).iter().map(|point| point.cast()).collect();
        let (starts, region) = match &scenario.start.position {
            StartPosition::Within(region) | StartPosition::FreeWithin(FreeSpace { region, .. }) => {
                (Vec::new(), Some(*region))
            }
            StartPosition::AlongWay(starts) => (Vec::new(), Some(starts.space.region)),
            StartPosition::AroundGoal { farthest_m, .. } => {
                let goal = scenario.aviary.goal;
                let region = Cuboid { low: goal.add_scalar(-farthest_m), high: goal.add_scalar(*farthest_m) };
                (Vec::new(), Some(region))
            }
            StartPosition::Exactly(places) => (places.iter().map(|place| place.position).collect(), None),
        };
        Self {
            name,
            about: format!("the aviary of the experiment {}, with the starts of its evaluation", scenario.name),
            world: scenario.aviary.world.clone(),
            routes: drones.clone().map(route).collect(),
            goals: drones.map(|drone| scenario.goals.at(&scenario.aviary.goal, drone, 0.0)).collect(),
            starts,
            start_region: region,
        }
    }

    /// Everything solid, seen or pushed.
    pub(super) fn solids(&self) -> impl Iterator<Item = &Solid> {
        self.world.solids.iter().chain(self.world.movables.iter().map(|movable| &movable.solid))
    }

    /// Lowest and highest coordinates of the solids \[m\], if there are any.
    pub fn solid_extent(&self) -> Option<(Vector3<f64>, Vector3<f64>)> {
        self.solids().map(Solid::extent).reduce(|one, other| (one.0.inf(&other.0), one.1.sup(&other.1)))
    }

    /// What the plan has to show \[m\]: solids, starts, goals and some air around them.
    pub(super) fn extent(&self) -> (Vector3<f64>, Vector3<f64>) {
        let region = self.start_region.iter().flat_map(|region| [region.low.cast(), region.high.cast()]);
        let points = self.goals.iter().chain(&self.starts).copied().chain(region);
        let extents = points.map(|point| (point, point)).chain(self.solid_extent());
        let (low, high) = extents
            .reduce(|one, other| (one.0.inf(&other.0), one.1.sup(&other.1)))
            .unwrap_or((Vector3::zeros(), Vector3::zeros()));
        let lack = (LEAST_SIZE - (high - low)).sup(&Vector3::zeros()) / 2.0;
        let margin = Vector3::new(MARGIN, MARGIN, 0.0);
        let (low, high) = (low - lack - margin, high + lack + margin);
        // The floor is always in view.
        (Vector3::new(low.x, low.y, low.z.clamp(-0.5, 0.0)), high + MARGIN * Vector3::z())
    }

    /// Sizes and numbers in one line.
    pub fn summary(&self) -> String {
        let World { solids, movables, .. } = &self.world;
        let size = self.solid_extent().map_or_else(
            || "no solids".to_owned(),
            |(low, high)| {
                let size = high - low;
                format!("{} m x {} m x {} m", short(size.x), short(size.y), short(size.z))
            },
        );
        let count =
            |count: usize, what: &str| if count == 0 { String::new() } else { format!(", {count} {what}") };
        format!("{size}{}{}", count(solids.len(), "solids"), count(movables.len(), "movables"))
    }
}

/// A length with two decimals, without trailing zeros.
pub(super) fn short(length: f64) -> String {
    let text = format!("{length:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}
