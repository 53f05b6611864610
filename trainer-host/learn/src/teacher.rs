//! A teacher for policies that hardly find the way by chance: the scripted pilot, led along the shortest free way.
//!
//! Kickstarting (Schmitt et al. 2018): the policy flies by itself, the teacher says in every state what it would do there, and
//! the learner pays for its divergence from that beside what it earns, less and less until a share of the training is done.
//! The teacher knows the true state and the map, as those of Chen et al. 2020 and Loquercio et al. 2021 do; the policy that
//! has learned needs neither.

use std::sync::Arc;

use kestrel_core::action::ACTION_LIMIT;
use kestrel_core::vehicle::State;
use kestrel_sim::contact::WayMap;
use kestrel_sim::scenario::{RewardTerm, Scenario};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::scripted::ScriptedPilot;

/// The teacher heads for the point of the way that is so far ahead \[m\]: nearer ones make it wobble, farther ones cut corners.
const LOOKAHEAD_M: f32 = 0.3;

/// As if the goal were so far away \[m\], it flies at full speed.
const PULL_M: f32 = 0.8;

/// How much a teacher is heeded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TeacherSettings {
    /// Of the divergence from what the teacher would do, in the loss of the first update; above zero.
    pub weight: f32,
    /// Share of the training, above 0 to 1, over which it falls to zero in a straight line.
    pub until: f32,
}

impl TeacherSettings {
    /// The weight once such a share of the training is done.
    pub(crate) fn weight_at(&self, progress: f64) -> f32 {
        self.weight * (1.0 - progress as f32 / self.until).max(0.0)
    }
}

/// The teacher of one task. It remembers nothing from one state to the next.
#[derive(Clone, Debug)]
pub struct Teacher {
    pilot: ScriptedPilot,
    ways: Arc<WayMap>,
}

impl Teacher {
    /// That of a task whose reward says which way leads to its goal; no other has one.
    pub fn of(scenario: &Scenario) -> Option<Self> {
        let ways = scenario.rewards.iter().find_map(|reward| match &reward.term {
            RewardTerm::Advance(ways) => Some(Arc::clone(ways)),
            _ => None,
        })?;
        let pilot = ScriptedPilot::new(&scenario.airframe, &scenario.action, scenario.physics.control_secs());
        Some(Self { pilot, ways })
    }

    /// What it would do, each value within \[-1, 1\], zeros behind the last.
    pub fn act(&mut self, state: &State<f32>) -> [f32; ACTION_LIMIT] {
        self.pilot.reset();
        self.pilot.act(state, &self.target(&state.position))
    }

    fn target(&self, position: &Vector3<f32>) -> Vector3<f32> {
        let ahead = self.ways.ahead((*position).into(), LOOKAHEAD_M);
        let leg = ahead - position;
        position + leg * (PULL_M / leg.norm().max(LOOKAHEAD_M / 2.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn its_weight_falls_in_a_straight_line() {
        let teacher = TeacherSettings { weight: 3.0, until: 0.5 };
        assert_eq!([0.0, 0.25, 0.5, 1.0].map(|progress| teacher.weight_at(progress)), [3.0, 1.5, 0.0, 0.0]);
    }
}
