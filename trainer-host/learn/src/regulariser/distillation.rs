//! Reset and distil: each task is learned by a fresh policy, which then teaches the one that is kept, together with the
//! states that are left of earlier tasks.

use serde::{Deserialize, Serialize};

use super::coreset::{clone_behaviour, draw_states};
use super::{Coreset, EndedTask};
use crate::actor_critic::Actor;
use crate::adam::Adam;

/// Most states of the present task that the teacher shows; they are thrown away afterwards.
const LESSONS: usize = 8192;

/// States of a gradient step, one half of the present task and one of the earlier ones.
const BATCH: usize = 512;

/// How a policy is taught.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DistillationSettings {
    /// Gradient steps.
    pub steps: u32,
    /// Step size of Adam at the start; it falls to a tenth.
    pub learning_rate: f32,
}

/// Teaches `keeper` what the policy of an `ended` task does there, without forgetting the states of `coreset`.
pub fn distil(keeper: &mut Actor, ended: &EndedTask<'_>, coreset: &Coreset, settings: &DistillationSettings) {
    let batches = draw_states(&ended.flight(), LESSONS);
    let memories: Vec<&[f32]> = coreset.states().map(Vec::as_slice).collect();
    let mut adam = Adam::new(keeper.parameters().len());
    let mut gradient = vec![0.0; keeper.parameters().len()];
    for step in 0..settings.steps as usize {
        gradient.fill(0.0);
        let batches: Vec<&[f32]> = turn(&batches, step, BATCH / 2);
        let memories = turn(&memories, step, BATCH / 2);
        for half in [batches, memories] {
            let weight = 0.5 / half.len().max(1) as f32;
            clone_behaviour(keeper, &half, weight, &mut gradient);
        }
        let progress = step as f32 / settings.steps as f32;
        let rate = settings.learning_rate * (1.0 - 0.9 * progress);
        adam.step(keeper.parameters_mut(), &gradient, 1.0, rate);
    }
}

/// The next `count` of the states, round and round.
fn turn<S: AsRef<[f32]>>(states: &[S], step: usize, count: usize) -> Vec<&[f32]> {
    let count = count.min(states.len());
    (0..count).map(|index| states[(step * count + index) % states.len()].as_ref()).collect()
}
