//! The task a simulation runs: checked values in SI units. What users write lives in the configuration.

use kestrel_core::action::ActionSpace;
use kestrel_core::airframe::Airframe;
use kestrel_core::dynamics::Integrator;
use kestrel_core::observation::ObservationLayout;
use kestrel_core::vehicle::Ground;
use nalgebra::Vector3;

use crate::world::World;

/// One task: where, with what, from where, for what, until when.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Name for people.
    pub name: String,
    /// The place.
    pub aviary: Aviary,
    /// The drone.
    pub airframe: Airframe,
    /// How time advances.
    pub physics: Physics,
    /// What the policy commands.
    pub action: ActionSpace,
    /// What the policy sees.
    pub observation: ObservationLayout,
    /// What the critic sees.
    pub critic: CriticView,
    /// Where episodes begin.
    pub start: Start,
    /// What differs from episode to episode.
    pub randomisation: Randomisation,
    /// What is rewarded.
    pub rewards: Vec<WeightedTerm>,
    /// What ends an episode in failure.
    pub terminations: Vec<Termination>,
    /// Time after which an episode is cut off \[s\].
    pub episode_secs: f32,
    /// What counts as success.
    pub success: Success,
}

/// Integration of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Physics {
    /// Integrator of each substep.
    pub integrator: Integrator,
    /// Substeps in one control period.
    pub substeps: u32,
    /// Time between two actions \[s\].
    pub control_secs: f32,
    /// Whether rotors feel the floor.
    pub ground: Ground,
}

/// One place with obstacles.
#[derive(Clone, Debug, PartialEq)]
pub struct Aviary {
    /// Where the drone shall go \[m, world\].
    pub goal: Vector3<f32>,
    /// What stands there.
    pub world: World,
}

/// Axis-aligned box \[m, world\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cuboid {
    /// Corner with the smallest coordinates.
    pub low: Vector3<f32>,
    /// Corner with the greatest coordinates.
    pub high: Vector3<f32>,
}

/// What the critic sees beside the observation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CriticView {
    /// Nothing else.
    Observation,
    /// Rotor speeds, wind, the episode's parameters and the time left.
    Privileged,
}

/// Start states: directions and heading uniform, magnitudes uniform up to their limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Where.
    pub position: StartPosition,
    /// Greatest tilt \[rad\].
    pub tilt_limit: f32,
    /// Greatest speed \[m/s\].
    pub speed_limit: f32,
    /// Greatest angular velocity \[rad/s\].
    pub body_rates_limit: f32,
}

/// Where episodes begin.
#[derive(Clone, Copy, Debug, PartialEq)]
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
}

/// Parameters drawn at each reset, as uniform factors `1 ± value`, and a constant wind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Randomisation {
    /// Of the mass.
    pub mass: f32,
    /// Of each moment of inertia.
    pub inertia: f32,
    /// Of the thrust coefficient.
    pub thrust: f32,
    /// Of the rotors' time constants.
    pub rotor_lag: f32,
    /// Greatest wind speed \[m/s\]; its direction is uniform.
    pub wind_speed: f32,
}

/// A reward term and its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeightedTerm {
    /// What is measured.
    pub term: RewardTerm,
    /// What one unit of it is worth; penalties are negative.
    pub weight: f32,
}

/// What can be rewarded. Terms are rates, multiplied by the control period, unless they say otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RewardTerm {
    /// One.
    Alive,
    /// `1 / (1 + (d / scale)²)` of the distance d to the goal.
    Proximity {
        /// Distance at which it is one half \[m\].
        scale_m: f32,
    },
    /// Distance to the goal \[m\].
    Distance,
    /// Squared speed \[m²/s²\].
    Velocity,
    /// Squared angular velocity \[rad²/s²\].
    BodyRates,
    /// One minus the cosine of the tilt.
    Tilt,
    /// Squared action.
    Action,
    /// Squared change of the action since the last step.
    ActionChange,
    /// Metres closer to the goal in this step (not a rate).
    Progress,
    /// One, once, when the episode ends in success.
    Success,
    /// One, once, when the episode ends in failure.
    Failure,
}

/// What ends an episode in failure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Termination {
    /// The drone's hull touches a solid or the floor.
    Collision,
    /// The centre of mass leaves the box.
    OutOfBounds(Cuboid),
    /// The tilt exceeds the limit.
    Tilt {
        /// \[rad\].
        limit: f32,
    },
    /// The drone is farther from the goal than the limit.
    Distance {
        /// \[m\].
        limit_m: f32,
    },
}

/// What counts as success.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Success {
    /// Within the radius of the goal from the given time to the end of the episode without leaving it.
    Settle {
        /// \[m\].
        radius_m: f32,
        /// \[s\].
        within_secs: f32,
    },
    /// Inside the region and slower than the limit; ends the episode.
    Reach {
        /// Where the centre of mass must be.
        region: Cuboid,
        /// \[m/s\].
        speed_limit: f32,
    },
}

impl RewardTerm {
    /// Name in logs and in the configuration.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Alive => "alive",
            Self::Proximity { .. } => "proximity",
            Self::Distance => "distance",
            Self::Velocity => "velocity",
            Self::BodyRates => "body_rates",
            Self::Tilt => "tilt",
            Self::Action => "action",
            Self::ActionChange => "action_change",
            Self::Progress => "progress",
            Self::Success => "success",
            Self::Failure => "failure",
        }
    }
}

impl Physics {
    /// Time of one substep \[s\].
    pub fn substep_secs(&self) -> f32 {
        self.control_secs / self.substeps as f32
    }
}

impl Scenario {
    /// Control periods after which an episode is cut off.
    pub fn episode_steps(&self) -> u32 {
        (self.episode_secs / self.physics.control_secs).round().max(1.0) as u32
    }
}
