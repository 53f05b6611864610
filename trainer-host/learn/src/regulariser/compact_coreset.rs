//! Function-space rehearsal within a few kilobytes: where earlier tasks led to, half a byte per number, with a strength that
//! follows from how far the policy may stray.
//!
//! States are cloned as in `ClonEx` (Wołczyk et al. 2022), [`Coreset`](super::Coreset) and, between stored ones, as in
//! pseudo-rehearsal (Robins 1995; for policies `RePR`, Atkinson et al. 2018). What the policy did in a state need not be
//! stored: the policy that begins a task did it, and a copy of that policy is asked while the task is learned. So it can
//! be asked anywhere, also between two states, and a state is its observation alone. That need not be exact, for the copy is
//! asked where the state is decoded to: four bits per number, and twice as many states as with eight.
//!
//! A policy with a memory is asked what it does, and what it then remembers, after one step from an observation and a hidden
//! state: what holds for every step holds for a flight.
//!
//! Where no end of a task is told, every rollout leaves a few states behind, in place of those of the rollout before: these are kept when
//! the next rollout is of another world ([`Boundaries`]). The policy that flew that one is the policy that ended the task. With the rollout
//! after it nothing is compared: learning has begun anew, and drones wander more.
//!
//! The strength is the multiplier of a constraint: that the mean divergence in these states stays within a budget. It
//! rises while the policy is outside and falls while it is inside, minibatch after minibatch, so that nothing has to be
//! tuned to a task.

use kestrel_config::{ConfigError, Field};
use kestrel_core::seed::{Purpose, Seed, Stream};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::boundary::{Boundaries, Observed};
use super::coreset::{draw_states, imitate};
use super::{EndedTask, Flight, Learning, REFERENCE_STD, Regulariser, Strength};
use crate::actor_critic::{Actor, Gradient};
use crate::gru::{Gru, GruWorkspace};
use crate::network::Workspace;

/// States of a minibatch's penalty: at most half of them stored ones, the others between two of these.
const COLUMNS: usize = 64;

/// Stored states of the same task among which the nearest is the other end of what lies between.
const NEIGHBOURS: usize = 8;

/// Largest code of a number: four bits, two of which share a byte.
const LARGEST_CODE: u8 = 15;

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
    /// Who says that a task has ended.
    #[serde(default)]
    pub boundaries: Boundaries,
}

const fn sixteen_kilobytes() -> usize {
    16384
}

const fn budget() -> Strength {
    Strength::Budget(0.01)
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
    /// Lowest and highest of each number of a state.
    ranges: Vec<[f32; 2]>,
    /// For each task its states, in random order, each [`Self::state_bytes`] of codes.
    tasks: Vec<Vec<u8>>,
    /// The policy that has ended the newest task, without its standard deviations: between tasks that is the policy itself.
    center: Vec<f32>,
    strength: f32,
    /// What the draws follow from: the seed of the newest task, and how often the penalty was computed since.
    seed: Seed,
    penalties: u32,
    /// The rollout before, where nobody tells when a task has ended.
    last: Option<LastRollout>,
}

/// What is known of a rollout that may have been the last of its task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct LastRollout {
    observed: Observed,
    /// Lowest and highest of each number of its states.
    ranges: Vec<[f32; 2]>,
    /// Its states, each [`CompactCoreset::state_bytes`] of codes.
    states: Vec<u8>,
}

impl CompactCoreset {
    pub(super) fn new(settings: &CompactCoresetSettings, Learning { actor, .. }: Learning<'_>) -> Self {
        Self {
            settings: *settings,
            ranges: vec![[f32::INFINITY, f32::NEG_INFINITY]; actor.mlp().inputs()],
            tasks: Vec::new(),
            center: vec![0.0; actor.mlp().parameter_count() + actor.front_parameters().len()],
            strength: FIRST_STRENGTH,
            seed: Seed(0),
            penalties: 0,
            last: None,
        }
    }

    /// Factor on the mean divergence at present.
    pub fn strength(&self) -> f32 {
        match self.settings.strength {
            Strength::Fixed(strength) => strength,
            Strength::Budget(_) => self.strength,
        }
    }

    /// Numbers of a state.
    fn width(&self) -> usize {
        self.ranges.len()
    }

    fn state_bytes(&self) -> usize {
        self.width().div_ceil(2)
    }

    /// Bytes beside the states: the ranges, and how many states a task has.
    fn overhead(&self) -> usize {
        8 * self.width() + 4
    }

