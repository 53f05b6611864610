//! A furnished room as it is drawn: a table to reach, and pieces where there was a place for them.

use nalgebra::{Vector3, vector};

use crate::config::{Placement, pillar_around, turned};
use crate::seed::Stream;
use crate::world::{BOX_CONTACT_GAP, Cuboid, Floor, Pose, Role, Shape, Solid, World};

/// Corners of the room \[m\]: those of rooms 0 to 2, and of `configs/aviaries/parts/room.yaml`.
pub const ROOM: Cuboid = Cuboid { low: vector![-1.0, -1.5, 0.0], high: vector![7.0, 1.5, 1.5] };

/// Where the evaluations of `configs/aviaries/parts/room.yaml` start \[m\].
pub const STARTS: Cuboid = Cuboid { low: vector![-0.7, -0.3, 0.4], high: vector![-0.4, 0.3, 0.65] };

/// Thickness of the walls \[m\], as in room 0.
pub const WALL_M: f64 = 0.1;

/// Red, green and blue of the walls, as in room 0.
pub const WALL_COLOUR: [f32; 3] = [1.0, 0.4, 0.4];

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
pub(super) const TRIES: usize = 30;

/// Size of a partition: thickness and width \[m\], and how far it is turned from straight across \[degrees\].
const PARTITION_THICKNESS_M: [f32; 2] = [0.08, 0.16];
const PARTITION_WIDTH_M: [f32; 2] = [0.6, 1.7];
const PARTITION_YAW_DEG: f32 = 30.0;

/// Between a piece and a wall, at least \[m\].
const WALL_GAP_M: f64 = 0.01;

/// Of all pieces, the shares that are pillars and partitions; the rest is furniture.
const PILLAR_SHARE: f32 = 0.25;
const PARTITION_SHARE: f32 = 0.2;

/// A room and what stands in it.
#[derive(Clone, Debug, PartialEq)]
pub struct RoomPlan {
    /// Where the drone shall go \[m\].
    pub goal: [f64; 3],
    /// What stands there, the table first.
    pub pieces: Vec<Piece>,
}

/// One thing on the floor; lengths in centimetres, angles in degrees, both whole.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// What it is.
    pub kind: Kind,
    /// Its origin \[m\], lifted where it would reach below the floor.
    pub at: [f64; 3],
}

/// What a piece is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// What to land on.
    Table,
    /// One of the workshop's models.
    Furniture {
        /// Which.
        model: usize,
        /// How far it is turned, counter-clockwise \[degrees\].
        yaw_deg: f64,
        /// How many times larger it is than its model.
        scale: f64,
    },
    /// One of the reference's.
    Pillar,
    /// A box from the floor to the ceiling.
    Partition {
        /// \[m\].
        thickness_m: f64,
        /// \[m\].
        width_m: f64,
        /// How far it is turned from straight across \[degrees\].
        yaw_deg: f64,
    },
}

/// What furnished rooms are made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Workshop {
    /// Parts of the table, in its own frame.
    pub table: Vec<Solid>,
    /// Pieces of furniture, at least one.
    pub furniture: Vec<Model>,
    /// Most pieces in a room.
    pub pieces: usize,
}

/// A piece of furniture.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Its parts, in its own frame.
    pub parts: Vec<Solid>,
    /// Least and greatest scale.
    pub scales: [f32; 2],
}

/// Lowest and highest coordinates \[m\].
pub type Extent = (Vector3<f64>, Vector3<f64>);

impl Workshop {
    /// A room, with at least half of `pieces`, as far as they find a place, and not more.
    pub fn draw(&self, pieces: usize, stream: &mut Stream) -> RoomPlan {
        let table = [TABLE_X_M, TABLE_Y_M].map(|range| within(stream, range, 100.0));
        let mut taken = vec![around_starts(START_REACH_M), around_table(table)];
        let mut placed = vec![Piece { kind: Kind::Table, at: [table[0], table[1], 0.0] }];
        let least = pieces.div_ceil(2);
        for _ in 0..least + stream.below((pieces - least) as u32 + 1) as usize {
            let kind = self.kind(stream);
            let extents: Vec<Extent> =
                self.solids(&Piece { kind, at: [0.0; 3] }).iter().map(Solid::extent).collect();
            if let Some(at) = place(&extents, &taken, stream) {
                taken.extend(moved(&extents, at));
                placed.push(Piece { kind, at });
            }
        }
        RoomPlan { goal: [table[0], table[1], GOAL_HEIGHT_M], pieces: placed }
    }

