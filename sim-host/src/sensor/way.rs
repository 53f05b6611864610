//! The way to the goal that a drone finds by itself, through a map of what its scan has met.

use kestrel_core::planner::{NodeGrid, OccupancyMap, Path, Planner, SearchNode};
use kestrel_core::real::Real;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{BEAM_LIMIT, Scan};
use crate::swarm::{Column, row, set_row, vector};

/// Nearer to the goal than this \[m\], the direction reads shorter: there it is time to slow down.
const NEAR_M: f32 = 0.8;

/// Points ahead that are nearer than this \[m\] have no direction of their own.
const HERE_M: f32 = 0.05;

/// A beam that reads less sees nothing: the limit, rounded.
const NOTHING: f32 = 1e-3;

/// How a drone looks for its way. It reads in which direction the point ahead on it is: a unit vector, world, shorter within 80 cm
/// of the goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// The map, empty at the start of an episode.
    pub grid: NodeGrid,
    /// Control periods from one search to the next, at least one.
    pub periods: u32,
    /// Distance to the point ahead, along the way \[m\].
    pub lookahead_m: f32,
    /// What a metre right beside something counts more than one in the open.
    pub nearness_cost: f32,
}

impl Way {
    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "there are three")]
    pub const fn len(&self) -> usize {
        3
    }
}

/// What the drones of a block know of their ways, by lane.
#[derive(Clone, Debug)]
pub(crate) struct WayMemory<const LANES: usize, R> {
    way: Way,
    planner: Planner,
    /// Memory of the searches.
    search: Vec<SearchNode>,
    /// Directions of the beams in each position, world.
    beams: Vec<Vec<Vector3<f32>>>,
    charts: [Chart; LANES],
    /// The points ahead \[m, world\].
    ahead: [Column<LANES, R>; 3],
}

/// What a drone has met, and the path that it follows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Chart {
    /// A byte per node: the memory of its [`OccupancyMap`].
    nodes: Vec<u8>,
    path: Path,
}

impl Chart {
    /// Nodes of its map.
    pub(crate) fn len(&self) -> usize {
        self.nodes.len()
    }
}

/// What a drone sees, from where and on the way where to \[m, world\].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Look<'a> {
    /// Control periods of the episode that have passed.
    pub(crate) period: u32,
    pub(crate) scan: &'a Scan,
    pub(crate) nearness: &'a [f32; BEAM_LIMIT],
    pub(crate) position: Vector3<f32>,
    pub(crate) goal: Vector3<f32>,
}

impl<const LANES: usize, R: Real> WayMemory<LANES, R> {
    /// Empty maps, of drones with a hull of this radius \[m\].
    pub(crate) fn new(way: Way, scan: &Scan, radius: f64) -> Box<Self> {
        let directions = |position| scan.directions(position).iter().map(|direction| direction.cast()).collect();
        Box::new(Self {
            way,
            planner: Planner::new(radius as f32, way.nearness_cost, way.lookahead_m),
            search: vec![SearchNode::default(); way.grid.len()],
            beams: (0..scan.positions()).map(directions).collect(),
            charts: core::array::from_fn(|_| Chart { nodes: vec![0; way.grid.len()], path: Path::default() }),
            ahead: [[R::zero(); LANES]; 3],
        })
    }

    /// Takes in what the drone of a lane sees, and looks for its way when it is time to.
    pub(crate) fn look(&mut self, lane: usize, look: &Look<'_>) {
        let Self { way, charts, beams, .. } = self;
        let Chart { nodes, path } = &mut charts[lane];
        let Some(mut map) = OccupancyMap::new(&way.grid, nodes) else { return };
        if look.period == 0 {
            map.clear();
            *path = Path::default();
        }
        let beams = &beams[look.period as usize % beams.len()];
        let distances = look.scan.distances(look.nearness);
        for ((nearness, distance), direction) in look.nearness.iter().zip(distances).zip(beams) {
            let met = look.position + direction * distance;
            if *nearness > NOTHING {
                map.mark(&met.into());
            }
        }
        if look.period.is_multiple_of(way.periods) {
            let leg = [&look.position.into(), &look.goal.into()];
            let ahead = self.planner.ahead(&map, leg, path, &mut self.search);
            set_row(&mut self.ahead, lane, ahead.map(R::from_f32));
        }
    }

    /// What the drone of a lane reads, that is at a point on the way to a goal \[m, world\].
    pub(crate) fn reading(&self, lane: usize, position: &Vector3<R>, goal: &Vector3<R>) -> [R; 3] {
        let length = |leg: &Vector3<R>| (leg.x * leg.x + leg.y * leg.y + leg.z * leg.z).sqrt();
        let at_least = |length: R, least: R| if length > least { length } else { least };
        let leg = vector(&self.ahead, lane) - position;
        let (near, distance) = (R::from_f32(NEAR_M), length(&(goal - position)));
        let share = if distance < near { distance / near } else { R::one() };
        let scale = share / at_least(length(&leg), R::from_f32(HERE_M));
        [leg.x * scale, leg.y * scale, leg.z * scale]
    }

    /// The point ahead of the drone of a lane \[m, world\].
    pub(crate) fn ahead(&self, lane: usize) -> Vector3<f32> {
        row(&self.ahead, lane).map(Real::to_f32).into()
    }

    pub(crate) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Column<LANES, R>> {
        self.ahead.iter_mut()
    }

    pub(crate) fn charts_mut(&mut self) -> &mut [Chart] {
        &mut self.charts
    }
}