    /// Stored states by turns and, for the rest, places in the box between two of them, where each number has its own share
    /// of the way: on the line between them alone the policy may stray beside it. `[inputs][COLUMNS]`.
    fn slice(&self) -> Vec<f32> {
        let bytes = self.state_bytes();
        let count = self.tasks.iter().map(Vec::len).sum::<usize>() / bytes;
        let slices = count.div_ceil(COLUMNS / 2);
        let stored = self.tasks.iter().flat_map(|states| states.chunks_exact(bytes));
        let mut slice = vec![0.0; self.width() * COLUMNS];
        let mut column = 0;
        for state in stored.skip(self.penalties as usize % slices).step_by(slices) {
            write(&mut slice, column, self.decoded(state));
            column += 1;
        }
        let mut stream = Stream::new(self.seed, self.penalties.wrapping_add(1), Purpose::Rehearsal);
        for column in column..COLUMNS {
            let task = &self.tasks[stream.below(self.tasks.len() as u32) as usize];
            let [one, other] = neighbours(task, bytes, &mut stream);
            let mut between = |(one, other): (f32, f32)| one + stream.uniform() * (other - one);
            write(&mut slice, column, self.decoded(one).zip(self.decoded(other)).map(&mut between));
        }
        slice
    }

    fn decoded<'a>(&'a self, state: &'a [u8]) -> impl Iterator<Item = f32> + 'a {
        codes(state).zip(&self.ranges).map(|(code, range)| decode(code, *range))
    }

    /// States that another task may have.
    fn share(&self) -> usize {
        let states = self.settings.bytes.saturating_sub(self.overhead()) / self.state_bytes();
        (states / (self.tasks.len() + 1)).max(1)
    }

    /// Keeps the states of a task whose last policy `flight` has.
    fn keep(&mut self, newest: &[Vec<f32>], flight: &Flight<'_>) {
        let kept = self.share() * self.state_bytes();
        self.tasks.iter_mut().for_each(|states| states.truncate(kept));
        self.widen(newest);
        self.tasks.push(newest.iter().flat_map(|state| packed(state, &self.ranges)).collect());
        let (network, front) = self.center.split_at_mut(flight.actor.mlp().parameter_count());
        network.copy_from_slice(&flight.actor.parameters()[..network.len()]);
        front.copy_from_slice(flight.actor.front_parameters());
        (self.strength, self.seed, self.penalties) = (FIRST_STRENGTH, flight.seed, 0);
    }

    /// Ranges that hold these observations as well; what is stored keeps its places as nearly as they can say.
    fn widen(&mut self, states: &[Vec<f32>]) {
        let former = self.ranges.clone();
        widen(&mut self.ranges, states);
        let (bytes, ranges) = (self.state_bytes(), &self.ranges);
        for state in self.tasks.iter_mut().flat_map(|states| states.chunks_exact_mut(bytes)) {
            let values: Vec<f32> = codes(state).zip(&former).map(|(code, range)| decode(code, *range)).collect();
            state.copy_from_slice(&packed(&values, ranges));
        }
    }
}

impl Regulariser for CompactCoreset {
    fn stored_bytes(&self) -> usize {
        self.tasks.iter().map(Vec::len).sum::<usize>() + self.overhead()
    }

    /// With the copy of the policy that began the task, and what is known of the rollout before.
    fn training_bytes(&self) -> usize {
        let last =
            self.last.as_ref().map_or(0, |last| last.states.len() + 8 * last.ranges.len() + last.observed.bytes());
        self.stored_bytes() + 4 * (self.center.len() + self.width() * COLUMNS) + last
    }

    /// Gradient of `strength · mean ½ ‖μ − μ_c‖² / σ²` at the reference spread; what is remembered counts as much as what is
    /// done.
    fn add_gradient(&mut self, Learning { actor, .. }: Learning<'_>, gradient: &mut Gradient) {
        if self.tasks.is_empty() {
            return;
        }
        let slice = self.slice();
        self.penalties = self.penalties.wrapping_add(1);
        let strength = self.strength();
        let weight = strength / (COLUMNS as f32 * REFERENCE_STD * REFERENCE_STD);
        let penalty = match actor.memory() {
            None => {
                let mut workspace = Workspace::new(actor.mlp(), COLUMNS);
                let wanted = actor.mlp().forward(&self.center, &slice, &mut workspace).to_vec();
                let gradient = &mut gradient.actor;
                imitate(actor, &slice, |place| Some(wanted[place]), weight, gradient, &mut workspace)
            }
            Some(memory) => imitate_step((actor, memory), &self.center, &slice, weight, &mut gradient.actor),
        };
        if let Strength::Budget(nats) = self.settings.strength {
            let excess = (penalty / (strength * nats) - 1.0).clamp(-1.0, 1.0);
            self.strength = (strength * libm::expf(STRENGTH_STEP * excess)).clamp(STRENGTHS[0], STRENGTHS[1]);
        }
    }

    fn consolidate(&mut self, ended: &EndedTask<'_>) {
        let flight = ended.flight();
        self.keep(&draw_states(&flight, self.share()), &flight);
    }

