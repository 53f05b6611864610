//! Worlds of which every episode draws one.

use std::sync::Arc;

use kestrel_core::airframe::Airframe;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::ConfigError;
use super::field::{Field, Limits};
use super::geometry::surrounds;
use super::world::{FurnitureConfig, SCALES};
use super::{AviaryConfig, GoalsConfig, ScenarioConfig, SensorConfig, StartConfig, SuccessConfig};
use crate::physics::{Contacts, Physics};
use crate::rooms::{
    Corridors, Forest, Furnisher, Model, ROOM, Raceway, Rearranger, RoomPlanner, RoomRange, Rooms, Workshop,
};
use crate::scenario::{FirstGoals, Place, Start, StartPosition};
use crate::seed::Seed;
use crate::termination::Termination;
use crate::world::{Cuboid, Solid};

/// Most worlds of a range.
const WORLDS_LIMIT: u64 = 100_000;

/// Most pieces that may be asked for: far fewer find a place.
const PIECES_LIMIT: u64 = 100;

/// Most models of furniture.
const MODELS_LIMIT: usize = 100;

/// Where a file says nothing: as `kestrel aviary generate`.
const PIECES: u64 = 14;

/// Most gates and posts that the hall has room for.
const GATES_LIMIT: u64 = 8;
const POSTS_LIMIT: u64 = 20;

/// Radius of the thickest trunk \[m\].
const TRUNK_LIMIT_M: f64 = 0.5;

/// Most people of a forest: more find no room to walk.
const PEOPLE_LIMIT: u64 = 12;

/// Without half of the walls hardly a draw is left whose way is not straight.
const LOOPS_LIMIT: f64 = 0.5;

/// Furniture is moved so far.
const SHIFT: Limits = Limits::from(0.01, 2.0, "m");

/// Openings of gates: the line through them keeps 24 cm from their frames.
const OPENING_LIMIT_M: f64 = 1.2;
const OPENING: Limits = Limits::from(0.5, OPENING_LIMIT_M, "m");

/// Worlds of which every episode draws one.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DrawnConfig {
    /// Which worlds.
    pub worlds: WorldsConfig,
    /// What makes them.
    pub from: GeneratorConfig,
}

/// A range of worlds: number `k` of a seed is the same world in every range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WorldsConfig {
    /// What everything random in them follows from.
    #[serde(default)]
    pub seed: u64,
    /// Number of the first.
    #[serde(default)]
    pub first: u64,
    /// How many: 1 to 100,000.
    pub count: u64,
}

/// What makes worlds.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum GeneratorConfig {
    /// Rooms like rooms 0 to 2, as `kestrel aviary generate` makes them.
    FurnishedRooms(FurnishedRoomsConfig),
    /// One room whose furniture stands elsewhere each time.
    MovedFurniture(MovedFurnitureConfig),
    /// Courses of gates to race through.
    RaceCourses(RaceCoursesConfig),
    /// Trunks to fly between.
    Forest(ForestConfig),
    /// Passages at right angles, some of them blind.
    Corridors(CorridorsConfig),
}

/// Trunks, from the floor to the ceiling, in a hall of 20 x 6 x 2.5 m with its origin a metre from the end at which flights
/// start. They stand from x = 1 to 16.5 m, the goal behind them, at x = 17.8 m. Every forest has a way that keeps 20 cm from
/// everything; where 30 draws leave none, the next have a trunk less.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ForestConfig {
    /// How dense it is.
    pub trunks_per_square_metre: f64,
    /// Least and greatest radius of a trunk.
    pub radius_m: [f64; 2],
    /// How many people walk to and fro among them, at most 12: cylinders of 50 cm across and 1.75 m, each on a straight line of
    /// 1.5 to 5 m that no trunk touches. People do not look where they go.
    pub people: u64,
    /// How fast they walk.
    pub walking_m_per_s: f64,
}

