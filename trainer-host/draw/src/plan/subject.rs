//! What a plan shows: the place of a world file, or the aviary of a scenario.

use kestrel_sim::config::AviaryParts;
use kestrel_sim::scenario::{FreeSpace, Goals, Scenario, StartPosition};
use kestrel_sim::world::{Cuboid, Solid, World};
use nalgebra::Vector3;

/// Air around what is drawn \[m\].
const MARGIN: f64 = 0.25;

/// Least width, depth and height that is drawn \[m\].
const LEAST_SIZE: Vector3<f64> = Vector3::new(2.0, 1.0, 1.0);

/// An aviary that can be drawn.
#[derive(Clone, Debug)]
pub struct Subject {
    /// Name of its file, without its ending.
    pub name: String,
    /// What it is, in one line; may be empty.
    pub about: String,
    /// What stands there.
    pub world: World,
    /// Where drones shall go \[m, world\].
    pub goals: Vec<Vector3<f64>>,
    /// Where drones start \[m, world\].
    pub starts: Vec<Vector3<f64>>,
    /// Points on the way to each goal \[m, world\]; there may be fewer routes than goals, and empty ones.
    pub routes: Vec<Vec<Vector3<f64>>>,
    /// The box of random starts, of an experiment.
    pub start_region: Option<Cuboid>,
}

impl Subject {
    /// A world with what its file says about it.
    pub fn of_place(name: String, place: AviaryParts) -> Self {
        let AviaryParts { about, goals, starts, routes, world, gates: _ } = place;
        Self { name, about, world, goals, starts, routes, start_region: None }
    }

    /// The aviary of a scenario.
    pub fn of_scenario(name: String, scenario: &Scenario) -> Self {
        let drones = 0..scenario.agents.count as usize;
        let route = |drone: usize| scenario.aviary.route(drone).iter().map(|point| point.cast()).collect();
        let (starts, region) = match &scenario.start.position {
            StartPosition::Within(region) | StartPosition::FreeWithin(FreeSpace { region, .. }) => {
                (Vec::new(), Some(*region))
            }
            StartPosition::AlongWay(starts) => (Vec::new(), Some(starts.space.region)),
            StartPosition::AroundGoal { farthest_m, .. } => {
                let goal = scenario.aviary.goal;
                let region = Cuboid { low: goal.add_scalar(-farthest_m), high: goal.add_scalar(*farthest_m) };
                (Vec::new(), Some(region))
            }
            StartPosition::Exactly(places) => (places.iter().map(|place| place.position).collect(), None),
        };
        Self {
            name,
            about: format!("the aviary of the experiment {}, with the starts of its evaluation", scenario.name),
            world: scenario.aviary.world.clone(),
            routes: drones.clone().map(route).collect(),
            goals: match scenario.goals {
                // A route ends where the first goal is: behind the last gate.
                Goals::Gates => scenario.aviary.gates.iter().rev().map(|gate| gate.center).collect(),
                Goals::Fixed | Goals::PerAgent(_) | Goals::Line(_) | Goals::Wave { .. } | Goals::Trajectory(_) => {
                    drones.map(|drone| scenario.goals.at(&scenario.aviary.goal, drone, 0.0)).collect()
                }
            },
            starts,
            start_region: region,
        }
    }

    /// Everything solid, seen or pushed.
    pub(super) fn solids(&self) -> impl Iterator<Item = &Solid> {
        self.world.solids.iter().chain(self.world.movables.iter().map(|movable| &movable.solid))
    }

    /// Lowest and highest coordinates of the solids \[m\], if there are any.
    pub fn solid_extent(&self) -> Option<(Vector3<f64>, Vector3<f64>)> {
        self.solids().map(Solid::extent).reduce(|one, other| (one.0.inf(&other.0), one.1.sup(&other.1)))
    }

    /// What the plan has to show \[m\]: solids, starts, goals and some air around them.
    pub(super) fn extent(&self) -> (Vector3<f64>, Vector3<f64>) {
        let region = self.start_region.iter().flat_map(|region| [region.low.cast(), region.high.cast()]);
        let points = self.goals.iter().chain(&self.starts).copied().chain(region);
        let extents = points.map(|point| (point, point)).chain(self.solid_extent());
        let (low, high) = extents
            .reduce(|one, other| (one.0.inf(&other.0), one.1.sup(&other.1)))
            .unwrap_or((Vector3::zeros(), Vector3::zeros()));
        let lack = (LEAST_SIZE - (high - low)).sup(&Vector3::zeros()) / 2.0;
        let margin = Vector3::new(MARGIN, MARGIN, 0.0);
        let (low, high) = (low - lack - margin, high + lack + margin);
        // The floor is always in view.
        (Vector3::new(low.x, low.y, low.z.clamp(-0.5, 0.0)), high + MARGIN * Vector3::z())
    }

    /// Sizes and numbers in one line.
    pub fn summary(&self) -> String {
        let World { solids, movables, .. } = &self.world;
        let size = self.solid_extent().map_or_else(
            || "no solids".to_owned(),
            |(low, high)| {
                let size = high - low;
                format!("{} m x {} m x {} m", short(size.x), short(size.y), short(size.z))
            },
        );
        let count =
            |count: usize, what: &str| if count == 0 { String::new() } else { format!(", {count} {what}") };
        format!("{size}{}{}", count(solids.len(), "solids"), count(movables.len(), "movables"))
    }
}

/// A length with two decimals, without trailing zeros.
pub(super) fn short(length: f64) -> String {
    let text = format!("{length:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}
