//! The memory of a recurrent policy: a gated recurrent unit, as [`kestrel_core::gru`] defines it, over columns of samples.
//!
//! A window of steps leaves a tape behind, along which the loss gradient goes back through time (truncated
//! backpropagation, Williams & Peng 1990).

use kestrel_core::activation::{sigmoid, tanh};
use kestrel_core::seed::Stream;
use pulp::{Simd, WithSimd};
use serde::{Deserialize, Serialize};

use crate::environment::Outcome;
use crate::network::{Accumulate, Dense, Mlp, SampleMatrix, dispatch};

/// Bias of the gates that keep the old state: at first most of it is kept, so that gradients reach far back (Jozefowicz et
/// al. 2015).
const KEEPING_BIAS: f32 = 1.0;

/// The shape of a gated recurrent unit.
///
/// Its parameters are one slice: of the gates the weights `[2 units][inputs + units]`, rows of r before those of z, and the
/// biases; then of the candidate the weights `[units][inputs + units]` and the biases.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Gru {
    gates: Mlp,
    candidate: Mlp,
}

impl Gru {
    /// For observations of so many values, and a hidden state of so many units.
    pub fn new(observation_len: usize, units: usize) -> Self {
        let inputs = observation_len + units;
        Self { gates: Mlp::new(inputs, &[], 2 * units), candidate: Mlp::new(inputs, &[], units) }
    }

    /// Values of its hidden state.
    pub fn units(&self) -> usize {
        self.candidate.outputs()
    }

    /// Values of an observation.
    pub fn observation_len(&self) -> usize {
        self.candidate.inputs() - self.units()
    }

    /// Number of weights and biases.
    pub fn parameter_count(&self) -> usize {
        self.gates.parameter_count() + self.candidate.parameter_count()
    }

    /// Orthogonal weights of gain one.
    pub fn initialise(&self, stream: &mut Stream) -> Vec<f32> {
        let mut parameters = self.gates.initialise(1.0, stream);
        let first = parameters.len() - self.units();
        parameters[first..].fill(KEEPING_BIAS);
        parameters.extend(self.candidate.initialise(1.0, stream));
        parameters
    }

    /// Gates and candidate.
    pub fn layers<'p>(&self, parameters: &'p [f32]) -> [Dense<'p>; 2] {
        let (gates, candidate) = parameters.split_at(self.gates.parameter_count());
        let only = |mlp: &Mlp, parameters| mlp.layers(parameters)[0];
        [only(&self.gates, gates), only(&self.candidate, candidate)]
    }

    /// Takes `observation [observation][columns]` into the state `hidden [units][columns]` of before; the new one stands in
    /// `step`.
    fn advance(&self, parameters: &[f32], (observation, hidden): (&[f32], &[f32]), step: &mut GruStep) {
        let GruStep { inputs, gates, gated_inputs, candidate, hidden: next, .. } = step;
        let columns = hidden.len() / self.units();
        let [gate_layer, candidate_layer] = self.layers(parameters);
        for target in [&mut *inputs, &mut *gated_inputs] {
            target[..observation.len()].copy_from_slice(observation);
        }
        inputs[observation.len()..].copy_from_slice(hidden);
        gate_layer.affine(SampleMatrix::by_feature(inputs, columns), gates);
        dispatch(Gate { gates, hidden, gated: &mut gated_inputs[observation.len()..] });
        candidate_layer.affine(SampleMatrix::by_feature(gated_inputs, columns), candidate);
        dispatch(Renew { candidate, kept: &gates[hidden.len()..], hidden, next });
    }
}

/// What one step leaves behind.
#[derive(Clone, Debug)]
struct GruStep {
    /// Observation and state of before, `[observation + units][columns]`.
    inputs: Vec<f32>,
    /// r and z, `[2 units][columns]`.
    gates: Vec<f32>,
    /// Observation and r times the state of before, as `inputs`.
    gated_inputs: Vec<f32>,
    /// n, `[units][columns]`.
    candidate: Vec<f32>,
    /// The new state, `[units][columns]`.
    hidden: Vec<f32>,
    /// The loss gradient of the new state by this step's own loss, `[units][columns]`.
    deltas: Vec<f32>,
}

impl GruStep {
    fn new(gru: &Gru, columns: usize) -> Self {
        let (inputs, units) = (gru.candidate.inputs(), gru.units());
        let zeros = |rows: usize| vec![0.0; rows * columns];
        Self {
            inputs: zeros(inputs),
            gates: zeros(2 * units),
            gated_inputs: zeros(inputs),
            candidate: zeros(units),
            hidden: zeros(units),
            deltas: zeros(units),
        }
    }
}

/// The place where slices of so many samples go through a memory, step after step.
#[derive(Clone, Debug)]
pub(crate) struct GruWorkspace {
    columns: usize,
    /// Of a window, as far as it was longest; the first one where nothing goes back.
    steps: Vec<GruStep>,
    /// Steps of the window so far.
    len: usize,
    /// Loss gradients of states, of sums of the gates, of sums of the candidate, of what goes into both.
    carried: Vec<f32>,
    gate_deltas: Vec<f32>,
    candidate_deltas: Vec<f32>,
    input_deltas: Vec<f32>,
    /// Of the gradients of the columns.
    lengths: Vec<f32>,
}

