//! What ends an episode before its time.
//!
//! A termination is a file: its keys in YAML, what is wrong with them, what it remembers and where it ends an episode. To
//! add one, write `termination/NAME.rs` and its name in the two lists here; schema and messages follow (`BLESS=1 cargo
//! test -p kestrel-experiments config::`). A termination of a user's own crate implements [`TerminationFunction`].

#[macro_use]
mod list;

mod arrival;
mod body_rates;
mod collision;
mod collision_outside;
mod custom;
mod cut_out_of_bounds;
mod distance;
mod enter_area;
mod exit;
mod field_covered;
mod finish;
mod fuel;
mod heading;
mod hold;
mod impact;
mod landing;
mod out_of_bounds;
mod rest;
mod roll_pitch;
mod speed;
mod tilt;

use kestrel_config::{ConfigError, Field};
use kestrel_core::real::Real;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use custom::{Custom, TerminationFunction};

use crate::outcome::Ending;
use crate::physics::Contacts;
use crate::swarm::Column;
use crate::term::{FlightView, Memory, Rule, RuleTask, StartLimit};
use crate::world::Cuboid;

terminations! {
    alone {
        "collision" Collision in collision;
        "landing" Landing in landing;
        "finish" Finish in finish;
    }

    with {
        "collision_outside" CollisionOutside in collision_outside;
        "out_of_bounds" OutOfBounds in out_of_bounds;
        "cut_out_of_bounds" CutOutOfBounds in cut_out_of_bounds;
        "tilt" Tilt in tilt;
        "roll_pitch" RollPitch in roll_pitch;
        "distance" Distance in distance;
        "arrival" Arrival in arrival;
        "enter_area" EnterArea in enter_area;
        "field_covered" FieldCovered in field_covered;
        "fuel" Fuel in fuel;
        "exit" Exit in exit;
        "rest" Rest in rest;
        "hold" Hold in hold;
        "speed" Speed in speed;
        "body_rates" BodyRates in body_rates;
        "impact" Impact in impact;
        "heading" Heading in heading;
    }
}

/// Most terminations.
const TERMINATIONS_LIMIT: usize = 16;

impl Termination {
    /// The terminations as they run; `field` is their list.
    ///
    /// # Errors
    /// When there are too many, a number is out of range, the goal itself ends the episode, or `landing` leaves no touch to an
    /// `impact` after it.
    pub(crate) fn check_all(
        terminations: &[Self],
        task: &RuleTask,
        field: &Field<'_>,
    ) -> Result<Vec<Self>, ConfigError> {
        if terminations.len() > TERMINATIONS_LIMIT {
            return Err(field.refuse("", format!("a list of at most {TERMINATIONS_LIMIT}")));
        }
        let mut after_landing = terminations.iter().skip_while(|rule| **rule != Self::Landing);
        if after_landing.any(|rule| matches!(rule, Self::Impact(_))) {
            return Err(field.reject("`impact` after `landing`, which ends every touch", "`impact` before it"));
        }
        let check = |(index, rule): (usize, &Self)| {
            rule.check(task, &field.at(index).at(rule.name()))?;
            Ok(rule.clone())
        };
        terminations.iter().enumerate().map(check).collect()
    }

    /// The box that the drone must not leave, if this is about one \[m, world\].
    pub fn bounds(&self) -> Option<Cuboid> {
        match self.start_limit() {
            StartLimit::Outside(bounds) => Some(bounds),
            StartLimit::None
            | StartLimit::Touching
            | StartLimit::Tilt(_)
            | StartLimit::Distance(_)
            | StartLimit::Speed(_)
            | StartLimit::BodyRates(_) => None,
        }
    }

    /// Whether it ends an episode in success.
    pub fn is_success(&self) -> bool {
        self.ending() == Ending::Success
    }
}