    fn watches(&self) -> bool {
        self.settings.boundaries == Boundaries::Found
    }

    fn watch(&mut self, flight: &Flight<'_>) -> bool {
        let observed = Observed::of(flight.visited, self.width());
        let ended = self.last.take().filter(|last| observed.differs_from(&last.observed));
        if let Some(LastRollout { ranges, states, .. }) = &ended {
            let decoded = |state| codes(state).zip(ranges).map(|(code, range)| decode(code, *range)).collect();
            let newest: Vec<Vec<f32>> = states.chunks_exact(self.state_bytes()).map(decoded).collect();
            self.keep(&newest, flight);
            return true;
        }
        let newest = draw_states(flight, self.share());
        let mut ranges = vec![[f32::INFINITY, f32::NEG_INFINITY]; self.width()];
        widen(&mut ranges, &newest);
        let states = newest.iter().flat_map(|state| packed(state, &ranges)).collect();
        self.last = Some(LastRollout { observed, ranges, states });
        false
    }
}

/// Makes ranges hold these states as well, number by number.
fn widen(ranges: &mut [[f32; 2]], states: &[Vec<f32>]) {
    for state in states {
        for ([low, high], value) in ranges.iter_mut().zip(state) {
            (*low, *high) = (low.min(*value), high.max(*value));
        }
    }
}

/// As [`imitate`], of the policy of a center with a memory: a step from `slice [observation + units][COLUMNS]`.
fn imitate_step(
    (actor, memory): (&Actor, &Gru),
    center: &[f32],
    slice: &[f32],
    weight: f32,
    gradient: &mut [f32],
) -> f32 {
    let (observation, hidden) = slice.split_at(memory.observation_len() * COLUMNS);
    let (mut unit, mut network) = (GruWorkspace::new(memory, COLUMNS, 1), Workspace::new(actor.mlp(), COLUMNS));
    let mut step = |of_network: &[f32], of_memory: &[f32]| {
        unit.begin(memory, of_memory, observation, hidden);
        let inputs = [observation, unit.hidden()].concat();
        (actor.mlp().forward(of_network, &inputs, &mut network).to_vec(), inputs)
    };
    let (of_network, of_memory) = center.split_at(actor.mlp().parameter_count());
    let (wanted_actions, wanted) = step(of_network, of_memory);
    let (_, inputs) = step(actor.parameters(), actor.front_parameters());
    let (means, deltas) = network.output_delta();
    let mut sum = 0.0;
    for ((delta, mean), wanted) in deltas.iter_mut().zip(means).zip(&wanted_actions) {
        *delta = weight * (mean - wanted);
        sum += 0.5 * *delta * (mean - wanted);
    }
    let mut by_inputs = vec![0.0; inputs.len()];
    let (of_network, of_memory) = gradient.split_at_mut(actor.log_std_places().end);
    let of_layers = &mut of_network[..actor.mlp().parameter_count()];
    actor.mlp().backward_to_inputs(actor.parameters(), &inputs, &mut network, of_layers, &mut by_inputs);
    let weight = weight * actor.action_len() as f32 / memory.units() as f32;
    let states = inputs.iter().zip(&wanted).zip(&mut by_inputs).skip(observation.len());
    for ((state, wanted), delta) in states {
        *delta += weight * (state - wanted);
        sum += 0.5 * weight * (state - wanted).powi(2);
    }
    unit.keep_last_deltas(&by_inputs[observation.len()..]);
    unit.begin_backward();
    unit.step_back(memory, actor.front_parameters(), 0, of_memory, &mut []);
    sum
}

/// Writes a state to a column of a slice.
fn write(slice: &mut [f32], column: usize, state: impl Iterator<Item = f32>) {
    for (row, value) in state.enumerate() {
        slice[row * COLUMNS + column] = value;
    }
}

