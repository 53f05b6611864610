//! How good a policy is: success over many random starts, beside the trivial baselines.

mod cockpit;
#[cfg(test)]
mod tests;

use std::borrow::Cow;
use std::cmp::Reverse;
use std::collections::BTreeMap;

use kestrel_core::crazyflie::StockController;
use kestrel_core::real::Real;
use kestrel_core::vehicle::State;
use kestrel_sim::contact::nearest_obstacle;
use kestrel_sim::outcome::{Ending, Episode, Outcome};
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::{Purpose, Seed};
use kestrel_sim::simulation::{Compiled, Simulation};
use kestrel_sim::world::{Floor, Pose, Solid};
use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::statistics::proportion::{Z_95, wilson, wilson_of_groups};
use crate::stock::Stock;
use kestrel_export::policy::Policy;
use kestrel_learn::actor_critic::Actor;

pub(crate) use cockpit::Cockpit;

/// Environments that one task flies.
const PANEL: usize = 128;

/// Who flies.
#[derive(Clone, Copy, Debug)]
pub enum Flyer<'a> {
    /// The trained network's mean action, in the trainer's floating point.
    Actor(&'a Actor),
    /// An exported policy, in the arithmetic of its file.
    Policy(&'a Policy<'a>),
    /// The zero action: hover thrust, no correction.
    Nothing,
    /// Uniform random actions.
    Random,
    /// The pilot written by hand.
    Scripted,
    /// One of Bitcraze's controllers, in the tasks for which [`Flyer::stock`] lists it.
    Stock(Stock),
}

/// From where evaluations fly: the same starts for every flyer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Starts {
    /// What they follow from.
    pub seed: Seed,
    /// Which of the seed's streams: starts that select a policy differ from those that judge it.
    pub purpose: Purpose,
    /// How many.
    pub episodes: usize,
}

/// What an evaluation found; see [`evaluate`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Who flew.
    pub pilot: String,
    /// Episodes flown, one from each start by every drone.
    pub episodes: usize,
    /// Share of episodes that were a success.
    pub success_rate: f64,
    /// Its 95 % confidence interval (Wilson); over worlds, where every episode draws one.
    pub success_interval: [f64; 2],
    /// Mean undiscounted return.
    pub episode_return: f64,
    /// Its 95 % confidence interval (normal approximation).
    pub return_interval: [f64; 2],
    /// Mean length \[s\].
    pub length_secs: f64,
    /// Mean length in control periods.
    #[serde(default)]
    pub steps: f64,
    /// How many episodes ended how.
    pub endings: Vec<(Ending, usize)>,
    /// What collisions were with, and how many, the most frequent first.
    #[serde(default, skip_serializing_if = "Vec::is_empty", with = "readable")]
    pub hits: Vec<(String, usize)>,
    /// Mean return of each weighted reward term, in the scenario's order.
    #[serde(default)]
    pub terms: Vec<f64>,
}

