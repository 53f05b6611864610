//! The model is read back by the rules of `FlatBuffers` and computes what the policy commands.

use kestrel_core::airframe::Airframe;
use kestrel_core::observation::{PX4_NEURAL_LEN, Px4NeuralLayout};
use kestrel_core::policy_file::PolicyMetadata;
use kestrel_sim::seed::{Purpose, Seed, Stream};

use super::*;
use crate::cost::{Cost, Form};
use crate::policy::Policy;
use crate::tests::METADATA;
use crate::{DenseLayer, Export, export};

/// PX4's motors on an X that is numbered clockwise from the front right.
const ROTORS: [usize; 4] = [0, 2, 3, 1];

/// A word of a buffer.
fn word(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

/// Where a field of the table at `table` is.
fn field(bytes: &[u8], table: usize, number: usize) -> Option<usize> {
    let description = table - word(bytes, table);
    let half = |at: usize| usize::from(u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap()));
    let slot = 4 + 2 * number;
    let offset = if slot < half(description) { half(description + slot) } else { 0 };
    (offset > 0).then_some(table + offset)
}

/// What a reference at `at` leads to.
fn follow(bytes: &[u8], at: usize) -> usize {
    at + word(bytes, at)
}

/// The tables of a vector in a field.
fn tables(bytes: &[u8], table: usize, number: usize) -> Vec<usize> {
    let vector = follow(bytes, field(bytes, table, number).unwrap());
    (0..word(bytes, vector)).map(|index| follow(bytes, vector + 4 * (1 + index))).collect()
}

/// The words of a vector in a field.
fn words(bytes: &[u8], table: usize, number: usize) -> Vec<usize> {
    let vector = follow(bytes, field(bytes, table, number).unwrap());
    (0..word(bytes, vector)).map(|index| word(bytes, vector + 4 * (1 + index))).collect()
}

/// What the model computes, by what its operators and tensors say.
fn computed(bytes: &[u8], observation: &[f32]) -> Vec<f32> {
    let model = word(bytes, 0);
    let graph = tables(bytes, model, 2)[0];
    let (tensors, buffers) = (tables(bytes, graph, 0), tables(bytes, model, 4));
    let numbers = |tensor: usize| -> Vec<f32> {
        let buffer = buffers[word(bytes, field(bytes, tensors[tensor], 2).unwrap())];
        let data = follow(bytes, field(bytes, buffer, 0).unwrap());
        assert_eq!((data + 4) % 16, 0, "weights are read in place");
        let values = &bytes[data + 4..][..word(bytes, data)];
        values.as_chunks::<4>().0.iter().map(|value| f32::from_le_bytes(*value)).collect()
    };
    let mut values = vec![Vec::new(); tensors.len()];
    values[words(bytes, graph, 1)[0]] = observation.to_vec();
    for operator in tables(bytes, graph, 3) {
        let [input, weights, biases] = words(bytes, operator, 1)[..] else { panic!("three inputs") };
        let (weights, biases, input) = (numbers(weights), numbers(biases), values[input].clone());
        let options = follow(bytes, field(bytes, operator, 4).unwrap());
        let rectified = bytes[field(bytes, options, 0).unwrap()] == 1;
        let sums = weights.chunks_exact(input.len()).zip(&biases).map(|(row, bias)| {
            let sum = row.iter().zip(&input).fold(*bias, |sum, (weight, value)| sum + weight * value);
            if rectified { sum.max(0.0) } else { sum }
        });
        values[words(bytes, operator, 2)[0]] = sums.collect();
    }
    values[words(bytes, graph, 2)[0]].clone()
}

fn x500() -> Airframe {
    Airframe {
        mass: 2.06,
        thrust_coefficient: 8.54858e-6,
        rotor_speed_limit: 1000.0,
        ..kestrel_core::airframe::CF2X
    }
}

fn policies(activation: Activation, space: RotorThrusts) -> Export {
    let mut stream = Stream::new(Seed(3), 0, Purpose::Weights);
    let mut normals = |count: usize, gain: f32| (0..count).map(|_| gain * stream.normal()).collect::<Vec<f32>>();
    let (first, second) = (normals(15 * 32, 0.3), normals(32 * 4, 0.3));
    let (first_bias, second_bias) = (normals(32, 0.1), normals(4, 0.3));
    let layers = [
        DenseLayer { inputs: 15, outputs: 32, weights: &first, bias: &first_bias, activation },
        DenseLayer { inputs: 32, outputs: 4, weights: &second, bias: &second_bias, activation },
    ];
    let metadata = PolicyMetadata {
        observation: ObservationLayout::Px4Neural(Px4NeuralLayout),
        action: ActionSpace::RotorThrusts(space),
        ..METADATA
    };
    export(&layers, &metadata, &normals(15 * 8, 1.0)).unwrap()
}