impl Default for ForestConfig {
    /// A straight line through it hits a trunk in five cases of six, by the area that a Crazyflie sweeps.
    fn default() -> Self {
        Self { trunks_per_square_metre: 0.3, radius_m: [0.08, 0.2], people: 0, walking_m_per_s: 1.0 }
    }
}

impl ForestConfig {
    fn check(&self, field: &Field<'_>) -> Result<Forest, ConfigError> {
        let radius = field.at("radius_m");
        let [low, high] = self.radius_m;
        let low = radius.at(0).number(low, &Limits::from(0.02, TRUNK_LIMIT_M, "m"))?;
        let high = radius.at(1).number(high, &Limits::from(self.radius_m[0], TRUNK_LIMIT_M, "m"))?;
        let density = field.at("trunks_per_square_metre");
        Ok(Forest {
            density: density.number(self.trunks_per_square_metre, &Limits::from(0.0, 1.0, "per m²"))?,
            radii: [low, high],
            people: field.at("people").whole(self.people, 0..=PEOPLE_LIMIT)? as u32,
            walking_speed: field
                .at("walking_m_per_s")
                .number(self.walking_m_per_s, &Limits::from(0.1, 3.0, "m/s"))?,
        })
    }
}

/// Passages a metre wide, from the middle of a wall to the next, at right angles in a hall of 12 x 4 x 1.5 m with its origin a
/// metre from the end at which flights start. Both ends are open across the hall, for a metre; the goal lies in the far one, at
/// x = 10.5 m. Every square of a metre between them can be reached, and no straight line leads to the goal.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CorridorsConfig {
    /// Share of the walls that are left out, 0 to 1: with none there is one way between any two squares, and each that does not
    /// lead to the goal is blind.
    pub loops: f64,
}

impl Default for CorridorsConfig {
    fn default() -> Self {
        Self { loops: 0.2 }
    }
}

impl CorridorsConfig {
    fn check(&self, field: &Field<'_>) -> Result<Corridors, ConfigError> {
        let loops = field.at("loops").number(self.loops, &Limits::from(0.0, LOOPS_LIMIT, ""))?;
        Ok(Corridors { loops })
    }
}

/// Gates, each 1.5 to 3.5 m ahead of the one before, and posts between them, in a hall of 10 x 6 x 2.5 m with its origin a metre
/// from the end at which races start. Every course has a line from gate to gate, of straight legs that keep 24 cm from
/// everything. Its goals are its gates, in their order.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RaceCoursesConfig {
    /// Least and greatest number of gates.
    pub gates: [u64; 2],
    /// Least and greatest width and height of their openings.
    pub opening_m: [f64; 2],
    /// Most posts, from the floor to the ceiling, 16 cm thick.
    pub posts: u64,
}

impl Default for RaceCoursesConfig {
    fn default() -> Self {
        Self { gates: [4, 6], opening_m: [0.6, 0.9], posts: 6 }
    }
}

impl RaceCoursesConfig {
    fn check(&self, field: &Field<'_>) -> Result<Raceway, ConfigError> {
        let gates = field.at("gates");
        let least = gates.at(0).whole(self.gates[0], 1..=GATES_LIMIT)?;
        let most = gates.at(1).whole(self.gates[1], least..=GATES_LIMIT)?;
        let opening = field.at("opening_m");
        let [low, high] = self.opening_m;
        let low = opening.at(0).number(low, &OPENING)?;
        let high = opening.at(1).number(high, &Limits::from(self.opening_m[0], OPENING_LIMIT_M, "m"))?;
        Ok(Raceway {
            gates: [least as u32, most as u32],
            opening: [low, high],
            posts: field.at("posts").whole(self.posts, 0..=POSTS_LIMIT)? as u32,
        })
    }
}

