//! What reward terms and terminations share: what they are checked against, what they look at, and what they remember
//! of an episode.

mod cells;
mod drone_view;
mod lanes;
mod reference;
mod roll_pitch_limit;

use kestrel_config::{ConfigError, Field, Limits};
use kestrel_core::real::Real;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub(crate) use cells::Cells;
pub use drone_view::DroneView;
pub(crate) use lanes::{contains, mark};

use crate::agent::PASSING_LEN;
use crate::contact::Touch;
use crate::outcome::Ending;
use crate::physics::Contacts;
use crate::rooms::{Arenas, Ways, room};
use crate::swarm::{Column, Swarm, vector};
use crate::world::Cuboid;

/// What every file of a term or a termination needs.
pub(crate) mod prelude {
    pub(crate) use kestrel_core::real::Real;
    pub(crate) use nalgebra::Vector3;
    pub(crate) use schemars::JsonSchema;
    pub(crate) use serde::{Deserialize, Serialize};

    pub(crate) use super::Cells;
    pub(crate) use super::lanes::{
        distance, each, is_unset, length, mark, planar_distance, planar_length, squared_length, stays_in,
        sum_squares,
    };
    pub(crate) use super::reference::{INTERVAL, LEVEL, LevelWithin, REST_HEIGHT, counted_periods, doubled};
    pub(crate) use super::roll_pitch_limit::RollPitchLimit;
    pub(crate) use super::{
        AgentSet, FlightView, LENGTH, Memory, Paid, RewardTask, Rule, RuleTask, SPEED, StartLimit, StepView, Term,
    };
    pub(crate) use crate::config::area::{AreaConfig, BoxConfig};
    pub(crate) use crate::outcome::Ending;
    pub(crate) use crate::physics::Contacts;
    pub(crate) use crate::swarm::{Column, vector};
    pub(crate) use kestrel_config::{ConfigError, Field, Limits};
}

/// Lengths that a term may name.
pub(crate) const LENGTH: Limits = Limits::above(0.0, 1000.0, "m");

/// Speeds that a termination may name.
pub(crate) const SPEED: Limits = Limits::above(0.0, 20.0, "m/s");

/// A reward term: the keys of its mapping in YAML, what is wrong with them, and what it pays.
pub(crate) trait Term: Sized {
    /// What a weight of one is paid by.
    const PAID: Paid;

    /// Refuses what is out of range or cannot be paid in this task; `field` is its mapping.
    fn check(&self, _task: &RewardTask, _field: &Field<'_>) -> Result<(), ConfigError> {
        Ok(())
    }

    /// The same term with what it needs of the task.
    fn prepared(self, _task: &RewardTask) -> Self {
        self
    }

    /// Which drones it is paid to.
    fn agents(&self) -> AgentSet {
        AgentSet::All
    }

    /// How far ahead it looks for the nearest obstacle \[s\], if it does.
    fn looks_around_secs(&self) -> Option<f32> {
        None
    }

    /// The ways to the goal that it is about, once it was checked as part of a task.
    fn ways(&self) -> Option<&Ways> {
        None
    }

    /// The same for other ways, if it is about ways.
    fn along(self, _ways: Ways) -> Self {
        self
    }

    /// Whether it looks for the point ahead on [`Self::ways`].
    fn looks_along_ways(&self) -> bool {
        false
    }

    /// How far ahead it looks for whom the drone meets \[s\], if it does.
    fn looks_ahead_secs(&self) -> Option<f64> {
        None
    }

    /// What it remembers of an episode.
    fn memory(&self) -> Memory {
        Memory::NONE
    }

    /// What it pays in each lane, where one unit is worth so much.
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    );
}

/// A rule that ends episodes: the keys of its mapping in YAML, what is wrong with them, and where it ends one.
pub(crate) trait Rule {
    /// Refuses what is out of range; `field` is its mapping.
    fn check(&self, _task: &RuleTask, _field: &Field<'_>) -> Result<(), ConfigError> {
        Ok(())
    }

    /// How its ends are reported.
    fn ending(&self) -> Ending;

    /// Whether its ends are cut-offs from which the future is still estimated, rather than terminal states.
    fn truncates(&self) -> bool {
        false
    }

    /// Where episodes cannot start because it would end them at once.
    fn start_limit(&self) -> StartLimit {
        StartLimit::None
    }

    /// What it takes contacts to do, if it looks at them.
    fn contacts(&self) -> Option<Contacts> {
        None
    }