/// What collisions were with stands in reports only: checkpoints, which hold evaluations as well, keep their bytes.
mod readable {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<S: Serializer>(hits: &Vec<(String, usize)>, to: S) -> Result<S::Ok, S::Error> {
        if to.is_human_readable() { hits.serialize(to) } else { to.serialize_unit() }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<(String, usize)>, D::Error> {
        if from.is_human_readable() { Vec::deserialize(from) } else { Ok(Vec::new()) }
    }
}

/// An episode, and what its collision was with, if it ended in one.
#[derive(Clone, Debug)]
struct Flight {
    episode: Episode,
    hit: Option<String>,
}

/// One flight, control period by control period.
#[derive(Clone, Debug)]
pub struct FlightPath {
    /// True states, the start first.
    pub states: Vec<State<f32>>,
    /// How it ended.
    pub episode: Episode,
}

/// Flies one episode from each of the starts; the bits do not depend on the number of threads.
pub fn evaluate(scenario: &Scenario, flyer: Flyer<'_>, starts: Starts) -> Evaluation {
    let scenario = &*flyer.task(scenario);
    summarise(flyer.name(), scenario, &fly(scenario, flyer, starts))
}

/// As [`evaluate`]: the episodes themselves, one from each start by every drone.
pub fn fly_episodes(scenario: &Scenario, flyer: Flyer<'_>, starts: Starts) -> Vec<Episode> {
    fly(&flyer.task(scenario), flyer, starts).into_iter().map(|flight| flight.episode).collect()
}

/// The flights of the task as the flyer flies it.
fn fly(scenario: &Scenario, flyer: Flyer<'_>, starts: Starts) -> Vec<Flight> {
    let firsts: Vec<usize> = (0..starts.episodes).step_by(PANEL).collect();
    let flights = firsts.into_par_iter().flat_map_iter(|first| {
        let count = PANEL.min(starts.episodes - first);
        first_episodes(starting_at(scenario, starts, first as u32, count), flyer, starts, first as u32)
    });
    flights.collect()
}

/// As [`evaluate`], in double precision and one environment at a time: what a comparison with a recording needs.
pub fn evaluate_exactly(scenario: &Scenario, flyer: Flyer<'_>, starts: Starts) -> Evaluation {
    let scenario = &*flyer.task(scenario);
    let flights = (0..starts.episodes as u32).into_par_iter().flat_map_iter(|first| {
        let simulation = Simulation::<1, f64>::with_purpose(scenario, starts.seed, starts.purpose, first, 1);
        first_episodes(simulation, flyer, starts, first)
    });
    summarise(flyer.name(), scenario, &flights.collect::<Vec<_>>())
}

/// What an actor met on flights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sightings {
    /// `[n][observation_len]`.
    pub observations: Vec<f32>,
    /// `[n][image]`; empty without a camera.
    pub images: Vec<u8>,
}

/// What the actor meets on flights from up to 64 of the starts, every eighth step, by every drone.
pub fn sightings_in_flight(scenario: &Scenario, actor: &Actor, starts: Starts) -> Sightings {
    let count = starts.episodes.clamp(1, 64);
    let mut simulation = starting_at(scenario, starts, 0, count);
    let mut cockpit = Cockpit::new(&simulation, Flyer::Actor(actor), starts.seed, 0);
    let mut met = Sightings::default();
    for step in 0..scenario.episode_steps() {
        if step % 8 == 0 {
            for row in 0..simulation.rows() {
                let columns = simulation.observations().chunks_exact(simulation.rows());
                met.observations.extend(columns.map(|column| column[row]));
            }
            met.images.extend_from_slice(simulation.images());
        }
        simulation.step(cockpit.act(&simulation));
    }
    met
}

/// Flies the episode that [`evaluate`] flies as number `start`, and keeps every state of the first drone.
pub fn record(scenario: &Scenario, flyer: Flyer<'_>, starts: Starts, start: u32) -> FlightPath {
    let mut flight = EpisodeFlight::begin(scenario, flyer, starts, start);
    let mut states = vec![flight.state()];
    loop {
        if let Some(episode) = flight.step() {
            return FlightPath { states, episode };
        }
        states.push(flight.state());
    }
}

/// The episode that [`evaluate`] flies as number `start`, control period by control period, of the first drone.
pub struct EpisodeFlight<'a> {
    simulation: Simulation,
    cockpit: Cockpit<'a, f32>,
}

impl<'a> EpisodeFlight<'a> {
    /// At its start.
    pub fn begin(scenario: &Scenario, flyer: Flyer<'a>, starts: Starts, start: u32) -> Self {
        let simulation = starting_at(&flyer.task(scenario), starts, start, 1);
        Self { cockpit: Cockpit::new(&simulation, flyer, starts.seed, start), simulation }
    }

    /// All of its drones; those whose episode has ended are at another start.
    pub fn simulation(&self) -> &Simulation {
        &self.simulation
    }

    /// The true state; once the episode has ended, that of another start.
    pub fn state(&self) -> State<f32> {
        self.simulation.state(0)
    }