/// Furniture, the reference's pillars and partitions between the start at the left end of a room of 8 x 3 x 1.5 m and a
/// table in its far third. Every room has a free way to the table, which is not straight.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FurnishedRoomsConfig {
    /// Most things in a room beside the table; at least half as many stand there, as far as they find a place and leave
    /// a way.
    #[serde(default = "pieces")]
    pub pieces: u64,
    /// What to land on; its `at_m`, `yaw_deg` and `scale` are not heeded.
    pub table: FurnitureConfig,
    /// What stands around; a quarter of all things are pillars and a fifth partitions.
    pub furniture: Vec<ModelConfig>,
}

/// A room in which everything but what to land on is moved, each piece by its own draw. None stands in another or in a wall
/// unless it does so in the room itself, none within 20 cm of the starts, and a way that keeps 12 cm from everything is left.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MovedFurnitureConfig {
    /// The room, usually imported, with a goal.
    pub room: Box<AviaryConfig>,
    /// Farthest along x, and along y: 0.01 to 2 m. Where 30 draws leave no way, the next reach a tenth less far.
    pub shift_m: f64,
}

impl MovedFurnitureConfig {
    fn check(&self, airframe: &Airframe, bounds: Cuboid, field: &Field<'_>) -> Result<Rearranger, ConfigError> {
        let (aviary, pieces) = self.room.with_pieces_apart(airframe, &field.at("room"))?;
        let shift_m = field.at("shift_m").number(self.shift_m, &SHIFT)?;
        let rearranger = Rearranger { aviary, pieces, shift_m, bounds, radius: airframe.collision_radius };
        match rearranger.unmoved() {
            Some(_) => Ok(rearranger),
            None => Err(field.at("room").reject(
                "a room whose starts are not free, or without a free way",
                "one that keeps 20 cm around the starts free, and has a way that keeps 12 cm from everything",
            )),
        }
    }
}

/// A piece of furniture that is drawn turned and scaled.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// The piece; its `at_m`, `yaw_deg` and `scale` are not heeded.
    pub piece: FurnitureConfig,
    /// Least and greatest scale.
    pub scales: [f64; 2],
}

const fn pieces() -> u64 {
    PIECES
}

impl WorldsConfig {
    /// The range.
    ///
    /// # Errors
    /// When it has no world or too many.
    pub fn check(&self, field: &Field<'_>) -> Result<RoomRange, ConfigError> {
        let count = field.at("count").whole(self.count, 1..=WORLDS_LIMIT)?;
        let first = field.at("first").whole(self.first, 0..=u64::from(u32::MAX) - count)?;
        Ok(RoomRange { seed: Seed(self.seed), first: first as u32, count: count as u32 })
    }
}

impl DrawnConfig {
    /// The worlds of a task that ends like this.
    ///
    /// # Errors
    /// When a number is out of range or a piece of furniture is wrong.
    pub(super) fn check(
        &self,
        airframe: &Airframe,
        bounds: Option<Cuboid>,
        field: &Field<'_>,
    ) -> Result<Arc<Rooms>, ConfigError> {
        let range = self.worlds.check(&field.at("worlds"))?;
        let field = field.at("from");
        let bounds = bounds.unwrap_or(ROOM);
        let planner = match &self.from {
            GeneratorConfig::FurnishedRooms(furnished) => RoomPlanner::Furnished(Furnisher {
                workshop: furnished.check(&field.at("furnished_rooms"))?,
                bounds,
                radius: airframe.collision_radius,
            }),
            GeneratorConfig::MovedFurniture(moved) => {
                RoomPlanner::Moved(moved.check(airframe, bounds, &field.at("moved_furniture"))?)
            }
            GeneratorConfig::Forest(forest) => {
                RoomPlanner::Forest(forest.check(&field.at("forest"))?, airframe.collision_radius)
            }
            GeneratorConfig::Corridors(corridors) => {
                RoomPlanner::Corridors(corridors.check(&field.at("corridors"))?, airframe.collision_radius)
            }
            GeneratorConfig::RaceCourses(courses) => RoomPlanner::Race(courses.check(&field.at("race_courses"))?),
        };
        Ok(Arc::new(Rooms::new(planner, range)))
    }
}

