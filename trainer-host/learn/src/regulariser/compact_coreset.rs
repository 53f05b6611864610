//! Function-space rehearsal within a few kilobytes: where earlier tasks led to, a byte per number, with a strength that
//! follows from how far the policy may stray.
//!
//! States are cloned as in `ClonEx` (Wołczyk et al. 2022), [`Coreset`](super::Coreset) and, between stored ones, as in
//! pseudo-rehearsal (Robins 1995; for policies `RePR`, Atkinson et al. 2018). What the policy did in a state need not be
//! stored: the policy that begins a task did it, and a copy of that policy is asked while the task is learned. So it can
//! be asked anywhere, also between two states, and a state is its observation alone, in as many bits as a policy on board
//! reads.
//!
//! The strength is the multiplier of a constraint: that the mean divergence in these states stays within a budget. It
//! rises while the policy is outside and falls while it is inside, minibatch after minibatch, so that nothing has to be
//! tuned to a task.

use kestrel_config::{ConfigError, Field};
use kestrel_core::seed::{Purpose, Seed, Stream};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::coreset::{draw_states, imitate};
use super::{EndedTask, Learning, REFERENCE_STD, Regulariser, Strength};
use crate::actor_critic::Gradient;
use crate::network::Workspace;

/// States of a minibatch's penalty: at most half of them stored ones, the others between two of these.
const COLUMNS: usize = 64;

/// Stored states of the same task among which the nearest is the other end of what lies between.
const NEIGHBOURS: usize = 8;

/// Strength that a budget begins with, and its limits.
const FIRST_STRENGTH: f32 = 1.0;
const STRENGTHS: [f32; 2] = [1e-3, 1e4];

/// Largest step of the logarithm of the strength after a minibatch.
const STRENGTH_STEP: f32 = 0.01;

/// How many bytes of states, and how strongly the policy is asked to do there what it did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CompactCoresetSettings {
    /// Bytes of the whole set.
    #[serde(default = "sixteen_kilobytes")]
    pub bytes: usize,
    /// Factor on the mean divergence \[nat\] over the states: fixed, or as much as keeps that divergence within a budget.
    #[serde(default = "budget")]
    pub strength: Strength,
}

const fn sixteen_kilobytes() -> usize {
    16384
}

const fn budget() -> Strength {
    Strength::Budget(0.005)
}

impl CompactCoresetSettings {
    pub(super) fn check(&self, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("bytes").whole(self.bytes as u64, 1024..=1 << 30)?;
        self.strength.check(&field.at("strength"))
    }
}

/// Where earlier tasks led to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CompactCoreset {
    settings: CompactCoresetSettings,
    /// Lowest and highest of each number of an observation.
    ranges: Vec<[f32; 2]>,
    /// For each task its observations, in random order.
    tasks: Vec<Vec<u8>>,
    /// The network that has ended the newest task, without its standard deviations: between tasks that is the policy itself.
    center: Vec<f32>,
    strength: f32,
    /// What the draws follow from: the seed of the newest task, and how often the penalty was computed since.
    seed: Seed,
    penalties: u32,
}

impl CompactCoreset {
    pub(super) fn new(settings: &CompactCoresetSettings, Learning { actor, .. }: Learning<'_>) -> Self {
        Self {
            settings: *settings,
            ranges: vec![[f32::INFINITY, f32::NEG_INFINITY]; actor.mlp().inputs()],
            tasks: Vec::new(),
            center: vec![0.0; actor.mlp().parameter_count()],
            strength: FIRST_STRENGTH,
            seed: Seed(0),
            penalties: 0,
        }
    }

    /// Factor on the mean divergence at present.
    pub fn strength(&self) -> f32 {
        match self.settings.strength {
            Strength::Fixed(strength) => strength,
            Strength::Budget(_) => self.strength,
        }
    }

    /// Numbers, and bytes, of a state.
    fn width(&self) -> usize {
        self.ranges.len()
    }

    /// Bytes beside the states: the ranges, and how many states a task has.
    fn overhead(&self) -> usize {
        8 * self.width() + 4
    }

    /// Stored states by turns and, for the rest, places between two of them, `[inputs][COLUMNS]`.
    fn slice(&self) -> Vec<f32> {
        let width = self.width();
        let count = self.tasks.iter().map(Vec::len).sum::<usize>() / width;
        let slices = count.div_ceil(COLUMNS / 2);
        let stored = self.tasks.iter().flat_map(|states| states.chunks_exact(width));
        let mut slice = vec![0.0; self.width() * COLUMNS];
        let mut column = 0;
        for state in stored.skip(self.penalties as usize % slices).step_by(slices) {
            write(&mut slice, column, self.decoded(state));
            column += 1;
        }
        let mut stream = Stream::new(self.seed, self.penalties.wrapping_add(1), Purpose::Rehearsal);
        for column in column..COLUMNS {
            let task = &self.tasks[stream.below(self.tasks.len() as u32) as usize];
            let [one, other] = neighbours(task, width, &mut stream);
            let share = stream.uniform();
            let between =
                self.decoded(one).zip(self.decoded(other)).map(|(one, other)| one + share * (other - one));
            write(&mut slice, column, between);
        }
        slice
    }

    fn decoded<'a>(&'a self, state: &'a [u8]) -> impl Iterator<Item = f32> + 'a {
        state.iter().zip(&self.ranges).map(|(code, range)| decode(*code, *range))
    }

