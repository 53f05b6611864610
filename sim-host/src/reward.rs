//! What a step is worth: named terms over the lanes of a block.

use kestrel_core::action::ACTION_LIMIT;

use crate::scenario::RewardTerm;
use crate::swarm::{Column, Swarm};

/// What the terms look at.
pub(crate) struct StepView<'a, const LANES: usize> {
    pub(crate) swarm: &'a Swarm<LANES>,
    pub(crate) actions: &'a [Column<LANES>; ACTION_LIMIT],
    pub(crate) previous_actions: &'a [Column<LANES>; ACTION_LIMIT],
    pub(crate) distances: &'a Column<LANES>,
    pub(crate) previous_distances: &'a Column<LANES>,
    pub(crate) ends: &'a Ends<LANES>,
    pub(crate) control_secs: f32,
}

/// One where an episode just ended so, zero elsewhere.
pub(crate) struct Ends<const LANES: usize> {
    pub(crate) success: Column<LANES>,
    pub(crate) failure: Column<LANES>,
}

impl RewardTerm {
    /// The term's value in each lane, multiplied by `weight` and, if it is a rate, by the control period.
    #[inline(always)]
    pub(crate) fn evaluate<const LANES: usize>(
        &self,
        view: &StepView<'_, LANES>,
        weight: f32,
        values: &mut Column<LANES>,
    ) {
        let rate = weight * view.control_secs;
        let swarm = view.swarm;
        match *self {
            Self::Alive => values.fill(rate),
            Self::Proximity { scale_m } => {
                let per_square = 1.0 / (scale_m * scale_m);
                each(values, |i| rate / (1.0 + view.distances[i] * view.distances[i] * per_square));
            }
            Self::Distance => each(values, |i| rate * view.distances[i]),
            Self::Velocity => each(values, |i| rate * squared_length(&swarm.velocity, i)),
            Self::BodyRates => each(values, |i| rate * squared_length(&swarm.body_rates, i)),
            Self::Tilt => each(values, |i| rate * (1.0 - swarm.state(i).world_from_body.up_cosine())),
            Self::Action => each(values, |i| rate * squared_length(view.actions, i)),
            Self::ActionChange => each(values, |i| rate * squared_change(view, i)),
            Self::Progress => each(values, |i| weight * (view.previous_distances[i] - view.distances[i])),
            Self::Success => each(values, |i| weight * view.ends.success[i]),
            Self::Failure => each(values, |i| weight * view.ends.failure[i]),
        }
    }
}

#[inline(always)]
fn each<const LANES: usize>(values: &mut Column<LANES>, value: impl Fn(usize) -> f32) {
    for (lane, slot) in values.iter_mut().enumerate() {
        *slot = value(lane);
    }
}

#[inline(always)]
fn squared_length<const LANES: usize, const N: usize>(columns: &[Column<LANES>; N], lane: usize) -> f32 {
    columns.iter().fold(0.0, |sum, column| sum + column[lane] * column[lane])
}

#[inline(always)]
fn squared_change<const LANES: usize>(view: &StepView<'_, LANES>, lane: usize) -> f32 {
    view.actions.iter().zip(view.previous_actions).fold(0.0, |sum, (now, before)| {
        let change = now[lane] - before[lane];
        sum + change * change
    })
}
