//! Policies that remember.

use kestrel_core::attitude::Attitude;
use kestrel_core::gru::HiddenState;
use kestrel_core::mlp::DenseLayer;
use kestrel_core::observation::PILOT_LEN;
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{
    HEADER_LEN, MEMORY_HEADER_LEN, MemoryDraft, ParameterFormat, PolicyError, PolicyFile, PolicyScratch,
    RecurrentDraft, RecurrentPolicy,
};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;
use proptest::prelude::*;

use crate::support::{Model, draft, golden, observations, seal};

/// A memory in front of a network, each with weights of its own.
struct Remembering {
    gates: Model,
    candidate: Model,
    network: Model,
}

impl Remembering {
    fn new(units: usize, hidden: &[usize]) -> Self {
        let inputs = PILOT_LEN + units;
        let widths: Vec<usize> = [&[inputs], hidden, &[4]].concat();
        Self {
            gates: Model::random(21, &[inputs, 2 * units], 1.5),
            candidate: Model::random(22, &[inputs, units], 1.5),
            network: Model::random(23, &widths, 1.0),
        }
    }

    fn with_draft<T>(&self, fixed: bool, work: impl FnOnce(&RecurrentDraft<'_>) -> T) -> T {
        let (golden, layers) = (golden(), self.network.layers());
        let parameters = if fixed { self.network.fixed_format() } else { ParameterFormat::Float32 };
        let [gates, candidate] = [self.gates.layers()[0], self.candidate.layers()[0]];
        let mut memory = MemoryDraft { gates, candidate, weight_fraction_bits: [0; 2] };
        if let ParameterFormat::Fixed16(format) = parameters {
            memory.weight_fraction_bits = memory.finest_bits(format).unwrap();
        }
        work(&RecurrentDraft { policy: draft(&layers, parameters, &golden), memory })
    }

    fn file(&self, fixed: bool) -> Vec<u8> {
        self.with_draft(fixed, |draft| {
            let mut bytes = vec![0xAA; draft.file_len().unwrap()];
            assert_eq!(draft.write(&mut bytes), Ok(bytes.len()));
            bytes
        })
    }

    /// Actions on a flight, in `f64`.
    fn reference(&self, flight: &[f32]) -> Vec<Vec<f64>> {
        reference([&self.gates, &self.candidate, &self.network], flight.chunks_exact(PILOT_LEN))
    }
}

/// Actions of gates, candidate and network on what a flight observes, in `f64`.
pub(crate) fn reference<'f>(
    [gates, candidate, network]: [&Model; 3],
    flight: impl Iterator<Item = &'f [f32]>,
) -> Vec<Vec<f64>> {
    let affine = |model: &Model, inputs: &[f64]| -> Vec<f64> {
        let DenseLayer { weights, bias, .. } = model.layers()[0];
        let rows = weights.chunks_exact(inputs.len()).zip(bias);
        rows.map(|(row, bias)| {
            f64::from(*bias)
                + row.iter().zip(inputs).map(|(weight, input)| f64::from(*weight) * input).sum::<f64>()
        })
        .collect()
    };
    let sigmoid = |value: f64| 1.0 / (1.0 + libm::exp(-value));
    let units = candidate.layers()[0].outputs;
    let mut hidden = vec![0.0; units];
    let mut actions = Vec::new();
    for observation in flight {
        let observed: Vec<f64> = observation.iter().map(|value| f64::from(*value)).collect();
        let opened: Vec<f64> =
            affine(gates, &[&observed[..], &hidden].concat()).into_iter().map(sigmoid).collect();
        let gated: Vec<f64> = hidden.iter().zip(&opened).map(|(hidden, gate)| hidden * gate).collect();
        let renewed = affine(candidate, &[&observed[..], &gated].concat());
        for ((hidden, candidate), kept) in hidden.iter_mut().zip(renewed).zip(&opened[units..]) {
            *hidden = kept * *hidden + (1.0 - kept) * libm::tanh(candidate);
        }
        let inputs: Vec<f32> = observed.iter().chain(&hidden).map(|value| *value as f32).collect();
        actions.push(network.reference(&inputs));
    }
    actions
}

fn files() -> [Vec<u8>; 2] {
    [false, true].map(|fixed| Remembering::new(8, &[6]).file(fixed))
}

#[test]
fn both_arithmetics_remember_as_the_equations_say() {
    let model = Remembering::new(32, &[64, 64]);
    let flight = observations(5, 400, 1.5);
    let wanted = model.reference(&flight);
    for (fixed, tolerance) in [(false, 1e-5), (true, 4e-3)] {
        let bytes = model.file(fixed);
        let policy = RecurrentPolicy::parse(&bytes).unwrap();
        assert_eq!((policy.units(), policy.multiply_accumulates()), (32, 54 * 96 + 54 * 64 + 64 * 64 + 64 * 4));
        let (mut hidden, mut scratch) = (HiddenState::new(), PolicyScratch::new());
        assert_eq!(policy.self_test_with(&mut hidden, &mut scratch), Ok(()));
        assert_eq!(hidden, HiddenState::new());
        for (step, (observation, wanted)) in flight.chunks_exact(PILOT_LEN).zip(&wanted).enumerate() {
            let action = policy.act(observation, &mut hidden, &mut scratch);
            for (found, wanted) in action.into_iter().zip(wanted) {
                assert!(
                    (f64::from(found) - wanted).abs() < tolerance,
                    "step {step}, {fixed}: {found}, not {wanted}"
                );
            }
        }
        assert_ne!(hidden, HiddenState::new());
    }
}