    /// Ranges that hold these observations as well; what is stored keeps its places as nearly as they can say.
    fn widen(&mut self, states: &[Vec<f32>]) {
        let former = self.ranges.clone();
        for state in states {
            for ([low, high], value) in self.ranges.iter_mut().zip(state) {
                (*low, *high) = (low.min(*value), high.max(*value));
            }
        }
        let ranges = &self.ranges;
        for state in self.tasks.iter_mut().flat_map(|states| states.chunks_exact_mut(former.len())) {
            for ((code, former), range) in state.iter_mut().zip(&former).zip(ranges) {
                *code = encode(decode(*code, *former), *range);
            }
        }
    }
}

impl Regulariser for CompactCoreset {
    fn stored_bytes(&self) -> usize {
        self.tasks.iter().map(Vec::len).sum::<usize>() + self.overhead()
    }

    /// With the copy of the policy that began the task.
    fn training_bytes(&self) -> usize {
        self.stored_bytes() + 4 * (self.center.len() + self.width() * COLUMNS)
    }

    /// Gradient of `strength · mean ½ ‖μ − μ_c‖² / σ²` at the reference spread.
    fn add_gradient(&mut self, Learning { actor, .. }: Learning<'_>, gradient: &mut Gradient) {
        if self.tasks.is_empty() {
            return;
        }
        let slice = self.slice();
        self.penalties = self.penalties.wrapping_add(1);
        let mut workspace = Workspace::new(actor.mlp(), COLUMNS);
        let wanted = actor.mlp().forward(&self.center, &slice, &mut workspace).to_vec();
        let strength = self.strength();
        let weight = strength / (COLUMNS as f32 * REFERENCE_STD * REFERENCE_STD);
        let gradient = &mut gradient.actor;
        let penalty = imitate(actor, &slice, |place| Some(wanted[place]), weight, gradient, &mut workspace);
        if let Strength::Budget(nats) = self.settings.strength {
            let excess = (penalty / (strength * nats) - 1.0).clamp(-1.0, 1.0);
            self.strength = (strength * libm::expf(STRENGTH_STEP * excess)).clamp(STRENGTHS[0], STRENGTHS[1]);
        }
    }

    fn consolidate(&mut self, ended: &EndedTask<'_>) {
        let width = self.width();
        let states = self.settings.bytes.saturating_sub(self.overhead()) / width;
        let share = (states / (self.tasks.len() + 1)).max(1);
        for states in &mut self.tasks {
            states.truncate(share * width);
        }
        let newest = draw_states(ended, share);
        self.widen(&newest);
        let ranges = &self.ranges;
        let encoded = |state: &Vec<f32>| -> Vec<u8> {
            state.iter().zip(ranges).map(|(value, range)| encode(*value, *range)).collect()
        };
        self.tasks.push(newest.iter().flat_map(encoded).collect());
        let count = self.center.len();
        self.center.copy_from_slice(&ended.actor.parameters()[..count]);
        (self.strength, self.seed, self.penalties) = (FIRST_STRENGTH, ended.seed, 0);
    }
}

/// Writes a state to a column of a slice.
fn write(slice: &mut [f32], column: usize, state: impl Iterator<Item = f32>) {
    for (row, value) in state.enumerate() {
        slice[row * COLUMNS + column] = value;
    }
}

/// A state and the nearest of a few others.
fn neighbours<'a>(states: &'a [u8], width: usize, stream: &mut Stream) -> [&'a [u8]; 2] {
    let count = (states.len() / width) as u32;
    let mut draw = || {
        let first = stream.below(count) as usize * width;
        &states[first..first + width]
    };
    let one = draw();
    let others = [(); NEIGHBOURS].map(|()| draw());
    let apart = |other: &&[u8]| match distance(one, other) {
        0 => u32::MAX,
        distance => distance,
    };
    [one, others.into_iter().min_by_key(apart).unwrap_or(one)]
}

/// Squared, in steps of the codes.
fn distance(one: &[u8], other: &[u8]) -> u32 {
    one.iter().zip(other).map(|(one, other)| u32::from(one.abs_diff(*other)).pow(2)).sum()
}

fn encode(value: f32, [low, high]: [f32; 2]) -> u8 {
    if high > low { ((value - low) / (high - low) * f32::from(u8::MAX)).round() as u8 } else { 0 }
}

fn decode(code: u8, [low, high]: [f32; 2]) -> f32 {
    if high > low { low + f32::from(code) / f32::from(u8::MAX) * (high - low) } else { low }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_byte_has_a_255th_of_a_range_and_a_range_of_nothing_has_its_value() {
        for range in [[-1.0, 1.0], [0.25, 0.5], [-30.0, 2.0]] {
            for step in 0..=1000 {
                let value = range[0] + (range[1] - range[0]) * step as f32 / 1000.0;
                let code = encode(value, range);
                let error = (decode(code, range) - value).abs();
                assert!(error <= 0.501 * (range[1] - range[0]) / 255.0, "{value}: {code}");
                assert_eq!(encode(decode(code, range), range), code);
            }
        }
        assert_eq!(decode(encode(0.7, [0.7, 0.7]), [0.7, 0.7]), 0.7);
    }

    #[test]
    fn the_other_end_is_near_and_never_the_state_itself() {
        // Two clouds at both ends of the codes: what lies between them is hardly ever visited.
        let value = |index: u8| if index.is_multiple_of(2) { index } else { 255 - index };
        let states: Vec<u8> = (0..100).flat_map(|index| [value(index), value(index) / 2]).collect();
        let mut stream = Stream::new(Seed(1), 0, Purpose::Rehearsal);
        let (mut itself, mut across) = (0, 0);
        for _ in 0..500 {
            let [one, other] = neighbours(&states, 2, &mut stream);
            itself += u32::from(one == other);
            across += u32::from((one[0] < 128) != (other[0] < 128));
        }
        assert!(itself == 0 && across < 10, "{itself}, {across} of 500");
    }
}