impl GruWorkspace {
    /// With room for so many steps, at least one; windows may be longer.
    pub(crate) fn new(gru: &Gru, columns: usize, steps: usize) -> Self {
        let zeros = |rows: usize| vec![0.0; rows * columns];
        Self {
            columns,
            steps: vec![GruStep::new(gru, columns); steps],
            len: 0,
            carried: zeros(gru.units()),
            gate_deltas: zeros(2 * gru.units()),
            candidate_deltas: zeros(gru.units()),
            input_deltas: zeros(gru.candidate.inputs()),
            lengths: zeros(1),
        }
    }

    /// Begins a window with `observation [observation][columns]`, of agents whose state is `hidden [units][columns]`.
    pub(crate) fn begin(&mut self, gru: &Gru, parameters: &[f32], observation: &[f32], hidden: &[f32]) {
        gru.advance(parameters, (observation, hidden), &mut self.steps[0]);
        self.len = 1;
    }

    /// Goes on with the window; those agents of which `outcomes [columns]` say that an episode ended remember nothing.
    pub(crate) fn go_on(&mut self, gru: &Gru, parameters: &[f32], observation: &[f32], outcomes: &[Outcome]) {
        if self.len == self.steps.len() {
            self.steps.push(GruStep::new(gru, self.columns));
        }
        let (past, next) = self.steps.split_at_mut(self.len);
        // Nothing reads `carried` before the way back.
        self.carried.copy_from_slice(&past[self.len - 1].hidden);
        forget(&mut self.carried, outcomes);
        gru.advance(parameters, (observation, &self.carried), &mut next[0]);
        self.len += 1;
    }

    /// The state after the last step, `[units][columns]`.
    pub(crate) fn hidden(&self) -> &[f32] {
        &self.steps[self.len - 1].hidden
    }

    /// What a step of the window read: the observation, and behind it the state of before, `[observation + units][columns]`.
    pub(crate) fn inputs(&self, index: usize) -> &[f32] {
        &self.steps[index].inputs
    }

    /// As [`Self::inputs`], to be written.
    pub(crate) fn inputs_mut(&mut self, index: usize) -> &mut [f32] {
        &mut self.steps[index].inputs
    }

    /// Keeps the loss gradient of the last step's state.
    pub(crate) fn keep_last_deltas(&mut self, deltas: &[f32]) {
        self.keep_deltas(self.len - 1, deltas);
    }

    /// Keeps the loss gradient of the state of a step of the window.
    pub(crate) fn keep_deltas(&mut self, index: usize, deltas: &[f32]) {
        self.steps[index].deltas.copy_from_slice(deltas);
    }

    /// Before [`Self::step_back`] through the last step: nothing comes after it.
    pub(crate) fn begin_backward(&mut self) {
        self.carried.fill(0.0);
    }

    /// An episode that ended takes nothing back to the one before it, by `outcomes [columns]` of the step before.
    pub(crate) fn forget(&mut self, outcomes: &[Outcome]) {
        forget(&mut self.carried, outcomes);
    }

    /// Shortens the loss gradient of the state, column by column, to at most this length.
    pub(crate) fn limit(&mut self, longest: f32) {
        shorten(&mut self.carried, &mut self.lengths, longest);
    }

    /// Carries the loss gradient of a step's state, and of those after it, to the parameters, whose `gradient` grows, to the
    /// state before the step, and to what the step observed: those `[observation][columns]` grow, too, unless they are empty
    /// because nobody asks.
    pub(crate) fn step_back(
        &mut self,
        gru: &Gru,
        parameters: &[f32],
        index: usize,
        gradient: &mut [f32],
        by_observation: &mut [f32],
    ) {
        let Self { columns, steps, carried, gate_deltas, candidate_deltas, input_deltas, .. } = self;
        let [gate_layer, candidate_layer] = gru.layers(parameters);
        let (of_gates, of_candidate) = gradient.split_at_mut(gru.gates.parameter_count());
        let GruStep { inputs, gates, gated_inputs, candidate, deltas, .. } = &steps[index];
        let observed = inputs.len() - carried.len();
        let (reading, keeping) = gates.split_at(carried.len());
        let (reading_deltas, keeping_deltas) = gate_deltas.split_at_mut(carried.len());
        let hidden = &inputs[observed..];
        dispatch(Differentiate { hidden, candidate, keeping, deltas, carried, candidate_deltas, keeping_deltas });
        // A layer writes the gradients of its last inputs, as many as there is room for.
        let wanted = &mut input_deltas[observed - by_observation.len()..];
        let layer_deltas = SampleMatrix::by_feature(candidate_deltas, *columns);
        let gated = SampleMatrix::by_feature(gated_inputs, *columns);
        gru.candidate.only_gradient(of_candidate).add(layer_deltas, gated);
        candidate_layer.input_deltas(layer_deltas, wanted);
        let (of_observation, gated_deltas) = wanted.split_at(by_observation.len());
        dispatch(Accumulate { values: of_observation, sums: by_observation });
        dispatch(PassGate { hidden, reading, gated_deltas, carried, reading_deltas });
        let layer_deltas = SampleMatrix::by_feature(gate_deltas, *columns);
        gru.gates.only_gradient(of_gates).add(layer_deltas, SampleMatrix::by_feature(inputs, *columns));
        gate_layer.input_deltas(layer_deltas, wanted);
        let (of_observation, of_state) = wanted.split_at(by_observation.len());
        dispatch(Accumulate { values: of_observation, sums: by_observation });
        dispatch(Accumulate { values: of_state, sums: carried });
    }
}

