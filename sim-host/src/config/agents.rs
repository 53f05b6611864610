//! Who flies together, and where each one's goal is.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::ConfigError;
use super::field::{Field, Limits};
use super::geometry::holds;
use crate::course::Gate;
use crate::scenario::{Agents, Goals, TeamEnd, TeamRewards, TeamSuccess};
use crate::trajectory::{Trajectories, TrajectoryShape};
use crate::world::{Drive, Floor, Movable, World};

/// Most drones in one environment; every one is tested against every other.
const DRONES_LIMIT: u64 = 256;

/// Most laps, and most gates to pass.
const LAPS_LIMIT: u64 = 100;
const PASSES_LIMIT: usize = 1000;

const SPEED: Limits = Limits::from(-20.0, 20.0, "m/s");
const LENGTH: Limits = Limits::from(-1000.0, 1000.0, "m");

/// Who flies together in one environment.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AgentsConfig {
    /// Drones in each environment.
    pub count: u64,
    /// What becomes of the others when one's episode ends.
    pub ends: TeamEnd,
    /// Whose rewards a drone is paid.
    pub rewards: TeamRewards,
    /// Who has to succeed.
    pub success: TeamSuccess,
}

/// How the goal differs between drones or moves in an episode; without it, it is the aviary's `goal_m` for all.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum GoalsConfig {
    /// One for each drone.
    PerAgent {
        /// `[x, y, z]` of each.
        points_m: Vec<[f64; 3]>,
    },
    /// From the aviary's goal along a line.
    Line {
        /// Its velocity.
        velocity_m_per_s: [f64; 3],
    },
    /// The aviary's goal plus `amplitude · cos(rate · t)`.
    Wave {
        /// Along x, y, z.
        amplitude_m: [f64; 3],
        /// Angle per second.
        rate_rad_per_s: f64,
        /// When it stops.
        until_secs: f64,
    },
    /// Along a closed curve about the aviary's goal, drawn anew for each episode; `path` under `sensors` shows the way
    /// ahead.
    Trajectory(TrajectoriesConfig),
    /// The middle of the next of the aviary's `gates`, which are passed one after the other.
    Gates(CourseConfig),
}

/// In which order gates are passed.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CourseConfig {
    /// Numbers of the gates, 1 for the first of the list; a gate may come twice, but not twice in a row. All, as they are listed,
    /// unless it is given.
    pub order: Vec<u64>,
    /// How often the course is flown.
    pub laps: u64,
}

impl Default for CourseConfig {
    fn default() -> Self {
        Self { order: Vec::new(), laps: 1 }
    }
}

/// From which curves an episode draws its own; two bounds that are equal fix a number.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TrajectoriesConfig {
    /// Shapes, seen from above, each as likely as the others; turned by any angle, and begun anywhere.
    pub shapes: Vec<TrajectoryShape>,
    /// Least and greatest distance from the centre.
    pub reach_m: [f64; 2],
    /// Least and greatest height that a curve rises above the centre and sinks below it, once on its way around.
    pub rise_m: [f64; 2],
    /// Least and greatest of the greatest speed on the curve.
    pub speed_m_per_s: [f64; 2],
}

impl Default for TrajectoriesConfig {
    fn default() -> Self {
        Self {
            shapes: TrajectoryShape::ALL.to_vec(),
            reach_m: [0.5, 1.0],
            rise_m: [0.0, 0.2],
            speed_m_per_s: [0.3, 1.5],
        }
    }
}

impl TrajectoriesConfig {
    fn check(&self, field: &Field<'_>) -> Result<Trajectories, ConfigError> {
        if self.shapes.is_empty() {
            return Err(field.at("shapes").refuse("[]", "one shape or several"));
        }
        let between = |key: &'static str, [least, most]: [f64; 2], limits: &Limits| {
            let field = field.at(key);
            let bounds = [field.at(0).number(least, limits)?, field.at(1).number(most, limits)?];
            if least > most {
                return Err(field.at(1).refuse(most, format!("at least {least}, the lower bound")));
            }
            Ok(bounds)
        };
        Ok(Trajectories {
            shapes: self.shapes.clone(),
            reach: between("reach_m", self.reach_m, &Limits::from(0.05, 100.0, "m"))?,
            rise: between("rise_m", self.rise_m, &Limits::from(0.0, 100.0, "m"))?,
            speed: between("speed_m_per_s", self.speed_m_per_s, &Limits::from(0.01, 20.0, "m/s"))?,
        })
    }
}