impl FurnishedRoomsConfig {
    fn check(&self, field: &Field<'_>) -> Result<Workshop, ConfigError> {
        let models = field.at("furniture");
        if !(1..=MODELS_LIMIT).contains(&self.furniture.len()) {
            return Err(models.refuse("", format!("a list of 1 to {MODELS_LIMIT} pieces")));
        }
        let model = |(index, model): (usize, &ModelConfig)| model.check(&models.at(index));
        Ok(Workshop {
            table: parts(&self.table, &field.at("table"))?,
            furniture: self.furniture.iter().enumerate().map(model).collect::<Result<_, _>>()?,
            pieces: field.at("pieces").whole(self.pieces, 1..=PIECES_LIMIT)? as usize,
        })
    }
}

impl ModelConfig {
    fn check(&self, field: &Field<'_>) -> Result<Model, ConfigError> {
        let scales = field.at("scales");
        let [least, most] = self.scales;
        let least = scales.at(0).number(least, &SCALES)?;
        let most = scales.at(1).number(most, &Limits::from(self.scales[0], 1e4, ""))?;
        Ok(Model { parts: parts(&self.piece, &field.at("piece"))?, scales: [least, most] })
    }
}

/// The parts of a piece, which look as they are: cameras see their bodies, not their meshes.
fn parts(piece: &FurnitureConfig, field: &Field<'_>) -> Result<Vec<Solid>, ConfigError> {
    let parts = piece.parts(field)?.into_iter();
    Ok(parts.map(|part| Solid { visual: None, ..part }).collect())
}

impl ScenarioConfig {
    /// The worlds of which episodes draw theirs, if they do.
    pub(super) fn drawn_rooms(
        &self,
        airframe: &Airframe,
        field: &Field<'_>,
    ) -> Result<Option<Arc<Rooms>>, ConfigError> {
        let Some(drawn) = &self.aviary.drawn else { return Ok(None) };
        let field = field.at("aviary");
        if let Some(key) = self.aviary.key_of_one_world() {
            return Err(field.at(key).reject("a key beside `drawn`", "none: `drawn` says everything"));
        }
        let bounds = self.terminations.iter().find_map(Termination::bounds);
        drawn.check(airframe, bounds, &field.at("drawn")).map(Some)
    }

    /// Refuses what has no meaning, or none yet, where every episode is in another world.
    pub(super) fn check_drawn(&self, physics: &Physics, field: &Field<'_>) -> Result<(), ConfigError> {
        let Some(drawn) = &self.aviary.drawn else { return Ok(()) };
        let one = |key: &str, found: &str, expected: &str| Err(field.at(key).reject(found, expected));
        if let GeneratorConfig::Forest(ForestConfig { people: 1.., .. }) = drawn.from
            && self.sensors.iter().any(|sensor| matches!(sensor, SensorConfig::Scan(_)))
        {
            return one("sensors", "a `scan` among people", "`tof`, which sees them: beams see what never moves");
        }
        self.check_goals_in_drawn(drawn, &field.at("goals"))?;
        match self.success {
            SuccessConfig::Reach { .. } | SuccessConfig::Visit { .. } => {
                return one("success", "a region beside `aviary.drawn`", "`ending` or `settle`");
            }
            SuccessConfig::Ending | SuccessConfig::Settle { .. } => {}
        }
        match physics.contacts {
            Contacts::Absent | Contacts::Reported => Ok(()),
            Contacts::Solved => {
                let expected = "`reported`, or a termination `collision`: drawn worlds push nothing";
                Err(field.at("physics").at("contacts").reject("solved contacts beside `aviary.drawn`", expected))
            }
        }
    }
}

