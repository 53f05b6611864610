//! Rooms that nobody has seen: furniture, pillars and partitions at random places, with a free way to a table.
//!
//! A draw that is refused is drawn anew, so that every room can be flown: it has a way that keeps its distance
//! ([`kestrel_sim::contact::Passage`]), which is not straight, and the scripted pilot flies it. What is written are a world file and a
//! task that imports it, which nothing distinguishes from those written by hand.

mod room;
#[cfg(test)]
mod tests;
pub(crate) mod text;

use std::path::{Path, PathBuf};

use kestrel_sim::config::ConfigError;
use kestrel_sim::seed::{Purpose, Seed, Stream};
use kestrel_sim::world::Cuboid;
use nalgebra::{Vector3, vector};
use rayon::prelude::*;

use crate::evaluation::{Flyer, Starts, evaluate};
use crate::experiment_config;
use kestrel_sim::contact::Passage;
use room::{Room, Workshop};
use text::{Layout, Manuscript};

/// Corners of the room \[m\]: those of rooms 0 to 2, and of `configs/aviaries/parts/room.yaml`.
pub(crate) const ROOM: Cuboid = Cuboid { low: vector![-1.0, -1.5, 0.0], high: vector![7.0, 1.5, 1.5] };

/// Where the evaluations of `configs/aviaries/parts/room.yaml` start \[m\].
const STARTS: Cuboid = Cuboid { low: vector![-0.7, -0.3, 0.4], high: vector![-0.4, 0.3, 0.65] };

/// Least distance between the way to the table and everything else \[m\]: a Crazyflie's hull has a radius of 0.06 m.
pub const CLEARANCE_M: f64 = 0.2;

/// Draws before a room is given up; of the first thirty with fourteen pieces one had no free way.
const DRAWS: u32 = 30;

/// Flights of the scripted pilot that accept a room, and the least share of successes.
const FLIGHTS: usize = 32;
const SUCCESS_RATE: f64 = 0.95;

/// Which rooms are wanted.
#[derive(Clone, Debug)]
pub struct Order {
    /// What all names begin with.
    pub name: String,
    /// How many rooms.
    pub count: usize,
    /// What everything random follows from; room k of a seed is the same for any number of rooms.
    pub seed: Seed,
    /// Most pieces in a room; each has at least half of them, as far as they find a place.
    pub pieces: usize,
    /// Folder of furniture files.
    pub furniture: PathBuf,
    /// What all tasks import.
    pub base: PathBuf,
    /// Folder for world files.
    pub worlds: PathBuf,
    /// Folder for tasks.
    pub tasks: PathBuf,
    /// The command that made them, for the files' comments.
    pub command: String,
}

/// A room as two files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Files {
    /// Where the world belongs, and its text.
    pub world: (PathBuf, String),
    /// Where the task belongs, and its text.
    pub task: (PathBuf, String),
}

/// Why there are no rooms.
#[derive(Debug, thiserror::Error)]
pub enum GeneratorError {
    /// The parts do not fit together: a piece of furniture or the base of the tasks is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// No draw had what a room needs.
    #[error(
        "{name}: found no room in {DRAWS} draws ({blocked} without a free way, {straight} with a straight one, {missed} that \
         the scripted pilot does not fly), expected one: ask for fewer pieces or another seed"
    )]
    Crowded {
        /// The room.
        name: String,
        /// How many had no way.
        blocked: u32,
        /// How many had nothing in the way.
        straight: u32,
        /// How many were not flown.
        missed: u32,
    },
}

/// Whether a draw is kept, or what is wrong with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Kept,
    Blocked,
    Straight,
    Missed,
}

impl Order {
    /// Where the files of room `index` belong: world and task.
    pub fn paths(&self, index: usize) -> [PathBuf; 2] {
        [&self.worlds, &self.tasks].map(|folder| folder.join(format!("{}.yaml", self.room_name(index))))
    }

    fn room_name(&self, index: usize) -> String {
        let digits = self.count.saturating_sub(1).to_string().len().max(2);
        format!("{}-{index:0digits$}", self.name)
    }
}

/// The rooms, in order; the same for any number of threads. Nothing is written.
///
/// # Errors
/// When a part is wrong, or a room cannot be made.
pub fn generate(order: &Order) -> Result<Vec<Files>, GeneratorError> {
    let rooms: Vec<Result<Files, GeneratorError>> =
        (0..order.count).into_par_iter().map(|index| make(order, index)).collect();
    // The first room's error, not that of the first thread.
    rooms.into_iter().collect()
}

fn make(order: &Order, index: usize) -> Result<Files, GeneratorError> {
    let name = order.room_name(index);
    let workshop = Workshop { furniture: &order.furniture, pieces: order.pieces };
    let mut stream = Stream::new(order.seed, index as u32, Purpose::Furnishing);
    let (mut blocked, mut straight, mut missed) = (0, 0, 0);
    for _ in 0..DRAWS {
        let mut room = workshop.draw(&mut stream)?;
        match settle(order, &name, &mut room)? {
            Verdict::Kept => return Ok(written(order, index, &room)),
            Verdict::Blocked => blocked += 1,
            Verdict::Straight => straight += 1,
            Verdict::Missed => missed += 1,
        }
    }
    Err(GeneratorError::Crowded { name, blocked, straight, missed })
}

/// Gives the room its route, if it has one, and judges it.
fn settle(order: &Order, name: &str, room: &mut Room) -> Result<Verdict, ConfigError> {
    let world = room.world(&order.furniture)?;
    let goal = Vector3::from(room.goal).cast();
    let passage = Passage { world: &world, bounds: ROOM, starts: STARTS, goal, clearance_m: CLEARANCE_M };
    let Some(route) = passage.route() else { return Ok(Verdict::Blocked) };
    if route.is_empty() {
        return Ok(Verdict::Straight);
    }
    room.route = route.into_iter().map(Into::into).collect();
    let flown = scripted_success(order, name, room)? >= SUCCESS_RATE;
    Ok(if flown { Verdict::Kept } else { Verdict::Missed })
}

/// Share of flights that the scripted pilot finishes, in the task as it will be.
fn scripted_success(order: &Order, name: &str, room: &Room) -> Result<f64, ConfigError> {
    let path = order.tasks.join(format!("{name}.yaml"));
    let layout = Layout::from(&order.tasks, &order.furniture, &order.base, &path);
    let text = Manuscript { name, command: &order.command, layout: &layout }.whole_task(room);
    let experiment = experiment_config::parse(&path.display().to_string(), &text, &[])?;
    // Other starts than those that judge policies.
    let starts = Starts { seed: order.seed, purpose: Purpose::Selection, episodes: FLIGHTS };
    Ok(evaluate(&experiment.evaluation.scenario, Flyer::Scripted, starts).success_rate)
}

fn written(order: &Order, index: usize, room: &Room) -> Files {
    let (name, command) = (&order.room_name(index), &order.command);
    let [world, task] = order.paths(index);
    let layout = |folder: &Path| Layout::from(folder, &order.furniture, &order.base, &world);
    let (of_world, of_task) = (layout(&order.worlds), layout(&order.tasks));
    let world_text = Manuscript { name, command, layout: &of_world }.world(room);
    let task_text = Manuscript { name, command, layout: &of_task }.task();
    Files { world: (world, world_text), task: (task, task_text) }
}
