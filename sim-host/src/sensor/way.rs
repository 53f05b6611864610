//! The way to the goal that a drone finds by itself, through a map of what its scan has met.

use kestrel_core::planner::{NodeGrid, OccupancyMap, Path, Planner, SearchNode};
use kestrel_core::real::Real;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{BEAM_LIMIT, Scan, SensorSuite};
use crate::swarm::{Column, row, set_row, vector};

/// Nearer to the goal than this \[m\], the direction reads shorter: there it is time to slow down.
const NEAR_M: f32 = 0.8;

/// Points ahead that are nearer than this \[m\] have no direction of their own.
const HERE_M: f32 = 0.05;

/// A beam that reads less sees nothing: the limit, rounded.
const NOTHING: f32 = 1e-3;

/// How a drone looks for its way. It reads in which direction the point ahead on it is: a unit vector, world (body axes beside the
/// `body` layout), shorter within 80 cm of the goal.
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
    /// What is met farther away \[m\] is not mapped.
    pub mapped_within_m: f32,
    /// How many metres one counts where no zone or beam has looked through, at least one.
    pub unseen_cost: f32,
    /// Whether it reads as well which way is away from the nearest thing on the map: a vector, in the axes of the first, of length
    /// 1 at the thing itself and 0 from 38 cm on.
    pub shows_nearest: bool,
}

impl Way {
    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "there are three at least")]
    pub const fn len(&self) -> usize {
        if self.shows_nearest { 6 } else { 3 }
    }
}

/// What the drones of a block know of their ways, by lane.
#[derive(Clone, Debug)]
pub(crate) struct WayMemory<const LANES: usize, R> {
    way: Way,
    planner: Planner,
    /// Memory of the searches.
    search: Vec<SearchNode>,
    /// Directions of the beams of a scan in each position, world; none without one.
    beams: Vec<Vec<Vector3<f32>>>,
    /// By lane; none where nothing is mapped.
    charts: Vec<Chart>,
    /// The points ahead \[m, world\].
    ahead: [Column<LANES, R>; 3],
}

/// What a drone has met, and the path that it follows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Chart {
    /// The memory of its [`OccupancyMap`].
    nodes: Vec<u8>,
    path: Path,
}

impl Chart {
    /// Bytes of its map.
    pub(crate) fn len(&self) -> usize {
        self.nodes.len()
    }
}

impl<const LANES: usize, R: Real> WayMemory<LANES, R> {
    /// Empty maps, of drones with a hull of this radius \[m\] and these sensors.
    pub(crate) fn new(way: Way, sensors: &SensorSuite, radius: f64) -> Box<Self> {
        let beams = |scan: &Scan| {
            let directions =
                |position| scan.directions(position).iter().map(|direction| direction.cast()).collect();
            (0..scan.positions()).map(directions).collect()
        };
        let len = if way.unseen_cost > 1.0 { OccupancyMap::seeing_len(&way.grid) } else { way.grid.len() };
        let planner = Planner::new(radius as f32, way.nearness_cost, way.lookahead_m);
        Box::new(Self {
            way,
            planner: planner.with_unseen_cost(way.unseen_cost),
            search: vec![SearchNode::default(); way.grid.len()],
            beams: sensors.scan().map(beams).unwrap_or_default(),
            charts: vec![Chart { nodes: vec![0; len], path: Path::default() }; LANES],
            ahead: [[R::zero(); LANES]; 3],
        })
    }

    /// An episode begins, in which nothing has been met yet.
    pub(crate) fn begin(&mut self, lane: usize) {
        let Chart { nodes, path } = &mut self.charts[lane];
        if let Some(mut map) = OccupancyMap::new(&self.way.grid, nodes) {
            map.clear();
        }
        *path = Path::default();
    }

    /// Takes in where the drone of a lane, which is at a place, has met something \[m, world\].
    pub(crate) fn mark(&mut self, lane: usize, place: &Vector3<f32>, met: impl Iterator<Item = Vector3<f32>>) {
        let reach = self.way.mapped_within_m;
        if let Some(mut map) = OccupancyMap::new(&self.way.grid, &mut self.charts[lane].nodes) {
            for point in met {
                map.see_through(&(*place).into(), &point.into());
                if (point - place).norm_squared() <= reach * reach {
                    map.mark(&point.into());
                }
            }
        }
    }