    /// Flies on for one control period; the episode, if that ended it.
    pub fn step(&mut self) -> Option<Episode> {
        self.simulation.step(self.cockpit.act(&self.simulation));
        self.simulation.take_episodes().into_iter().find(|episode| episode.agent == 0)
    }
}

impl Flyer<'_> {
    /// Name in reports.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Actor(_) => "policy",
            Self::Policy(policy) => policy.arithmetic().name(),
            Self::Nothing => "do nothing",
            Self::Random => "random",
            Self::Scripted => "scripted pilot",
            Self::Stock(Stock { controller: StockController::Cascade, .. }) => "Crazyflie's PID",
            Self::Stock(Stock { controller: StockController::Mellinger, .. }) => "Mellinger",
        }
    }

    /// Bitcraze's controllers, where a goal moves and their motors can carry the drone; nobody elsewhere.
    pub fn stock(scenario: &Scenario) -> Vec<Flyer<'static>> {
        Stock::of(scenario).into_iter().map(Flyer::Stock).collect()
    }

    /// The task as it is flown: with other actions, more often, by controllers that do not bear those of the task.
    pub(crate) fn task<'s>(&self, scenario: &'s Scenario) -> Cow<'s, Scenario> {
        match self {
            Self::Stock(_) => Cow::Owned(Stock::task(scenario)),
            Self::Actor(_) | Self::Policy(_) | Self::Nothing | Self::Random | Self::Scripted => {
                Cow::Borrowed(scenario)
            }
        }
    }
}

fn starting_at(scenario: &Scenario, starts: Starts, first: u32, count: usize) -> Simulation {
    Simulation::with_purpose(scenario, starts.seed, starts.purpose, first, count)
}

/// The first episode of each drone, agent by agent and by environment.
fn first_episodes<const LANES: usize, R: Real>(
    mut simulation: Simulation<LANES, R>,
    flyer: Flyer<'_>,
    starts: Starts,
    first: u32,
) -> Vec<Flight>
where
    Simulation<LANES, R>: Compiled<R>,
{
    let mut cockpit = Cockpit::new(&simulation, flyer, starts.seed, first);
    let mut flights: Vec<Option<Flight>> = vec![None; simulation.rows()];
    while flights.iter().any(Option::is_none) {
        let before = Scene::of(&simulation);
        simulation.step(cockpit.act(&simulation));
        if simulation.outcomes().iter().all(|outcome| *outcome == Outcome::Running) {
            continue;
        }
        for episode in simulation.take_episodes() {
            let environment = (episode.environment - first) as usize;
            let row = episode.agent as usize * simulation.environments() + environment;
            flights[row].get_or_insert_with(|| {
                let hit =
                    (episode.ending == Ending::Collision).then(|| before.obstacle(simulation.scenario(), row));
                Flight { episode, hit }
            });
        }
    }
    flights.into_iter().flatten().collect()
}

/// Where everything is before a control period: with its collisions new episodes begin, in other rooms.
struct Scene {
    /// Of each row, and its place \[m, world\].
    rooms: Vec<(u32, Vector3<f64>)>,
    /// What moves in each environment.
    movables: Vec<Vec<Pose>>,
}

impl Scene {
    fn of<const LANES: usize, R: Real>(simulation: &Simulation<LANES, R>) -> Self {
        let place = |row: usize| simulation.state(row).position.map(Real::to_f64);
        Self {
            rooms: (0..simulation.rows()).map(|row| (simulation.room(row), place(row))).collect(),
            movables: (0..simulation.environments()).map(|environment| simulation.movables(environment)).collect(),
        }
    }