    /// What stands in a room: walls, partitions, pillars, furniture.
    pub fn world(&self, plan: &RoomPlan) -> World {
        let rank = |piece: &&Piece| match piece.kind {
            Kind::Partition { .. } => 0,
            Kind::Pillar => 1,
            Kind::Table | Kind::Furniture { .. } => 2,
        };
        let mut pieces: Vec<&Piece> = plan.pieces.iter().collect();
        pieces.sort_by_key(rank);
        let solids =
            walls(&ROOM).into_iter().chain(pieces.into_iter().flat_map(|piece| self.solids(piece))).collect();
        World { floor: Floor::Solid, solids, ..World::empty() }
    }

    /// Where goals can be \[m\].
    pub fn goals() -> Cuboid {
        let corner = |end: usize| Vector3::new(TABLE_X_M[end], TABLE_Y_M[end], GOAL_HEIGHT_M as f32);
        Cuboid { low: corner(0), high: corner(1) }
    }

    /// The air around the starts that is free in every room \[m\].
    pub fn kept_free() -> Cuboid {
        let (low, high) = around_starts(START_REACH_M);
        Cuboid { low: low.cast(), high: high.cast() }
    }

    fn kind(&self, stream: &mut Stream) -> Kind {
        let share = stream.uniform();
        if share < PILLAR_SHARE {
            return Kind::Pillar;
        }
        if share < PILLAR_SHARE + PARTITION_SHARE {
            return Kind::Partition {
                thickness_m: within(stream, PARTITION_THICKNESS_M, 100.0),
                width_m: within(stream, PARTITION_WIDTH_M, 100.0),
                yaw_deg: within(stream, [-PARTITION_YAW_DEG, PARTITION_YAW_DEG], 1.0),
            };
        }
        let model = stream.below(self.furniture.len() as u32) as usize;
        let yaw_deg = within(stream, [-180.0, 180.0], 1.0);
        Kind::Furniture { model, yaw_deg, scale: within(stream, self.furniture[model].scales, 1000.0) }
    }

    /// The bodies of a piece \[m, world\].
    fn solids(&self, piece: &Piece) -> Vec<Solid> {
        let [x, y, _] = piece.at;
        let placed = |parts: &[Solid], yaw_deg, scale| {
            let placement = Placement::new(piece.at, yaw_deg, scale);
            parts.iter().map(|part| placement.apply(part.clone())).collect()
        };
        match piece.kind {
            Kind::Table => placed(&self.table, 0.0, 1.0),
            Kind::Furniture { model, yaw_deg, scale } => placed(&self.furniture[model].parts, yaw_deg, scale),
            Kind::Pillar => vec![pillar_around([x, y])],
            Kind::Partition { thickness_m, width_m, yaw_deg } => {
                let height = f64::from(ROOM.high.z);
                let pose = Pose {
                    position: Vector3::new(x, y, height / 2.0),
                    world_from_body: turned(Vector3::new(0.0, 0.0, yaw_deg)),
                };
                let half = Vector3::new(thickness_m, width_m, height) / 2.0;
                vec![upright_solid("partition", half, pose, [0.6; 3])]
            }
        }
    }
}

/// Walls around a room, as `RoomConfig` has them.
pub(super) fn walls(room: &Cuboid) -> Vec<Solid> {
    let (low, high): (Vector3<f64>, Vector3<f64>) = (room.low.cast(), room.high.cast());
    let side = |name: &str, low_x: f64, low_y: f64, high_x: f64, high_y: f64| {
        let (low, high) = (Vector3::new(low_x, low_y, low.z), Vector3::new(high_x, high_y, high.z));
        upright_solid(name, (high - low) / 2.0, Pose::at((low + high) / 2.0), WALL_COLOUR)
    };
    vec![
        side("back wall", low.x - WALL_M, low.y - WALL_M, low.x, high.y + WALL_M),
        side("front wall", high.x, low.y - WALL_M, high.x + WALL_M, high.y + WALL_M),
        side("right wall", low.x, low.y - WALL_M, high.x, low.y),
        side("left wall", low.x, high.y, high.x, high.y + WALL_M),
    ]
}

fn upright_solid(name: &str, half: Vector3<f64>, pose: Pose, colour: [f32; 3]) -> Solid {
    Solid {
        name: name.to_owned(),
        shape: Shape::Cuboid(half),
        pose,
        role: Role::Obstacle,
        friction: 0.5,
        contact_gap: BOX_CONTACT_GAP,
        colour,
        visual: None,
    }
}

/// A number of few digits, one part in `per_unit` apart; never −0.
pub(super) fn within(stream: &mut Stream, [low, high]: [f32; 2], per_unit: f64) -> f64 {
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
pub fn overlap((low, high): &Extent, (other_low, other_high): &Extent) -> bool {
    (0..3).all(|axis| low[axis] <= other_high[axis] && other_low[axis] <= high[axis])
}

/// The air so far around that in which evaluations start \[m\].
pub(super) fn around_starts(reach: f64) -> Extent {
    let reach = Vector3::repeat(reach);
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