    /// Takes in what the beams of a scan read from a place \[m, world\], at this reading of the episode.
    pub(crate) fn look(
        &mut self,
        lane: usize,
        (scan, nearness): (&Scan, &[f32; BEAM_LIMIT]),
        position: &Vector3<f32>,
        reading: u32,
    ) {
        let beams = core::mem::take(&mut self.beams);
        let beam = &beams[reading as usize % beams.len()];
        let read = nearness.iter().zip(scan.distances(nearness)).zip(beam);
        let met = read.filter(|((nearness, _), _)| **nearness > NOTHING);
        self.mark(lane, position, met.map(|((_, distance), direction)| position + direction * distance));
        self.beams = beams;
    }

    /// Looks for the way of a lane from a place to a goal \[m, world\], when it is time to.
    pub(crate) fn search(&mut self, lane: usize, reading: u32, [position, goal]: [&Vector3<f32>; 2]) {
        let Self { way, charts, planner, search, .. } = self;
        let Chart { nodes, path } = &mut charts[lane];
        let Some(map) = OccupancyMap::new(&way.grid, nodes) else { return };
        if reading.is_multiple_of(way.periods) {
            let ahead = planner.ahead(&map, [&(*position).into(), &(*goal).into()], path, search);
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

    /// What it reads beside that of the nearest thing on its map, if that is shown.
    pub(crate) fn away_from_nearest(&mut self, lane: usize, position: &Vector3<f32>) -> Option<[R; 3]> {
        let Self { way, charts, .. } = self;
        let map = OccupancyMap::new(&way.grid, &mut charts[lane].nodes).filter(|_| way.shows_nearest)?;
        Some(map.away_from_nearest(&(*position).into()).map(R::from_f32))
    }

    /// The point ahead of the drone of a lane \[m, world\].
    pub(crate) fn ahead(&self, lane: usize) -> Vector3<f32> {
        row(&self.ahead, lane).map(Real::to_f32).into()
    }

    /// Number of values that each reads.
    pub(crate) const fn len(&self) -> usize {
        self.way.len()
    }

    /// Those of all lanes \[m, world\].
    pub(crate) fn points_ahead(&self) -> &[Column<LANES, R>; 3] {
        &self.ahead
    }

    /// From now on maps nothing and looks for no way: what was found last stays.
    pub(crate) fn forget_maps(&mut self) {
        self.charts.clear();
    }

    pub(crate) fn has_maps(&self) -> bool {
        !self.charts.is_empty()
    }

    pub(crate) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Column<LANES, R>> {
        self.ahead.iter_mut()
    }

    pub(crate) fn charts_mut(&mut self) -> &mut [Chart] {
        &mut self.charts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_looked_through_is_remembered_where_it_counts_and_what_is_far_is_not_met() {
        let grid = NodeGrid::new([0.0; 3], [2.0, 1.0, 1.0], 0.1).unwrap();
        let charted = |unseen_cost: f32| {
            let way = Way {
                grid,
                periods: 1,
                lookahead_m: 0.3,
                nearness_cost: 12.0,
                mapped_within_m: 0.5,
                unseen_cost,
                shows_nearest: false,
            };
            let mut memory = WayMemory::<1, f32>::new(way, &SensorSuite::none(), 0.06);
            memory.begin(0);
            let empty = memory.charts[0].nodes.clone();
            memory.mark(0, &Vector3::new(0.5, 0.5, 0.5), [Vector3::new(1.7, 0.5, 0.5)].into_iter());
            let (before, after) = (empty.split_at(grid.len()), memory.charts[0].nodes.split_at(grid.len()));
            assert_eq!(before.0, after.0, "it is 1.2 m away");
            after.1.iter().map(|bits| bits.count_ones()).sum::<u32>()
        };
        assert_eq!(charted(1.0), 0);
        assert!((10..=12).contains(&charted(2.0)), "{}", charted(2.0));
    }
}
