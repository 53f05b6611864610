//! The thesis's incremental obstacles: a pillar where a trained policy flies, so that the next room is harder for it.
//!
//! So the thesis made its incremental rooms (section 3.2.4): an agent learned a room, and a pillar was put into its flight
//! path. Here by rule: [`Traffic`] counts which flights pass where, and [`Traffic::obstruct`] takes the busiest spot around
//! their middle at which a pillar leaves a free way. [`files`] writes the next room.

pub mod files;
#[cfg(test)]
mod tests;

use kestrel_sim::config::AviaryConfig;
use kestrel_sim::scenario::{Scenario, StartPosition};
use kestrel_sim::termination::Termination;
use kestrel_sim::world::{Cuboid, Solid, World};
use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

use crate::evaluation::{FlightPath, Flyer, Starts, record};
use kestrel_sim::contact::Passage;

/// Least distance between the way that must remain and everything \[m\]: the drone's hull and 8 cm beside it.
pub const CLEARANCE_M: f64 = 0.14;

/// Half the width of a pillar, and its height \[m\]: the reference's (`AviaryConfig::pillars`).
const PILLAR_HALF_M: f64 = 0.09;
const PILLAR_HEIGHT_M: f64 = 1.0;

/// A flight within this distance of a spot passes it \[m\]: it would touch a pillar there.
const PASSING_M: f64 = 0.15;

/// The middle part of the mean flight, in shares of its length, around which a pillar may stand.
const MIDDLE: [f64; 2] = [0.3, 0.7];

/// How far from the mean flight it may stand \[m\].
const ASIDE_M: f64 = 0.5;

/// Between two spots that are compared \[m\].
const SPACING_M: f64 = 0.05;

/// Kept free around where flights start and end \[m\].
const ENDS_REACH_M: f64 = 0.35;

/// Points at which flights are averaged.
const SHARES: usize = 41;

/// Spots that are tried, busiest first: each costs a map of ways.
const TRIES: usize = 100;

/// Least share of successful flights: where a policy fails says nothing about its way.
const SUCCESS_RATE: f64 = 0.5;

/// Why there is no next room.
#[derive(Debug, thiserror::Error)]
pub enum ObstructionError {
    /// The policy does not fly the room as it is.
    #[error(
        "found {successes} of {flights} flights successful, expected at least half: train longer before it gets harder"
    )]
    Failing {
        /// Flights that succeeded.
        successes: usize,
        /// All.
        flights: usize,
    },
    /// The task's rules say no box to fly in or to start from.
    #[error("found a task without {0}, expected one")]
    Unbounded(&'static str),
    /// Every spot would close the way.
    #[error(
        "found no spot for a pillar that flights pass and that leaves a way of {CLEARANCE_M} m on both sides, expected one: \
         this room is full"
    )]
    Full,
}

/// Where a pillar goes.
#[derive(Clone, Debug, PartialEq)]
pub struct Spot {
    /// Its middle \[m, world\].
    pub at: [f64; 2],
    /// Successful flights that pass there.
    pub passing: usize,
    /// Points on the way that remains \[m, world\].
    pub route: Vec<Vector3<f64>>,
}

/// Successful flights through one place.
#[derive(Clone, Debug)]
pub struct Traffic {
    /// Positions \[m, world\], flight by flight.
    flights: Vec<Vec<Vector3<f64>>>,
}

impl Traffic {
    /// Flights of the first drone from each of the starts.
    ///
    /// # Errors
    /// [`ObstructionError::Failing`] when fewer than half succeed.
    pub fn observe(scenario: &Scenario, flyer: Flyer<'_>, starts: Starts) -> Result<Self, ObstructionError> {
        let all = (0..starts.episodes as u32).into_par_iter();
        let paths: Vec<FlightPath> = all.map(|start| record(scenario, flyer, starts, start)).collect();
        let successful: Vec<_> = paths.iter().filter(|path| path.episode.success).collect();
        if (successful.len() as f64) < SUCCESS_RATE * paths.len() as f64 {
            return Err(ObstructionError::Failing { successes: successful.len(), flights: paths.len() });
        }
        let positions =
            |path: &&FlightPath| path.states.iter().map(|state| state.position.cast()).collect::<Vec<_>>();
        Ok(Self { flights: successful.iter().map(positions).collect() })
    }

    /// How many there are.
    pub fn flights(&self) -> usize {
        self.flights.len()
    }

    /// The busiest spot around the middle of the mean flight at which a pillar leaves a free way; of equally busy ones that
    /// which is nearest to the mean flight's very middle.
    ///
    /// # Errors
    /// When the task is unfit, or there is no such spot.
    pub fn obstruct(&self, scenario: &Scenario) -> Result<Spot, ObstructionError> {
        let site = Site::of(scenario)?;
        let spots = self.spots();
        let tried = spots.into_iter().filter(|(at, _)| site.is_clear(at)).take(TRIES);
        let free = |(at, passing): (Vector2<f64>, usize)| {
            let route = site.route_past(&at)?;
            Some(Spot { at: at.into(), passing, route })
        };
        tried.into_iter().find_map(free).ok_or(ObstructionError::Full)
    }

