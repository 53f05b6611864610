//! A room as it is drawn: a table to reach, and pieces where there was a place for them.

use std::path::Path;

use kestrel_sim::config::{AviaryConfig, ConfigError, Document};
use kestrel_sim::seed::Stream;
use kestrel_sim::world::{Solid, World};
use nalgebra::Vector3;

use super::text::{contents, furnishing};
use super::{ROOM, STARTS};

/// Where the table's middle is: in the far third, with room for a drone behind it \[m\].
const TABLE_X_M: [f32; 2] = [4.6, 6.5];
const TABLE_Y_M: [f32; 2] = [-1.0, 1.0];

/// Height of the goal: a centimetre above the table, as in the task of room 0 \[m\].
const GOAL_HEIGHT_M: f64 = 0.65;

/// Around the table's middle, kept free up to the ceiling \[m\]: the table's half width and 15 cm.
const TABLE_REACH_M: f64 = 0.45;

/// Around the starts, kept free up to the ceiling \[m\]: the way's clearance, and 10 cm to begin in.
const START_REACH_M: f64 = 0.3;

/// Tries to find a piece a place; afterwards it is left out.
const TRIES: usize = 30;

/// Size of a partition: thickness and width \[m\], and how far it is turned from straight across \[degrees\].
const PARTITION_THICKNESS_M: [f32; 2] = [0.08, 0.16];
const PARTITION_WIDTH_M: [f32; 2] = [0.6, 1.7];
const PARTITION_YAW_DEG: f32 = 30.0;

/// Between a piece and a wall, at least \[m\].
const WALL_GAP_M: f64 = 0.01;

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

/// Of all pieces, the shares that are pillars and partitions; the rest is furniture.
const PILLAR_SHARE: f32 = 0.25;
const PARTITION_SHARE: f32 = 0.2;

/// A room and what stands in it, as its file says it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Room {
    /// Where the drone shall go \[m\].
    pub(super) goal: [f64; 3],
    /// What stands there, the table first.
    pub(super) pieces: Vec<Piece>,
    /// Points to fly through \[m\].
    pub(super) route: Vec<[f64; 3]>,
}

/// One thing on the floor; lengths in centimetres, angles in degrees, both whole.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Piece {
    pub(super) kind: Kind,
    /// Its origin \[m\], lifted where it would reach below the floor.
    pub(super) at: [f64; 3],
}

/// What a piece is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    /// What to land on.
    Table,
    /// From a file of furniture.
    Furniture { file: &'static str, yaw_deg: f64, scale: f64 },
    /// One of the reference's.
    Pillar,
    /// A box from the floor to the ceiling.
    Partition { thickness_m: f64, width_m: f64, yaw_deg: f64 },
}

/// What rooms are made of.
#[derive(Clone, Copy, Debug)]
pub(super) struct Workshop<'a> {
    /// Folder of furniture files.
    pub(super) furniture: &'a Path,
    /// Most pieces in a room.
    pub(super) pieces: usize,
}

/// Lowest and highest coordinates \[m\].
type Extent = (Vector3<f64>, Vector3<f64>);

impl Workshop<'_> {
    /// A room without a route.
    ///
    /// # Errors
    /// When a file of furniture is missing or wrong.
    pub(super) fn draw(&self, stream: &mut Stream) -> Result<Room, ConfigError> {
        let table = [TABLE_X_M, TABLE_Y_M].map(|range| within(stream, range, 100.0));
        let mut taken = vec![around_starts(), around_table(table)];
        let mut pieces = vec![Piece { kind: Kind::Table, at: [table[0], table[1], 0.0] }];
        let least = self.pieces.div_ceil(2);
        for _ in 0..least + stream.below((self.pieces - least) as u32 + 1) as usize {
            let kind = Kind::draw(stream);
            let extents = self.extents(kind)?;
            if let Some(at) = place(&extents, &taken, stream) {
                taken.extend(moved(&extents, at));
                pieces.push(Piece { kind, at });
            }
        }
        Ok(Room { goal: [table[0], table[1], GOAL_HEIGHT_M], pieces, route: Vec::new() })
    }

    /// Bounds of the parts of a piece that stands at the world's origin.
    fn extents(&self, kind: Kind) -> Result<Vec<Extent>, ConfigError> {
        let world = read(self.furniture, &furnishing(&[Piece { kind, at: [0.0; 3] }], ""))?;
        Ok(world.solids.iter().map(Solid::extent).collect())
    }
}

