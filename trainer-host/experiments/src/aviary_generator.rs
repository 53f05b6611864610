//! Rooms that nobody has seen: furniture, pillars and partitions at random places, with a free way to a table.
//!
//! A draw that is refused is drawn anew, so that every room can be flown: it has a way that keeps its distance
//! ([`Passage`]), which is not straight, and the scripted pilot flies it. What is written are a world file and a task that imports it, which nothing distinguishes from those written by hand.

#[cfg(test)]
mod tests;
pub(crate) mod text;

use std::path::{Path, PathBuf};

use kestrel_sim::config::{AviaryConfig, ConfigError, Document};
use kestrel_sim::rooms::{CLEARANCE_M, Model, ROOM, RoomPlan, STARTS, Workshop};
use kestrel_sim::seed::{Purpose, Seed, Stream};
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::evaluation::{Flyer, Starts, evaluate};
use crate::experiment_config;
use kestrel_sim::contact::Passage;
use text::{Layout, Manuscript};

/// What to land on.
const TABLE: &str = "table-square";

/// Furniture, and how many times larger than its parts say: the sizes of rooms 0 to 2 and a little around them.
const FURNITURE: [(&str, [f32; 2]); 8] = [
    ("armchair", [0.8, 1.2]),
    ("coffee-table", [0.6, 1.2]),
    ("couch", [0.5, 0.8]),
    ("cupboard", [0.18, 0.24]),
    ("dresser", [0.12, 0.16]),
    ("kit-chair", [0.008, 0.012]),
    ("lamp", [0.7, 0.95]),
    ("tv-stand", [0.7, 1.1]),
];

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

/// A room and the route through it.
#[derive(Clone, Debug, PartialEq)]
struct Room {
    /// What stands there.
    plan: RoomPlan,
    /// Points to fly through \[m\].
    route: Vec<[f64; 3]>,
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
    let workshop = workshop(&order.furniture, order.pieces)?;
    let rooms: Vec<Result<Files, GeneratorError>> =
        (0..order.count).into_par_iter().map(|index| make(order, &workshop, index)).collect();
    // The first room's error, not that of the first thread.
    rooms.into_iter().collect()
}

/// What the rooms are made of, from a folder of furniture.
fn workshop(furniture: &Path, pieces: usize) -> Result<Workshop, ConfigError> {
    let pieces_of_furniture = FURNITURE.iter().map(|(file, _)| format!("  - {{ import: {file}.yaml }}\n"));
    let table = format!("  - {{ import: {TABLE}.yaml, name: goal table, role: landing }}\n");
    let list: String = pieces_of_furniture.chain([table]).collect();
    let name = furniture.join("a random room").display().to_string();
    let document = Document::parse(&name, &format!("furniture:\n{list}"))?;
    let field = document.root().at("furniture");
    let read = document.decode::<AviaryConfig>()?.furniture;
    let parts = |index: usize| read[index].parts(&field.at(index));
    let model =
        |(index, (_, scales)): (usize, &(&str, [f32; 2]))| Ok(Model { parts: parts(index)?, scales: *scales });
    let furniture = FURNITURE.iter().enumerate().map(model).collect::<Result<_, _>>()?;
    Ok(Workshop { table: parts(FURNITURE.len())?, furniture, pieces })
}

fn make(order: &Order, workshop: &Workshop, index: usize) -> Result<Files, GeneratorError> {
    let name = order.room_name(index);
    let mut stream = Stream::new(order.seed, index as u32, Purpose::Furnishing);
    let (mut blocked, mut straight, mut missed) = (0, 0, 0);
    for _ in 0..DRAWS {
        let mut room = Room { plan: workshop.draw(order.pieces, &mut stream), route: Vec::new() };
        match settle(order, (&name, workshop), &mut room)? {
            Verdict::Kept => return Ok(written(order, index, &room)),
            Verdict::Blocked => blocked += 1,
            Verdict::Straight => straight += 1,
            Verdict::Missed => missed += 1,
        }
    }
    Err(GeneratorError::Crowded { name, blocked, straight, missed })
}

/// Gives the room its route, if it has one, and judges it.
fn settle(order: &Order, (name, workshop): (&str, &Workshop), room: &mut Room) -> Result<Verdict, ConfigError> {
    let world = workshop.world(&room.plan);
    let goal = Vector3::from(room.plan.goal).cast();
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