/// A state and the nearest of a few others.
fn neighbours<'a>(states: &'a [u8], bytes: usize, stream: &mut Stream) -> [&'a [u8]; 2] {
    let count = (states.len() / bytes) as u32;
    let mut draw = || {
        let first = stream.below(count) as usize * bytes;
        &states[first..first + bytes]
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
    codes(one).zip(codes(other)).map(|(one, other)| u32::from(one.abs_diff(other)).pow(2)).sum()
}

/// The codes of a state; of an odd number of them a last zero.
fn codes(state: &[u8]) -> impl Iterator<Item = u8> {
    state.iter().flat_map(|pair| [pair & LARGEST_CODE, pair >> 4])
}

/// The codes of as many values as there are ranges, two to a byte.
fn packed(values: &[f32], ranges: &[[f32; 2]]) -> Vec<u8> {
    let coded: Vec<u8> = values.iter().zip(ranges).map(|(value, range)| encode(*value, *range)).collect();
    coded.chunks(2).map(|pair| pair[0] | pair.get(1).map_or(0, |code| code << 4)).collect()
}

fn encode(value: f32, [low, high]: [f32; 2]) -> u8 {
    if high > low { ((value - low) / (high - low) * f32::from(LARGEST_CODE)).round() as u8 } else { 0 }
}

fn decode(code: u8, [low, high]: [f32; 2]) -> f32 {
    if high > low { low + f32::from(code) / f32::from(LARGEST_CODE) * (high - low) } else { low }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actor_critic::{ActorLengths, Front};

    #[test]
    fn a_step_with_a_memory_has_the_gradient_of_its_differences_and_none_where_nothing_differs() {
        let mut stream = Stream::new(Seed(1), 0, Purpose::Weights);
        let (lengths, memory) = (ActorLengths { observation: 3, action: 2 }, Gru::new(3, 4));
        let actor = Actor::new(lengths, Front::Memory(memory.clone()), &[8], -1.0, &mut stream);
        let mut moved = |actor: &Actor, by: f32| {
            let mut moved = actor.clone();
            moved.parameters_mut().iter_mut().for_each(|value| *value += by * stream.normal());
            moved
        };
        let policy = moved(&actor, 0.3);
        let center = [&actor.parameters()[..actor.mlp().parameter_count()], actor.front_parameters()].concat();
        let slice: Vec<f32> = (0..7 * COLUMNS).map(|place| ((place * 37 % 100) as f32 - 50.0) / 60.0).collect();
        let penalty = |policy: &Actor, gradient: &mut [f32]| {
            f64::from(imitate_step((policy, &memory), &center, &slice, 0.1, gradient))
        };
        let mut gradient = vec![0.0; policy.parameters().len()];
        assert!(penalty(&policy, &mut gradient) > 0.01);
        let direction: Vec<f32> = moved(&policy, 1.0)
            .parameters()
            .iter()
            .zip(policy.parameters())
            .map(|(one, other)| one - other)
            .collect();
        let at = |by: f32| {
            let mut policy = policy.clone();
            policy.parameters_mut().iter_mut().zip(&direction).for_each(|(value, way)| *value += by * way);
            penalty(&policy, &mut gradient.clone())
        };
        let expected: f64 = gradient.iter().zip(&direction).map(|(slope, way)| f64::from(slope * way)).sum();
        let found = (at(1e-3) - at(-1e-3)) / 2e-3;
        assert!((found - expected).abs() < 0.01 * expected.abs() + 1e-3, "{found} {expected}");
        let mut nothing = vec![0.0; gradient.len()];
        assert_eq!(penalty(&actor, &mut nothing), 0.0);
        assert!(nothing.iter().all(|value| *value == 0.0));
    }

    #[test]
    fn a_code_has_a_fifteenth_of_a_range_and_a_range_of_nothing_has_its_value() {
        for range in [[-1.0, 1.0], [0.25, 0.5], [-30.0, 2.0]] {
            for step in 0..=1000 {
                let value = range[0] + (range[1] - range[0]) * step as f32 / 1000.0;
                let code = encode(value, range);
                let error = (decode(code, range) - value).abs();
                assert!(error <= 0.501 * (range[1] - range[0]) / 15.0, "{value}: {code}");
                assert_eq!(encode(decode(code, range), range), code);
            }
        }
        assert_eq!(decode(encode(0.7, [0.7, 0.7]), [0.7, 0.7]), 0.7);
    }

    #[test]
    fn two_codes_share_a_byte() {
        let ranges = [[0.0, 15.0]; 5];
        let state = packed(&[1.0, 2.0, 15.0, 0.0, 7.0], &ranges);
        assert_eq!(state, [0x21, 0x0f, 0x07]);
        assert_eq!(codes(&state).collect::<Vec<_>>(), [1, 2, 15, 0, 7, 0]);
    }

    #[test]
    fn the_other_end_is_near_and_never_the_state_itself() {
        // Two clouds at both ends of the codes: what lies between them is hardly ever visited.
        let state = |index: u8| [if index.is_multiple_of(2) { index % 4 } else { 15 - index % 4 }, index / 8];
        let states: Vec<u8> = (0..100).map(state).map(|[first, second]| first | second << 4).collect();
        let mut stream = Stream::new(Seed(1), 0, Purpose::Rehearsal);
        let (mut itself, mut across) = (0, 0);
        for _ in 0..500 {
            let [one, other] = neighbours(&states, 1, &mut stream);
            itself += u32::from(one == other);
            across += u32::from((one[0] & 15 < 8) != (other[0] & 15 < 8));
        }
        assert!(itself == 0 && across < 10, "{itself}, {across} of 500");
    }
}
