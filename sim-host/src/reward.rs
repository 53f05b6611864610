//! What a step is worth: named terms over the lanes of a block.

mod component;
#[cfg(test)]
mod tests;

use kestrel_core::real::Real;

use crate::contact::DistanceField;
use crate::scenario::{AgentSet, RewardTerm, WeightedTerm};
use crate::swarm::{Column, Swarm, row};

/// What the terms look at.
pub(crate) struct StepView<'a, const LANES: usize, R: Real> {
    pub(crate) swarm: &'a Swarm<LANES, R>,
    pub(crate) actions: &'a [Column<LANES, R>],
    pub(crate) previous_actions: &'a [Column<LANES, R>],
    pub(crate) distances: &'a Column<LANES, R>,
    pub(crate) previous_distances: &'a Column<LANES, R>,
    /// One while touching an obstacle, one while touching the landing zone.
    pub(crate) touches: &'a [Column<LANES, R>; 2],
    /// Control periods flown, this one included.
    pub(crate) steps: &'a Column<LANES, R>,
    pub(crate) ends: &'a Ends<LANES, R>,
    /// Which drone of its environment this is.
    pub(crate) agent: usize,
    /// Positions of all drones of the environments.
    pub(crate) team: &'a [[Column<LANES, R>; 3]],
    pub(crate) control_secs: R,
}

/// One where an episode just ended so, zero elsewhere.
#[derive(Clone, Debug)]
pub(crate) struct Ends<const LANES: usize, R> {
    pub(crate) success: Column<LANES, R>,
    pub(crate) failure: Column<LANES, R>,
    pub(crate) time_up: Column<LANES, R>,
}

impl AgentSet {
    fn contains(self, agent: usize) -> bool {
        match self {
            Self::All => true,
            Self::First => agent == 0,
            Self::Others => agent > 0,
        }
    }
}

impl WeightedTerm {
    /// The term's value in each lane, multiplied by its weight and, if it is a rate, by the control period.
    #[inline(always)]
    pub(crate) fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        if !self.agents.contains(view.agent) {
            *values = [R::zero(); LANES];
            return;
        }
        let weight = R::from_f64(self.weight);
        let rate = weight * view.control_secs;
        let swarm = view.swarm;
        match &self.term {
            RewardTerm::Alive => values.fill(rate),
            RewardTerm::Proximity { scale_m } => {
                let per_square = R::one() / R::from_f32(scale_m * scale_m);
                let one = R::one();
                each(values, |i| rate / (one + view.distances[i] * view.distances[i] * per_square));
            }
            RewardTerm::Distance => each(values, |i| rate * view.distances[i]),
            RewardTerm::Velocity => each(values, |i| rate * squared_length(&swarm.velocity, i)),
            RewardTerm::BodyRates => each(values, |i| rate * squared_length(&swarm.body_rates, i)),
            RewardTerm::Tilt => each(values, |i| rate * (R::one() - swarm.state(i).world_from_body.up_cosine())),
            RewardTerm::Action => each(values, |i| rate * squared_length(view.actions, i)),
            RewardTerm::ActionChange => each(values, |i| rate * squared_change(view, i)),
            RewardTerm::Progress => {
                each(values, |i| weight * (view.previous_distances[i] - view.distances[i]));
            }
            RewardTerm::Advance(ways) => advance(view, ways, weight, &mut memory[0], values),
            RewardTerm::Shaping { discount } => {
                let discount = R::from_f32(*discount);
                each(values, |i| weight * (view.previous_distances[i] - discount * view.distances[i]));
            }
            RewardTerm::Success => each(values, |i| weight * view.ends.success[i]),
            RewardTerm::Failure => each(values, |i| weight * view.ends.failure[i]),
            RewardTerm::Component(component) => {
                component.evaluate(view, memory, values);
                each_scaled(values, weight);
            }
        }
    }
}

impl RewardTerm {
    /// Columns that the term remembers an episode by.
    pub(crate) fn memory_len(&self) -> usize {
        match self {
            Self::Component(component) => component.memory_len(),
            Self::Advance(_) => 1,
            Self::Alive
            | Self::Proximity { .. }
            | Self::Distance
            | Self::Velocity
            | Self::BodyRates
            | Self::Tilt
            | Self::Action
            | Self::ActionChange
            | Self::Progress
            | Self::Shaping { .. }
            | Self::Success
            | Self::Failure => 0,
        }
    }
}

/// Metres that the way became shorter; none in the first step, before which it is not known.
///
/// Not inlined into the kernels: it is looked up, lane by lane.
#[inline(never)]
fn advance<const LANES: usize, R: Real>(
    view: &StepView<'_, LANES, R>,
    ways: &DistanceField,
    weight: R,
    before: &mut Column<LANES, R>,
    values: &mut Column<LANES, R>,
) {
    for lane in 0..LANES {
        let length = R::from_f32(ways.length(row(&view.swarm.position, lane).map(Real::to_f32)));
        let gained = if component::is_unset(before[lane]) { R::zero() } else { before[lane] - length };
        values[lane] = weight * gained;
        before[lane] = length;
    }
}

#[inline(always)]
fn each<const LANES: usize, R>(values: &mut Column<LANES, R>, value: impl Fn(usize) -> R) {
    for (lane, slot) in values.iter_mut().enumerate() {
        *slot = value(lane);
    }
}

#[inline(always)]
fn each_scaled<const LANES: usize, R: Real>(values: &mut Column<LANES, R>, weight: R) {
    for value in values {
        *value *= weight;
    }
}

#[inline(always)]
fn squared_length<const LANES: usize, R: Real>(columns: &[Column<LANES, R>], lane: usize) -> R {
    columns.iter().fold(R::zero(), |sum, column| sum + column[lane] * column[lane])
}

#[inline(always)]
fn squared_change<const LANES: usize, R: Real>(view: &StepView<'_, LANES, R>, lane: usize) -> R {
    view.actions.iter().zip(view.previous_actions).fold(R::zero(), |sum, (now, before)| {
        let change = now[lane] - before[lane];
        sum + change * change
    })
}