    /// Spots that flights pass, busiest first.
    fn spots(&self) -> Vec<(Vector2<f64>, usize)> {
        let mean = self.mean();
        let last = (mean.len() - 1) as f64;
        let [first, end] = MIDDLE.map(|share| (share * last).round() as usize);
        let (part, middle) = (&mean[first..=end], mean[mean.len() / 2]);
        let mut spots: Vec<_> = lattice(part)
            .into_iter()
            .map(|spot| (spot, self.flights.iter().filter(|flight| passes(flight, &spot)).count()))
            .filter(|(_, passing)| *passing > 0)
            .collect();
        let distance = |spot: &Vector2<f64>| (spot - middle).norm();
        spots.sort_by(|(one, busy), (other, busier)| {
            busier.cmp(busy).then(distance(one).total_cmp(&distance(other)))
        });
        spots
    }

    /// The mean flight, from above: at equal shares of each flight's length.
    fn mean(&self) -> Vec<Vector2<f64>> {
        let even: Vec<_> = self.flights.iter().map(|flight| evenly(flight)).collect();
        let count = even.len() as f64;
        (0..SHARES).map(|share| even.iter().map(|flight| flight[share]).sum::<Vector2<f64>>() / count).collect()
    }
}

/// Whether a flight would touch a pillar at the spot.
fn passes(flight: &[Vector3<f64>], spot: &Vector2<f64>) -> bool {
    flight.iter().any(|point| point.z < PILLAR_HEIGHT_M && (point.xy() - spot).norm() < PASSING_M)
}

/// A flight from above, at equal shares of its length.
fn evenly(flight: &[Vector3<f64>]) -> Vec<Vector2<f64>> {
    let points: Vec<Vector2<f64>> = flight.iter().map(Vector3::xy).collect();
    let mut flown = vec![0.0];
    for pair in points.windows(2) {
        flown.push(flown[flown.len() - 1] + (pair[1] - pair[0]).norm());
    }
    let length = flown[flown.len() - 1];
    let at = |share: usize| {
        let metres = length * share as f64 / (SHARES - 1) as f64;
        points[flown.partition_point(|so_far| *so_far < metres).min(points.len() - 1)]
    };
    (0..SHARES).map(at).collect()
}

/// Spots near a line, in even coordinates.
fn lattice(line: &[Vector2<f64>]) -> Vec<Vector2<f64>> {
    let low = line.iter().fold(Vector2::repeat(f64::INFINITY), |low, point| low.inf(point));
    let high = line.iter().fold(Vector2::repeat(f64::NEG_INFINITY), |high, point| high.sup(point));
    let number = |metres: f64| (metres / SPACING_M).round() as i64;
    let range = |axis: usize| number(low[axis] - ASIDE_M)..=number(high[axis] + ASIDE_M);
    // In centimetres, so that what is written is what was tried.
    let metres = |number: i64| number as f64 * (100.0 * SPACING_M) / 100.0;
    let spots = range(0).flat_map(|x| range(1).map(move |y| Vector2::new(metres(x), metres(y))));
    spots.filter(|spot| line.iter().any(|point| (point - spot).norm() <= ASIDE_M)).collect()
}

/// Where a pillar is to stand.
struct Site<'a> {
    scenario: &'a Scenario,
    bounds: Cuboid,
    starts: Cuboid,
}

impl<'a> Site<'a> {
    fn of(scenario: &'a Scenario) -> Result<Self, ObstructionError> {
        let bounds = scenario.terminations.iter().find_map(Termination::bounds);
        let StartPosition::Within(starts) = scenario.start.position else {
            return Err(ObstructionError::Unbounded("`evaluation.start.position.within`"));
        };
        let bounds = bounds.ok_or(ObstructionError::Unbounded("the termination `out_of_bounds`"))?;
        Ok(Self { scenario, bounds, starts })
    }

    /// Whether a pillar there stands in nothing, and in no start and no goal.
    fn is_clear(&self, at: &Vector2<f64>) -> bool {
        let half = Vector2::repeat(PILLAR_HALF_M);
        let (low, high) = (at - half, at + half);
        let apart = |other_low: Vector2<f64>, other_high: Vector2<f64>| {
            (0..2).any(|axis| high[axis] < other_low[axis] || other_high[axis] < low[axis])
        };
        let reach = Vector2::repeat(ENDS_REACH_M);
        let (starts, goal) = (self.starts, self.scenario.aviary.goal.xy().cast::<f64>());
        let solid = |solid: &Solid| {
            let (low, high) = solid.extent();
            low.z > PILLAR_HEIGHT_M || apart(low.xy(), high.xy())
        };
        apart(starts.low.xy().cast() - reach, starts.high.xy().cast() + reach)
            && apart(goal - reach, goal + reach)
            && self.scenario.aviary.world.tangible().all(solid)
    }

    /// The way that a pillar there leaves, if it leaves one.
    fn route_past(&self, at: &Vector2<f64>) -> Option<Vec<Vector3<f64>>> {
        let aviary = &self.scenario.aviary;
        let mut world: World = aviary.world.clone();
        let (low, high) = (at.add_scalar(-PILLAR_HALF_M), at.add_scalar(PILLAR_HALF_M));
        world.solids.push(Solid::block("pillar", low.push(0.0), high.push(PILLAR_HEIGHT_M)));
        let Self { bounds, starts, .. } = *self;
        Passage { world: &world, bounds, starts, goal: aviary.goal, clearance_m: CLEARANCE_M }.route()
    }
}

/// The pillars of a room, the new one last.
pub fn pillars(room: &AviaryConfig, spot: &Spot) -> Vec<[f64; 2]> {
    room.pillars.iter().copied().chain([spot.at]).collect()
}
