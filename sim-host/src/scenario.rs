//! The task a simulation runs: checked values in SI units. What users write lives in the configuration.

use std::sync::{Arc, OnceLock};

use kestrel_core::action::{ActionSpace, RotorSpeeds};
use kestrel_core::airframe::Airframe;
use kestrel_core::observation::{ObservationLayout, PilotLayout};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::airframe_family::AirframeFamily;
use crate::camera::OnboardCamera;
use crate::contact::DistanceField;
use crate::course::Gate;
use crate::estimate::EstimateErrors;
use crate::latency::Latency;
use crate::rate_loop::GYRO_CUTOFF_HZ;
use crate::reward::RewardTerm;
use crate::rooms::{Room, Rooms, Ways};
use crate::sensor::SensorSuite;
use crate::termination::Termination;
use crate::trajectory::Trajectories;
use crate::world::{Cuboid, World};

mod success;

pub use success::Success;

pub use crate::physics::{Contacts, Downwash, Physics, Preset};

/// One task: where, with what, from where, for what, until when.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Name for people.
    pub name: String,
    /// The place; the first of the rooms where episodes draw theirs.
    pub aviary: Aviary,
    /// The rooms of which every episode draws one, unless all are in one place.
    pub drawn: Option<Arc<Rooms>>,
    /// How the goal moves.
    pub goals: Goals,
    /// Who flies there together.
    pub agents: Agents,
    /// The drone.
    pub airframe: Airframe,
    /// How time advances.
    pub physics: Physics,
    /// What the policy commands.
    pub action: ActionSpace,
    /// Cut-off frequency of the gyroscope's low-pass filter \[Hz\], below half of the physics rate; read by the rate loop
    /// of [`ActionSpace::RateLoop`] only.
    pub gyro_cutoff_hz: f64,
    /// What the drone measures, where the policy sees measurements.
    pub sensors: SensorSuite,
    /// What the policy sees.
    pub observation: ObservationLayout,
    /// The camera whose images it sees beside that.
    pub camera: Option<OnboardCamera>,
    /// What the critic sees.
    pub critic: CriticView,
    /// Where episodes begin.
    pub start: Start,
    /// How late the drone knows its state, and its motors their command.
    pub latency: Latency,
    /// How wrong it knows it.
    pub estimate: EstimateErrors,
    /// What differs from episode to episode.
    pub randomisation: Randomisation,
    /// What is rewarded.
    pub rewards: Vec<RewardTerm>,
    /// What ends an episode before its time.
    pub terminations: Vec<Termination>,
    /// Time after which an episode is cut off \[s\].
    pub episode_secs: f32,
    /// How that time is counted.
    pub clock: Clock,
    /// What running out of time means.
    pub time_limit: TimeLimit,
    /// What counts as success.
    pub success: Success,
}

/// Who flies together in one environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Agents {
    /// Drones in each environment, at least one.
    pub count: u32,
    /// What becomes of the others when one's episode ends.
    pub ends: TeamEnd,
    /// Whose rewards a drone is paid.
    pub rewards: TeamRewards,
    /// Who has to succeed.
    pub success: TeamSuccess,
}

/// What becomes of the others when one drone's episode ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TeamEnd {
    /// Their episodes end with it.
    #[default]
    Together,
    /// They fly on; the one starts anew.
    Alone,
}

/// Whose rewards a drone is paid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TeamRewards {
    /// Its own.
    #[default]
    Own,
    /// The sum over all drones of the environment.
    Shared,
}

/// Who has to succeed for a drone's episode to be a success.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TeamSuccess {
    /// The drone itself.
    #[default]
    Own,
    /// All drones of the environment.
    All,
}