impl CourseConfig {
    /// Gates in the order in which they are passed.
    ///
    /// # Errors
    /// When there are none or too many, or a number is that of none.
    pub(super) fn check(&self, gates: &[Gate], field: &Field<'_>) -> Result<Vec<Gate>, ConfigError> {
        if gates.is_empty() {
            return Err(field.reject("a course without gates", "`gates` in the `aviary`"));
        }
        let order = field.at("order");
        let mut lap = Vec::new();
        for (index, number) in self.order.iter().enumerate() {
            let number = order.at(index).whole(*number, 1..=gates.len() as u64)?;
            if index > 0 && self.order[index - 1] == number {
                return Err(order.at(index).refuse(number, "another gate than the one before"));
            }
            lap.push(gates[number as usize - 1]);
        }
        let lap = if lap.is_empty() { gates.to_vec() } else { lap };
        let laps = field.at("laps").whole(self.laps, 1..=LAPS_LIMIT)?;
        let course: Vec<Gate> = (0..laps).flat_map(|_| lap.iter().copied()).collect();
        if course.len() > PASSES_LIMIT {
            return Err(field.reject(format!("{} gates to pass", course.len()), format!("at most {PASSES_LIMIT}")));
        }
        if course.windows(2).any(|pair| pair[0] == pair[1]) {
            return Err(field.reject("a lap that begins at the gate where it ends", "another gate at its end"));
        }
        Ok(course)
    }
}

impl Default for AgentsConfig {
    fn default() -> Self {
        Self { count: 1, ends: TeamEnd::Together, rewards: TeamRewards::Own, success: TeamSuccess::Own }
    }
}

impl AgentsConfig {
    /// The drones that fly in `world`.
    ///
    /// # Errors
    /// When there are none or too many, or they would leave its bodies lying about for good.
    pub fn check(&self, world: &World, field: &Field<'_>) -> Result<Agents, ConfigError> {
        let count = field.at("count").whole(self.count, 1..=DRONES_LIMIT)? as u32;
        let ends = match self.ends {
            // What starts anew with all drones starts anew with the only one.
            TeamEnd::Alone if count > 1 => TeamEnd::Alone,
            TeamEnd::Together | TeamEnd::Alone => TeamEnd::Together,
        };
        let lies_about = |movable: &Movable| !matches!(movable.drive, Drive::Walking(_));
        if ends == TeamEnd::Alone && world.movables.iter().any(lies_about) {
            let expected = "`together`: bodies that can be pushed stand up again when the episodes of all end";
            return Err(field.at("ends").reject("`alone` in a world with movables", expected));
        }
        Ok(Agents { count, ends, rewards: self.rewards, success: self.success })
    }
}

impl GoalsConfig {
    /// The goals of `drones` drones in a world.
    ///
    /// # Errors
    /// When a number is out of range, there is not one point for each drone, or no drone can be at one.
    pub fn check(&self, drones: u32, world: &World, field: &Field<'_>) -> Result<Goals, ConfigError> {
        match self {
            Self::PerAgent { points_m } => {
                let field = field.at("per_agent").at("points_m");
                if points_m.len() != drones as usize {
                    return Err(field.refuse("", format!("a list of {drones}, one for each drone")));
                }
                let point = |(index, point): (usize, &[f64; 3])| free_point(*point, world, &field.at(index));
                points_m.iter().enumerate().map(point).collect::<Result<_, _>>().map(Goals::PerAgent)
            }
            Self::Line { velocity_m_per_s } => {
                let field = field.at("line").at("velocity_m_per_s");
                field.reals(*velocity_m_per_s, &SPEED).map(Goals::Line)
            }
            Self::Wave { amplitude_m, rate_rad_per_s, until_secs } => {
                let field = field.at("wave");
                Ok(Goals::Wave {
                    amplitude: field.at("amplitude_m").reals(*amplitude_m, &LENGTH)?,
                    rate: field
                        .at("rate_rad_per_s")
                        .real(*rate_rad_per_s, &Limits::from(-100.0, 100.0, "rad/s"))?,
                    until_secs: field.at("until_secs").real(*until_secs, &Limits::from(0.0, 600.0, "s"))?,
                })
            }
            Self::Gates(_) => Ok(Goals::Gates),
            Self::Trajectory(trajectories) => trajectories.check(&field.at("trajectory")).map(Goals::Trajectory),
        }
    }
}

/// A point above the floor and outside of solids.
fn free_point(point: [f64; 3], world: &World, field: &Field<'_>) -> Result<Vector3<f64>, ConfigError> {
    let point = field.place(point)?;
    if world.floor == Floor::Solid && point.z <= 0.0 {
        return Err(field.at(2).refuse(point.z, "more than 0, because there is a floor at z = 0"));
    }
    match world.solids.iter().find(|solid| holds(solid, &point)) {
        Some(_) => Err(field.reject("a goal in a solid", "one that a drone can be at")),
        None => Ok(point),
    }
}