    /// What it remembers of an episode.
    fn memory(&self) -> Memory {
        Memory::NONE
    }

    /// Writes `code` where it ends the episode.
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        memory: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    );
}

/// What a term's unit is paid by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paid {
    /// The second: changing the control rate does not change what an episode is worth.
    PerSecond,
    /// The control period, whatever that is.
    PerStep,
}

/// Some drones of an environment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AgentSet {
    /// All.
    #[default]
    All,
    /// The first, who leads.
    First,
    /// All but the first.
    Others,
}

impl AgentSet {
    /// Whether the drone with this index belongs to it.
    pub fn contains(self, agent: usize) -> bool {
        match self {
            Self::All => true,
            Self::First => agent == 0,
            Self::Others => agent > 0,
        }
    }
}

/// What a term or a termination remembers of a drone's episode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Memory {
    /// Numbers, in the precision of the simulation.
    pub columns: usize,
    /// What each of them is at the start of an episode.
    pub start: f64,
    /// Whether they outlive the episode.
    pub lasts: bool,
}

impl Memory {
    /// Nothing.
    pub const NONE: Self = Self { columns: 0, start: 0.0, lasts: false };

    /// So many numbers that are zero at the start of an episode.
    pub const fn zeros(columns: usize) -> Self {
        Self { columns, start: 0.0, lasts: false }
    }

    /// So many numbers that are NaN at the start of an episode, which says that there is nothing to remember yet.
    pub const fn unset(columns: usize) -> Self {
        Self { columns, start: f64::NAN, lasts: false }
    }
}

/// What reward terms are checked against.
pub(crate) struct RewardTask {
    pub(crate) goals: GoalKind,
    pub(crate) contacts: Contacts,
    /// To the goal.
    pub(crate) ways: Ways,
    /// Whether drones look for one by themselves.
    pub(crate) own_way: bool,
}

impl RewardTask {
    /// Refuses a term that follows the way that a drone finds where it looks for none.
    pub(crate) fn needs_own_way(&self, field: &Field<'_>) -> Result<(), ConfigError> {
        if self.own_way {
            return Ok(());
        }
        Err(field.reject("true for drones that look for no way", "a sensor `way`, or false"))
    }

    /// Refuses `found`, which is about the shortest way to the goal, where there is none; what can be written instead.
    pub(crate) fn needs_ways(&self, found: &str, instead: &str, field: &Field<'_>) -> Result<(), ConfigError> {
        match self.goals {
            GoalKind::OnePlace => Ok(()),
            GoalKind::Several => {
                let expected = format!("{instead}: ways lead to one goal that stands still");
                Err(field.reject(format!("{found} beside `goals`"), expected))
            }
        }
    }

    /// Refuses a term that looks for obstacles where physics knows none.
    pub(crate) fn needs_contacts(&self, term: &str, field: &Field<'_>) -> Result<(), ConfigError> {
        match self.contacts {
            Contacts::Reported | Contacts::Solved => Ok(()),
            Contacts::Absent => {
                Err(field.reject(format!("`{term}` beside physics without contacts"), "physics that has them"))
            }
        }
    }
}

/// How many places the goals of a task are at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum GoalKind {
    /// All drones have one, which stands still.
    OnePlace,
    /// Drones have different ones, or they move.
    Several,
}

/// What terminations are checked against.
pub(crate) struct RuleTask {
    /// Where goals can be \[m, world\]: a point, unless worlds are drawn.
    pub(crate) goals: Cuboid,
    /// Whether they are gates to pass.
    pub(crate) is_race: bool,
}

/// Which starts a termination would end at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum StartLimit {
    /// None.
    None,
    /// Those that touch something.
    Touching,
    /// Those outside a box.
    Outside(Cuboid),
    /// Those tilted so much \[rad\].
    Tilt(f32),
    /// Those so far from the goal \[m\].
    Distance(f32),
    /// Those so fast \[m/s\].
    Speed(f32),
    /// Those that turn so fast \[rad/s\].
    BodyRates(f32),
}