/// How the goal differs between drones or moves in an episode.
#[derive(Clone, Debug, PartialEq)]
pub enum Goals {
    /// It is [`Aviary::goal`] for all, always.
    Fixed,
    /// One point for each drone \[m, world\].
    PerAgent(Vec<Vector3<f64>>),
    /// From [`Aviary::goal`] on with this velocity \[m/s, world\].
    Line(Vector3<f64>),
    /// [`Aviary::goal`] plus `amplitude · cos(rate · t)`, standing still from `until_secs` on.
    Wave {
        /// \[m, world\].
        amplitude: Vector3<f64>,
        /// \[rad/s\].
        rate: f64,
        /// \[s\].
        until_secs: f64,
    },
    /// Along a curve about [`Aviary::goal`], drawn for each episode.
    Trajectory(Trajectories),
    /// The middle of the next of [`Aviary::gates`]; that of the last when all were passed.
    Gates,
}

/// Where the goals of an environment are when an episode begins.
#[derive(Clone, Debug, PartialEq)]
pub struct FirstGoals<'a> {
    /// Of each drone \[m, world\]; of a goal that goes along a curve, the curve's centre.
    pub centres: Vec<Vector3<f32>>,
    /// The curves, on any point of which it may begin.
    pub curves: Option<&'a Trajectories>,
}

/// How the time of an episode is counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// The n-th control period ends at n periods; an episode of T seconds has T times the control rate of them.
    Elapsed,
    /// As the reference counts: the clock is read before it advances and must exceed the limit, so that an episode has
    /// two control periods more, and moving goals are one period late.
    Reference,
}

/// What running out of time means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeLimit {
    /// The future still has worth.
    Truncates,
    /// Nothing follows, as in those aviaries of the reference that do not say why an episode ended.
    Terminates,
}

/// One place with obstacles.
#[derive(Clone, Debug, PartialEq)]
pub struct Aviary {
    /// Where the drone shall go \[m, world\].
    pub goal: Vector3<f32>,
    /// Points to fly through on the way to the goal \[m, world\], for each drone; the last list holds for
    /// all further ones. Nothing in the simulation reads them: they are for pilots who know the place.
    pub routes: Vec<Vec<Vector3<f32>>>,
    /// Gates in the order in which they are passed, which may come back to one; none where there is no race.
    pub gates: Vec<Gate>,
    /// What stands there.
    pub world: World,
}

/// What the critic sees while training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CriticView {
    /// What the policy sees.
    #[default]
    Observation,
    /// Also rotor speeds, wind, the episode's parameters and the time left, which only a simulator knows.
    Privileged,
}

/// Start states: directions uniform, headings and magnitudes uniform up to their limits.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// Where.
    pub position: StartPosition,
    /// Greatest heading to either side of +x \[rad\]; drones at places of their own have the place's, unless they are tilted.
    pub heading_limit: f32,
    /// Greatest tilt \[rad\].
    pub tilt_limit: f32,
    /// Greatest speed \[m/s\].
    pub speed_limit: f32,
    /// Greatest angular velocity \[rad/s\].
    pub body_rates_limit: f32,
}

/// Where episodes begin.
#[derive(Clone, Debug, PartialEq)]
pub enum StartPosition {
    /// At a distance from the goal, in any direction.
    AroundGoal {
        /// Least distance \[m\].
        nearest_m: f32,
        /// Greatest distance \[m\].
        farthest_m: f32,
    },
    /// Uniform in a box.
    Within(Cuboid),
    /// Uniform where a box is free.
    FreeWithin(FreeSpace),
    /// On the way from a box to the goal.
    AlongWay(PathStarts),
    /// Always there, or nearby, one place for each drone.
    Exactly(Vec<Place>),
}

/// The part of a box that is far enough from everything.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeSpace {
    /// The box.
    pub region: Cuboid,
    /// Least distance of a start \[m\] to the obstacles.
    pub clearance_m: f32,
    /// Axis-aligned bounds of what stands there.
    pub obstacles: Vec<Cuboid>,
    /// A point that is free.
    pub refuge: Vector3<f32>,
}

