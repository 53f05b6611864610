//! What a step is worth: a sum of weighted terms.
//!
//! A term is a file: its keys in YAML, what is wrong with them, what it remembers and what it pays. To add one, write
//! `reward/NAME.rs` and its name in the two lists here; schema and messages follow (`BLESS=1 cargo test -p
//! kestrel-experiments config::`). A term of a user's own crate implements [`RewardFunction`].

#[macro_use]
mod list;

mod action;
mod action_change;
mod alive;
mod avoidance;
mod body_rates;
mod clearance;
mod cruise;
mod custom;
mod distance;
mod encounter;
mod energy;
mod failure;
mod geodesic_progress;
mod heading_error;
mod jerk;
mod progress;
mod proximity;
mod reference;
mod shaping;
mod success;
#[cfg(test)]
mod tests;
mod tilt;
#[cfg(test)]
mod trial;
mod velocity;
mod yaw_rate;

use kestrel_config::{ConfigError, Field, Limits};
use kestrel_core::real::Real;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use custom::{Custom, RewardFunction};
pub use reference::height_difference::Neighbour;

pub use crate::term::{AgentSet, DroneView, Memory, Paid};

use crate::rooms::Ways;
use crate::swarm::Column;
use crate::term::{RewardTask, StepView, Term};

reward_terms! {
    "alive" Alive in alive;
    "proximity" Proximity in proximity;
    "distance" Distance in distance;
    "velocity" Velocity in velocity;
    "body_rates" BodyRates in body_rates;
    "tilt" Tilt in tilt;
    "action" Action in action;
    "action_change" ActionChange in action_change;
    "progress" Progress in progress;
    "advance" GeodesicProgress in geodesic_progress;
    "shaping" Shaping in shaping;
    "success" Success in success;
    "failure" Failure in failure;
    "clearance" Clearance in clearance;
    "avoidance" Avoidance in avoidance;
    "encounter" Encounter in encounter;
    "cruise" Cruise in cruise;
    "energy" Energy in energy;
    "heading_error" HeadingError in heading_error;
    "jerk" Jerk in jerk;
    "yaw_rate" YawRate in yaw_rate;

    "bounds" Bounds in reference::bounds;
    "collision" Collision in reference::collision;
    "no_collision" NoCollision in reference::no_collision;
    "delta_distance" DeltaDistance in reference::delta_distance;
    "delta_distance_v2" DeltaDistanceV2 in reference::delta_distance_v2;
    "safe_delta_distance" SafeDeltaDistance in reference::safe_delta_distance;
    "distance_root" DistanceRoot in reference::distance_root;
    "distance_root_v2" DistanceRootV2 in reference::distance_root_v2;
    "safe_distance" SafeDistance in reference::safe_distance;
    "drop_altitude" DropAltitude in reference::drop_altitude;
    "field_coverage" FieldCoverage in reference::field_coverage;
    "landing" Landing in reference::landing;
    "landing_v2" LandingV2 in reference::landing_v2;
    "orientation" Orientation in reference::orientation;
    "rebase" Rebase in reference::rebase;
    "slowdown" Slowdown in reference::slowdown;
    "speed" Speed in reference::speed;
    "touch_landing_zone" TouchLandingZone in reference::touch_landing_zone;
    "waypoint" Waypoint in reference::waypoint;
    "enter_area" EnterArea in reference::enter_area;
    "increase_x" IncreaseX in reference::increase_x;
    "increase_x_v2" IncreaseXV2 in reference::increase_x_v2;
    "squared_distance" SquaredDistance in reference::squared_distance;
    "quartic_distance" QuarticDistance in reference::quartic_distance;
    "climb" Climb in reference::climb;
    "exit" Exit in reference::exit;
    "land_vision" LandVision in reference::land_vision;
    "height_difference" HeightDifference in reference::height_difference;
    "meeting" Meeting in reference::meeting;
}

/// Most reward terms; every one is a column of the log.
const TERMS_LIMIT: usize = 16;

const WEIGHT: Limits = Limits::from(-10_000.0, 10_000.0, "");

impl RewardTerm {
    /// The terms as they run, at least one; `field` is their list.
    ///
    /// # Errors
    /// When the list is empty or too long, or a number is out of range.
    pub(crate) fn check_all(
        terms: &[Self],
        task: &RewardTask,
        field: &Field<'_>,
    ) -> Result<Vec<Self>, ConfigError> {
        if terms.is_empty() || terms.len() > TERMS_LIMIT {
            return Err(field.refuse("", format!("a list of 1 to {TERMS_LIMIT}")));
        }
        let looks = terms.iter().find_map(Self::looks_around_secs);
        let check = |(index, term): (usize, &Self)| {
            let field = field.at(index).at(term.name());
            field.at("weight").number(term.weight(), &WEIGHT)?;
            term.check(task, &field)?;
            if let (Some(secs), Some(first)) = (term.looks_around_secs(), looks)
                && secs != first
            {
                let expected = format!("{first}, as in the first of these terms");
                return Err(field.at("ahead_secs").reject(secs.to_string(), expected));
            }
            Ok(term.clone().prepared(task))
        };
        terms.iter().enumerate().map(check).collect()
    }

    /// The term's value in each lane, multiplied by its weight and, if it is a rate, by the control period.
    #[inline(always)]
    pub(crate) fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        if !self.agents().contains(view.agent) {
            *values = [R::zero(); LANES];
            return;
        }
        let weight = R::from_f64(self.weight());
        let worth = match self.paid() {
            Paid::PerSecond => weight * R::from_f64(1.0 / view.control_rate_hz),
            Paid::PerStep => weight,
        };
        self.evaluate_term(view, worth, memory, values);
    }
}