fn file(files: &[(&'static str, Vec<u8>)], name: &str) -> Vec<u8> {
    files.iter().find(|(found, _)| *found == name).unwrap().1.clone()
}

#[test]
fn the_model_commands_what_the_policy_does() {
    let space = RotorThrusts::new(&x500(), 0.05, 150.0);
    let bytes = policies(Activation::Relu, space).float_policy;
    let policy = PolicyFile::parse(&bytes).unwrap();
    let model = file(&px4_files(&bytes, ROTORS).unwrap(), "control_net.tflite");
    assert_eq!(model[4..8], *b"TFL3");
    let mut stream = Stream::new(Seed(4), 0, Purpose::Evaluation);
    let mut limited = 0;
    for _ in 0..1000 {
        let observation: [f32; PX4_NEURAL_LEN] = std::array::from_fn(|_| stream.between(-3.0, 3.0));
        let action = policy.act(&observation, &mut policy.scratch());
        let targets = space.rotor_targets(&[action[0], action[1], action[2], action[3]]);
        limited += action.iter().filter(|value| value.abs() == 1.0).count();
        for (output, rotor) in computed(&model, &observation).into_iter().zip(ROTORS) {
            let per_sec = f64::from(targets[rotor]) / std::f64::consts::TAU;
            let expected = 5.0e-5 * per_sec * per_sec - 1.0;
            assert!((f64::from(output) - expected).abs() < 2e-6, "{output}, not {expected}");
        }
    }
    assert!(limited > 100, "the limits are met: {limited}");
}

#[test]
fn the_model_takes_the_flash_that_was_said() {
    let bytes = policies(Activation::Relu, RotorThrusts::new(&x500(), 0.05, 150.0)).float_policy;
    let model = file(&px4_files(&bytes, ROTORS).unwrap(), "control_net.tflite");
    let flash = Cost::of(&Policy::parse(&bytes).unwrap(), Form::Px4, bytes.len()).flash();
    assert!((model.len()..model.len() + 500).contains(&flash), "{flash} for {}", model.len());
}

#[test]
fn the_sources_hold_the_model_and_the_parameters_its_motors() {
    let bytes = policies(Activation::Relu, RotorThrusts::new(&x500(), 0.05, 150.0)).float_policy;
    let files = px4_files(&bytes, ROTORS).unwrap();
    assert_eq!(files, px4_files(&bytes, ROTORS).unwrap(), "the same bytes again");
    let text = |name: &str| String::from_utf8(file(&files, name)).unwrap();
    let model = file(&files, "control_net.tflite");
    let source = text("control_net.cpp");
    let held = source.split([' ', ',', '\n']).filter_map(|word| word.strip_prefix("0x"));
    assert_eq!(held.map(|word| u8::from_str_radix(word, 16).unwrap()).collect::<Vec<u8>>(), model);
    assert!(text("control_net.hpp").contains(&format!("control_net_tflite_size = {};", model.len())));
    let parameters = text("kestrel.params");
    for line in
        ["MC_NN_MIN_RPM\t1432\t6", "MC_NN_MAX_RPM\t9550\t6", "MC_NN_THRST_COEF\t5.0000\t9", "THR_MDL_FAC\t0.8\t9"]
    {
        assert!(parameters.contains(line), "{line}: {parameters}");
    }
}

#[test]
fn fast_rotors_span_the_whole_range_of_outputs() {
    let motors = MotorParameters::new(&RotorThrusts::new(&kestrel_core::airframe::CF2X, 0.05, 100.0)).unwrap();
    let highest = motors.output_of(kestrel_core::airframe::CF2X.rotor_speed_limit as f32);
    assert!((0.9999..=1.0).contains(&highest), "{highest}");
}

#[test]
fn what_px4_cannot_fly_is_refused_by_name() {
    let space = RotorThrusts::new(&x500(), 0.05, 150.0);
    let refusal = |bytes: &[u8]| px4_files(bytes, ROTORS).unwrap_err().to_string();
    let tangents = policies(Activation::Tanh, space);
    assert!(
        refusal(&tangents.float_policy).contains("with tangents, expected one with `training.activation: relu`")
    );
    assert!(refusal(&tangents.fixed_policy).contains("in fixed16, expected one in float32"));
    let crazyflie = export(
        &[DenseLayer {
            inputs: 22,
            outputs: 4,
            weights: &[0.1; 88],
            bias: &[0.0; 4],
            activation: Activation::Tanh,
        }],
        &METADATA,
        &[0.5; 22],
    );
    let crazyflie = refusal(&crazyflie.unwrap().float_policy);
    assert!(crazyflie.contains("that sees `pilot`, expected one that sees `px4_neural`"), "{crazyflie}");
    // As fast as an idling motor to within a revolution per minute.
    let idling = RotorThrusts { lowest_rotor_speed: 150.01, idle_rotor_speed: 150.0, ..space };
    let error =
        MotorParameters::new(&RotorThrusts { idle_rotor_speed: 150.02, ..idling }).unwrap_err().to_string();
    assert!(error.contains("PX4 disarms a motor below it"), "{error}");
    let fast = MotorParameters::new(&RotorThrusts { rotor_speed_limit: 1e4, ..space }).unwrap_err().to_string();
    assert!(fast.contains("at most the 80000"), "{fast}");
}