/// Starts in a box, and around points of the shortest ways from it to the goal.
#[derive(Clone, Debug)]
pub struct PathStarts {
    /// The box, whose points all count as free, and what is free around the way.
    pub space: FreeSpace,
    /// Greatest distance of a start from a point of a way, along each axis \[m\].
    pub spread_m: f32,
    /// Share of the starts in the box.
    pub box_share: f32,
    /// The ways.
    pub ways: Arc<DistanceField>,
    points: OnceLock<Vec<Vector3<f32>>>,
}

/// A position and a heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// \[m, world\].
    pub position: Vector3<f64>,
    /// About the world z axis, zero facing +x \[rad\].
    pub heading: f64,
    /// Starts are drawn from the ball of this radius around the position \[m\].
    pub spread: f32,
}

/// Parameters drawn at each reset, as uniform factors `1 ± value` or between two bounds, and a constant wind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Randomisation {
    /// Of the mass.
    pub mass: f32,
    /// Of each moment of inertia.
    pub inertia: f32,
    /// Of the thrust coefficient.
    pub thrust: f32,
    /// Least and greatest share of the rotors' time constants.
    pub rotor_lag: [f32; 2],
    /// Least and greatest share of the rotors' reaction torque, beside that of their thrust.
    pub torque: [f32; 2],
    /// Of the rotors' drag, and of each of the airframe's effects but the rate damping.
    pub effects: f32,
    /// Least and greatest share of the airframe's rate damping.
    pub rate_damping: [f32; 2],
    /// Of the thrust of each motor by itself.
    pub motor: f32,
    /// Least and greatest share of a commanded rotor speed that the battery reaches.
    pub battery: [f32; 2],
    /// Greatest wind speed \[m/s\]; its direction is uniform.
    pub wind_speed: f32,
    /// Least and greatest share of its thrust that one motor, any of the four, has.
    pub weak_motor: [f32; 2],
    /// Where every episode has an airframe of its own: which. What is above is drawn around that one.
    pub airframes: Option<AirframeFamily>,
}

impl Randomisation {
    /// Nominal drones in still air.
    pub const NONE: Self = Self {
        mass: 0.0,
        inertia: 0.0,
        thrust: 0.0,
        rotor_lag: [1.0; 2],
        torque: [1.0; 2],
        effects: 0.0,
        rate_damping: [1.0; 2],
        motor: 0.0,
        battery: [1.0; 2],
        wind_speed: 0.0,
        weak_motor: [1.0; 2],
        airframes: None,
    };
}

impl Agents {
    /// A lone drone.
    pub const ONE: Self =
        Self { count: 1, ends: TeamEnd::Together, rewards: TeamRewards::Own, success: TeamSuccess::Own };
}

impl Goals {
    /// The goal of an agent \[m, world\] after a time \[s\] of its episode; `nominal` is that of the aviary, and the centre
    /// of a curve.
    pub fn at(&self, nominal: &Vector3<f32>, agent: usize, secs: f64) -> Vector3<f64> {
        let nominal: Vector3<f64> = nominal.cast();
        match self {
            Self::Fixed | Self::Trajectory(_) | Self::Gates => nominal,
            Self::PerAgent(goals) => goals[agent],
            Self::Line(velocity) => nominal + velocity * secs,
            Self::Wave { amplitude, rate, until_secs } => {
                nominal + amplitude * libm::cos(rate * secs.min(*until_secs))
            }
        }
    }