    /// What was nearest to the drone of a row.
    fn obstacle(&self, scenario: &Scenario, row: usize) -> String {
        let ((room, place), environments) = (self.rooms[row], self.movables.len());
        let world = &scenario.aviary_of(room).world;
        let movables = world.movables.iter().zip(&self.movables[row % environments]);
        let movables: Vec<Solid> =
            movables.map(|(body, pose)| Solid { pose: *pose, ..body.solid.clone() }).collect();
        let mates = (row % environments..self.rooms.len()).step_by(environments).filter(|mate| *mate != row);
        let to_mate = mates.map(|mate| (self.rooms[mate].1 - place).norm()).fold(f64::INFINITY, f64::min);
        let to_floor = if world.floor == Floor::Solid { place.z } else { f64::INFINITY };
        // Half of the way to another drone is its own.
        let (name, least) =
            if to_mate / 2.0 < to_floor { ("another drone", to_mate / 2.0) } else { ("the floor", to_floor) };
        match nearest_obstacle(world.solids.iter().chain(&movables), &place) {
            // Of a piece of furniture, whatever part it was.
            Some((solid, distance)) if distance < least => {
                solid.name.split(':').next().unwrap_or_default().to_owned()
            }
            Some(_) | None => name.to_owned(),
        }
    }
}

fn summarise(pilot: &str, scenario: &Scenario, flights: &[Flight]) -> Evaluation {
    let episodes: Vec<&Episode> = flights.iter().map(|flight| &flight.episode).collect();
    let episodes = &episodes[..];
    let count = episodes.len().max(1) as f64;
    let successes = episodes.iter().filter(|episode| episode.success).count();
    let returns: Vec<f64> = episodes.iter().map(|episode| f64::from(episode.total_reward)).collect();
    let mean = returns.iter().sum::<f64>() / count;
    let variance =
        returns.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / (count - 1.0).max(1.0);
    let margin = Z_95 * (variance / count).sqrt();
    let steps: f64 = episodes.iter().map(|episode| f64::from(episode.steps)).sum();
    Evaluation {
        pilot: pilot.to_owned(),
        episodes: episodes.len(),
        success_rate: successes as f64 / count,
        success_interval: success_interval(scenario, episodes),
        episode_return: mean,
        return_interval: [mean - margin, mean + margin],
        length_secs: steps / count / scenario.physics.control_rate_hz,
        steps: steps / count,
        endings: endings(episodes),
        hits: hits(flights),
        terms: (0..scenario.rewards.len())
            .map(|term| episodes.iter().map(|episode| f64::from(episode.terms[term])).sum::<f64>() / count)
            .collect(),
    }
}

/// Of the share of successes.
fn success_interval(scenario: &Scenario, episodes: &[&Episode]) -> [f64; 2] {
    let worlds = scenario.rooms();
    let mut groups: Vec<(f64, f64)> = vec![(0.0, 0.0); worlds as usize];
    for episode in episodes {
        // The first episode of an environment is in the world of its number.
        let (successes, count) = &mut groups[(episode.environment % worlds) as usize];
        *successes += f64::from(u8::from(episode.success));
        *count += 1.0;
    }
    if let [(successes, count)] = groups[..] {
        return wilson(successes, count.max(1.0));
    }
    groups.retain(|(_, count)| *count > 0.0);
    wilson_of_groups(&groups)
}

/// What collisions were with, the most frequent first, by name where as many.
fn hits(flights: &[Flight]) -> Vec<(String, usize)> {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for hit in flights.iter().filter_map(|flight| flight.hit.as_deref()) {
        *counts.entry(hit).or_default() += 1;
    }
    let mut hits: Vec<_> = counts.into_iter().map(|(name, count)| (name.to_owned(), count)).collect();
    hits.sort_by_key(|(_, count)| Reverse(*count));
    hits
}

fn endings(episodes: &[&Episode]) -> Vec<(Ending, usize)> {
    let kinds = [
        Ending::Success,
        Ending::TimeLimit,
        Ending::Collision,
        Ending::OutOfBounds,
        Ending::Tilt,
        Ending::Distance,
        Ending::OutOfFuel,
        Ending::Overdue,
        Ending::Limit,
        Ending::Teammate,
    ];
    let count = |kind| episodes.iter().filter(|episode| episode.ending == kind).count();
    kinds.into_iter().map(|kind| (kind, count(kind))).filter(|(_, count)| *count > 0).collect()
}