/// What terminations look at: the drones of a block after a control period.
pub(crate) struct FlightView<'a, const LANES: usize, R: Real> {
    pub(crate) swarm: &'a Swarm<LANES, R>,
    pub(crate) goal: &'a [Column<LANES, R>; 3],
    /// To the goal \[m\].
    pub(crate) distances: &'a Column<LANES, R>,
    pub(crate) previous_distances: &'a Column<LANES, R>,
    pub(crate) actions: &'a [Column<LANES, R>],
    pub(crate) previous_actions: &'a [Column<LANES, R>],
    /// One while touching an obstacle, one while touching the landing zone.
    pub(crate) touches: &'a [Column<LANES, R>; 2],
    /// The plane that touches the nearest obstacle, where a reward looks around: its normal towards the drone, and how far the
    /// origin is above it \[m\].
    pub(crate) nearest: Option<&'a [Column<LANES, R>; 4]>,
    /// The mate or person whom the drone meets next, where a reward looks ahead: the middle and the radius of a ball \[m, world\],
    /// and its velocity \[m/s, world\].
    pub(crate) passing: Option<&'a [Column<LANES, R>; PASSING_LEN]>,
    /// The points ahead on the ways that drones find by themselves \[m, world\], where they do: those that they saw last.
    pub(crate) ahead: Option<&'a [Column<LANES, R>; 3]>,
    /// The points ahead on the shortest free ways \[m, world\], where a reward looks along them.
    pub(crate) signposts: Option<&'a [Column<LANES, R>; 3]>,
    /// Control periods flown, this one included.
    pub(crate) steps: &'a Column<LANES, R>,
    /// Gates that are still to be passed, where there is a race.
    pub(crate) gates_left: Option<&'a Column<LANES, R>>,
    /// Which drone of its environment this is.
    pub(crate) agent: usize,
    /// Positions of all drones of the environments.
    pub(crate) team: &'a [[Column<LANES, R>; 3]],
    /// What stands there, unless contacts are absent.
    pub(crate) arenas: Option<&'a Arenas>,
    /// The room of each lane, where rooms are drawn.
    pub(crate) rooms: Option<&'a Column<LANES, R>>,
    pub(crate) control_rate_hz: f64,
}

/// What reward terms look at: the flight, and which episodes end with this step.
pub(crate) struct StepView<'a, const LANES: usize, R: Real> {
    pub(crate) flight: FlightView<'a, LANES, R>,
    pub(crate) ends: &'a Ends<LANES, R>,
}

impl<'a, const LANES: usize, R: Real> core::ops::Deref for StepView<'a, LANES, R> {
    type Target = FlightView<'a, LANES, R>;

    #[inline(always)]
    fn deref(&self) -> &Self::Target {
        &self.flight
    }
}

/// One where an episode just ended so, zero elsewhere.
#[derive(Clone, Debug)]
pub(crate) struct Ends<const LANES: usize, R> {
    pub(crate) success: Column<LANES, R>,
    pub(crate) failure: Column<LANES, R>,
    pub(crate) time_up: Column<LANES, R>,
}

impl<const LANES: usize, R: Real> FlightView<'_, LANES, R> {
    /// Shows every drone, with what is remembered of its episode.
    pub(crate) fn each_drone(
        &self,
        memory: &mut [Column<LANES, R>],
        mut show: impl FnMut(usize, &DroneView<'_>, &mut [f64]),
    ) {
        let mut remembered = vec![0.0; memory.len()];
        for lane in 0..LANES {
            let numbers = |columns: &[Column<LANES, R>]| -> Vec<f64> {
                columns.iter().map(|column| column[lane].to_f64()).collect()
            };
            let position = vector(&self.swarm.position, lane).map(Real::to_f32);
            let view = DroneView {
                state: self.swarm.state(lane).map(Real::to_f64),
                goal: vector(self.goal, lane).map(Real::to_f64),
                distance: self.distances[lane].to_f64(),
                previous_distance: self.previous_distances[lane].to_f64(),
                action: &numbers(self.actions),
                previous_action: &numbers(&self.previous_actions[..self.actions.len()]),
                touch: Touch {
                    obstacle: self.touches[0][lane].to_f64() > 0.5,
                    landing: self.touches[1][lane].to_f64() > 0.5,
                },
                clearance: self.arenas.map_or(f64::INFINITY, |arenas| {
                    let arena = arenas.of(room(self.rooms, lane));
                    f64::from(arena.clearance(position.x, position.y, position.z))
                }),
                agent: self.agent,
                team: &self.team.iter().map(|place| vector(place, lane).map(Real::to_f64)).collect::<Vec<_>>(),
                period: self.steps[lane].to_f64() as u32,
                control_secs: 1.0 / self.control_rate_hz,
            };
            remembered.iter_mut().zip(&*memory).for_each(|(number, column)| *number = column[lane].to_f64());
            show(lane, &view, &mut remembered);
            memory.iter_mut().zip(&remembered).for_each(|(column, number)| column[lane] = R::from_f64(*number));
        }
    }
}