    /// Where the goals of all drones of an environment are at the start.
    pub fn first(&self, nominal: &Vector3<f32>, drones: u32) -> FirstGoals<'_> {
        let centres = (0..drones as usize).map(|agent| self.at(nominal, agent, 0.0).cast()).collect();
        FirstGoals { centres, curves: self.trajectories() }
    }

    /// Its velocity \[m/s, world\], that of a curve apart, on average over the `lag_secs` before then, or then where that is zero. The average of
    /// a wave that has come to rest is that of its last motion: the reference's target velocity never ends.
    pub fn velocity_at(&self, secs: f64, lag_secs: f64) -> Vector3<f64> {
        match self {
            Self::Fixed | Self::PerAgent(_) | Self::Trajectory(_) | Self::Gates => Vector3::zeros(),
            Self::Line(velocity) => *velocity,
            Self::Wave { amplitude, rate, until_secs } => {
                if lag_secs > 0.0 {
                    let last = secs.min(*until_secs);
                    let phase = |secs: f64| libm::cos(rate * secs.max(0.0));
                    return amplitude * ((phase(last) - phase(last - lag_secs)) / lag_secs);
                }
                amplitude * if secs < *until_secs { -rate * libm::sin(rate * secs) } else { 0.0 }
            }
        }
    }

    /// Whether it moves by itself.
    pub fn is_moving(&self) -> bool {
        match self {
            Self::Fixed | Self::PerAgent(_) | Self::Gates => false,
            Self::Line(_) | Self::Wave { .. } | Self::Trajectory(_) => true,
        }
    }

    /// The curves that episodes draw theirs from.
    pub(crate) fn trajectories(&self) -> Option<&Trajectories> {
        match self {
            Self::Trajectory(trajectories) => Some(trajectories),
            Self::Fixed | Self::PerAgent(_) | Self::Line(_) | Self::Wave { .. } | Self::Gates => None,
        }
    }
}

impl Start {
    /// The same with more to keep off.
    fn among(&self, obstacles: &[Cuboid]) -> Self {
        let mut start = self.clone();
        if let StartPosition::FreeWithin(space) = &mut start.position {
            space.obstacles.extend_from_slice(obstacles);
        }
        start
    }
}

impl FreeSpace {
    /// Whether a point \[m, world\] is far enough from everything.
    pub fn holds(&self, point: &Vector3<f32>) -> bool {
        self.holds_among(point, &[])
    }

    /// Whether it is also far enough from these.
    pub(crate) fn holds_among(&self, point: &Vector3<f32>, obstacles: &[Cuboid]) -> bool {
        let limit = self.clearance_m * self.clearance_m;
        self.obstacles
            .iter()
            .chain(obstacles)
            .all(|Cuboid { low, high }| (point - point.sup(low).inf(high)).norm_squared() >= limit)
    }
}

impl PathStarts {
    /// Starts in and on the way from the region of `space`.
    pub fn new(space: FreeSpace, spread_m: f32, box_share: f32, ways: Arc<DistanceField>) -> Self {
        Self { space, spread_m, box_share, ways, points: OnceLock::new() }
    }

    /// Points of the ways from the corners of the box and its middle, at least one \[m, world\].
    pub fn points(&self) -> &[Vector3<f32>] {
        self.points.get_or_init(|| {
            let Cuboid { low, high } = self.space.region;
            let corner = |number: usize| Vector3::from_fn(|axis, _| [low, high][number >> axis & 1][axis]);
            let origins = (0..8).map(corner).chain([(low + high) * 0.5]);
            origins.flat_map(|origin| self.ways.path_from(origin.into())).collect()
        })
    }
}

impl PartialEq for PathStarts {
    fn eq(&self, other: &Self) -> bool {
        let numbers = |starts: &Self| (starts.spread_m, starts.box_share);
        numbers(self) == numbers(other) && self.space == other.space && self.ways == other.ways
    }
}

impl Aviary {
    /// An empty floor with a goal \[m, world\].
    pub fn empty(goal: Vector3<f32>) -> Self {
        Self { goal, routes: Vec::new(), gates: Vec::new(), world: World::empty() }
    }

    /// Points to fly through on an agent's way to its goal \[m, world\]; none where nothing stands between.
    pub fn route(&self, agent: usize) -> &[Vector3<f32>] {
        match self.routes.get(agent) {
            Some(route) => route,
            None => self.routes.last().map_or(&[], Vec::as_slice),
        }
    }
}