/// Shortens columns of `values [rows][columns]` that are longer, to this length; one that is not finite says nothing and becomes
/// zero. `lengths [columns]` are overwritten.
pub(crate) fn shorten(values: &mut [f32], lengths: &mut [f32], longest: f32) {
    let columns = lengths.len();
    lengths.fill(0.0);
    for row in values.chunks_exact(columns) {
        lengths.iter_mut().zip(row).for_each(|(length, value)| *length += value * value);
    }
    for length in lengths.iter_mut() {
        let share = (longest / length.sqrt()).min(1.0);
        *length = if length.is_finite() { share } else { 0.0 };
    }
    for row in values.chunks_exact_mut(columns) {
        for (value, share) in row.iter_mut().zip(&*lengths) {
            // Zero times what is not finite is not zero.
            *value = if *share == 0.0 { 0.0 } else { *value * share };
        }
    }
}

/// Zeros in `values [rows][columns]`, hidden states for example, where an episode ended by `outcomes [columns]`.
pub fn forget(values: &mut [f32], outcomes: &[Outcome]) {
    if outcomes.iter().all(|outcome| *outcome == Outcome::Running) {
        return;
    }
    for row in values.chunks_exact_mut(outcomes.len().max(1)) {
        for (value, outcome) in row.iter_mut().zip(outcomes) {
            *value = if *outcome == Outcome::Running { *value } else { 0.0 };
        }
    }
}

/// Sums become gates, `[r, z]`, and `gated = r hidden`.
struct Gate<'a> {
    gates: &'a mut [f32],
    hidden: &'a [f32],
    gated: &'a mut [f32],
}

impl WithSimd for Gate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for gate in self.gates.iter_mut() {
            *gate = sigmoid(*gate);
        }
        for ((gated, hidden), gate) in self.gated.iter_mut().zip(self.hidden).zip(&*self.gates) {
            *gated = gate * hidden;
        }
    }
}

/// Sums become the candidate n, and `next = n + z (hidden - n)`.
struct Renew<'a> {
    candidate: &'a mut [f32],
    kept: &'a [f32],
    hidden: &'a [f32],
    next: &'a mut [f32],
}

impl WithSimd for Renew<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let columns = self.candidate.iter_mut().zip(self.next).zip(self.hidden.iter().zip(self.kept));
        for ((candidate, next), (hidden, kept)) in columns {
            *candidate = tanh(*candidate);
            *next = *candidate + kept * (hidden - *candidate);
        }
    }
}

/// From the loss gradient of the new state, `deltas + carried`, to those of the sums behind z and n, and of the old state
/// by the way that keeps it, into `carried`.
struct Differentiate<'a> {
    hidden: &'a [f32],
    candidate: &'a [f32],
    keeping: &'a [f32],
    deltas: &'a [f32],
    carried: &'a mut [f32],
    candidate_deltas: &'a mut [f32],
    keeping_deltas: &'a mut [f32],
}

impl WithSimd for Differentiate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let len = self.carried.len();
        let (hidden, candidate, keeping) = (&self.hidden[..len], &self.candidate[..len], &self.keeping[..len]);
        let (deltas, carried) = (&self.deltas[..len], &mut self.carried[..len]);
        let (candidate_deltas, keeping_deltas) =
            (&mut self.candidate_deltas[..len], &mut self.keeping_deltas[..len]);
        for index in 0..len {
            let (delta, kept, new) = (deltas[index] + carried[index], keeping[index], candidate[index]);
            candidate_deltas[index] = delta * (1.0 - kept) * (1.0 - new * new);
            keeping_deltas[index] = delta * (hidden[index] - new) * kept * (1.0 - kept);
            carried[index] = delta * kept;
        }
    }
}

/// From the loss gradient of `r hidden` to that of the sum behind r, and to that of the old state.
struct PassGate<'a> {
    hidden: &'a [f32],
    reading: &'a [f32],
    gated_deltas: &'a [f32],
    carried: &'a mut [f32],
    reading_deltas: &'a mut [f32],
}

impl WithSimd for PassGate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let len = self.carried.len();
        let (hidden, reading, gated_deltas) =
            (&self.hidden[..len], &self.reading[..len], &self.gated_deltas[..len]);
        let (carried, reading_deltas) = (&mut self.carried[..len], &mut self.reading_deltas[..len]);
        for index in 0..len {
            let (gate, delta) = (reading[index], gated_deltas[index]);
            reading_deltas[index] = delta * hidden[index] * gate * (1.0 - gate);
            carried[index] += delta * gate;
        }
    }
}
