//! Rooms of which every episode draws one, and what stands around each lane of a block.

mod corridors;
mod forest;
mod furnishing;
mod moving;
mod racing;
#[cfg(test)]
pub(crate) mod tests;

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use kestrel_core::airframe::Airframe;
use kestrel_core::real::Real;

pub use corridors::Corridors;
pub use forest::Forest;
pub use moving::Rearranger;
pub use racing::Raceway;

pub use furnishing::{Extent, Kind, Model, Piece, ROOM, RoomPlan, STARTS, WALL_COLOUR, WALL_M, Workshop, overlap};

use crate::contact::{Arena, ContactReport, DistanceField, Motion, Passage};
use crate::scenario::Aviary;
use crate::seed::{Purpose, Seed, Stream};
use crate::sensor::Scan;
use crate::swarm::Column;
use crate::world::{Cuboid, World};

/// Least distance between the way to the goal and everything else \[m\]: a Crazyflie's hull has a radius of 0.06 m.
pub const CLEARANCE_M: f64 = 0.2;

/// Draws of a room before the next have a piece less; of the first thirty with fourteen pieces one had no free way.
const DRAWS: u32 = 30;

/// Where an episode can be, and the ways to the goal there.
#[derive(Clone, Debug)]
pub struct Room {
    /// The place, with its goal.
    pub aviary: Aviary,
    /// The ways to that goal; none where a course leads from gate to gate.
    pub ways: Option<Arc<DistanceField>>,
    /// Axis-aligned bounds of what stands there.
    pub obstacles: Vec<Cuboid>,
}

/// Which rooms they are; the numbers of two ranges of one seed are those of different rooms unless they overlap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RoomRange {
    /// What everything random in them follows from.
    pub seed: Seed,
    /// Number of the first.
    pub first: u32,
    /// How many, at least one.
    pub count: u32,
}

/// What rooms are drawn from: room `k` of a seed is the same in every range.
#[derive(Clone, Debug, PartialEq)]
pub enum RoomPlanner {
    /// Furniture between the start and a table.
    Furnished(Furnisher),
    /// One room, its furniture moved.
    Moved(Rearranger),
    /// Courses of gates.
    Race(Raceway),
    /// Trunks between the start and a goal, for hulls of this radius \[m\].
    Forest(Forest, f64),
    /// Walls between the start and a goal, for hulls of this radius \[m\].
    Corridors(Corridors, f64),
}

/// What furnished rooms are drawn from.
#[derive(Clone, Debug, PartialEq)]
pub struct Furnisher {
    /// What they are made of.
    pub workshop: Workshop,
    /// In which the ways lead \[m, world\].
    pub bounds: Cuboid,
    /// Of the drone's hull, for which the ways are \[m\].
    pub radius: f64,
}

/// Rooms of which every episode draws one, each made when the first drone comes in. Environment `e` begins in room `e`
/// modulo their number, so that an evaluation flies all equally often; later episodes draw from the stream of their drone.
#[derive(Debug)]
pub struct Rooms {
    planner: RoomPlanner,
    range: RoomRange,
    made: Arc<[OnceLock<Room>]>,
    arenas: Mutex<Vec<Arc<RoomArenas>>>,
}

/// The ways to the goal: of the task's one place, or of each room that it draws.
#[derive(Clone, Debug, PartialEq)]
pub enum Ways {
    /// There is one place.
    Same(Arc<DistanceField>),
    /// Every room has its own.
    Drawn(Arc<Rooms>),
}

/// What stands around the drones of a simulation.
#[derive(Clone, Debug)]
pub(crate) enum Arenas {
    /// The same around all.
    Same(Arc<Arena>),
    /// To each lane its room.
    Drawn(Arc<RoomArenas>),
}

/// What is around the drones of a block.
#[derive(Clone, Copy)]
pub(crate) struct Around<'a> {
    /// What never moves, if anything is looked at or touched.
    pub(crate) arenas: Option<&'a Arenas>,
    /// The bodies that do, by lane.
    pub(crate) movables: &'a [Vec<Motion>],
}

/// The arenas of some rooms for one airframe.
#[derive(Debug)]
pub(crate) struct RoomArenas {
    rooms: Arc<[OnceLock<Room>]>,
    airframe: Airframe,
    report: ContactReport,
    scan: Option<Scan>,
    arenas: Vec<OnceLock<Arena>>,
}

impl PartialEq for Rooms {
    fn eq(&self, other: &Self) -> bool {
        self.planner == other.planner && self.range == other.range
    }
}

impl RoomRange {
    /// Whether the two have a room in common.
    pub fn overlaps(&self, other: &Self) -> bool {
        let end = |range: &Self| u64::from(range.first) + u64::from(range.count);
        self.seed == other.seed && u64::from(self.first) < end(other) && u64::from(other.first) < end(self)
    }
}