impl Scenario {
    /// Hover one metre above the origin of an empty floor, from rest nearby: the least task, to make others from. It pays
    /// nothing, and nothing ends it but its eight seconds.
    pub fn hover(airframe: &Airframe, physics: Physics) -> Self {
        Self {
            name: "hover".into(),
            aviary: Aviary::empty(Vector3::new(0.0, 0.0, 1.0)),
            drawn: None,
            airframe: *airframe,
            goals: Goals::Fixed,
            agents: Agents::ONE,
            physics,
            action: ActionSpace::RotorSpeeds(RotorSpeeds::new(airframe, 0.3)),
            gyro_cutoff_hz: GYRO_CUTOFF_HZ,
            sensors: SensorSuite::none(),
            observation: ObservationLayout::Pilot(PilotLayout {
                position_scale_m: 1.0,
                velocity_scale: 2.0,
                body_rates_scale: 10.0,
            }),
            camera: None,
            critic: CriticView::Observation,
            start: Start {
                position: StartPosition::AroundGoal { nearest_m: 0.0, farthest_m: 0.5 },
                heading_limit: core::f32::consts::PI,
                tilt_limit: 0.0,
                speed_limit: 0.0,
                body_rates_limit: 0.0,
            },
            latency: Latency::NONE,
            estimate: EstimateErrors::NONE,
            randomisation: Randomisation::NONE,
            rewards: Vec::new(),
            terminations: Vec::new(),
            episode_secs: 8.0,
            clock: Clock::Elapsed,
            time_limit: TimeLimit::Truncates,
            success: Success::Settle { radius_m: 0.05, within_secs: 4.0 },
        }
    }

    /// How many rooms episodes draw from; one where all are in one place.
    pub fn rooms(&self) -> u32 {
        self.drawn.as_ref().map_or(1, |rooms| rooms.range().count)
    }

    /// The place of a room.
    ///
    /// # Panics
    /// When rooms are drawn and there is no such one.
    pub fn aviary_of(&self, room: u32) -> &Aviary {
        self.drawn.as_ref().map_or(&self.aviary, |rooms| &rooms.room(room).aviary)
    }

    /// Bounds of what stands in a room that is drawn; where none is, what there is to keep off stands with the start.
    pub(crate) fn obstacles_of(&self, room: u32) -> &[Cuboid] {
        self.drawn.as_ref().map_or(&[], |rooms| &rooms.room(room).obstacles)
    }

    /// The same task in one of its rooms only.
    ///
    /// # Panics
    /// As [`Self::aviary_of`].
    #[must_use]
    pub fn in_room(&self, room: u32) -> Self {
        let Some(rooms) = &self.drawn else { return self.clone() };
        let Room { aviary, ways, obstacles } = rooms.room(room);
        Self {
            aviary: aviary.clone(),
            start: self.start.among(obstacles),
            rewards: match ways {
                Some(ways) => self.rewards_along(&Ways::Same(Arc::clone(ways))),
                None => self.rewards.clone(),
            },
            drawn: None,
            ..self.clone()
        }
    }

    /// The same task in other rooms.
    #[must_use]
    pub fn in_rooms(&self, rooms: &Arc<Rooms>) -> Self {
        Self {
            aviary: rooms.room(0).aviary.clone(),
            rewards: self.rewards_along(&Ways::Drawn(Arc::clone(rooms))),
            drawn: Some(Arc::clone(rooms)),
            ..self.clone()
        }
    }

    fn rewards_along(&self, ways: &Ways) -> Vec<RewardTerm> {
        self.rewards.iter().cloned().map(|term| term.along(ways.clone())).collect()
    }

    /// Control periods after which an episode is cut off.
    pub fn episode_steps(&self) -> u32 {
        let periods = f64::from(self.episode_secs) * self.physics.control_rate_hz;
        match self.clock {
            Clock::Elapsed => periods.round().max(1.0) as u32,
            // A limit in single precision may stand a hair below the whole number that it means.
            Clock::Reference => (periods + 1e-3).floor() as u32 + 2,
        }
    }
}