impl Kind {
    fn draw(stream: &mut Stream) -> Self {
        let share = stream.uniform();
        if share < PILLAR_SHARE {
            return Self::Pillar;
        }
        if share < PILLAR_SHARE + PARTITION_SHARE {
            return Self::Partition {
                thickness_m: within(stream, PARTITION_THICKNESS_M, 100.0),
                width_m: within(stream, PARTITION_WIDTH_M, 100.0),
                yaw_deg: within(stream, [-PARTITION_YAW_DEG, PARTITION_YAW_DEG], 1.0),
            };
        }
        let (file, scales) = FURNITURE[stream.below(FURNITURE.len() as u32) as usize];
        let yaw_deg = within(stream, [-180.0, 180.0], 1.0);
        Self::Furniture { file, yaw_deg, scale: within(stream, scales, 1000.0) }
    }
}

impl Room {
    /// What stands in it, as its file will say.
    ///
    /// # Errors
    /// When a file of furniture is missing or wrong.
    pub(super) fn world(&self, furniture: &Path) -> Result<World, ConfigError> {
        read(furniture, &contents(self, ""))
    }
}

/// The world of a text that imports furniture by its name only.
fn read(furniture: &Path, text: &str) -> Result<World, ConfigError> {
    let document = Document::parse(&furniture.join("a random room").display().to_string(), text)?;
    Ok(document.decode::<AviaryConfig>()?.place(&document.root())?.world)
}

/// A number of few digits, one part in `per_unit` apart; never −0.
fn within(stream: &mut Stream, [low, high]: [f32; 2], per_unit: f64) -> f64 {
    (f64::from(stream.between(low, high)) * per_unit).round() / per_unit + 0.0
}

/// A free place for a piece with these parts, if one is soon found.
fn place(extents: &[Extent], taken: &[Extent], stream: &mut Stream) -> Option<[f64; 3]> {
    let (low, high) = extents.iter().copied().reduce(|(low, high), (a, b)| (low.inf(&a), high.sup(&b)))?;
    let gap = Vector3::repeat(WALL_GAP_M);
    let (first, last) = (ROOM.low.cast() + gap - low, ROOM.high.cast() - gap - high);
    if first.x > last.x || first.y > last.y {
        return None;
    }
    let range = |axis: usize| [first[axis] as f32, last[axis] as f32];
    let lift = (-100.0 * low.z).max(0.0).ceil() / 100.0;
    (0..TRIES).find_map(|_| {
        let [x, y] = [0, 1].map(|axis| within(stream, range(axis), 100.0));
        let at = [x, y, lift];
        let apart = |part: &Extent| taken.iter().all(|other| !overlap(part, other));
        moved(extents, at).iter().all(apart).then_some(at)
    })
}

fn moved(extents: &[Extent], at: [f64; 3]) -> Vec<Extent> {
    let by = Vector3::from(at);
    extents.iter().map(|(low, high)| (low + by, high + by)).collect()
}

/// Whether two boxes have a point in common.
pub(super) fn overlap((low, high): &Extent, (other_low, other_high): &Extent) -> bool {
    (0..3).all(|axis| low[axis] <= other_high[axis] && other_low[axis] <= high[axis])
}

/// The air in which evaluations start.
fn around_starts() -> Extent {
    let reach = Vector3::repeat(START_REACH_M);
    upright(STARTS.low.cast() - reach, STARTS.high.cast() + reach)
}

/// The air above the table, and the table.
fn around_table([x, y]: [f64; 2]) -> Extent {
    let (middle, reach) = (Vector3::new(x, y, 0.0), Vector3::repeat(TABLE_REACH_M));
    upright(middle - reach, middle + reach)
}

/// A box from the floor to the ceiling.
fn upright(low: Vector3<f64>, high: Vector3<f64>) -> Extent {
    let height = f64::from(ROOM.high.z);
    (Vector3::new(low.x, low.y, 0.0), Vector3::new(high.x, high.y, height))
}