impl RoomPlanner {
    /// Room `number` of a seed: one with a free way to the goal, which among drawn furniture is not straight, or from gate to
    /// gate. It has fewer pieces or posts, or they are moved less, where many leave none.
    pub fn room(&self, seed: Seed, number: u32) -> Room {
        let mut stream = Stream::new(seed, number, Purpose::Furnishing);
        let mut most = match self {
            Self::Furnished(furnisher) => furnisher.workshop.pieces as u32,
            Self::Moved(_) => moving::TENTHS,
            Self::Race(raceway) => raceway.posts,
            Self::Forest(forest, _) => forest.trunks(),
            Self::Corridors(..) => 0,
        };
        loop {
            let mut draw = || match self {
                Self::Furnished(furnisher) => furnisher.draw(most as usize, &mut stream),
                Self::Moved(rearranger) => rearranger.draw(most, &mut stream),
                Self::Race(raceway) => raceway.draw(most, &mut stream).map(Room::of_course),
                Self::Forest(forest, radius) => {
                    let place = forest.draw(most, &mut stream);
                    place.map(|(world, goal)| Room::with_ways(world, goal, forest::HALL, *radius))
                }
                Self::Corridors(corridors, radius) => {
                    let place = corridors.draw(&mut stream);
                    place.map(|(world, goal)| Room::with_ways(world, goal, corridors::HALL, *radius))
                }
            };
            if let Some(room) = (0..DRAWS).find_map(|_| draw()) {
                return room;
            }
            most = most.saturating_sub(1);
        }
    }

    /// Where goals can be \[m\].
    fn goals(&self) -> Cuboid {
        match self {
            Self::Furnished(_) => Workshop::goals(),
            Self::Moved(rearranger) => Cuboid { low: rearranger.aviary.goal, high: rearranger.aviary.goal },
            Self::Race(_) => Raceway::goals(),
            Self::Forest(..) => Forest::goals(),
            Self::Corridors(..) => Corridors::goals(),
        }
    }

    /// Whether goals are gates to pass.
    fn is_race(&self) -> bool {
        matches!(self, Self::Race(_))
    }
}

impl Room {
    /// A place with the ways to a goal \[m, world\] that lead within these bounds, for a hull of this radius \[m\].
    fn with_ways(world: World, goal: nalgebra::Vector3<f32>, bounds: Cuboid, radius: f64) -> Self {
        let ways = Arc::new(DistanceField::new(&world, &goal, bounds, radius).coarse());
        Self { obstacles: world.bounds(), ways: Some(ways), aviary: Aviary { world, ..Aviary::empty(goal) } }
    }

    fn of_course(aviary: Aviary) -> Self {
        Self { obstacles: aviary.world.bounds(), ways: None, aviary }
    }
}

impl Furnisher {
    fn draw(&self, pieces: usize, stream: &mut Stream) -> Option<Room> {
        // A table alone has a straight way.
        self.furnished(&self.workshop.draw(pieces, stream), |straight| straight == (pieces == 0))
    }

    /// The room of a plan, if it has a free way that is straight or is not, as `asked`.
    fn furnished(&self, plan: &RoomPlan, asked: impl Fn(bool) -> bool) -> Option<Room> {
        let world = self.workshop.world(plan);
        let goal = nalgebra::Vector3::from(plan.goal).cast();
        let passage = Passage { world: &world, bounds: ROOM, starts: STARTS, goal, clearance_m: CLEARANCE_M };
        if !asked(passage.is_straight()) || !passage.is_free() {
            return None;
        }
        Some(Room::with_ways(world, goal, self.bounds, self.radius))
    }
}

impl Rooms {
    /// The rooms of a range.
    pub fn new(planner: RoomPlanner, range: RoomRange) -> Self {
        let made = (0..range.count).map(|_| OnceLock::new()).collect();
        Self { planner, range, made, arenas: Mutex::default() }
    }

    /// Other rooms of the same kind.
    #[must_use]
    pub fn elsewhere(&self, range: RoomRange) -> Self {
        Self::new(self.planner.clone(), range)
    }

    /// A room in which nothing stands; its goal is that of the first.
    pub(crate) fn bare(&self) -> Aviary {
        let goal = self.room(0).aviary.goal;
        let world = match &self.planner {
            RoomPlanner::Furnished(furnisher) => {
                furnisher.workshop.world(&RoomPlan { goal: goal.cast().into(), pieces: Vec::new() })
            }
            RoomPlanner::Moved(rearranger) => rearranger.aviary.world.clone(),
            RoomPlanner::Race(_) => Raceway::bare(),
            RoomPlanner::Forest(..) => Forest::bare(),
            RoomPlanner::Corridors(..) => Corridors::bare(),
        };
        Aviary { world, ..Aviary::empty(goal) }
    }

    /// Where goals can be \[m, world\].
    pub(crate) fn goals(&self) -> Cuboid {
        self.planner.goals()
    }

    /// The air around the starts that is free in every room \[m, world\].
    pub(crate) fn kept_free(&self) -> Cuboid {
        match self.planner {
            RoomPlanner::Furnished(_) | RoomPlanner::Race(_) => Workshop::kept_free(),
            RoomPlanner::Moved(_) => Rearranger::kept_free(),
            RoomPlanner::Forest(..) => Forest::kept_free(),
            RoomPlanner::Corridors(..) => Corridors::kept_free(),
        }
    }