impl ScenarioConfig {
    /// Refuses goals in drawn worlds but those of a team behind the trunks of a forest, each of which is free in all of them.
    fn check_goals_in_drawn(&self, drawn: &DrawnConfig, field: &Field<'_>) -> Result<(), ConfigError> {
        match (&self.goals, &drawn.from) {
            (None, _) => Ok(()),
            (Some(GoalsConfig::PerAgent { points_m }), GeneratorConfig::Forest(_)) => {
                let field = field.at("per_agent").at("points_m");
                let free = Forest::kept_free_for_goals();
                let in_reach = |point: &[f64; 3]| {
                    (0..3).all(|axis| (free.low[axis]..=free.high[axis]).contains(&(point[axis] as f32)))
                };
                match points_m.iter().position(|point| !in_reach(point)) {
                    None => Ok(()),
                    Some(index) => {
                        let Cuboid { low, high } = free;
                        let expected = format!(
                            "one behind the trunks: x from {} to {} m, y from {} to {} m, z from {} to {} m",
                            low.x, high.x, low.y, high.y, low.z, high.z
                        );
                        Err(field.at(index).reject("a goal that may be in a trunk or a wall", expected))
                    }
                }
            }
            (Some(_), _) => Err(field.reject(
                "goals beside `aviary.drawn`",
                "none: every drawn world has its own; a team has `per_agent` ones in a `forest`",
            )),
        }
    }
}

impl StartConfig {
    /// As [`Self::check`], in all of these rooms.
    ///
    /// # Errors
    /// As there, and when rooms do not promise that a start is free.
    pub fn check_in_rooms(
        &self,
        rooms: &Rooms,
        airframe: &Airframe,
        terminations: &[Termination],
        goals: &FirstGoals<'_>,
        field: &Field<'_>,
    ) -> Result<Start, ConfigError> {
        let mut start = self.check(&rooms.bare(), airframe, terminations, goals, field)?;
        settle_start(&mut start, &rooms.kept_free(), airframe.collision_radius as f32, field)?;
        Ok(start)
    }
}

/// Refuses starts of which drawn rooms do not promise that they are free, and makes sure of a free place.
fn settle_start(start: &mut Start, free: &Cuboid, radius: f32, field: &Field<'_>) -> Result<(), ConfigError> {
    let within = |clearance: f32| Cuboid {
        low: free.low + Vector3::new(clearance, clearance, 0.0),
        high: free.high - Vector3::new(clearance, clearance, 0.0),
    };
    let position = field.at("position");
    let shown = |Cuboid { low, high }: Cuboid| {
        format!("x from {} to {} m and y from {} to {} m", low.x, high.x, low.y, high.y)
    };
    match &mut start.position {
        StartPosition::Within(region) => {
            let promised = within(radius);
            if surrounds(&promised, region) {
                return Ok(());
            }
            let expected = format!("inside {}, which all drawn rooms keep free", shown(promised));
            Err(position.at("within").reject("a box in which something may stand", expected))
        }
        StartPosition::FreeWithin(space) => {
            let promised = within(space.clearance_m);
            let (low, high) = (space.region.low.sup(&promised.low), space.region.high.inf(&promised.high));
            if (high - low).min() < 0.0 {
                let expected = format!("one that reaches {}, which all drawn rooms keep free", shown(promised));
                return Err(position.at("free_within").reject("a box in which all may be occupied", expected));
            }
            space.refuge = (low + high) / 2.0;
            Ok(())
        }
        StartPosition::Exactly(places) => {
            let around = |place: &Place| Cuboid {
                low: place.position.cast().add_scalar(-place.spread),
                high: place.position.cast().add_scalar(place.spread),
            };
            let promised = within(radius);
            match places.iter().position(|place| !surrounds(&promised, &around(place))) {
                None => Ok(()),
                Some(index) => {
                    let expected = format!("inside {}, which all drawn rooms keep free", shown(promised));
                    let found = "a place where something may stand";
                    Err(position.at("exactly").at(index).reject(found, expected))
                }
            }
        }
        StartPosition::AroundGoal { .. } | StartPosition::AlongWay(_) => {
            Err(position.reject("another start beside `aviary.drawn`", "`within`, `exactly` or `free_within`"))
        }
    }
}