#[test]
fn what_is_stored_can_be_read_back() {
    let model = Remembering::new(8, &[6]);
    for (fixed, tolerance) in [(false, 0.0), (true, 1e-3)] {
        let bytes = model.file(fixed);
        let policy = RecurrentPolicy::parse(&bytes).unwrap();
        for (index, layer) in [model.gates.layers()[0], model.candidate.layers()[0]].iter().enumerate() {
            for row in 0..layer.outputs {
                assert!((policy.memory().bias(index, row) - layer.bias[row]).abs() <= tolerance);
                for column in 0..layer.inputs {
                    let weight = layer.weights[row * layer.inputs + column];
                    assert!((policy.memory().weight(index, row, column) - weight).abs() <= tolerance);
                }
            }
        }
    }
}

#[test]
fn a_pilot_forgets_when_it_is_reset() {
    for fixed in [false, true] {
        let bytes = Remembering::new(16, &[16]).file(fixed);
        let mut pilot = Pilot::with_memory(RecurrentPolicy::parse(&bytes).unwrap());
        pilot.self_test().unwrap();
        let state = State {
            position: Vector3::new(0.1, 0.2, 0.3),
            world_from_body: Attitude::level(),
            velocity: Vector3::zeros(),
            body_rates: Vector3::zeros(),
            rotor_speeds: [1000.0; 4],
        };
        let mut fly = || [0; 5].map(|_| pilot.tick(&state, &Vector3::new(0.0, 0.0, 1.0)));
        let first = fly();
        assert_ne!(first, fly());
        pilot.reset();
        assert_eq!(first, [0; 5].map(|_| pilot.tick(&state, &Vector3::new(0.0, 0.0, 1.0))));
    }
}

#[test]
fn files_of_other_kinds_are_told_apart() {
    for bytes in files() {
        assert_eq!(PolicyFile::parse(&bytes).unwrap_err(), PolicyError::Recurrent);
    }
    let without = Model::random(1, &[PILOT_LEN, 6, 4], 1.0).float_file();
    assert_eq!(RecurrentPolicy::parse(&without).unwrap_err(), PolicyError::StateBased);
}

#[test]
fn every_flipped_bit_and_every_cut_is_found() {
    for mut bytes in files() {
        for bit in 0..bytes.len() * 8 {
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(RecurrentPolicy::parse(&bytes).is_err(), "bit {bit}");
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        assert!((0..bytes.len()).all(|len| RecurrentPolicy::parse(&bytes[..len]).is_err()));
        assert!(RecurrentPolicy::parse(&bytes).is_ok());
    }
}

#[test]
fn a_memory_that_no_policy_has_is_refused() {
    let forged = |mut bytes: Vec<u8>, at: usize, value: u8| {
        bytes[at] = value;
        seal(&mut bytes);
        RecurrentPolicy::parse(&bytes).unwrap_err()
    };
    let [float, fixed] = files();
    for units in [0, 3, 6, 68] {
        let expected = PolicyError::Units { found: units, observation: PILOT_LEN };
        assert_eq!(forged(float.clone(), HEADER_LEN, units as u8), expected);
    }
    assert!(matches!(forged(float.clone(), HEADER_LEN, 12), PolicyError::Length { .. }));
    let unused = |offset| PolicyError::UnusedField { offset, found: 1 };
    assert_eq!(forged(float.clone(), HEADER_LEN + 2, 1), unused(HEADER_LEN + 2));
    let last = HEADER_LEN + MEMORY_HEADER_LEN - 1;
    assert_eq!(forged(fixed.clone(), last, 1), unused(last));
    assert!(matches!(forged(fixed, HEADER_LEN + 2, 21), PolicyError::FractionBits { .. }));
    let wide = Remembering::new(8, &[6]);
    let narrow = Model::random(24, &[PILOT_LEN + 4, 8], 1.0);
    wide.with_draft(false, |draft| {
        let memory = MemoryDraft { candidate: narrow.layers()[0], ..draft.memory };
        let error = RecurrentDraft { memory, ..*draft }.file_len().unwrap_err();
        assert!(matches!(error, PolicyError::LayerShape { layer: 1, .. }), "{error}");
    });
}

proptest! {
    #[test]
    fn no_observation_and_no_forged_file_panics(
        fixed: bool,
        changes in prop::collection::vec((8_usize..160, any::<u8>()), 0..4),
        flight in prop::collection::vec(any::<f32>(), 3 * PILOT_LEN),
    ) {
        let [float_file, fixed_file] = files();
        let mut bytes = if fixed { fixed_file } else { float_file };
        for (at, value) in changes {
            bytes[at] = value;
        }
        seal(&mut bytes);
        if let Ok(policy) = RecurrentPolicy::parse(&bytes) {
            let (mut hidden, mut scratch) = (HiddenState::new(), PolicyScratch::new());
            for observation in flight.chunks_exact(PILOT_LEN) {
                let action = policy.act(observation, &mut hidden, &mut scratch);
                prop_assert!(action.iter().all(|value| (-1.0..=1.0).contains(value)));
            }
        }
    }
}