    /// Whether goals are gates to pass.
    pub(crate) fn is_race(&self) -> bool {
        self.planner.is_race()
    }

    /// Which they are.
    pub fn range(&self) -> RoomRange {
        self.range
    }

    /// Room `index` of the range.
    ///
    /// # Panics
    /// When there is none.
    pub fn room(&self, index: u32) -> &Room {
        let draw = || self.planner.room(self.range.seed, self.range.first + index);
        self.made[index as usize].get_or_init(draw)
    }

    /// The same arenas for everybody who asks with the same airframe.
    fn arenas(&self, airframe: &Airframe, report: ContactReport, scan: Option<&Scan>) -> Arc<RoomArenas> {
        // A panic elsewhere leaves the list as it was: it is only ever changed as a whole.
        let mut known = self.arenas.lock().unwrap_or_else(PoisonError::into_inner);
        let fits = |arenas: &&Arc<RoomArenas>| {
            arenas.airframe == *airframe && arenas.report == report && arenas.scan.as_ref() == scan
        };
        if let Some(arenas) = known.iter().find(fits) {
            return Arc::clone(arenas);
        }
        let arenas = Arc::new(RoomArenas {
            rooms: Arc::clone(&self.made),
            airframe: *airframe,
            report,
            scan: scan.cloned(),
            arenas: (0..self.made.len()).map(|_| OnceLock::new()).collect(),
        });
        known.push(Arc::clone(&arenas));
        arenas
    }
}

/// Every reset asks for its room before anything looks at it.
#[inline(always)]
fn entered(rooms: &[OnceLock<Room>], index: usize) -> &Room {
    rooms[index].get().expect("a drone that is in a room has entered it")
}

impl Ways {
    /// Those of a room; there is only one where none is drawn.
    ///
    /// # Panics
    /// Where a course leads from gate to gate: what leads along ways is refused there.
    #[inline(always)]
    pub fn of(&self, room: u32) -> &DistanceField {
        match self {
            Self::Same(ways) => ways,
            Self::Drawn(rooms) => {
                rooms.room(room).ways.as_ref().expect("what leads along ways is refused on a course of gates")
            }
        }
    }

    /// Length of the shortest way of each lane, `[axis][lane]` \[m\]; the room of each where they are drawn.
    #[inline(always)]
    pub(crate) fn lengths<const LANES: usize, R: Real>(
        &self,
        rooms: Option<&Column<LANES, R>>,
        points: &[[f32; LANES]; 3],
    ) -> [f32; LANES] {
        match self {
            Self::Same(ways) => ways.lengths(points),
            Self::Drawn(_) => core::array::from_fn(|lane| {
                self.of(room(rooms, lane)).length(points.each_ref().map(|axis| axis[lane]))
            }),
        }
    }
}

impl Arenas {
    /// Those of these rooms.
    pub(crate) fn of_rooms(
        rooms: &Rooms,
        airframe: &Airframe,
        report: ContactReport,
        scan: Option<&Scan>,
    ) -> Self {
        Self::Drawn(rooms.arenas(airframe, report, scan))
    }

    /// The arena of a room; there is only one where none is drawn.
    #[inline(always)]
    pub(crate) fn of(&self, room: u32) -> &Arena {
        match self {
            Self::Same(arena) => arena,
            Self::Drawn(arenas) => arenas.of(room as usize),
        }
    }

    /// Whether there is nothing at all to touch, wherever a drone is.
    pub(crate) fn is_empty(&self) -> bool {
        match self {
            Self::Same(arena) => arena.is_empty(),
            Self::Drawn(_) => false,
        }
    }

    /// As [`Arena::clearances`], around lanes in these rooms.
    #[inline(always)]
    pub(crate) fn clearances<const LANES: usize, R: Real>(
        &self,
        rooms: Option<&Column<LANES, R>>,
        points: &[[f32; LANES]; 3],
    ) -> [f32; LANES] {
        match self {
            Self::Same(arena) => arena.clearances(points),
            Self::Drawn(arenas) => {
                let mut clearances = [0.0; LANES];
                for (lane, clearance) in clearances.iter_mut().enumerate() {
                    let [x, y, z] = points.each_ref().map(|axis| axis[lane]);
                    *clearance = arenas.of(room(rooms, lane) as usize).clearance(x, y, z);
                }
                clearances
            }
        }
    }
}

impl RoomArenas {
    #[inline(always)]
    fn of(&self, room: usize) -> &Arena {
        self.arenas[room].get_or_init(|| {
            let world = &entered(&self.rooms, room).aviary.world;
            Arena::coarse(world, &self.airframe, self.report, self.scan.as_ref())
        })
    }
}

/// The room of a lane, zero where none is drawn; columns hold whole numbers up to 2²⁴.
#[inline(always)]
pub(crate) fn room<const LANES: usize, R: Real>(rooms: Option<&Column<LANES, R>>, lane: usize) -> u32 {
    rooms.map_or(0, |rooms| rooms[lane].to_f64() as u32)
}
